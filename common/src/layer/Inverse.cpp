// Makes the inverse of an edit, and applies the one of a register to its present content.
#include "usdlive/common/layer/Inverse.h"

#include <algorithm>
#include <iterator>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

constexpr std::size_t kInverseOverhead = 256;  // bytes that an inverse takes beside its values
constexpr std::size_t kSpecOverhead = 512;     // bytes of a deleted spec

// The order of the entries of a longer map is not restored: each edit would keep the whole map.
constexpr std::size_t kMostOrdered = 256;

FieldValue fieldOfEntry(const Dictionary::Entry& entry) {
    return std::visit([](const auto& content) { return FieldValue(content); }, entry);
}

// Returns the item that follows `item` in its list.
std::optional<Value> nextItem(const FieldValue* field, const ListItem& part) {
    const auto* op = field ? field->as<ListOp>() : nullptr;
    if (!op) return std::nullopt;
    const ListItems& items = (*op)[part.list];
    auto at = items.find(part.item);
    if (at == items.end() || ++at == items.end()) return std::nullopt;
    return *at;
}

bool isEmptyOp(const ListOp& op) {
    return std::ranges::all_of(op.lists, [](const ListItems& items) { return items.empty(); });
}

// Returns the part that a write of `part` replaces as a whole, or nothing.
std::optional<FieldPart> replacedBy(const FieldValue* field, const FieldPart& part, ValueType form,
                                    bool sets) {
    const FieldPart whole;
    const Overloaded replaces{
        [](std::monostate) -> std::optional<FieldPart> { return std::nullopt; },
        [&](const DictionaryKey& key) -> std::optional<FieldPart> {
            if (!field || !sets) return std::nullopt;
            const auto* dictionary = field->as<Dictionary>();
            if (!dictionary || dictionary->entries.empty()) return whole;
            DictionaryKey above;
            for (std::size_t depth = 0; depth + 1 < key.path.size(); ++depth) {
                above.path.push_back(key.path[depth]);
                const auto* entry = entryAt(dictionary, above.path);
                if (!entry) return std::nullopt;
                const auto* inner = std::get_if<Dictionary>(entry);
                if (!inner || inner->entries.empty()) return FieldPart(above);
            }
            return std::nullopt;
        },
        [&](const SampleTime&) -> std::optional<FieldPart> {
            const auto* samples = field ? field->as<TimeSamples>() : nullptr;
            if (!field || !sets || (samples && !samples->samples.empty())) return std::nullopt;
            return whole;
        },
        [&](const ListItem& item) -> std::optional<FieldPart> {
            const bool explicitly = item.list == ListName::Explicit;
            if (!field) return explicitly && sets ? std::optional(whole) : std::nullopt;
            const auto* op = field->as<ListOp>();
            const bool holds =
                op && (op->itemType == form || !sets) && op->isExplicit == explicitly;
            return holds && (op->isExplicit || !isEmptyOp(*op)) ? std::nullopt
                                                                : std::optional(whole);
        },
        [&](const MapKey&) -> std::optional<FieldPart> {
            if (!field) return std::nullopt;
            const auto* map = field->as<Map>();
            const bool holds = map && !map->entries.empty() && (map->keyType == form || !sets);
            if (!holds) return sets ? std::optional(whole) : std::nullopt;
            // Only maps of Strings are sorted.
            const bool isOrdered = !sets && map->keyType != ValueType::String;
            return isOrdered && map->entries.size() <= kMostOrdered ? std::optional(whole)
                                                                    : std::nullopt;
        }};
    return std::visit(replaces, part);
}

WrittenRegister writtenRegister(const FieldValue* field, const std::string& name,
                                const FieldPart& part, ValueType form, bool sets) {
    WrittenRegister written{.field = name, .own = {part, contentOf(field, part), {}}};
    if (const auto* item = std::get_if<ListItem>(&part)) {
        written.next = nextItem(field, *item);
        if (const auto* op = field ? field->as<ListOp>() : nullptr; op && !sets)
            form = op->itemType;
    }
    written.form = form;
    if (const auto* map = field ? field->as<Map>() : nullptr;
        map && std::holds_alternative<MapKey>(part) && !sets)
        written.form = map->keyType;
    if (const auto replaced = replacedBy(field, part, form, sets))
        written.replaced = {*replaced, contentOf(field, *replaced), {}};
    return written;
}

