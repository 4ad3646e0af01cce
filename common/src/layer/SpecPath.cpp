// Parses and composes the paths of specs (PA1).
#include "usdlive/common/layer/SpecPath.h"

#include <algorithm>

#include "Identifier.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::specpath {

namespace {

constexpr std::size_t kMaxSpecPathBytes = 16 * 1024;
constexpr std::size_t kMaxElements = 1024;

// Parses one path from left to right.
class Parser {
public:
    explicit Parser(std::string_view path) : rest_(path) {}

    // Returns the reason why the path is invalid, or nullptr.
    const char* run(std::vector<PathElement>& out) {
        if (!rest_.starts_with('/')) return "does not begin with '/'";
        rest_.remove_prefix(1);
        if (rest_.empty()) return nullptr;
        if (!takePrim(out)) return kBadPrim;
        while (!rest_.empty()) {
            if (out.size() >= kMaxElements) return "has more than 1,024 elements";
            if (const char* problem = takeStep(out)) return problem;
        }
        return out.size() > kMaxElements ? "has more than 1,024 elements" : nullptr;
    }

private:
    static constexpr const char* kBadPrim = "lacks a valid prim name";

    // Takes the text up to the next separator. Not for names of variants, which may contain dots.
    std::string_view takeName() {
        const auto ends = [](char c) { return c == '/' || c == '.' || c == '{'; };
        const auto end = std::find_if(rest_.begin(), rest_.end(), ends);
        const std::string_view name(rest_.begin(), end);
        rest_.remove_prefix(name.size());
        return name;
    }

    bool takePrim(std::vector<PathElement>& out) {
        out.push_back({ChildList::Prims, takeName()});
        return isIdentifier(out.back().name);
    }

    // Parses the step after a prim or a variant.
    const char* takeStep(std::vector<PathElement>& out) {
        const bool afterPrim = out.back().list == ChildList::Prims;
        const char separator = rest_.front();
        if (separator == '{') return takeVariant(out);
        if (separator == '.') return takeProperty(out);
        if (afterPrim) rest_.remove_prefix(1);  // the '/' after its name
        return takePrim(out) ? nullptr : kBadPrim;
    }

    const char* takeProperty(std::vector<PathElement>& out) {
        out.push_back({ChildList::Properties, rest_.substr(1)});
        rest_ = {};
        return isPropertyName(out.back().name) ? nullptr : "does not end in a valid property name";
    }

    const char* takeVariant(std::vector<PathElement>& out) {
        const std::size_t equals = rest_.find('=');
        const std::size_t end = rest_.find('}');
        if (end == std::string_view::npos || equals > end) return "has '{' without '=' and '}'";
        const std::string_view set = rest_.substr(1, equals - 1);
        const std::string_view variant = rest_.substr(equals + 1, end - equals - 1);
        rest_.remove_prefix(end + 1);
        if (!isIdentifier(set)) return "has no valid variant set name after '{'";
        out.push_back({ChildList::VariantSets, set});
        if (variant.empty()) return rest_.empty() ? nullptr : "continues after a variant set";
        if (!isVariantName(variant)) return "has no valid variant name after '='";
        out.push_back({ChildList::Variants, variant});
        return nullptr;
    }

    std::string_view rest_;
};

bool isVariantSet(std::string_view path) { return path.ends_with("=}"); }

}  // namespace

Result<std::vector<PathElement>> parse(std::string_view path) {
    std::vector<PathElement> elements;
    elements.reserve(16);
    const char* problem =
        path.size() > kMaxSpecPathBytes ? "is longer than 16 KiB" : Parser(path).run(elements);
    if (problem) return fail(ErrorCode::InvalidPath, "the path " + inQuotes(path) + " " + problem);
    return elements;
}

bool isName(ChildList list, std::string_view name) {
    switch (list) {
        case ChildList::Prims:
        case ChildList::VariantSets:
            return isIdentifier(name);
        case ChildList::Properties:
            return isPropertyName(name);
        case ChildList::Variants:
            return isVariantName(name);
    }
    return false;
}

std::string child(std::string_view path, ChildList list, std::string_view name) {
    std::string out;
    out.reserve(path.size() + name.size() + 3);
    out = path;
    extend(out, list, name);
    return out;
}

void extend(std::string& path, ChildList list, std::string_view name) {
    switch (list) {
        case ChildList::Prims:
            if (path != "/" && !path.ends_with('}')) path += '/';
            path += name;
            break;
        case ChildList::Properties:
            (path += '.') += name;
            break;
        case ChildList::VariantSets:
            ((path += '{') += name) += "=}";
            break;
        case ChildList::Variants:
            path.pop_back();
            (path += name) += '}';
            break;
    }
}

std::string_view parentView(std::string_view path, std::string& scratch) {
    if (path == "/") return {};
    if (isVariantSet(path)) return path.substr(0, path.rfind('{'));
    if (path.ends_with('}')) {
        scratch = path.substr(0, path.rfind('=') + 1);
        return scratch += '}';
    }
    const std::size_t at = path.find_last_of("/.}");
    if (path[at] == '}') return path.substr(0, at + 1);
    return at == 0 ? path.substr(0, 1) : path.substr(0, at);
}

std::string parent(std::string_view path) {
    std::string scratch;
    return std::string(parentView(path, scratch));
}

PathElement last(std::string_view path) {
    if (path.ends_with('}')) {
        const std::size_t open = path.rfind('{');
        const std::size_t equals = path.rfind('=');
        if (isVariantSet(path))
            return {ChildList::VariantSets, path.substr(open + 1, equals - open - 1)};
        return {ChildList::Variants, path.substr(equals + 1, path.size() - equals - 2)};
    }
    const std::size_t at = path.find_last_of("/.}");
    return {path[at] == '.' ? ChildList::Properties : ChildList::Prims, path.substr(at + 1)};
}

bool hasPrefix(std::string_view path, std::string_view ancestor) {
    if (path == ancestor || ancestor == "/") return true;
    if (isVariantSet(ancestor)) return path.starts_with(ancestor.substr(0, ancestor.size() - 1));
    if (path.size() <= ancestor.size() || !path.starts_with(ancestor)) return false;
    const char next = path[ancestor.size()];
    return ancestor.ends_with('}') || next == '/' || next == '.' || next == '{';
}

std::string replacePrefix(std::string_view path, std::string_view ancestor,
                          std::string_view newAncestor) {
    if (path == ancestor) return std::string(newAncestor);
    if (isVariantSet(ancestor)) {  // the rest begins inside the braces: "one}B.x"
        const std::string_view set = newAncestor.substr(0, newAncestor.size() - 1);
        return std::string(set).append(path.substr(ancestor.size() - 1));
    }
    std::string_view rest = path.substr(ancestor.size());
    if (rest.starts_with('.') || rest.starts_with('{'))
        return std::string(newAncestor).append(rest);
    if (rest.starts_with('/')) rest.remove_prefix(1);
    return child(newAncestor, ChildList::Prims, rest);
}

}  // namespace usdlive::specpath
