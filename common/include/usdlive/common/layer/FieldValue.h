// The content of a field and its encoding.
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
#include "usdlive/common/layer/ListItems.h"
#include "usdlive/common/layer/Value.h"

namespace usdlive {

/// A dictionary with sorted keys, as VtDictionary. Keys are UTF-8 and may contain any character,
/// also `:`. A key path is a vector of keys and never a joined string.
struct Dictionary {
    using Entry = std::variant<Value, Dictionary>;
    std::map<std::string, Entry, std::less<>> entries;
    bool operator==(const Dictionary&) const = default;
};

/// Samples sorted by time. Times are finite and distinct.
struct TimeSamples {
    std::map<double, Value> samples;
    bool operator==(const TimeSamples&) const = default;
};

enum class ListName : std::uint8_t { Explicit, Added, Prepended, Appended, Deleted, Ordered };
inline constexpr std::size_t kListNames = 6;

/// A list op of any item type (references, targets, API schemas, ...). Also the `subLayers` of a
/// layer: explicit items of type SubLayer, which include their offset. itemKey() identifies an
/// item.
struct ListOp {
    ValueType itemType = ValueType::None;
    bool isExplicit = false;
    std::array<ListItems, kListNames> lists;

    [[nodiscard]] ListItems& operator[](ListName name) { return lists[std::size_t(name)]; }
    [[nodiscard]] const ListItems& operator[](ListName name) const {
        return lists[std::size_t(name)];
    }
    bool operator==(const ListOp&) const = default;
};

/// Returns the key of a list item: the asset path of a SubLayer, otherwise the whole item.
[[nodiscard]] Value itemKey(const Value& item);

/// Keys and values in a given order: `variantSelection` (Strings, sorted by key), `relocates` and
/// `layerRelocates` (Paths, in the authored order).
struct Map {
    ValueType keyType = ValueType::None;
    std::vector<std::pair<Value, Value>> entries;
    bool operator==(const Map&) const = default;
};

template <class T>
concept IsContent = std::same_as<T, Value> || std::same_as<T, Dictionary> ||
                    std::same_as<T, TimeSamples> || std::same_as<T, ListOp> || std::same_as<T, Map>;

/// The content of one field of one spec. Composite content is kept in parts, because each part is a
/// register (M1). Everything else is one opaque Value.
class FieldValue {
public:
    FieldValue() = default;
    template <class T>
        requires IsContent<T>
    // NOLINT: a field converts from its content
    FieldValue(T value) : content_(std::move(value)) {}

    [[nodiscard]] ValueType type() const;
    bool operator==(const FieldValue&) const = default;

    /// Returns nullptr if the field has another form.
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
    /// Returns the content as a T. Replaces it by an empty T first if it has another form.
    template <class T>
        requires IsContent<T>
    T& become() {
        if (!as<T>()) content_ = T();
        return *as<T>();
    }
    /// Calls `visitor` with the content.
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
    // Every field of every spec holds one of these. A list op in place would make it three times as
    // large.
    std::variant<Value, Dictionary, TimeSamples, Box<ListOp>, Map> content_;
};

/// V10: the one encoding of a field's content, used on the wire, in snapshots and in the store: u16
/// type, u8 form (0: bytes inline, 1: blob), u64 size, then the bytes, or for a blob its hash (32
/// bytes). Composite types nest the same encoding, dictionaries at most kMaxNesting levels deep.
inline constexpr std::size_t kMaxNesting = 64;
/// Returns the number of nested dictionaries: 1 for a flat one. decodeFieldValue() refuses more
/// than kMaxNesting.
[[nodiscard]] std::size_t nesting(const Dictionary& dictionary);
void encodeFieldValue(const FieldValue& value, Bytes& out);
[[nodiscard]] Bytes encodeFieldValue(const FieldValue& value);
/// Decodes and verifies a field's content, leaf values with validateValue(). All input must be
/// consumed, and encoding the result returns the same bytes. Errors: ErrorCode::InvalidValue with
/// the reason. An empty FieldValue (type None) can be encoded but not decoded.
[[nodiscard]] Result<FieldValue> decodeFieldValue(ByteView bytes);

/// Calls `visit` for every blob that the value refers to.
void forEachBlob(const FieldValue& value, const std::function<void(const Value&)>& visit);

}  // namespace usdlive
