// Computes the edits of one field's parts that turn one content into another.
#include <limits>
#include <map>
#include <set>

#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/layer/LongestIncreasing.h"

namespace usdlive {

namespace {

struct ValueLess {
    bool operator()(const Value& left, const Value& right) const { return left < right; }
};

// An author sends up to this many parts even if the whole is shorter, because colleagues may change
// others. Every replica applies them one by one, and a part of a Map costs as much as the whole.
constexpr std::size_t kMostParts = 1000;
constexpr std::size_t kAnyNumber = std::numeric_limits<std::size_t>::max();

// Collects the parts in which one field differs, and the size of the whole for comparison.
class Difference {
public:
    Difference(std::string_view field, bool authored) : field_(field), authored_(authored) {}

    void run(const Dictionary& from, const Dictionary& to) {
        std::vector<std::string> path;
        wholeSize_ = leaves(to);
        whole_ = to.entries.empty();
        compare(from, to, path);
    }

    void run(const TimeSamples& from, const TimeSamples& to) {
        wholeSize_ = to.samples.size();
        whole_ = to.samples.empty();
        auto old = from.samples.begin();
        for (const auto& [time, value] : to.samples) {
            for (; old != from.samples.end() && old->first < time; ++old)
                erase(SampleTime{old->first});
            const bool there = old != from.samples.end() && old->first == time;
            if (!there || old->second != value) set(SampleTime{time}, value);
            if (there) ++old;
        }
        for (; old != from.samples.end(); ++old) erase(SampleTime{old->first});
    }

    void run(const ListOp& from, const ListOp& to) {
        const bool sameForm = from.itemType == to.itemType && from.isExplicit == to.isExplicit;
        whole_ = !sameForm && !authored_;
        const ListOp none;  // the content after the first item of another form
        for (std::size_t i = 0; i < kListNames && !whole_; ++i) {
            wholeSize_ += to.lists[i].size();
            const auto& old = (sameForm ? from : none).lists[i];
            if (old != to.lists[i])
                compare(ListName(i), old.values(), to.lists[i].values(), to.itemType);
        }
        whole_ = whole_ || wholeSize_ == 0;
    }

    void run(const Map& from, const Map& to) {
        wholeSize_ = to.entries.size();
        whole_ = from.keyType != to.keyType || to.entries.empty();
        const std::map<Value, Value, ValueLess> old(from.entries.begin(), from.entries.end());
        const std::map<Value, Value, ValueLess> now(to.entries.begin(), to.entries.end());
        for (const auto& [key, value] : to.entries) {
            const auto found = old.find(key);
            if (found == old.end() || found->second != value) set(MapKey{key}, value, to.keyType);
        }
        for (const auto& [key, value] : from.entries)
            if (!now.contains(key)) erase(MapKey{key});
    }

    void run(const Value&, const Value&) { whole_ = true; }

    // The parts, or the whole if there are more than `most` parts and the whole is not longer. Sets
    // come first, so that no erase leaves an empty field in between.
    std::vector<EditAction> take(const FieldValue& from, const FieldValue& to, std::size_t most) {
        const std::size_t parts = sets_.size() + erases_.size();
        if (!whole_ && (parts <= most || parts < wholeSize_)) {
            std::move(erases_.begin(), erases_.end(), std::back_inserter(sets_));
            if (isExact(from, to)) return std::move(sets_);
        }
        return {SetField{field_, {}, to, ValueType::None}};
    }

private:
    static std::size_t leaves(const Dictionary& dictionary) {
        std::size_t count = 0;
        for (const auto& [key, entry] : dictionary.entries) {
            const auto* inner = std::get_if<Dictionary>(&entry);
            count += inner ? std::max<std::size_t>(1, leaves(*inner)) : 1;
        }
        return count;
    }

    void compare(const Dictionary& from, const Dictionary& to, std::vector<std::string>& path) {
        for (const auto& [key, entry] : to.entries) {
            path.push_back(key);
            const auto old = from.entries.find(key);
            if (old == from.entries.end())
                setEntry(path, entry);
            else
                compare(old->second, entry, path);
            path.pop_back();
        }
        for (const auto& [key, entry] : from.entries) {
            if (to.entries.contains(key)) continue;
            path.push_back(key);
            erase(DictionaryKey{path});
            path.pop_back();
        }
    }

    void compare(const Dictionary::Entry& from, const Dictionary::Entry& to,
                 std::vector<std::string>& path) {
        const auto* oldInner = std::get_if<Dictionary>(&from);
        const auto* newInner = std::get_if<Dictionary>(&to);
        if (!oldInner || !newInner) {
            if (from != to) setEntry(path, to);
        } else if (newInner->entries.empty()) {
            if (!oldInner->entries.empty()) setEntry(path, to);
        } else {
            compare(*oldInner, *newInner, path);
        }
    }

