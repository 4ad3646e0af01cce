#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/common/core/Box.h"
#include "usdlive/common/layer/Value.h"

namespace usdlive {

/// A dictionary's keys are sorted, as in VtDictionary. Keys are UTF-8 and may hold any character,
/// also
/// `:`; a key *path* is a vector of keys and never a joined string inside our code.
struct Dictionary {
    using Entry = std::variant<Value, Dictionary>;
    std::map<std::string, Entry, std::less<>> entries;
    bool operator==(const Dictionary&) const = default;
};

/// Samples sorted by time; times are finite and distinct.
struct TimeSamples {
    std::vector<std::pair<double, Value>> samples;
    bool operator==(const TimeSamples&) const = default;
};

enum class ListName : std::uint8_t { Explicit, Added, Prepended, Appended, Deleted, Ordered };
inline constexpr std::size_t kListNames = 6;

/// A list op of any item type (references, targets, API schemas, ...), and the `subLayers` of a
/// layer (explicit items of type SubLayer, which carry their offset). An item is identified by
/// itemKey().
struct ListOp {
    ValueType itemType = ValueType::None;
    bool isExplicit = false;
    std::array<std::vector<Value>, kListNames> lists;

    [[nodiscard]] std::vector<Value>& operator[](ListName name) { return lists[std::size_t(name)]; }
    [[nodiscard]] const std::vector<Value>& operator[](ListName name) const {
        return lists[std::size_t(name)];
    }
    bool operator==(const ListOp&) const = default;
};

/// What identifies an item of a list: its asset path for a SubLayer, else the whole item.
[[nodiscard]] Value itemKey(const Value& item);

/// Keys to values in a given order. `variantSelection` (Strings, sorted by key) and `relocates` /
/// `layerRelocates` (Paths, in the order authored).
struct Map {
    ValueType keyType = ValueType::None;
    std::vector<std::pair<Value, Value>> entries;
    bool operator==(const Map&) const = default;
};

template <class T>
concept IsContent = std::same_as<T, Value> || std::same_as<T, Dictionary> ||
                    std::same_as<T, TimeSamples> || std::same_as<T, ListOp> || std::same_as<T, Map>;

/// The content of one field of one spec. Composite ones are held apart, so that their parts are
/// registers (M1); everything else is one opaque Value.
class FieldValue {
public:
    FieldValue() = default;
    template <class T>
        requires IsContent<T>
    FieldValue(T value) : content_(std::move(value)) {}  // NOLINT: a field is given by its content

    [[nodiscard]] ValueType type() const;
    bool operator==(const FieldValue&) const = default;

    /// Nothing when it holds another form.
    template <class T>
        requires IsContent<T>
    [[nodiscard]] const T* as() const {
        return const_cast<FieldValue*>(this)->as<T>();
    }
    template <class T>
        requires IsContent<T>
    [[nodiscard]] T* as() {
        if constexpr (std::same_as<T, ListOp>) {
            auto* boxed = std::get_if<Box<ListOp>>(&content_);
            return boxed ? &**boxed : nullptr;
        } else {
            return std::get_if<T>(&content_);
        }
    }
    /// The content as a T, an empty one when it held another form.
    template <class T>
        requires IsContent<T>
    T& become() {
        if (!as<T>()) content_ = T();
        return *as<T>();
    }
    /// Calls `visitor` with what it holds.
    template <class Visitor>
    decltype(auto) visit(Visitor&& visitor) const {
        return std::visit(
            [&]<class T>(const T& content) -> decltype(auto) {
                if constexpr (std::same_as<T, Box<ListOp>>)
                    return visitor(*content);
                else
                    return visitor(content);
            },
            content_);
    }

private:
    // Every field of every spec holds one of these: a list op by itself would make it three times
    // as large.
    std::variant<Value, Dictionary, TimeSamples, Box<ListOp>, Map> content_;
};

/// V10: the one encoding of a field's content, used on the wire, in snapshots and in the store:
/// u16 type, u8 form (0 bytes inline, 1 blob), u64 size, then the bytes, or hash (32) for a blob.
/// Composite types nest the same encoding; dictionaries at most kMaxNesting deep.
inline constexpr std::size_t kMaxNesting = 64;
/// How many dictionaries deep: 1 for a flat one. More than kMaxNesting cannot be decoded again.
[[nodiscard]] std::size_t nesting(const Dictionary& dictionary);
void encodeFieldValue(const FieldValue& value, Bytes& out);
[[nodiscard]] Bytes encodeFieldValue(const FieldValue& value);
/// Verifies everything, leaf values by validateValue(). The input must be consumed whole, and is
/// what encoding the result gives again. ErrorCode::InvalidValue says what is wrong. An empty
/// FieldValue (type None) encodes, but nothing decodes to it.
[[nodiscard]] Result<FieldValue> decodeFieldValue(ByteView bytes);

/// Calls `visit` for every blob named in the value.
void forEachBlob(const FieldValue& value, const std::function<void(const Value&)>& visit);

}  // namespace usdlive
