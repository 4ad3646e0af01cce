// Checks and applies edits of one field's parts (ED5, ED6).
#include "usdlive/common/layer/FieldParts.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <iterator>
#include <string_view>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

tl::unexpected<Error> invalidEdit(const std::string& field, const char* problem) {
    return fail(ErrorCode::InvalidEdit, "the edit of the field " + inQuotes(field) + " " + problem);
}

// Returns true for the fields of Sdf that list a spec's children. The model derives them from the
// specs.
bool isChildrenField(std::string_view name) {
    constexpr std::string_view kNames[] = {
        "primChildren",    "properties",         "variantSetChildren",
        "variantChildren", "connectionChildren", "targetChildren",
        "mapperChildren",  "mapperArgChildren",  "expressionChildren"};
    return std::ranges::find(kNames, name) != std::end(kNames);
}

bool isLeaf(const FieldValue& value) {
    const auto* leaf = value.as<Value>();
    return leaf && isLeafType(leaf->type());
}

const char* problemOf(const DictionaryKey& part, const SetField& set) {
    if (part.path.empty()) return "has no dictionary key";
    const auto* dictionary = set.value.as<Dictionary>();
    if (!dictionary && !isLeaf(set.value))
        return "sets a dictionary key to a value that it cannot hold";
    const std::size_t depth = part.path.size() + (dictionary ? nesting(*dictionary) : 0);
    return depth > kMaxNesting ? "nests dictionaries too deeply" : nullptr;
}
const char* problemOf(const SampleTime& part, const SetField& set) {
    if (!std::isfinite(part.time)) return "has a time that is not finite";
    return isLeaf(set.value) ? nullptr : "sets a time sample to a value that it cannot hold";
}
const char* problemOf(const ListItem& part, const SetField& set) {
    if (std::size_t(part.list) >= kListNames) return "names a list that does not exist";
    if (set.form == ValueType::None || part.item.type() != set.form)
        return "inserts an item of another type into a list";
    return nullptr;
}
const char* problemOf(const MapKey& part, const SetField& set) {
    if (set.form == ValueType::None || part.key.type() != set.form)
        return "has a map key of another type";
    return isLeaf(set.value) ? nullptr : "sets a map key to a value that it cannot hold";
}
const char* problemOf(std::monostate, const SetField& set) {
    return set.value.as<Value>() && !isLeaf(set.value) ? "has no value" : nullptr;
}

// D1: composition depends on it.
Result<void> checkTimeCodes(const SetField& set) {
    const auto* value = set.value.as<Value>();
    if (!std::holds_alternative<std::monostate>(set.part) || !value ||
        value->type() != ValueType::Double || value->bytes().size() != sizeof(double))
        return fail(ErrorCode::InvalidValue, "timeCodesPerSecond must be a double");
    double number = 0;
    std::memcpy(&number, value->bytes().data(), sizeof number);
    if (!std::isfinite(number) || number <= 0)
        return fail(ErrorCode::ForbiddenValue, "timeCodesPerSecond must be greater than 0");
    return {};
}

auto mapEntryAt(auto& entries, const Value& key) {
    return std::find_if(entries.begin(), entries.end(),
                        [&](const auto& entry) { return entry.first == key; });
}

Dictionary::Entry entryOf(const FieldValue& value) {
    if (const auto* dictionary = value.as<Dictionary>()) return *dictionary;
    return *value.as<Value>();
}

// Erases dictionaries that become empty, too, as VtDictionary::EraseValueAtPath.
void eraseKey(Dictionary& dictionary, const std::string* key, const std::string* end) {
    const auto found = dictionary.entries.find(*key);
    if (key + 1 != end) {
        auto& inner = std::get<Dictionary>(found->second);
        eraseKey(inner, key + 1, end);
        if (!inner.entries.empty()) return;
    }
    dictionary.entries.erase(found);
}

void setPart(FieldValue& field, const DictionaryKey& part, const SetField& set) {
    Dictionary* dictionary = &field.become<Dictionary>();
    for (std::size_t i = 0; i + 1 < part.path.size(); ++i) {
        auto& entry = dictionary->entries[part.path[i]];
        if (!std::holds_alternative<Dictionary>(entry)) entry = Dictionary{};
        dictionary = &std::get<Dictionary>(entry);
    }
    dictionary->entries.insert_or_assign(part.path.back(), entryOf(set.value));
}

void setPart(FieldValue& field, const SampleTime& part, const SetField& set) {
    field.become<TimeSamples>().samples.insert_or_assign(part.time, *set.value.as<Value>());
}

void setPart(FieldValue& field, const ListItem& part, const SetField& set) {
    auto& op = field.become<ListOp>();
    const bool explicitly = part.list == ListName::Explicit;
    if (op.itemType != set.form || op.isExplicit != explicitly) op = {set.form, explicitly, {}};
    op[part.list].place(part.item, part.before);
}

void setPart(FieldValue& field, const MapKey& part, const SetField& set) {
    auto& map = field.become<Map>();
    if (map.keyType != set.form) map = {set.form, {}};
    const Value& value = *set.value.as<Value>();
    auto at = mapEntryAt(map.entries, part.key);
    if (at != map.entries.end()) {
        at->second = value;
        return;
    }
    if (map.keyType == ValueType::String)
        at = std::find_if(map.entries.begin(), map.entries.end(), [&](const auto& entry) {
            return textOf(part.key) < textOf(entry.first);
        });
    map.entries.emplace(at, part.key, value);
}

void setPart(FieldValue& field, std::monostate, const SetField& set) { field = set.value; }

