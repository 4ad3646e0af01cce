// The types of values and their bytes.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

/// The types of a Value's bytes (rules V1-V9 of PROTOCOL.md). The numbers are part of the protocol
/// and of the store: never reuse one.
enum class ValueType : std::uint16_t {
    None = 0,
    // Scalars of Sdf, little-endian, as in memory.
    Bool = 1,  // 1 byte, 0 or 1
    UChar = 2,
    Int = 3,
    UInt = 4,
    Int64 = 5,
    UInt64 = 6,
    Half = 7,  // IEEE binary16
    Float = 8,
    Double = 9,
    TimeCode = 10,  // double
    String = 11,    // u32 length, UTF-8 bytes (also the next five)
    Token = 12,
    Asset = 13,  // the authored path only; each client resolves it itself
    PathExpression = 14,
    Path = 15,      // result of SdfPath::GetAsString; empty for the empty path
    Opaque = 16,    // no bytes
    Matrix2d = 20,  // row major
    Matrix3d = 21,
    Matrix4d = 22,
    Quath = 23,  // i, j, k, real
    Quatf = 24,
    Quatd = 25,
    Int2 = 26,
    Half2 = 27,
    Float2 = 28,
    Double2 = 29,
    Int3 = 30,
    Half3 = 31,
    Float3 = 32,
    Double3 = 33,
    Int4 = 34,
    Half4 = 35,
    Float4 = 36,
    Double4 = 37,
    // Other types of Sdf's fields.
    Block = 50,           // SdfValueBlock, no bytes
    AnimationBlock = 51,  // no bytes
    Spline = 52,          // Ts binary data, then its custom data: see V7
    Specifier = 53,       // 1 byte, as SdfSpecifier
    Variability = 54,
    Permission = 55,
    TokenVector = 56,  // u32 count, then strings
    StringVector = 57,
    Reference = 58,     // V8: asset, prim path, offset, scale, custom data
    Payload = 59,       // V8: asset, prim path, offset, scale
    SubLayer = 60,      // asset path, offset, scale: an item of `subLayers`
    Unregistered = 61,  // SdfUnregisteredValue: u8 kind, then string, dictionary or list op
    LayerOffset = 62,   // two doubles: offset, scale
    // Composite fields; each of their parts is a register (M1).
    Dictionary = 80,
    TimeSamples = 81,
    ListOp = 82,
    Map = 83,
    // Added to the number of a scalar: an array of it (u64 count, then the elements), and a
    // VtArrayEdit.
    ArrayFlag = 0x100,
    ArrayEditFlag = 0x200,
};

[[nodiscard]] constexpr ValueType arrayOf(ValueType scalar) {
    return ValueType(std::uint16_t(scalar) | std::uint16_t(ValueType::ArrayFlag));
}
[[nodiscard]] constexpr ValueType arrayEditOf(ValueType scalar) {
    return ValueType(std::uint16_t(scalar) | std::uint16_t(ValueType::ArrayEditFlag));
}

/// V9: values of at least this size are sent beside the stream and named by their hash.
inline constexpr std::size_t kBigValueBytes = 256 * 1024;

/// An opaque value: a type and its bytes. A big value has only the hash and size of its bytes,
/// which a BlobStore keeps and which are fetched in chunks. Neither server nor session looks
/// inside. A plain value; copies share the bytes.
class Value {
public:
    Value() = default;
    Value(ValueType type, Bytes bytes);
    Value(ValueType type, ByteView bytes);
    static Value blob(ValueType type, const Hash& hash, std::uint64_t size);

    [[nodiscard]] ValueType type() const { return type_; }
    [[nodiscard]] bool isBlob() const;
    /// Returns the bytes; empty for a blob.
    [[nodiscard]] ByteView bytes() const;
    /// Returns the size of the content, also for a blob.
    [[nodiscard]] std::uint64_t size() const;
    /// Precondition: isBlob().
    [[nodiscard]] const Hash& hash() const;

    /// Compare by type and content. A blob equals only a blob with the same hash.
    friend bool operator==(const Value&, const Value&);
    friend std::strong_ordering operator<=>(const Value&, const Value&);

private:
    static constexpr std::size_t kInlineBytes = 24;
    struct BlobName {
        Hash hash;
        std::uint64_t size = 0;
        bool operator==(const BlobName&) const = default;
    };
    using SharedBlobName = std::shared_ptr<const BlobName>;
    using Inline = std::array<std::uint8_t, kInlineBytes>;
    // Up to kInlineBytes are kept in place (a double3, a quaternion of floats, a short token); more
    // are shared.
    std::variant<Inline, SharedBytes, SharedBlobName> content_;
    ValueType type_ = ValueType::None;
    std::uint8_t inlineSize_ = 0;
};

/// V9: returns true for types whose value may be a blob: arrays, array edits, splines and single
/// texts.
[[nodiscard]] bool canBeBlob(ValueType type);

/// Returns true for a type of the list above that is neither None nor a composite field.
[[nodiscard]] bool isLeafType(ValueType type);

/// Returns the name as in the list above: `Float3`, `Float3[]`, `Float3[edit]`, `type 999`.
[[nodiscard]] std::string typeName(ValueType type);

/// V1-V8: checks that the bytes fit the type: sizes, counts, UTF-8 and nesting. Allocates no more
/// than the size of the bytes. For composite types see FieldValue.
[[nodiscard]] Result<void> validateValue(ValueType type, ByteView bytes);

/// Build values of the types that the rules themselves write.
[[nodiscard]] Value tokenValue(std::string_view text);
[[nodiscard]] Value stringValue(std::string_view text);
[[nodiscard]] Value pathValue(std::string_view text);
[[nodiscard]] Value doubleValue(double number);
[[nodiscard]] Value boolValue(bool flag);

/// Returns the text of a String, Token, Asset, PathExpression or Path, as a view into `value`.
/// Returns nothing for other types, a blob, and bytes that do not fit.
[[nodiscard]] std::optional<std::string_view> textOf(const Value& value);

}  // namespace usdlive
