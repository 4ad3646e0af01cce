// Makes random edits and transactions.
#pragma once

#include <algorithm>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "unit/Seeds.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

inline Value intValue(std::int32_t number) {
    Bytes bytes;
    for (int shift = 0; shift < 32; shift += 8)
        bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint32_t>(number) >> shift));
    return {ValueType::Int, std::move(bytes)};
}

inline SetField setInt(std::string field, std::int32_t number) {
    return {std::move(field), {}, intValue(number), ValueType::None};
}

// Random edits in a small namespace: few names cause many conflicts.
class RandomEdits {
public:
    explicit RandomEdits(unsigned seed) : random_(seed) {}

    std::size_t below(std::size_t count) { return random_() % count; }
    bool chance(std::size_t oneIn) { return below(oneIn) == 0; }

    template <class T>
    const T& of(const std::vector<T>& choices) {
        return choices[below(choices.size())];
    }

    static std::vector<std::string> paths(const LayerDoc& doc) {
        std::vector<std::string> all;
        doc.visit([&](const LayerDoc::SpecView& spec) { all.emplace_back(spec.path); });
        return all;
    }

    std::string name() { return std::string(1, static_cast<char>('a' + below(5))); }

    // Returns a path that may exist or not.
    std::pair<std::string, SpecKind> childOf(const std::string& parent) {
        const bool inVariantSet = parent.ends_with("=}");
        if (inVariantSet)
            return {specpath::child(parent, ChildList::Variants, name()), SpecKind::Variant};
        switch (parent == "/" ? 0 : below(6)) {
            case 3:
                return {specpath::child(parent, ChildList::Properties, name()),
                        SpecKind::Attribute};
            case 4:
                return {specpath::child(parent, ChildList::Properties, name()),
                        SpecKind::Relationship};
            case 5:
                return {specpath::child(parent, ChildList::VariantSets, name()),
                        SpecKind::VariantSet};
            default:
                return {specpath::child(parent, ChildList::Prims, name()), SpecKind::Prim};
        }
    }

    std::pair<std::string, EditAction> edit(const LayerDoc& doc) {
        const auto all = paths(doc);
        const std::string& path = of(all);
        switch (below(10)) {
            case 0:
                return {path, DeleteSpec{}};
            case 1:
            case 2:
                return {path, MoveSpec{{of(all), {}}, name()}};
            case 3:
                return {path, PlaceSpec{name()}};
            case 4:
                return {path, fieldEdit()};
            default: {
                const auto [child, kind] = childOf(path);
                return {child, CreateSpec{kind}};
            }
        }
    }

    EditAction fieldEdit() {
        static const std::vector<std::string> kFields{"f", "g"};
        const std::string& field = of(kFields);
        if (chance(8)) return EraseField{field, {}};
        if (chance(3)) return SetField{field, {}, content(), ValueType::None};
        return partEdit(field);
    }

    EditAction partEdit(const std::string& field) {
        const bool erase = chance(3);
        FieldPart part;
        FieldValue value = smallValue();
        ValueType form = ValueType::None;
        switch (below(4)) {
            case 0: {
                std::vector<std::string> keys{name()};
                while (chance(2)) keys.push_back(name());
                part = DictionaryKey{keys};
                if (chance(5)) value = dictionary(1);
                break;
            }
            case 1:
                part = SampleTime{static_cast<double>(below(5))};
                break;
            case 2: {
                ListItem item{ListName(below(kListNames)), tokenValue(name()), {}};
                if (chance(2)) item.before = tokenValue(name());
                part = item;
                form = ValueType::Token;
                break;
            }
            default:
                part = MapKey{chance(2) ? stringValue(name()) : pathValue("/" + name())};
                form = std::get<MapKey>(part).key.type();
        }
        if (erase) return EraseField{field, part};
        return SetField{field, part, std::holds_alternative<ListItem>(part) ? FieldValue{} : value,
                        form};
    }

    Value smallValue() { return intValue(static_cast<std::int32_t>(below(3))); }

    Dictionary dictionary(int depth) {
        Dictionary made;
        for (std::size_t count = below(4); count > 0; --count) {
            if (depth < 3 && chance(3))
                made.entries[name()] = dictionary(depth + 1);
            else
                made.entries[name()] = smallValue();
        }
        return made;
    }

    ListOp listOp() {
        ListOp op{ValueType::Token, chance(2), {}};
        for (std::size_t i = 0; i < kListNames; ++i) {
            if (op.isExplicit != (i == 0) && !chance(20)) continue;
            for (std::size_t count = below(5); count > 0; --count) {
                const Value item = tokenValue(name());
                const bool there =
                    std::find(op.lists[i].begin(), op.lists[i].end(), item) != op.lists[i].end();
                if (!there || chance(20)) op.lists[i].push_back(item);
            }
        }
        return op;
    }

    Map map() {
        Map made{chance(2) ? ValueType::String : ValueType::Path, {}};
        std::string keys = made.keyType == ValueType::String ? "abcde" : "dbeca";
        if (chance(20)) std::shuffle(keys.begin(), keys.end(), random_);
        for (const char key : keys)
            if (chance(2))
                made.entries.emplace_back(made.keyType == ValueType::String
                                              ? stringValue(std::string(1, key))
                                              : pathValue("/" + std::string(1, key)),
                                          smallValue());
        return made;
    }

    // Returns any content of a field.
    FieldValue content() {
        switch (below(5)) {
            case 0:
                return smallValue();
            case 1:
                return dictionary(1);
            case 2: {
                TimeSamples made;
                for (int time = 0; time < 5; ++time)
                    if (chance(2)) made.samples.emplace(time, smallValue());
                return made;
            }
            case 3:
                return listOp();
            default:
                return map();
        }
    }

    void editTimes(LayerDoc& doc, int times) {
        for (int i = 0; i < times; ++i) {
            const auto [path, action] = edit(doc);
            (void)doc.apply(path, action);
        }
    }

    std::mt19937& engine() { return random_; }

private:
    std::mt19937 random_;
};

// Such a list cannot be written item by item.
inline bool hasRepeatedItems(const LayerDoc& doc) {
    bool found = false;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        for (const auto& [name, value] : *spec.fields)
            if (const auto* op = value.as<ListOp>())
                for (const ListItems& list : op->lists) {
                    const std::vector<Value> items = list.values();
                    const std::set<Value> distinct(items.begin(), items.end());
                    found = found || distinct.size() < items.size();
                }
    });
    return found;
}

}  // namespace usdlive
