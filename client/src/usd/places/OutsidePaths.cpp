// Reads asset paths in edits.
#include "usd/places/OutsidePaths.h"

#include <pxr/usd/sdf/path.h>

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>
#include <variant>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kMostOutside = 1'000;

/// Returns the scheme of an address, "file" of "file:///a.png", in lower case. One letter is a
/// drive of Windows.
std::string schemeOf(std::string_view path) {
    const auto colon = path.find(':');
    if (colon == path.npos) return {};
    std::string scheme(path.substr(0, colon));
    for (char& c : scheme) {
        const auto letter = static_cast<unsigned char>(c);
        if (!std::isalnum(letter) && c != '+' && c != '-' && c != '.') return {};
        c = char(std::tolower(letter));
    }
    return scheme;
}

/// Returns the path without format arguments, with the separators of POSIX. Of a variable
/// expression, such as `"./${SHOT}.usda"`, returns the text before the first variable.
std::string plainPath(std::string_view path) {
    if (path.starts_with("`\"") || path.starts_with("`'")) {
        path.remove_prefix(2);
        path = path.substr(0, std::min(path.find("${"), path.size()));
    }
    std::string plain(path.substr(0, path.find(":SDF_FORMAT_ARGS:")));
    std::ranges::replace(plain, '\\', '/');
    return plain;
}

/// Returns whether only this process or this machine can open the path that `layer` names.
bool isOutside(const LayerId& layer, std::string_view path, const std::vector<fs::path>& folders) {
    const std::string plain = plainPath(path);
    const std::string scheme = schemeOf(plain);
    // The name of the format follows after "anon:" in layers without a file that everybody can
    // make.
    if (scheme == "anon") return plain.starts_with("anon:0x");
    if (scheme.size() > 1) return scheme == "file";
    if (!scheme.empty()) return true;
    if (!plain.starts_with('/')) {
        if (plain.find("..") == plain.npos) return false;
        const auto inProject = (fs::path(layer.value).parent_path() / plain).lexically_normal();
        return inProject.begin() != inProject.end() && *inProject.begin() == "..";
    }
    const std::string normal = fs::path(plain).lexically_normal().string();
    return std::ranges::none_of(
        folders, [&](const fs::path& folder) { return normal.starts_with(folder.string() + "/"); });
}

class Search {
public:
    Search(const std::vector<fs::path>& folders, BlobSource& blobs,
           std::vector<event::PathOutside>& found)
        : folders_(folders), blobs_(blobs), found_(found) {}

    void look(const AuthoredEdit& edit) {
        edit_ = &edit;
        const auto* set = std::get_if<SetField>(&edit.action);
        if (!set) return;
        if (const auto* item = std::get_if<ListItem>(&set->part)) {
            if (isUsed(item->list)) look(item->item);
            return;
        }
        const auto* key = std::get_if<DictionaryKey>(&set->part);
        key_ = key ? key->path.back() : std::string_view();
        isClips_ = set->field == "clips";
        set->value.visit([this](const auto& content) { look(content); });
    }

private:
    static bool isUsed(ListName list) {
        return list != ListName::Deleted && list != ListName::Ordered;
    }

    void look(const Dictionary& dictionary) {
        for (const auto& [key, entry] : dictionary.entries) {
            key_ = key;
            std::visit([this](const auto& content) { look(content); }, entry);
        }
    }

    void look(const TimeSamples& samples) {
        for (const auto& [time, value] : samples.samples) look(value);
    }

    void look(const ListOp& list) {
        for (std::size_t i = 0; i < kListNames; ++i)
            if (isUsed(ListName(i)))
                for (const Value& item : list.lists[i]) look(item);
    }

    void look(const Map&) {}

    void look(const Value& value) {
        const ValueType type = value.type();
        if (type == arrayOf(ValueType::Asset) || type == arrayEditOf(ValueType::Asset))
            return lookAtArray(value);
        switch (type) {
            case ValueType::String:
                if (isClips_ && key_ == "templateAssetPath")
                    check(ByteReader(value.bytes()).text());
                return;
            // All begin with the asset path.
            case ValueType::Asset:
            case ValueType::Reference:
            case ValueType::Payload:
            case ValueType::SubLayer:
                return check(ByteReader(value.bytes()).text());
            default:
                return;
        }
    }

    // An edit of an array begins with an array, too: its literals.
    void lookAtArray(const Value& value) {
        const SharedBytes blob = value.isBlob() ? blobs_.blob(value.hash()) : nullptr;
        if (value.isBlob() && !blob) return;
        ByteReader bytes(blob ? ByteView(*blob) : ByteView(value.bytes()));
        for (auto left = bytes.u64(); left > 0 && !bytes.failed(); --left) check(bytes.text());
    }

    void check(std::string_view path) {
        if (found_.size() >= kMostOutside || !isOutside(edit_->layer, path, folders_)) return;
        const pxr::SdfPath spec(edit_->path);
        const bool isProperty = spec.IsPropertyPath();
        const auto prim = isProperty ? spec.GetPrimOrPrimVariantSelectionPath() : spec;
        found_.push_back({edit_->layer, prim.GetString(),
                          isProperty ? spec.GetName() : std::string(), std::string(path)});
    }

    const std::vector<fs::path>& folders_;
    BlobSource& blobs_;
    std::vector<event::PathOutside>& found_;
    const AuthoredEdit* edit_ = nullptr;
    std::string_view key_;  // the dictionary's entry
    bool isClips_ = false;
};

}  // namespace

std::vector<event::PathOutside> outsidePaths(const std::vector<AuthoredEdit>& edits,
                                             const std::vector<fs::path>& folders,
                                             BlobSource& blobs) {
    std::vector<event::PathOutside> found;
    Search search(folders, blobs, found);
    for (const AuthoredEdit& edit : edits) search.look(edit);
    return found;
}

}  // namespace usdlive::client
