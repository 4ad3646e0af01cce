// An open gesture: its edits so far, and its previews (M11).
#include "session/Gesture.h"

#include <algorithm>

#include "session/Prediction.h"

namespace usdlive::client {

namespace {

/// Calls `visit` for every address of the edits.
void forEachAddress(std::vector<Edit>& edits, const std::function<void(Address&)>& visit) {
    for (Edit& edit : edits) {
        visit(edit.address);
        if (auto* move = std::get_if<MoveSpec>(&edit.action)) visit(move->parent);
        for (Address& name : edit.names) visit(name);
    }
}

// A number that no edit of a gesture has.
constexpr std::uint32_t kNoEdit = ~std::uint32_t(0);

// The relation of an earlier edit to a later one of the same spec and field.
enum class Relation { Same, Apart, Entangled };

bool isPrefix(const std::vector<std::string>& shorter, const std::vector<std::string>& longer) {
    return shorter.size() <= longer.size() &&
           std::equal(shorter.begin(), shorter.end(), longer.begin());
}

Relation relate(const FieldPart& earlier, const FieldPart& later) {
    if (earlier.index() != later.index()) return Relation::Entangled;
    if (earlier == later)  // the order of list items and map entries is part of the content
        return std::holds_alternative<ListItem>(earlier) || std::holds_alternative<MapKey>(earlier)
                   ? Relation::Entangled
                   : Relation::Same;
    if (std::holds_alternative<SampleTime>(earlier)) return Relation::Apart;
    if (const auto* key = std::get_if<DictionaryKey>(&earlier)) {
        const auto& other = std::get<DictionaryKey>(later).path;
        const bool nested = isPrefix(key->path, other) || isPrefix(other, key->path);
        return nested ? Relation::Entangled : Relation::Apart;
    }
    return Relation::Entangled;
}

// The earlier write that `later` may replace.
Edit* replaced(std::vector<Edit>& edits, const Edit& later) {
    const auto* set = std::get_if<SetField>(&later.action);
    if (!set) return nullptr;
    for (auto earlier = edits.rbegin(); earlier != edits.rend(); ++earlier) {
        if (earlier->layer != later.layer || earlier->address != later.address) continue;
        const auto* other = std::get_if<SetField>(&earlier->action);
        const auto* erased = std::get_if<EraseField>(&earlier->action);
        if (erased && erased->field == set->field) return nullptr;
        if (!other || other->field != set->field) continue;
        switch (relate(other->part, set->part)) {
            case Relation::Same:
                return &*earlier;
            case Relation::Entangled:
                return nullptr;
            case Relation::Apart:
                break;
        }
    }
    return nullptr;
}

}  // namespace

bool setSameRegister(const EditAction& earlier, const EditAction& later) {
    const auto* first = std::get_if<SetField>(&earlier);
    const auto* second = std::get_if<SetField>(&later);
    return first && second && first->field == second->field &&
           relate(first->part, second->part) == Relation::Same;
}

std::size_t Gesture::add(Edit edit, AuthoredEdit authored) {
    changed = unreported = true;
    auto& edits = pending.transaction.edits;
    if (Edit* earlier = replaced(edits, edit)) {
        const auto index = std::size_t(earlier - edits.data());
        pending.authored[index] = std::move(authored);
        *earlier = std::move(edit);
        return index;
    }
    edits.push_back(std::move(edit));
    pending.authored.push_back(std::move(authored));
    return edits.size() - 1;
}

AuthoredEdit Gesture::remove(std::uint32_t index) {
    changed = unreported = true;
    auto& edits = pending.transaction.edits;
    edits.erase(edits.begin() + index);
    AuthoredEdit removed = std::move(pending.authored[index]);
    pending.authored.erase(pending.authored.begin() + index);
    const std::uint64_t own = pending.transaction.id.sequence;
    forEachAddress(edits, [&](Address& address) {
        if (!address.creation || address.creation->sequence != own) return;
        if (address.creation->edit == index)
            address.creation->edit = kNoEdit;
        else if (address.creation->edit > index && address.creation->edit != kNoEdit)
            --address.creation->edit;
    });
    return removed;
}

PreviewFrame Gesture::preview() const {
    const Transaction& transaction = pending.transaction;
    PreviewFrame frame{transaction.id.client, transaction.gesture, transaction.base,
                       transaction.edits};
    forEachAddress(frame.edits, [&](Address& address) {
        if (address.creation && address.creation->sequence == transaction.id.sequence)
            address.creation->sequence = kThisPreview;
    });
    return frame;
}

}  // namespace usdlive::client
