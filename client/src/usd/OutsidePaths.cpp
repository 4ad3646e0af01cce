// Reads asset paths in edits.
#include "usd/OutsidePaths.h"

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

bool isAbsoluteFile(std::string_view path) {
    const bool hasDrive = path.size() > 2 && std::isalpha(static_cast<unsigned char>(path[0])) &&
                          path[1] == ':' && (path[2] == '/' || path[2] == '\\');
    return path.starts_with('/') || path.starts_with("file:") || path.starts_with("\\\\") ||
           hasDrive;
}

class Search {
public:
    Search(const std::vector<fs::path>& folders, std::vector<event::PathOutside>& found)
        : folders_(folders), found_(found) {}

    void look(const AuthoredEdit& edit) {
        edit_ = &edit;
        const auto* set = std::get_if<SetField>(&edit.action);
        if (!set) return;
        if (const auto* item = std::get_if<ListItem>(&set->part)) {
            if (isUsed(item->list)) look(item->item);
            return;
        }
        set->value.visit([this](const auto& content) { look(content); });
    }

private:
    static bool isUsed(ListName list) {
        return list != ListName::Deleted && list != ListName::Ordered;
    }

    void look(const Dictionary& dictionary) {
        for (const auto& [key, entry] : dictionary.entries)
            std::visit([this](const auto& content) { look(content); }, entry);
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
        ByteReader bytes(value.bytes());
        if (value.type() == arrayOf(ValueType::Asset)) {
            for (auto left = bytes.u64(); left > 0 && !bytes.failed(); --left) check(bytes.text());
            return;
        }
        switch (value.type()) {
            // All begin with the asset path.
            case ValueType::Asset:
            case ValueType::Reference:
            case ValueType::Payload:
            case ValueType::SubLayer:
                return check(bytes.text());
            default:
                return;
        }
    }

    void check(std::string_view path) {
        if (!isAbsoluteFile(path) || found_.size() >= kMostOutside) return;
        const std::string normal = fs::path(path).lexically_normal().string();
        const auto has = [&](const fs::path& folder) {
            return normal.starts_with(folder.string() + "/");
        };
        if (std::ranges::any_of(folders_, has)) return;
        const pxr::SdfPath spec(edit_->path);
        const bool isProperty = spec.IsPropertyPath();
        const auto prim = isProperty ? spec.GetPrimOrPrimVariantSelectionPath() : spec;
        found_.push_back({edit_->layer, prim.GetString(),
                          isProperty ? spec.GetName() : std::string(), std::string(path)});
    }

    const std::vector<fs::path>& folders_;
    std::vector<event::PathOutside>& found_;
    const AuthoredEdit* edit_ = nullptr;
};

}  // namespace

std::vector<event::PathOutside> outsidePaths(const std::vector<AuthoredEdit>& edits,
                                             const std::vector<fs::path>& folders) {
    std::vector<event::PathOutside> found;
    Search search(folders, found);
    for (const AuthoredEdit& edit : edits) search.look(edit);
    return found;
}

}  // namespace usdlive::client