// Returns whether setting the part keeps the other parts that the field has now.
bool canTake(const FieldValue* present, const FieldPart& part, ValueType form) {
    if (!present) return true;
    const Overloaded takes{[](std::monostate) { return true; },
                           [&](const DictionaryKey& key) {
                               const auto* dictionary = present->as<Dictionary>();
                               if (!dictionary) return false;
                               DictionaryKey above;
                               for (std::size_t depth = 0; depth + 1 < key.path.size(); ++depth) {
                                   above.path.push_back(key.path[depth]);
                                   const auto* entry = entryAt(dictionary, above.path);
                                   if (entry && !std::holds_alternative<Dictionary>(*entry))
                                       return false;
                               }
                               return true;
                           },
                           [&](const SampleTime&) { return present->as<TimeSamples>() != nullptr; },
                           [&](const ListItem& item) {
                               const auto* op = present->as<ListOp>();
                               return op && op->itemType == form &&
                                      op->isExplicit == (item.list == ListName::Explicit);
                           },
                           [&](const MapKey&) {
                               const auto* map = present->as<Map>();
                               return map && map->keyType == form;
                           }};
    return std::visit(takes, part);
}

EditAction restoring(const std::string& field, FieldPart part,
                     const std::optional<FieldValue>& content, const std::optional<Value>& next,
                     ValueType form) {
    if (!content) return EraseField{field, std::move(part)};
    if (auto* item = std::get_if<ListItem>(&part)) {
        item->item = *content->as<Value>();
        item->before = next;
        return SetField{field, std::move(part), FieldValue{}, form};
    }
    return SetField{field, std::move(part), *content, form};
}

// Restores the parts of a field that was written as a whole.
std::optional<std::vector<EditAction>> restoredParts(
    const WrittenRegister& written, const FieldValue* present,
    const std::function<bool(const FieldPart&)>& isOthers) {
    const auto& [part, before, after] = written.own;
    if (!before || !after || !present || before->type() != after->type() ||
        present->type() != after->type())
        return std::nullopt;
    std::vector<EditAction> actions;
    bool keeps = false;
    for (EditAction& action : authoredParts(written.field, &*after, &*before)) {
        const auto* set = std::get_if<SetField>(&action);
        const FieldPart& one = set ? set->part : std::get<EraseField>(action).part;
        if (std::holds_alternative<std::monostate>(one)) return std::nullopt;
        if (isOthers(one) || contentOf(present, one) != contentOf(&*after, one) ||
            (set && !canTake(present, one, set->form)))
            keeps = true;
        else
            actions.push_back(std::move(action));
    }
    if (actions.empty() && keeps) return std::nullopt;
    return actions;
}

std::size_t memoryOfContent(const std::optional<FieldValue>& content) {
    if (!content) return 0;
    const auto ofValue = [](const Value& value) {
        return sizeof(Value) + std::size_t(value.isBlob() ? 0 : value.size());
    };
    const auto ofDictionary = [&](const auto& self, const Dictionary& dictionary) -> std::size_t {
        std::size_t bytes = 0;
        for (const auto& [key, entry] : dictionary.entries) {
            bytes += 64 + key.size();
            if (const auto* inner = std::get_if<Dictionary>(&entry))
                bytes += self(self, *inner);
            else
                bytes += ofValue(std::get<Value>(entry));
        }
        return bytes;
    };
    const Overloaded measure{
        [&](const Value& value) { return ofValue(value); },
        [&](const Dictionary& dictionary) { return ofDictionary(ofDictionary, dictionary); },
        [&](const TimeSamples& samples) {
            std::size_t bytes = 0;
            for (const auto& [time, value] : samples.samples) bytes += 64 + ofValue(value);
            return bytes;
        },
        [&](const ListOp& op) {
            std::size_t bytes = sizeof(ListOp);
            for (const ListItems& items : op.lists)
                for (const Value& item : items) bytes += 32 + ofValue(item);
            return bytes;
        },
        [&](const Map& map) {
            std::size_t bytes = 0;
            for (const auto& [key, value] : map.entries) bytes += ofValue(key) + ofValue(value);
            return bytes;
        }};
    return content->visit(measure);
}

}  // namespace

std::optional<FieldValue> contentOf(const FieldValue* field, const FieldPart& part) {
    if (!field || !holdsPart(*field, part)) return std::nullopt;
    const Overloaded content{
        [&](std::monostate) { return *field; },
        [&](const DictionaryKey& key) {
            return fieldOfEntry(*entryAt(field->as<Dictionary>(), key.path));
        },
        [&](const SampleTime& sample) {
            return FieldValue(field->as<TimeSamples>()->samples.at(sample.time));
        },
        [&](const ListItem& item) {
            return FieldValue(*(*field->as<ListOp>())[item.list].find(item.item));
        },
        [&](const MapKey& key) {
            const auto& entries = field->as<Map>()->entries;
            return FieldValue(std::ranges::find(entries, key.key, [](const auto& entry) {
                                  return entry.first;
                              })->second);
        }};
    return std::visit(content, part);
}

bool overlap(const FieldPart& one, const FieldPart& other) {
    if (std::holds_alternative<std::monostate>(one) || one.index() != other.index()) return true;
    if (const auto* key = std::get_if<DictionaryKey>(&one)) {
        const auto& path = std::get<DictionaryKey>(other).path;
        const auto end = std::ranges::mismatch(key->path, path);
        return end.in1 == key->path.end() || end.in2 == path.end();
    }
    if (const auto* item = std::get_if<ListItem>(&one)) {
        const auto& second = std::get<ListItem>(other);
        return item->list == second.list && sameItem(item->item, second.item);
    }
    return one == other;
}

