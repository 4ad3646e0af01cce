// Names the kinds of specs, and says what an edit moves and which blobs it names.
#include "usdlive/common/layer/Edit.h"

#include "usdlive/common/core/Utf8.h"

namespace usdlive {

Revision newestSeen(const Transaction& transaction) {
    return transaction.seen == 0 ? transaction.base : transaction.seen;
}

std::uint32_t SubmittedIndexes::next() {
    for (; passed_ < dropped_->size() && (*dropped_)[passed_].index == index_; ++passed_) ++index_;
    return index_++;
}

bool concernsPlace(const EditAction& action) {
    const auto* move = std::get_if<MoveSpec>(&action);
    const auto* remove = std::get_if<DeleteSpec>(&action);
    return (move && move->place) || (remove && remove->place);
}

std::string destination(std::string_view path, const MoveSpec& move) {
    return specpath::child(move.parent.path, specpath::last(path).list, move.name);
}

MoveSpec stayingAt(std::string_view path) {
    return {{specpath::parent(path), {}}, std::string(specpath::last(path).name), true};
}

bool changesNamespace(const Edit& executed) {
    if (std::holds_alternative<DeleteSpec>(executed.action)) return true;
    const auto* move = std::get_if<MoveSpec>(&executed.action);
    return move && destination(executed.address.path, *move) != executed.address.path;
}

std::string_view specKindName(SpecKind kind) {
    switch (kind) {
        case SpecKind::Attribute:
            return "attribute";
        case SpecKind::Prim:
            return "prim";
        case SpecKind::PseudoRoot:
            return "pseudo-root";
        case SpecKind::Relationship:
            return "relationship";
        case SpecKind::Variant:
            return "variant";
        case SpecKind::VariantSet:
            return "variant set";
    }
    return "unknown kind";
}

std::string labelOf(std::string_view text) {
    std::string label;
    while (!text.empty()) {
        const std::string_view before = text;
        const auto point = takeCodePoint(text);
        if (!point) {  // not UTF-8
            text.remove_prefix(1);
            continue;
        }
        const std::string_view written = before.substr(0, before.size() - text.size());
        if (label.size() + written.size() > kMaxLabelBytes) break;
        const bool isControl = *point < 0x20 || (*point >= 0x7f && *point < 0xa0);
        label += isControl ? std::string_view(" ") : written;
    }
    return label;
}

void forEachBlob(const EditAction& action, const std::function<void(const Value&)>& visit) {
    const auto* set = std::get_if<SetField>(&action);
    if (!set) return;
    forEachBlob(set->value, visit);
    if (const auto* item = std::get_if<ListItem>(&set->part)) forEachBlob(item->item, visit);
    if (const auto* key = std::get_if<MapKey>(&set->part)) forEachBlob(key->key, visit);
}

}  // namespace usdlive