bool holdsAlready(const FieldValue& field, const DictionaryKey& part, const SetField& set) {
    const auto* entry = entryAt(field.as<Dictionary>(), part.path);
    return entry && *entry == entryOf(set.value);
}
bool holdsAlready(const FieldValue& field, const SampleTime& part, const SetField& set) {
    const auto* content = field.as<TimeSamples>();
    if (!content) return false;
    const auto at = content->samples.find(part.time);
    return at != content->samples.end() && at->second == *set.value.as<Value>();
}
bool holdsAlready(const FieldValue& field, const ListItem& part, const SetField& set) {
    const auto* op = field.as<ListOp>();
    return op && op->itemType == set.form && op->isExplicit == (part.list == ListName::Explicit) &&
           (*op)[part.list].isPlaced(part.item, part.before);
}
bool holdsAlready(const FieldValue& field, const MapKey& part, const SetField& set) {
    const auto* map = field.as<Map>();
    if (!map || map->keyType != set.form) return false;
    const auto at = mapEntryAt(map->entries, part.key);
    return at != map->entries.end() && at->second == *set.value.as<Value>();
}
bool holdsAlready(const FieldValue& field, std::monostate, const SetField& set) {
    return field == set.value;
}

}  // namespace

const Dictionary::Entry* entryAt(const Dictionary* dictionary,
                                 const std::vector<std::string>& path) {
    const Dictionary::Entry* entry = nullptr;
    for (const auto& key : path) {
        if (!dictionary) return nullptr;
        const auto found = dictionary->entries.find(key);
        if (found == dictionary->entries.end()) return nullptr;
        entry = &found->second;
        dictionary = std::get_if<Dictionary>(entry);
    }
    return entry;
}

Result<void> checkSet(bool pseudoRoot, const SetField& set) {
    if (set.field.empty()) return invalidEdit(set.field, "has no field name");
    if (isChildrenField(set.field))
        return invalidEdit(set.field, "sets a list of children, which follows from the specs");
    if (pseudoRoot && set.field == "timeCodesPerSecond") return checkTimeCodes(set);
    const char* problem =
        std::visit([&](const auto& part) { return problemOf(part, set); }, set.part);
    if (problem) return invalidEdit(set.field, problem);
    return {};
}

bool makesOver(const SetField& set) {
    constexpr std::uint8_t kOver = 1;
    const auto* value = set.value.as<Value>();
    return set.field == "specifier" && value && value->type() == ValueType::Specifier &&
           value->bytes().size() == 1 && value->bytes().front() == kOver;
}

Result<void> checkAuthored(const SetField& set) {
    if (set.field.ends_with("Children")) return invalidEdit(set.field, "sets a list of children");
    return {};
}

Result<void> checkErase(const EraseField& erase) {
    if (erase.field.empty()) return invalidEdit(erase.field, "has no field name");
    const auto* key = std::get_if<DictionaryKey>(&erase.part);
    if (key && key->path.empty()) return invalidEdit(erase.field, "has no dictionary key");
    const auto* item = std::get_if<ListItem>(&erase.part);
    if (item && std::size_t(item->list) >= kListNames)
        return invalidEdit(erase.field, "names a list that does not exist");
    return {};
}

bool canHave(SpecKind kind, const SetField& set) {
    static constexpr std::string_view kOfAttributes[] = {"connectionPaths", "spline", "timeSamples",
                                                         "typeName"};
    if (kind == SpecKind::Attribute) return set.field != "targetPaths";
    if (kind != SpecKind::Relationship) return true;
    if (set.field == "default")
        return std::holds_alternative<std::monostate>(set.part) &&
               set.value.type() == ValueType::Path;
    return std::ranges::find(kOfAttributes, set.field) == std::end(kOfAttributes);
}

bool holdsAlready(const FieldValue* field, const SetField& set) {
    if (!field) return false;
    return std::visit([&](const auto& part) { return holdsAlready(*field, part, set); }, set.part);
}

void setPart(FieldValue& field, const SetField& set) {
    std::visit([&](const auto& part) { setPart(field, part, set); }, set.part);
}

bool holdsPart(const FieldValue& field, const FieldPart& part) {
    const Overloaded holds{
        [](std::monostate) { return true; },
        [&](const DictionaryKey& key) {
            return entryAt(field.as<Dictionary>(), key.path) != nullptr;
        },
        [&](const SampleTime& sample) {
            const auto* content = field.as<TimeSamples>();
            return content && content->samples.contains(sample.time);
        },
        [&](const ListItem& item) {
            const auto* op = field.as<ListOp>();
            return op && (*op)[item.list].find(item.item) != (*op)[item.list].end();
        },
        [&](const MapKey& key) {
            const auto* map = field.as<Map>();
            return map && mapEntryAt(map->entries, key.key) != map->entries.end();
        }};
    return std::visit(holds, part);
}

bool erasePart(FieldValue& field, const FieldPart& part) {
    const Overloaded erase{
        [](std::monostate) { return false; },
        [&](const DictionaryKey& key) {
            auto& dictionary = *field.as<Dictionary>();
            eraseKey(dictionary, key.path.data(), key.path.data() + key.path.size());
            return !dictionary.entries.empty();
        },
        [&](const SampleTime& sample) {
            auto& samples = field.as<TimeSamples>()->samples;
            samples.erase(sample.time);
            return !samples.empty();
        },
        [&](const ListItem& item) {
            auto& op = *field.as<ListOp>();
            op[item.list].remove(item.item);
            const auto empty = [](const ListItems& items) { return items.empty(); };
            return op.isExplicit || !std::all_of(op.lists.begin(), op.lists.end(), empty);
        },
        [&](const MapKey& key) {
            auto& entries = field.as<Map>()->entries;
            entries.erase(mapEntryAt(entries, key.key));
            return !entries.empty();
        }};
    return std::visit(erase, part);
}

}  // namespace usdlive
