// Reads .obj files line by line: one function for each kind of statement.
#include "ObjParser.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <unordered_map>

namespace usdlive::obj {

namespace {

// More of them could not be addressed by the int[] arrays of a mesh.
constexpr std::size_t kMaxElements = std::numeric_limits<int>::max();

constexpr std::string_view kPassedOver[] = {"s",        "mg",       "lod",        "bevel",
                                            "c_interp", "d_interp", "shadow_obj", "trace_obj",
                                            "usemap",   "maplib"};
constexpr std::string_view kFreeForm[] = {
    "vp",   "cstype", "deg", "bmat", "step", "curv",  "curv2", "surf", "parm", "trim",
    "hole", "scrv",   "sp",  "end",  "con",  "stech", "ctech", "call", "csh"};
constexpr std::string_view kRead[] = {"v", "vt", "vn", "f",      "fo",    "l",
                                      "p", "o",  "g",  "usemtl", "mtllib"};

bool contains(std::span<const std::string_view> words, std::string_view word) {
    return std::ranges::find(words, word) != words.end();
}

bool isSpace(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

// The bytes of a valid UTF-8 sequence at the beginning of `text`; 0: there is none.
std::size_t utf8Length(std::string_view text) {
    const auto byte = [&](std::size_t at) { return at < text.size() ? std::uint8_t(text[at]) : 0; };
    const auto follows = [&](std::size_t at) { return (byte(at) & 0xC0) == 0x80; };
    const unsigned first = byte(0), second = byte(1);
    if (first < 0x80) return 1;
    if (first >= 0xC2 && first < 0xE0) return follows(1) ? 2 : 0;
    if (first >= 0xE0 && first < 0xF0) {
        const bool shortest = first != 0xE0 || second >= 0xA0;
        const bool surrogate = first == 0xED && second >= 0xA0;
        return follows(1) && follows(2) && shortest && !surrogate ? 3 : 0;
    }
    if (first >= 0xF0 && first < 0xF5) {
        const bool inRange = (first != 0xF0 || second >= 0x90) && (first != 0xF4 || second < 0x90);
        return follows(1) && follows(2) && follows(3) && inRange ? 4 : 0;
    }
    return 0;
}

std::string asUtf8(std::string_view text) {
    std::string valid;
    while (!text.empty()) {
        const std::size_t length = utf8Length(text);
        if (length == 0)
            valid += "\xEF\xBF\xBD";
        else if (std::uint8_t(text[0]) >= 0x20 && text[0] != 0x7F)
            valid += text.substr(0, length);
        else
            valid += isSpace(text[0]) ? ' ' : '_';  // control characters
        text.remove_prefix(std::max<std::size_t>(length, 1));
    }
    return valid;
}

std::string quoted(std::string_view word) {
    constexpr std::size_t kShown = 40;
    std::string text = asUtf8(word.substr(0, kShown));
    return "'" + text + (word.size() > kShown ? "...'" : "'");
}

/// Statements of a text: lines, joined where one ends with a backslash, without comments.
class Lines {
public:
    explicit Lines(std::string_view text) : rest_(text) {}

    /// False at the end.
    bool next() {
        joined_.clear();
        line_ += lines_;
        lines_ = 0;
        if (rest_.empty()) return false;
        std::string_view line = take();
        // A path at the end of a comment may end with a backslash, too.
        while (line.ends_with('\\') && line.find('#') == std::string_view::npos && !rest_.empty()) {
            joined_ += line.substr(0, line.size() - 1);
            joined_ += ' ';
            line = take();
        }
        if (!joined_.empty()) {
            joined_ += line;
            line = joined_;
        }
        words_ = line.substr(0, line.find('#'));
        return true;
    }
    /// The next word of the statement; empty: there is none.
    std::string_view word() {
        skipSpaces();
        std::size_t end = 0;
        while (end < words_.size() && !isSpace(words_[end])) ++end;
        const auto word = words_.substr(0, end);
        words_.remove_prefix(end);
        return word;
    }
    /// All that remains of the statement.
    std::string_view remaining() {
        skipSpaces();
        while (!words_.empty() && isSpace(words_.back())) words_.remove_suffix(1);
        return words_;
    }
    [[nodiscard]] std::size_t line() const { return line_; }

private:
    std::string_view take() {
        const std::size_t end = rest_.find('\n');
        std::string_view line = rest_.substr(0, end);
        rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
        ++lines_;
        if (line.ends_with('\r')) line.remove_suffix(1);
        return line;
    }
    void skipSpaces() {
        while (!words_.empty() && isSpace(words_.front())) words_.remove_prefix(1);
    }

    std::string_view rest_, words_;
    std::string joined_;
    std::size_t line_ = 1, lines_ = 0;
};

std::optional<float> number(std::string_view word) {
    if (word.starts_with('+')) word.remove_prefix(1);
    double value = 0;
    const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (problem != std::errc() || end != word.data() + word.size()) return {};
    const auto single = float(value);
    if (!std::isfinite(single)) return {};
    return single;
}

/// The largest index that an element uses, and where: elements may come before what they use.
struct LastUsed {
    int index = -1;
    std::size_t line = 0;

    void use(int used, std::size_t where) {
        if (used > index) *this = {used, where};
    }
};

class Parser {
public:
    Parser(std::string_view text, Split split) : lines_(text), split_(split) {
        if (split_ == Split::Automatic) split_ = hasObjects(text) ? Split::Objects : Split::Groups;
    }

    std::variant<Model, ParseError> run() {
        while (lines_.next()) {
            const auto keyword = lines_.word();
            if (!keyword.empty() && !statement(keyword)) return ParseError{lines_.line(), reason_};
        }
        if (const auto missing = findMissing()) return *missing;
        std::erase_if(model_.parts, [](const Part& part) { return part.isEmpty(); });
        return std::move(model_);
    }

private:
    static bool hasObjects(std::string_view text) {
        Lines lines(text);
        while (lines.next())
            if (lines.word() == "o") return true;
        return false;
    }

    bool refuse(std::string reason) {
        reason_ = std::move(reason);
        return false;
    }

    bool statement(std::string_view keyword) {
        if (keyword == "v") return vertex();
        if (keyword == "vt") return numbers(keyword, 1, 3, model_.texCoords);
        if (keyword == "vn") return numbers(keyword, 3, 3, model_.normals);
        if (keyword == "f" || keyword == "fo") return face();
        if (keyword == "l") return polyline();
        if (keyword == "p") return points();
        if (keyword == "o") return begin(object_);
        if (keyword == "g") return begin(group_);
        if (keyword == "usemtl") return useMaterial();
        if (keyword == "mtllib") return materialLibraries();
        if (contains(kPassedOver, keyword)) return true;
        if (contains(kFreeForm, keyword))
            return refuse(quoted(keyword) + ": free-form geometry is not supported");
        return refuse("unknown statement " + quoted(keyword));
    }

    // Reads the numbers of a statement. Returns how many, or 0 after an error.
    std::size_t readNumbers(std::string_view keyword, std::array<float, 7>& values,
                            std::size_t least, std::size_t most) {
        std::size_t count = 0;
        for (auto word = lines_.word(); !word.empty(); word = lines_.word()) {
            if (count == most)
                return refuse(quoted(keyword) + " has more than " + std::to_string(most) +
                              " numbers");
            const auto value = number(word);
            if (!value) return refuse(quoted(word) + " is no number, or too large");
            values[count++] = *value;
        }
        if (count < least)
            return refuse(quoted(keyword) + " needs " + std::to_string(least) +
                          " numbers, and has " + std::to_string(count));
        return count;
    }

    bool numbers(std::string_view keyword, std::size_t least, std::size_t most,
                 std::vector<Vec3>& into) {
        std::array<float, 7> values{};
        if (!readNumbers(keyword, values, least, most)) return false;
        if (into.size() == kMaxElements) return refuse("too many " + quoted(keyword));
        into.push_back({values[0], values[1], values[2]});
        return true;
    }

    bool vertex() {
        std::array<float, 7> values{};
        const std::size_t count = readNumbers("v", values, 3, 7);
        if (count == 0) return false;
        if (count == 5) return refuse("'v' with 5 numbers: expected x y z, x y z w or x y z r g b");
        if (count % 3 == 1 && values[3] != 1)
            return refuse("'v' has a weight, which only free-form geometry uses");
        auto& points = model_.points;
        if (points.size() == kMaxElements) return refuse("too many 'v'");
        points.push_back({values[0], values[1], values[2]});
        if (count >= 6) {
            const std::size_t at = count == 7 ? 4 : 3;
            model_.colors.resize(points.size(), {1, 1, 1});
            model_.isColored.resize(points.size());
            model_.colors.back() = {values[at], values[at + 1], values[at + 2]};
            model_.isColored.back() = true;
        } else if (!model_.colors.empty()) {
            model_.colors.push_back({1, 1, 1});
            model_.isColored.push_back(false);
        }
        return true;
    }

    // Converts an index of the file: from 1, or negative and counted from the end.
    bool index(std::string_view text, std::string_view word, std::size_t count, LastUsed& last,
               int& result) {
        if (text.starts_with('+')) text.remove_prefix(1);
        std::int64_t value = 0;
        const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (problem != std::errc() || end != text.data() + text.size())
            return refuse(quoted(word) + " is no index");
        if (value == 0) return refuse("the index 0 in " + quoted(word) + ": indices begin at 1");
        value = value > 0 ? value - 1 : std::int64_t(count) + value;
        if (value < 0 || value >= std::int64_t(kMaxElements))
            return refuse("the index in " + quoted(word) + " is out of range");
        result = int(value);
        last.use(result, lines_.line());
        return true;
    }

    // "1", "1/2", "1//3" or "1/2/3"
    bool corner(std::string_view word, Corner& result) {
        const std::size_t slash = word.find('/');
        if (!index(word.substr(0, slash), word, model_.points.size(), lastPoint_, result.point))
            return false;
        if (slash == std::string_view::npos) return true;
        const std::string_view more = word.substr(slash + 1);
        const std::size_t second = more.find('/');
        const auto texCoord = more.substr(0, second);
        if (!texCoord.empty() &&
            !index(texCoord, word, model_.texCoords.size(), lastTexCoord_, result.texCoord))
            return false;
        if (second == std::string_view::npos) return true;
        const auto normal = more.substr(second + 1);
        return normal.empty() ||
               index(normal, word, model_.normals.size(), lastNormal_, result.normal);
    }

    bool face() {
        Part& part = this->part();
        int count = 0;
        for (auto word = lines_.word(); !word.empty(); word = lines_.word(), ++count)
            if (!corner(word, part.corners.emplace_back())) return false;
        if (count < 3)
            return refuse("'f' needs three or more corners, and has " + std::to_string(count));
        if (part.corners.size() > kMaxElements) return refuse("too many corners of faces");
        part.faceCounts.push_back(count);
        part.faceMaterials.push_back(material_);
        return true;
    }

    bool polyline() {
        Part& part = this->part();
        int count = 0;
        for (auto word = lines_.word(); !word.empty(); word = lines_.word(), ++count) {
            Corner one;
            if (!corner(word, one)) return false;
            part.linePoints.push_back(one.point);
        }
        if (count < 2)
            return refuse("'l' needs two or more points, and has " + std::to_string(count));
        part.lineCounts.push_back(count);
        return true;
    }

    bool points() {
        Part& part = this->part();
        const std::size_t before = part.points.size();
        for (auto word = lines_.word(); !word.empty(); word = lines_.word()) {
            Corner one;
            if (!corner(word, one)) return false;
            part.points.push_back(one.point);
        }
        return part.points.size() > before || refuse("'p' needs a point");
    }

    bool begin(std::string& name) {
        name = asUtf8(lines_.remaining());
        if (&name == &object_) group_.clear();
        part_.reset();
        return true;
    }

    // The part that elements are added to. A name that comes again continues its part.
    Part& part() {
        if (!part_) {
            std::string name = split_ == Split::None      ? std::string()
                               : split_ == Split::Objects ? object_
                               : group_.empty()           ? object_
                                                          : group_;
            const auto key = split_ == Split::Groups ? object_ + '\0' + name : name;
            const auto [known, isNew] = partOfName_.try_emplace(key, model_.parts.size());
            if (isNew) model_.parts.push_back({.name = std::move(name)});
            part_ = known->second;
        }
        return model_.parts[*part_];
    }

    bool useMaterial() {
        const auto name = asUtf8(lines_.remaining());
        if (name.empty()) return refuse("'usemtl' needs a name");
        const auto [known, isNew] = materialOfName_.try_emplace(name, int(model_.materials.size()));
        if (isNew) model_.materials.push_back(name);
        material_ = known->second;
        return true;
    }

    bool materialLibraries() {
        const auto before = model_.materialLibraries.size();
        for (auto word = lines_.word(); !word.empty(); word = lines_.word())
            model_.materialLibraries.push_back(asUtf8(word));
        return model_.materialLibraries.size() > before || refuse("'mtllib' needs a file");
    }

    [[nodiscard]] std::optional<ParseError> findMissing() const {
        const auto check = [](const LastUsed& last, std::size_t count,
                              const char* what) -> std::optional<ParseError> {
            if (last.index < 0 || std::size_t(last.index) < count) return {};
            return ParseError{last.line, std::string("uses ") + what + " " +
                                             std::to_string(std::int64_t(last.index) + 1) +
                                             ", and the file has " + std::to_string(count)};
        };
        if (auto missing = check(lastPoint_, model_.points.size(), "vertex")) return missing;
        if (auto missing = check(lastTexCoord_, model_.texCoords.size(), "texture coordinate"))
            return missing;
        return check(lastNormal_, model_.normals.size(), "normal");
    }

    Lines lines_;
    Split split_;
    Model model_;
    std::string reason_;
    std::string object_, group_;
    std::map<std::string, std::size_t> partOfName_;
    std::optional<std::size_t> part_;
    std::unordered_map<std::string, int> materialOfName_;
    int material_ = -1;
    LastUsed lastPoint_, lastTexCoord_, lastNormal_;
};

}  // namespace

std::variant<Model, ParseError> parse(std::string_view text, Split split) {
    return Parser(text, split).run();
}

bool looksLikeObj(std::string_view beginning) {
    Lines lines(beginning);
    while (lines.next()) {
        const auto keyword = lines.word();
        if (keyword.empty()) continue;
        return contains(kRead, keyword) || contains(kPassedOver, keyword) ||
               contains(kFreeForm, keyword);
    }
    return true;
}

}  // namespace usdlive::obj
