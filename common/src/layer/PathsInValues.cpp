// Finds and replaces the paths of specs in values.
#include "usdlive/common/layer/PathsInValues.h"

#include <algorithm>
#include <array>
#include <concepts>
#include <set>
#include <vector>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

bool isArc(ValueType type) { return type == ValueType::Reference || type == ValueType::Payload; }
bool hasPaths(ValueType type) { return type == ValueType::Path || isArc(type); }

bool hasPaths(const Dictionary& dictionary) {
    return std::ranges::any_of(dictionary.entries, [](const auto& entry) {
        const auto* inner = std::get_if<Dictionary>(&entry.second);
        return inner ? hasPaths(*inner) : hasPaths(std::get<Value>(entry.second).type());
    });
}

struct MayHavePaths {
    bool operator()(const Value& value) const { return hasPaths(value.type()); }
    bool operator()(const Dictionary& dictionary) const { return hasPaths(dictionary); }
    // All samples of an attribute have its type, or are blocks.
    bool operator()(const TimeSamples& samples) const {
        return std::ranges::any_of(
            samples.samples, [](const auto& sample) { return hasPaths(sample.second.type()); });
    }
    bool operator()(const ListOp& list) const { return hasPaths(list.itemType); }
    bool operator()(const Map& map) const { return map.keyType == ValueType::Path; }
};

bool isSpecPath(std::string_view path) { return path.size() > 1 && specpath::parse(path); }

// Replaces the path in one value. `gone` is set if it has been deleted; the value then stays.
class Replacement {
public:
    explicit Replacement(const PathChange& change) : change_(change) {}

    bool gone = false;

    void operator()(Value& value, PathRole role = PathRole::Object) {
        if (value.type() == ValueType::Path) {
            const std::string_view path = textOf(value).value_or(std::string_view());
            if (const auto now = changed(path, role)) value = pathValue(*now);
        } else if (isArc(value.type())) {
            inArc(value);
        }
    }

private:
    // Returns nothing if the path stays as it is.
    std::optional<std::string> changed(std::string_view path, PathRole role) {
        if (!isSpecPath(path)) return std::nullopt;
        auto now = change_(path, role);
        if (!now) gone = true;
        const bool isSame = !now || *now == path;
        // A variant is no place that a value can name.
        if (isSame || now->find('{') != std::string::npos) return std::nullopt;
        return now;
    }

    // V8: asset, prim path, and the rest.
    void inArc(Value& value) {
        ByteReader in(value.bytes());
        const std::string_view asset = in.text();
        const std::string path(in.text());
        const ByteView rest = in.take(in.left());
        if (!in.finished() || !asset.empty()) return;
        const auto now = changed(path, PathRole::Object);
        if (!now) return;
        Bytes bytes;
        appendText(bytes, asset);
        appendText(bytes, *now);
        bytes.insert(bytes.end(), rest.begin(), rest.end());
        value = Value(value.type(), std::move(bytes));
    }

    const PathChange& change_;
};

// Replaces the paths in contents. Each function returns false if nothing but a deleted path is
// written.
class Rewriting {
public:
    explicit Rewriting(const PathChange& change) : change_(change) {}

    bool content(FieldValue& field) {
        if (auto* value = field.as<Value>()) return leaf(*value);
        if (auto* dictionary = field.as<Dictionary>()) return inDictionary(*dictionary);
        if (auto* samples = field.as<TimeSamples>()) {
            for (auto& [time, value] : samples->samples) (void)leaf(value);
            return true;
        }
        if (auto* list = field.as<ListOp>()) return inList(*list);
        if (auto* map = field.as<Map>()) return inMap(*map);
        return true;
    }

    bool part(FieldPart& part, FieldValue& value) {
        if (auto* item = std::get_if<ListItem>(&part)) {
            if (item->before && !leaf(*item->before)) item->before.reset();
            return leaf(item->item);
        }
        if (auto* key = std::get_if<MapKey>(&part)) return relocated(key->key, value);
        const bool whole = std::holds_alternative<std::monostate>(part);
        return content(value) || !whole;
    }

    void erased(FieldPart& part) {
        if (auto* item = std::get_if<ListItem>(&part)) (void)leaf(item->item);
        if (auto* key = std::get_if<MapKey>(&part)) (void)leaf(key->key, PathRole::Place);
    }

private:
    bool leaf(Value& value, PathRole role = PathRole::Object) {
        Replacement replace(change_);
        replace(value, role);
        return !replace.gone;
    }

    bool inDictionary(Dictionary& dictionary) {
        for (auto& [key, entry] : dictionary.entries)
            std::visit(
                [this]<class T>(T& one) {
                    if constexpr (std::same_as<T, Dictionary>)
                        (void)inDictionary(one);
                    else
                        (void)leaf(one);
                },
                entry);
        return true;
    }

    // Two items can have the same path afterwards. The first one stays.
    bool inList(ListOp& list) {
        if (!hasPaths(list.itemType)) return true;
        bool changed = false, left = false;
        std::array<std::vector<Value>, kListNames> all;
        for (std::size_t i = 0; i < kListNames; ++i) {
            std::set<Value> items;
            for (Value item : list.lists[i].values()) {
                const Value before = item;
                const bool there = leaf(item);
                changed = changed || !there || item != before;
                if (there && items.insert(item).second) all[i].push_back(std::move(item));
            }
            left = left || !all[i].empty();
        }
        if (!changed) return true;
        for (std::size_t i = 0; i < kListNames; ++i) list.lists[i] = std::move(all[i]);
        return left;
    }

    bool inMap(Map& map) {
        if (map.keyType != ValueType::Path) return true;
        const bool wasEmpty = map.entries.empty();
        std::set<Value> keys;
        std::erase_if(map.entries, [&](auto& entry) {
            FieldValue value(entry.second);
            if (!relocated(entry.first, value) || !keys.insert(entry.first).second) return true;
            entry.second = *value.template as<Value>();
            return false;
        });
        return wasEmpty || !map.entries.empty();
    }

    bool relocated(Value& source, FieldValue& target) {
        bool there = leaf(source, PathRole::Place);
        if (auto* value = target.as<Value>()) there = leaf(*value, PathRole::Place) && there;
        return there;
    }

    const PathChange& change_;
};

}  // namespace

bool mayHavePaths(const FieldValue& content) { return content.visit(MayHavePaths{}); }

bool mayHavePaths(const EditAction& action) {
    const auto part = [](const FieldPart& part) {
        const auto* item = std::get_if<ListItem>(&part);
        const auto* key = std::get_if<MapKey>(&part);
        return (item && hasPaths(item->item.type())) || (key && key->key.type() == ValueType::Path);
    };
    if (const auto* set = std::get_if<SetField>(&action))
        return part(set->part) || mayHavePaths(set->value);
    const auto* erase = std::get_if<EraseField>(&action);
    return erase && part(erase->part);
}

bool changePaths(FieldValue& content, const PathChange& change) {
    return Rewriting(change).content(content);
}

bool changePaths(EditAction& action, const PathChange& change) {
    if (auto* set = std::get_if<SetField>(&action))
        return Rewriting(change).part(set->part, set->value);
    if (auto* erase = std::get_if<EraseField>(&action)) Rewriting(change).erased(erase->part);
    return true;
}

void forEachPath(const EditAction& action,
                 const std::function<void(std::string_view path, PathRole role)>& visit) {
    EditAction copy = action;
    (void)changePaths(copy, [&](std::string_view path, PathRole role) {
        visit(path, role);
        return std::optional(std::string(path));
    });
}

}  // namespace usdlive
