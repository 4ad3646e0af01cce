// Follows who has written which register last.
#include "UndoCheck.h"

#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::simulation {

namespace {

// The field and part that an action writes, or nullptr.
const std::string* writtenField(const EditAction& action, const FieldPart*& part) {
    if (const auto* set = std::get_if<SetField>(&action)) return part = &set->part, &set->field;
    if (const auto* erase = std::get_if<EraseField>(&action))
        return part = &erase->part, &erase->field;
    return nullptr;
}

}  // namespace

void UndoCheck::follow(Registers& registers, const std::string& path, const EditAction& action) {
    const auto* move = std::get_if<MoveSpec>(&action);
    if (!move && !std::holds_alternative<DeleteSpec>(action)) return;
    Registers followed;
    for (auto& [at, one] : registers)
        if (!specpath::hasPrefix(at, path))
            followed.emplace(at, one);
        else if (move)
            followed.emplace(specpath::replacePrefix(at, path, destination(path, *move)), one);
    registers = std::move(followed);
}

// The items of a list and the entries of a map depend on each other.
void UndoCheck::overwrite(Registers& registers, const std::string& path, const std::string& field,
                          const FieldPart& part) {
    const bool isList =
        std::holds_alternative<ListItem>(part) || std::holds_alternative<MapKey>(part);
    const auto [begin, end] = registers.equal_range(path);
    for (auto at = begin; at != end;)
        if (at->second.field == field && (isList || overlap(at->second.part, part)))
            at = registers.erase(at);
        else
            ++at;
}

void UndoCheck::committed(const Commit& commit, bool isOwn) {
    for (const Edit& edit : commit.edits) {
        Registers& registers = others_[edit.layer];
        follow(registers, edit.address.path, edit.action);
        const FieldPart* part = nullptr;
        const std::string* field = writtenField(edit.action, part);
        if (!field) continue;
        overwrite(registers, edit.address.path, *field, *part);
        if (!isOwn) registers.emplace(edit.address.path, Register{*field, *part});
    }
}

std::string UndoCheck::changed(const LayerDocs& before, const LayerDocs& after,
                               const std::vector<client::AuthoredEdit>& edits) const {
    for (const auto& [layer, registers] : others_) {
        const auto then = before.find(layer), now = after.find(layer);
        if (then == before.end() || now == after.end()) continue;
        for (const auto& [path, one] : registers) {
            if (!then->second.has(path)) continue;
            std::string moved = path;
            for (const client::AuthoredEdit& edit : edits)
                if (const auto* move = std::get_if<MoveSpec>(&edit.action);
                    move && edit.layer == layer && specpath::hasPrefix(moved, edit.path))
                    moved =
                        specpath::replacePrefix(moved, edit.path, destination(edit.path, *move));
            if (!now->second.has(moved)) return layer.value + " " + path + " is gone";
            if (contentOf(then->second.field(path, one.field), one.part) !=
                contentOf(now->second.field(moved, one.field), one.part))
                return layer.value + " " + path + " " + one.field;
        }
    }
    return {};
}

}  // namespace usdlive::simulation