    // Keeps the longest run of items in order and inserts the others from the back, so that the
    // next item is always in place.
    void compare(ListName list, const std::vector<Value>& from, const std::vector<Value>& to,
                 ValueType form) {
        std::map<Value, std::size_t, ValueLess> places;  // in `from`
        for (std::size_t i = 0; i < from.size(); ++i) places.emplace(itemKey(from[i]), i);
        std::set<Value, ValueLess> wanted;
        std::vector<std::size_t> kept;
        for (const Value& item : to) {
            const auto key = itemKey(item);
            whole_ = whole_ || !wanted.insert(key).second;
            const auto place = places.find(key);
            kept.push_back(place == places.end() ? kNotThere : place->second);
        }
        whole_ = whole_ || places.size() != from.size();
        const std::vector<bool> stays = longestIncreasing(kept);
        for (std::size_t i = to.size(); i-- > 0;)
            if (!stays[i] || from[kept[i]] != to[i]) put(list, to, i, form);
        for (const Value& item : from)
            if (!wanted.contains(itemKey(item))) erase(ListItem{list, item, {}});
    }

    void put(ListName list, const std::vector<Value>& to, std::size_t index, ValueType form) {
        ListItem part{list, to[index], {}};
        if (index + 1 < to.size()) part.before = to[index + 1];
        set(std::move(part), FieldValue{}, form);
    }

    void set(FieldPart part, FieldValue value, ValueType form = ValueType::None) {
        sets_.push_back(SetField{field_, std::move(part), std::move(value), form});
    }
    void setEntry(std::vector<std::string>& path, const Dictionary::Entry& entry) {
        const auto* inner = std::get_if<Dictionary>(&entry);
        if (authored_ && inner && !inner->entries.empty()) return compare({}, *inner, path);
        std::visit([&](const auto& content) { set(DictionaryKey{path}, FieldValue(content)); },
                   entry);
    }
    void erase(FieldPart part) { erases_.push_back(EraseField{field_, std::move(part)}); }

    // Tries the parts on a copy. Samples and dictionaries need no trial, because they have only one
    // order.
    [[nodiscard]] bool isExact(const FieldValue& from, const FieldValue& to) const {
        if (!from.as<ListOp>() && !from.as<Map>()) return true;
        FieldValue trial = from;
        bool left = true;
        for (const EditAction& action : sets_) {
            if (const auto* set = std::get_if<SetField>(&action)) setPart(trial, *set);
            const auto* erase = std::get_if<EraseField>(&action);
            if (erase && !holdsPart(trial, erase->part)) return false;
            if (erase) left = erasePart(trial, erase->part);
        }
        return left && trial == to;
    }

    std::string field_;
    bool authored_;
    std::vector<EditAction> sets_;
    std::vector<EditAction> erases_;
    std::size_t wholeSize_ = 0;
    bool whole_ = false;
};

enum class Purpose { Shortest, Authored };

std::vector<EditAction> compareContents(std::string_view field, const FieldValue& from,
                                        const FieldValue& to, Purpose purpose, std::size_t most) {
    if (from == to) return {};
    Difference difference(field, purpose == Purpose::Authored);
    const auto compare = [&](const auto& old) {
        using Content = std::decay_t<decltype(old)>;
        const auto* now = to.as<Content>();
        if (now) difference.run(old, *now);
        return now != nullptr;
    };
    if (!from.visit(compare)) return {SetField{std::string(field), {}, to, ValueType::None}};
    return difference.take(from, to, most);
}

struct EmptyOf {
    FieldValue operator()(const Value& value) const { return value; }
    FieldValue operator()(const Dictionary&) const { return Dictionary{}; }
    FieldValue operator()(const TimeSamples&) const { return TimeSamples{}; }
    FieldValue operator()(const ListOp& list) const {
        ListOp none;
        none.itemType = list.itemType;
        none.isExplicit = list.isExplicit;
        return none;
    }
    FieldValue operator()(const Map& map) const { return Map{map.keyType, {}}; }
};

// The parts that make a content. The first one changes a field of another form to this form.
std::vector<EditAction> partsOf(std::string_view field, const FieldValue& content,
                                std::size_t most) {
    const FieldValue none = content.visit(EmptyOf{});
    if (none == content) return {SetField{std::string(field), {}, content, ValueType::None}};
    return compareContents(field, none, content, Purpose::Authored, most);
}

}  // namespace

std::vector<EditAction> fieldDifference(std::string_view field, const FieldValue* from,
                                        const FieldValue* to) {
    if (!to && !from) return {};
    if (!to) return {EraseField{std::string(field), {}}};
    if (!from) return {SetField{std::string(field), {}, *to, ValueType::None}};
    return compareContents(field, *from, *to, Purpose::Shortest, 1);
}

std::vector<EditAction> authoredParts(std::string_view field, const FieldValue* from,
                                      const FieldValue* to) {
    if (!to) return fieldDifference(field, from, to);
    if (from && from->type() == to->type())
        return compareContents(field, *from, *to, Purpose::Authored, kMostParts);
    return partsOf(field, *to, kMostParts);
}

// Here nobody sends the parts, so their number is limited only for a Map.
FieldValue unitedParts(std::string_view field, const FieldValue& present, const FieldValue& added) {
    FieldValue united = present;
    const std::size_t most = added.as<Map>() ? kMostParts : kAnyNumber;
    for (const EditAction& action : partsOf(field, added, most))
        setPart(united, std::get<SetField>(action));
    return united;
}

}  // namespace usdlive