Inverse inverseBefore(const LayerDoc& doc, const std::string& path, const EditAction& action) {
    const Overloaded make{
        [&](const CreateSpec&) -> Inverse {
            if (doc.has(path)) return {};
            return CreatedSpec{};
        },
        [&](const DeleteSpec&) -> Inverse {
            if (path == "/" || !doc.has(path)) return {};
            return DeletedSpec{SpecTree(doc, path), doc.nextSibling(path)};
        },
        [&](const MoveSpec& move) -> Inverse {
            if (path == "/" || destination(path, move) == path) return {};
            if (!move.place && !doc.has(path)) return {};
            return MovedSpec{specpath::parent(path), std::string(specpath::last(path).name),
                             doc.nextSibling(path), move.place};
        },
        [&](const PlaceSpec&) -> Inverse {
            if (path == "/" || !doc.has(path)) return {};
            return PlacedSpec{doc.nextSibling(path)};
        },
        [&](const SetField& set) -> Inverse {
            return writtenRegister(doc.field(path, set.field), set.field, set.part, set.form, true);
        },
        [&](const EraseField& erase) -> Inverse {
            return writtenRegister(doc.field(path, erase.field), erase.field, erase.part,
                                   ValueType::None, false);
        }};
    return std::visit(make, action);
}

void completeInverse(Inverse& inverse, const LayerDoc& doc, const std::string& path) {
    if (const auto* placed = std::get_if<PlacedSpec>(&inverse)) {
        if (placed->next == doc.nextSibling(path)) inverse = std::monostate();
        return;
    }
    if (const auto* moved = std::get_if<MovedSpec>(&inverse)) {
        if (moved->place && doc.has(path)) inverse = std::monostate();  // it stays
        return;
    }
    auto* written = std::get_if<WrittenRegister>(&inverse);
    if (!written) return;
    const FieldValue* field = doc.field(path, written->field);
    written->own.after = contentOf(field, written->own.part);
    if (written->replaced) written->replaced->after = contentOf(field, written->replaced->part);
    const auto* item = std::get_if<ListItem>(&written->own.part);
    const bool isSame = written->own.before == written->own.after &&
                        (!item || nextItem(field, *item) == written->next);
    const bool replacesSame =
        !written->replaced || written->replaced->before == written->replaced->after;
    written->changed = !isSame || !replacesSame;
}

std::optional<std::vector<EditAction>> restoredRegister(
    const WrittenRegister& written, const FieldValue* present,
    const std::function<bool(const FieldPart&)>& isOthers) {
    if (const auto& wide = written.replaced;
        wide && contentOf(present, wide->part) == wide->after && !isOthers(wide->part) &&
        canTake(present, wide->part, written.form))
        return std::vector{restoring(written.field, wide->part, wide->before, {}, ValueType::None)};
    const auto& [part, before, after] = written.own;
    const bool isWhole = std::holds_alternative<std::monostate>(part);
    const auto now = contentOf(present, part);
    const bool isList = std::holds_alternative<ListItem>(part);
    if (now == after && !isOthers(part)) {
        if (before && !canTake(present, part, written.form)) return std::nullopt;
        if (!before && !now) return std::vector<EditAction>();
        return std::vector{restoring(written.field, part, before, written.next, written.form)};
    }
    if (now == before && !isList && !isOthers(part)) return std::vector<EditAction>();
    return isWhole ? restoredParts(written, present, isOthers) : std::nullopt;
}

std::vector<std::pair<std::string, EditAction>> restoredSpecs(const SpecTree& content,
                                                              const std::string& path) {
    std::vector<std::pair<std::string, EditAction>> edits;
    content.visit([&](const LayerDoc::SpecView& spec) {
        const std::string own = specpath::replacePrefix(spec.path, content.path(), path);
        edits.emplace_back(own, CreateSpec{spec.kind});
        for (const auto& [name, value] : *spec.fields)
            edits.emplace_back(own, SetField{name, {}, value});
    });
    return edits;
}

std::size_t memoryOf(const Inverse& inverse) {
    std::size_t bytes = kInverseOverhead;
    if (const auto* written = std::get_if<WrittenRegister>(&inverse)) {
        bytes += memoryOfContent(written->own.before) + memoryOfContent(written->own.after);
        if (written->replaced)
            bytes += memoryOfContent(written->replaced->before) +
                     memoryOfContent(written->replaced->after);
    } else if (const auto* deleted = std::get_if<DeletedSpec>(&inverse)) {
        deleted->content.visit([&](const LayerDoc::SpecView& spec) {
            bytes += kSpecOverhead;
            for (const auto& [name, value] : *spec.fields) bytes += memoryOfContent(value);
        });
    }
    return bytes;
}

}  // namespace usdlive
