// Encodes and decodes single values, arrays and list ops of USD (V1-V8).
#include "LeafCodec.h"

#include <pxr/base/gf/half.h>
#include <pxr/base/gf/quatd.h>
#include <pxr/base/gf/quatf.h>
#include <pxr/base/gf/quath.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/ts/binary.h>
#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/arrayEdit.h>
#include <pxr/base/vt/arrayEditBuilder.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/opaqueValue.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/timeCode.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <typeindex>
#include <unordered_map>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/FileRules.h"

namespace usdlive::usd {

namespace {

using pxr::VtValue;

// ------------------------------------------------------------------ elements
// Writes one element of each type, and reads it from bytes that have passed validateValue().
// `write` returns false if a part is unknown to the protocol. `read` returns nothing if this
// OpenUSD demands more than the protocol.

template <class T>
struct Element;

// Copied as in memory, which keeps -0 and every NaN. GfHalf, GfTimeCode, vectors, matrices and
// quaternions (imaginary first) consist of their numbers only.
template <class T>
concept Plain = requires { Element<T>::kPlain; };

template <class T, ValueType Type, std::size_t Size>
struct PlainElement {
    static_assert(sizeof(T) == Size);
    static constexpr bool kPlain = true;
    static constexpr ValueType kType = Type;
    static bool write(Bytes& out, const T& value) {
        appendBytes(out, {reinterpret_cast<const std::uint8_t*>(&value), sizeof value});
        return true;
    }
    static std::optional<T> read(ByteReader& in) {
        const ByteView bytes = in.take(sizeof(T));
        if (in.failed()) return std::nullopt;
        T value;
        std::memcpy(static_cast<void*>(&value), bytes.data(), sizeof value);
        return value;
    }
};

#define USDLIVE_PLAIN(CppType, Name, Size) \
    template <>                            \
    struct Element<CppType> : PlainElement<CppType, ValueType::Name, Size> {}
USDLIVE_PLAIN(unsigned char, UChar, 1);
USDLIVE_PLAIN(int, Int, 4);
USDLIVE_PLAIN(unsigned int, UInt, 4);
USDLIVE_PLAIN(std::int64_t, Int64, 8);
USDLIVE_PLAIN(std::uint64_t, UInt64, 8);
USDLIVE_PLAIN(pxr::GfHalf, Half, 2);
USDLIVE_PLAIN(float, Float, 4);
USDLIVE_PLAIN(double, Double, 8);
USDLIVE_PLAIN(pxr::SdfTimeCode, TimeCode, 8);
USDLIVE_PLAIN(pxr::GfMatrix2d, Matrix2d, 32);
USDLIVE_PLAIN(pxr::GfMatrix3d, Matrix3d, 72);
USDLIVE_PLAIN(pxr::GfMatrix4d, Matrix4d, 128);
USDLIVE_PLAIN(pxr::GfQuath, Quath, 8);
USDLIVE_PLAIN(pxr::GfQuatf, Quatf, 16);
USDLIVE_PLAIN(pxr::GfQuatd, Quatd, 32);
USDLIVE_PLAIN(pxr::GfVec2i, Int2, 8);
USDLIVE_PLAIN(pxr::GfVec2h, Half2, 4);
USDLIVE_PLAIN(pxr::GfVec2f, Float2, 8);
USDLIVE_PLAIN(pxr::GfVec2d, Double2, 16);
USDLIVE_PLAIN(pxr::GfVec3i, Int3, 12);
USDLIVE_PLAIN(pxr::GfVec3h, Half3, 6);
USDLIVE_PLAIN(pxr::GfVec3f, Float3, 12);
USDLIVE_PLAIN(pxr::GfVec3d, Double3, 24);
USDLIVE_PLAIN(pxr::GfVec4i, Int4, 16);
USDLIVE_PLAIN(pxr::GfVec4h, Half4, 8);
USDLIVE_PLAIN(pxr::GfVec4f, Float4, 16);
USDLIVE_PLAIN(pxr::GfVec4d, Double4, 32);
#undef USDLIVE_PLAIN

template <class T, ValueType Type>
struct ByteElement {
    static constexpr ValueType kType = Type;
    static bool write(Bytes& out, const T& value) {
        out.push_back(std::uint8_t(value));
        return true;
    }
    static std::optional<T> read(ByteReader& in) { return T(in.u8()); }
};
template <>
struct Element<bool> : ByteElement<bool, ValueType::Bool> {};
template <>
struct Element<pxr::SdfSpecifier> : ByteElement<pxr::SdfSpecifier, ValueType::Specifier> {};
template <>
struct Element<pxr::SdfVariability> : ByteElement<pxr::SdfVariability, ValueType::Variability> {};
template <>
struct Element<pxr::SdfPermission> : ByteElement<pxr::SdfPermission, ValueType::Permission> {};

template <>
struct Element<std::string> {
    static constexpr ValueType kType = ValueType::String;
    static bool write(Bytes& out, const std::string& value) {
        appendText(out, value);
        return true;
    }
    static std::optional<std::string> read(ByteReader& in) { return std::string(in.text()); }
};

template <>
struct Element<pxr::TfToken> {
    static constexpr ValueType kType = ValueType::Token;
    static bool write(Bytes& out, const pxr::TfToken& value) {
        appendText(out, value.GetString());
        return true;
    }
    static std::optional<pxr::TfToken> read(ByteReader& in) {
        return pxr::TfToken(std::string(in.text()));
    }
};

// Constructs a T from text. Returns nothing if Tf reports an error.
template <class T>
std::optional<T> fromText(std::string_view text) {
    pxr::TfErrorMark mark;
    T value{std::string(text)};
    if (mark.Clear()) return std::nullopt;
    return value;
}

template <>
struct Element<pxr::SdfAssetPath> {
    static constexpr ValueType kType = ValueType::Asset;
    static bool write(Bytes& out, const pxr::SdfAssetPath& value) {
        appendText(out, value.GetAuthoredPath());
        return true;
    }
    static std::optional<pxr::SdfAssetPath> read(ByteReader& in) {
        return fromText<pxr::SdfAssetPath>(in.text());  // no control characters
    }
};

template <>
struct Element<pxr::SdfPathExpression> {
    static constexpr ValueType kType = ValueType::PathExpression;
    static bool write(Bytes& out, const pxr::SdfPathExpression& value) {
        appendText(out, value.GetText());
        return true;
    }
    static std::optional<pxr::SdfPathExpression> read(ByteReader& in) {
        const std::string_view text = in.text();
        auto value = fromText<pxr::SdfPathExpression>(text);
        // Sdf would write it differently
        if (value && value->GetText() != text) return std::nullopt;
        return value;
    }
};

template <>
struct Element<pxr::SdfPath> {
    static constexpr ValueType kType = ValueType::Path;
    static bool write(Bytes& out, const pxr::SdfPath& value) {
        appendText(out, value.GetAsString());
        return value.IsEmpty() || value.IsAbsolutePath();
    }
    static std::optional<pxr::SdfPath> read(ByteReader& in) {
        auto path = parsePath(in.text());
        if (!path) return std::nullopt;
        return *std::move(path);
    }
};

template <class T, ValueType Type>
struct EmptyElement {
    static constexpr ValueType kType = Type;
    static bool write(Bytes&, const T&) { return true; }
    static std::optional<T> read(ByteReader&) { return T(); }
};
template <>
struct Element<pxr::SdfOpaqueValue> : EmptyElement<pxr::SdfOpaqueValue, ValueType::Opaque> {};
template <>
struct Element<pxr::SdfValueBlock> : EmptyElement<pxr::SdfValueBlock, ValueType::Block> {};
template <>
struct Element<pxr::SdfAnimationBlock>
    : EmptyElement<pxr::SdfAnimationBlock, ValueType::AnimationBlock> {};

template <class T, ValueType Type>
struct VectorElement {
    static constexpr ValueType kType = Type;
    static bool write(Bytes& out, const std::vector<T>& value) {
        appendNumber<std::uint32_t>(out, std::uint32_t(value.size()));
        return std::ranges::all_of(value,
                                   [&](const T& item) { return Element<T>::write(out, item); });
    }
    static std::optional<std::vector<T>> read(ByteReader& in) {
        const std::uint32_t count = in.u32();
        std::vector<T> value;
        value.reserve(count);
        for (std::uint32_t index = 0; index < count; ++index) {
            auto item = Element<T>::read(in);
            if (!item) return std::nullopt;
            value.push_back(*std::move(item));
        }
        return value;
    }
};
template <>
struct Element<std::vector<pxr::TfToken>> : VectorElement<pxr::TfToken, ValueType::TokenVector> {};
template <>
struct Element<std::vector<std::string>> : VectorElement<std::string, ValueType::StringVector> {};

template <>
struct Element<pxr::SdfLayerOffset> {
    static constexpr ValueType kType = ValueType::LayerOffset;
    static bool write(Bytes& out, const pxr::SdfLayerOffset& value) {
        appendNumber<double>(out, value.GetOffset());
        appendNumber<double>(out, value.GetScale());
        return true;
    }
    static std::optional<pxr::SdfLayerOffset> read(ByteReader& in) {
        const double offset = in.f64();
        const double scale = in.f64();
        if (in.failed()) return std::nullopt;
        return pxr::SdfLayerOffset(offset, scale);
    }
};

// ------------------------------------------------------------------ with dictionaries inside
// A dictionary or list inside a leaf is encoded as in V10, without its first header and without
// blobs.

bool writeDictionary(Bytes& out, const pxr::VtDictionary& dictionary, std::size_t depth = 1);
std::optional<pxr::VtDictionary> readDictionary(ByteReader& in);

template <class T>
bool writeArc(Bytes& out, const T& value) {
    return Element<std::string>::write(out, value.GetAssetPath()) &&
           Element<pxr::SdfPath>::write(out, value.GetPrimPath()) &&
           Element<pxr::SdfLayerOffset>::write(out, value.GetLayerOffset());
}

template <class T>
std::optional<T> readArc(ByteReader& in) {
    const auto asset = Element<pxr::SdfAssetPath>::read(in);
    const auto path = Element<pxr::SdfPath>::read(in);
    const auto offset = Element<pxr::SdfLayerOffset>::read(in);
    if (!asset || !path || !offset) return std::nullopt;
    return T(asset->GetAuthoredPath(), *path, *offset);
}

template <>
struct Element<pxr::SdfPayload> {
    static constexpr ValueType kType = ValueType::Payload;
    static bool write(Bytes& out, const pxr::SdfPayload& value) { return writeArc(out, value); }
    static std::optional<pxr::SdfPayload> read(ByteReader& in) {
        return readArc<pxr::SdfPayload>(in);
    }
};

template <>
struct Element<pxr::SdfReference> {
    static constexpr ValueType kType = ValueType::Reference;
    static bool write(Bytes& out, const pxr::SdfReference& value) {
        return writeArc(out, value) && writeDictionary(out, value.GetCustomData());
    }
    static std::optional<pxr::SdfReference> read(ByteReader& in) {
        auto value = readArc<pxr::SdfReference>(in);
        if (!value) return std::nullopt;
        const auto customData = readDictionary(in);
        if (!customData) return std::nullopt;
        value->SetCustomData(*customData);
        return value;
    }
};

// Ts accepts any number for its enumerations, and knots without a type, and fails or crashes when
// it uses them.
bool isSound(const pxr::TsSpline& spline) {
    if (!spline.GetValueType() && !spline.IsEmpty()) return false;
    const auto isBetween = [](auto value, auto first, auto last) {
        return value >= first && value <= last;
    };
    const auto isExtrapolation = [&](const pxr::TsExtrapolation& extrapolation) {
        return isBetween(extrapolation.mode, pxr::TsExtrapValueBlock, pxr::TsExtrapLoopOscillate);
    };
    const auto isAlgorithm = [&](pxr::TsTangentAlgorithm algorithm) {
        return isBetween(algorithm, pxr::TsTangentAlgorithmNone, pxr::TsTangentAlgorithmAutoEase);
    };
    double before = -std::numeric_limits<double>::infinity();
    for (const pxr::TsKnot& knot : spline.GetKnots()) {
        if (!std::isfinite(knot.GetTime()) || !(before < knot.GetTime()) ||
            !isBetween(knot.GetNextInterpolation(), pxr::TsInterpValueBlock, pxr::TsInterpCurve) ||
            !isAlgorithm(knot.GetPreTanAlgorithm()) || !isAlgorithm(knot.GetPostTanAlgorithm()))
            return false;
        before = knot.GetTime();
    }
    return isBetween(spline.GetCurveType(), pxr::TsCurveTypeBezier, pxr::TsCurveTypeHermite) &&
           isExtrapolation(spline.GetPreExtrapolation()) &&
           isExtrapolation(spline.GetPostExtrapolation());
}

template <>
struct Element<pxr::TsSpline> {
    static constexpr ValueType kType = ValueType::Spline;
    using CustomData = std::unordered_map<pxr::TsTime, pxr::VtDictionary>;

    static bool write(Bytes& out, const pxr::TsSpline& value) {
        Bytes knots;
        const CustomData* customData = nullptr;
        pxr::Ts_BinaryDataAccess::GetBinaryData(value, &knots, &customData);
        appendNumber<std::uint32_t>(out, std::uint32_t(knots.size()));
        appendBytes(out, knots);
        std::map<pxr::TsTime, const pxr::VtDictionary*> sorted;
        if (customData)
            for (const auto& [time, data] : *customData) sorted.emplace(time, &data);
        appendNumber<std::uint32_t>(out, std::uint32_t(sorted.size()));
        for (const auto& [time, data] : sorted) {
            appendNumber<double>(out, time);
            if (!writeDictionary(out, *data)) return false;
        }
        return true;
    }

    static std::optional<pxr::TsSpline> read(ByteReader& in) {
        const ByteView knots = in.take(in.u32());
        CustomData customData;
        const std::uint32_t count = in.u32();
        for (std::uint32_t left = count; left > 0; --left) {
            const double time = in.f64();
            const auto data = readDictionary(in);
            if (!data) return std::nullopt;
            customData.emplace(time, *data);
        }
        pxr::TfErrorMark mark;
        auto value = pxr::Ts_BinaryDataAccess::CreateSplineFromBinaryData(
            Bytes(knots.begin(), knots.end()), std::move(customData));
        if (mark.Clear() || !isSound(value) || !keeps(value, count)) return std::nullopt;
        return value;
    }

private:
    /// Ts drops the custom data of a spline without knots.
    static bool keeps(const pxr::TsSpline& value, std::size_t count) {
        if (count == 0) return true;
        Bytes knots;
        const CustomData* kept = nullptr;
        pxr::Ts_BinaryDataAccess::GetBinaryData(value, &knots, &kept);
        return kept && kept->size() == count;
    }
};

template <>
struct Element<pxr::SdfUnregisteredValue> {
    static constexpr ValueType kType = ValueType::Unregistered;
    enum Kind : std::uint8_t { Text = 0, Dict = 1, List = 2 };

    static bool write(Bytes& out, const pxr::SdfUnregisteredValue& value) {
        const VtValue& content = value.GetValue();
        if (content.IsHolding<std::string>()) {
            out.push_back(Text);
            return Element<std::string>::write(out, content.UncheckedGet<std::string>());
        }
        if (content.IsHolding<pxr::VtDictionary>()) {
            out.push_back(Dict);
            return writeDictionary(out, content.UncheckedGet<pxr::VtDictionary>());
        }
        if (!content.IsHolding<pxr::SdfUnregisteredValueListOp>()) return false;
        out.push_back(List);
        return writeList(out, content);
    }

    static std::optional<pxr::SdfUnregisteredValue> read(ByteReader& in) {
        const std::uint8_t kind = in.u8();
        if (kind == Text) return pxr::SdfUnregisteredValue(std::string(in.text()));
        if (kind == List) return readList(in);
        if (auto dictionary = readDictionary(in)) return pxr::SdfUnregisteredValue(*dictionary);
        return std::nullopt;
    }

private:
    static constexpr std::size_t kHeaderBytes = 11;  // header of a field in V10: type, form, size

    static bool writeList(Bytes& out, const VtValue& content) {
        auto list = encodeListOp(content);
        if (!list) return false;
        const Bytes bytes = encodeFieldValue(FieldValue(*std::move(list)));
        appendBytes(out, ByteView(bytes).subspan(kHeaderBytes));
        return true;
    }

    static std::optional<pxr::SdfUnregisteredValue> readList(ByteReader& in) {
        const ByteView body = in.take(in.left());
        Bytes field;
        appendNumber<std::uint16_t>(field, std::uint16_t(ValueType::ListOp));
        appendNumber<std::uint8_t>(field, 0);
        appendNumber<std::uint64_t>(field, body.size());
        appendBytes(field, body);
        const auto content = decodeFieldValue(field);
        if (!content) return std::nullopt;
        const auto decoded = decodeListOp(*content->as<ListOp>());
        if (!decoded) return std::nullopt;
        return pxr::SdfUnregisteredValue(decoded->UncheckedGet<pxr::SdfUnregisteredValueListOp>());
    }
};

// ------------------------------------------------------------------ arrays and their edits

template <class T>
bool writeItems(Bytes& out, const pxr::VtArray<T>& array) {
    appendNumber<std::uint64_t>(out, array.size());
    if constexpr (Plain<T>) {
        appendBytes(
            out, {reinterpret_cast<const std::uint8_t*>(array.cdata()), array.size() * sizeof(T)});
        return true;
    }
    return std::all_of(array.cbegin(), array.cend(),
                       [&](const T& item) { return Element<T>::write(out, item); });
}

template <class T>
std::optional<pxr::VtArray<T>> readItems(ByteReader& in) {
    const auto count = std::size_t(in.u64());
    pxr::VtArray<T> array;
    if constexpr (Plain<T>) {
        const ByteView bytes = in.take(count * sizeof(T));
        array.resize(count, [&](T* begin, T*) {
            std::memcpy(static_cast<void*>(begin), bytes.data(), bytes.size());
        });
    } else {
        array.reserve(count);
        for (std::size_t index = 0; index < count; ++index) {
            auto item = Element<T>::read(in);
            if (!item) return std::nullopt;
            array.push_back(*std::move(item));
        }
    }
    return array;
}

template <class T>
struct Element<pxr::VtArray<T>> {
    static constexpr ValueType kType = arrayOf(Element<T>::kType);
    static bool write(Bytes& out, const pxr::VtArray<T>& value) { return writeItems(out, value); }
    static std::optional<pxr::VtArray<T>> read(ByteReader& in) { return readItems<T>(in); }
};

template <class T>
struct Element<pxr::VtArrayEdit<T>> {
    static constexpr ValueType kType = arrayEditOf(Element<T>::kType);
    using Builder = pxr::VtArrayEditBuilder<T>;

    static bool write(Bytes& out, const pxr::VtArrayEdit<T>& value) {
        pxr::VtArray<T> literals;
        std::vector<std::int64_t> instructions;
        Builder::GetSerializationData(value, &literals, &instructions);
        if (!writeItems(out, literals)) return false;
        appendNumber<std::uint64_t>(out, instructions.size());
        for (const std::int64_t number : instructions) appendNumber<std::int64_t>(out, number);
        return true;
    }
    static std::optional<pxr::VtArrayEdit<T>> read(ByteReader& in) {
        const auto literals = readItems<T>(in);
        if (!literals) return std::nullopt;
        std::vector<std::int64_t> instructions(in.u64());
        for (auto& number : instructions) number = in.i64();
        return Builder::CreateFromSerializationData(*literals, instructions);
    }
};

// ------------------------------------------------------------------ table

template <class T>
bool writeLeaf(const VtValue& value, Bytes& out) {
    return Element<T>::write(out, value.UncheckedGet<T>());
}

/// Shares the bytes of a big value as the memory of arrays. They are deleted with the last array,
/// and an array copies them before it changes.
class SharedItems final : public pxr::Vt_ArrayForeignDataSource {
public:
    explicit SharedItems(SharedBytes bytes)
        : Vt_ArrayForeignDataSource(
              [](Vt_ArrayForeignDataSource* self) { delete static_cast<SharedItems*>(self); }),
          bytes_(std::move(bytes)) {}

private:
    const SharedBytes bytes_;
};

template <class T>
concept PlainArray = requires { typename T::ElementType; } && Plain<typename T::ElementType> &&
                     std::same_as<T, pxr::VtArray<typename T::ElementType>>;

/// Returns nothing if the bytes are not aligned for these items.
template <PlainArray Array>
std::optional<Array> share(const SharedBytes& bytes) {
    using Item = typename Array::ElementType;
    ByteReader in(*bytes);
    const auto count = std::size_t(in.u64());
    const std::uint8_t* items = in.take(count * sizeof(Item)).data();
    if (reinterpret_cast<std::uintptr_t>(items) % alignof(Item) != 0) return std::nullopt;
    auto* data = const_cast<Item*>(reinterpret_cast<const Item*>(items));
    return Array(new SharedItems(bytes), data, count);
}

/// `owner`, if set, holds exactly these bytes.
template <class T>
std::optional<VtValue> readLeaf(ByteView bytes, const SharedBytes& owner) {
    if constexpr (PlainArray<T>)
        if (auto array = owner ? share<T>(owner) : std::nullopt) return VtValue::Take(*array);
    ByteReader in(bytes);
    auto value = Element<T>::read(in);
    if (!value) return std::nullopt;
    return VtValue::Take(*value);
}

/// Returns the items of an array of numbers as they are in memory and on the wire. Empty for any
/// other value.
template <class T>
ByteView plainItems(const VtValue& value) {
    if constexpr (PlainArray<T>) {
        const auto& array = value.UncheckedGet<T>();
        return {reinterpret_cast<const std::uint8_t*>(array.cdata()),
                array.size() * sizeof(typename T::ElementType)};
    }
    return {};
}

struct LeafCodec {
    ValueType type = ValueType::None;
    bool (*write)(const VtValue& value, Bytes& out) = nullptr;
    std::optional<VtValue> (*read)(ByteView bytes, const SharedBytes& owner) = nullptr;
    ByteView (*plainItems)(const VtValue& value) = nullptr;
};

struct LeafTable {
    std::unordered_map<std::type_index, LeafCodec> byCppType;
    std::unordered_map<ValueType, LeafCodec> byType;

    template <class T>
    void add() {
        const LeafCodec codec{Element<T>::kType, &writeLeaf<T>, &readLeaf<T>, &plainItems<T>};
        byCppType.emplace(typeid(T), codec);
        byType.emplace(codec.type, codec);
    }
    template <class... T>
    void addAll() {
        (add<T>(), ...);
    }
    // Adds a scalar type of Sdf and its arrays.
    template <class T>
    void addValueType() {
        add<T>();
        if constexpr (!std::is_same_v<T, pxr::SdfOpaqueValue>)
            addAll<pxr::VtArray<T>, pxr::VtArrayEdit<T>>();
    }
};

LeafTable makeLeafTable() {
    using namespace pxr;  // Sdf's list of value types uses names without a namespace
    LeafTable table;
#define USDLIVE_ADD(unused, elem) table.addValueType<SDF_VALUE_CPP_TYPE(elem)>();
    TF_PP_SEQ_FOR_EACH(USDLIVE_ADD, ~, SDF_VALUE_TYPES)
#undef USDLIVE_ADD
    table.addAll<pxr::SdfPath, pxr::SdfValueBlock, pxr::SdfAnimationBlock, pxr::TsSpline,
                 pxr::SdfSpecifier, pxr::SdfVariability, pxr::SdfPermission,
                 std::vector<pxr::TfToken>, std::vector<std::string>, pxr::SdfReference,
                 pxr::SdfPayload, pxr::SdfUnregisteredValue, pxr::SdfLayerOffset>();
    return table;
}

const LeafTable& leafTable() {
    static const LeafTable table = makeLeafTable();
    return table;
}

template <class Key>
const LeafCodec* find(const std::unordered_map<Key, LeafCodec>& table, const Key& key) {
    const auto entry = table.find(key);
    return entry == table.end() ? nullptr : &entry->second;
}

const LeafCodec* codecFor(const VtValue& value) {
    return find<std::type_index>(leafTable().byCppType, value.GetTypeid());
}
const LeafCodec* codecFor(ValueType type) { return find(leafTable().byType, type); }

tl::unexpected<Error> unsupported(const VtValue& value, const std::string& why) {
    return fail(ErrorCode::UnsupportedValue,
                "a value of type " + value.GetTypeName() + " is not supported" + why);
}

// ------------------------------------------------------------------ dictionaries within leaves

bool writeEntry(Bytes& out, const VtValue& value, std::size_t depth) {
    const bool nested = value.IsHolding<pxr::VtDictionary>();
    const LeafCodec* codec = nested || value.IsEmpty() ? nullptr : codecFor(value);
    if (!nested && !codec) return false;
    appendNumber<std::uint16_t>(out, std::uint16_t(nested ? ValueType::Dictionary : codec->type));
    appendNumber<std::uint8_t>(out, 0);
    appendNumber<std::uint64_t>(out, 0);
    const std::size_t start = out.size();
    const bool written =
        nested ? writeDictionary(out, value.UncheckedGet<pxr::VtDictionary>(), depth + 1)
               : codec->write(value, out);
    const std::uint64_t size = out.size() - start;
    std::memcpy(out.data() + start - sizeof size, &size, sizeof size);
    return written;
}

bool writeDictionary(Bytes& out, const pxr::VtDictionary& dictionary, std::size_t depth) {
    if (depth > kMaxNesting) return false;
    appendNumber<std::uint32_t>(out, std::uint32_t(dictionary.size()));
    return std::ranges::all_of(dictionary, [&](const auto& entry) {
        appendText(out, entry.first);
        return writeEntry(out, entry.second, depth);
    });
}

std::optional<VtValue> readEntry(ByteReader& in) {
    const ValueType type{in.u16()};
    in.u8();
    const ByteView bytes = in.take(in.u64());
    if (type != ValueType::Dictionary) {
        const LeafCodec* codec = codecFor(type);
        return codec ? codec->read(bytes, nullptr) : std::nullopt;
    }
    ByteReader inner(bytes);
    auto dictionary = readDictionary(inner);
    if (!dictionary) return std::nullopt;
    return VtValue::Take(*dictionary);
}

std::optional<pxr::VtDictionary> readDictionary(ByteReader& in) {
    pxr::VtDictionary dictionary;
    for (std::uint32_t left = in.u32(); left > 0; --left) {
        const std::string key(in.text());
        auto value = readEntry(in);
        if (!value) return std::nullopt;
        dictionary[key] = *std::move(value);
    }
    return dictionary;
}

}  // namespace

// ------------------------------------------------------------------ leaves

Result<pxr::SdfPath> parsePath(std::string_view text) {
    if (text.empty()) return pxr::SdfPath();
    const std::string copy(text);
    std::string problem;
    if (!pxr::SdfPath::IsValidPathString(copy, &problem))
        return fail(ErrorCode::InvalidValue, problem);
    pxr::SdfPath path(copy);
    if (path.GetAsString() != text)
        return fail(ErrorCode::InvalidValue,
                    "the path " + copy + " is not in the form that Sdf writes");
    // Sdf makes all authored paths absolute, and writing a relative one to a binary file ends the
    // process.
    if (!path.IsAbsolutePath())
        return fail(ErrorCode::InvalidValue, "the path " + copy + " is relative");
    return path;
}

namespace {

// Returns true if the bytes give the same value everywhere. Sdf can build values that its own text
// does not preserve: a path expression with -0.0 or a line break.
bool readsBack(const LeafCodec& codec, ByteView bytes) {
    switch (ValueType(std::uint16_t(codec.type) & 0xFF)) {
        case ValueType::PathExpression:
        case ValueType::Asset:
        case ValueType::Path:
        case ValueType::Spline:
        case ValueType::Reference:
        case ValueType::Payload:
        case ValueType::Unregistered:
            break;
        default:
            return true;
    }
    const auto value = codec.read(bytes, nullptr);
    Bytes again;
    return value && codec.write(*value, again) && std::ranges::equal(bytes, again);
}

/// Encodes a big array of numbers. Hashes it in place and copies it only if the sink wants its
/// bytes. Any numbers are valid. Returns nothing for any other value.
std::optional<Value> encodeBigArray(const LeafCodec& codec, const VtValue& value, BlobSink& blobs) {
    const ByteView items = codec.plainItems(value);
    if (items.size() < kBigValueBytes || !canBeBlob(codec.type)) return std::nullopt;
    Bytes count;
    appendNumber<std::uint64_t>(count, value.GetArraySize());
    const Hash hash = sha256({count, items});
    if (blobs.wantsBlob(hash)) {
        Bytes bytes;
        bytes.reserve(count.size() + items.size());
        appendBytes(bytes, count);
        appendBytes(bytes, items);
        blobs.keepBlob(hash, std::make_shared<const Bytes>(std::move(bytes)));
    }
    return Value::blob(codec.type, hash, count.size() + items.size());
}

}  // namespace

bool areIdentical(const VtValue& left, const VtValue& right) {
    if (left != right) return false;
    const auto sameEntries = [&]<class Map>(std::in_place_type_t<Map>) {
        const auto& ours = left.UncheckedGet<Map>();
        const auto& theirs = right.UncheckedGet<Map>();
        return std::equal(ours.begin(), ours.end(), theirs.begin(), theirs.end(),
                          [](const auto& one, const auto& other) {
                              return areIdentical(VtValue(one.second), VtValue(other.second));
                          });
    };
    if (left.IsHolding<pxr::VtDictionary>())
        return sameEntries(std::in_place_type<pxr::VtDictionary>);
    if (left.IsHolding<pxr::SdfTimeSampleMap>())
        return sameEntries(std::in_place_type<pxr::SdfTimeSampleMap>);
    const LeafCodec* codec = left.IsEmpty() ? nullptr : codecFor(left);
    Bytes ours, theirs;
    return !codec || !codec->write(left, ours) || !codec->write(right, theirs) || ours == theirs;
}

Result<Value> encodeLeaf(const VtValue& value, BlobSink& blobs) {
    if (EncodedArrays* const arrays = value.IsArrayValued() ? blobs.encodedArrays() : nullptr)
        if (auto known = arrays->encoded(value)) return *std::move(known);
    const LeafCodec* codec = value.IsEmpty() ? nullptr : codecFor(value);
    if (!codec) return unsupported(value, "");
    if (auto big = encodeBigArray(*codec, value, blobs)) return *std::move(big);
    Bytes bytes;
    if (!codec->write(value, bytes)) return unsupported(value, ": a part of it is not supported");
    if (auto valid = validateValue(codec->type, bytes); !valid)
        return unsupported(value, ": " + valid.error().message);
    if (!readsBack(*codec, bytes))
        return unsupported(value, ": OpenUSD does not read back what it writes");
    if (bytes.size() >= kBigValueBytes && holdsNul(codec->type, bytes))
        return unsupported(value, ": a text in it holds a NUL, and no file keeps what comes after");
    if (bytes.size() < kBigValueBytes || !canBeBlob(codec->type))
        return Value(codec->type, std::move(bytes));
    const Hash hash = sha256(bytes);
    const std::uint64_t size = bytes.size();
    blobs.keepBlob(hash, std::make_shared<const Bytes>(std::move(bytes)));
    return Value::blob(codec->type, hash, size);
}

namespace {

Result<VtValue> decodeBytes(ValueType type, ByteView bytes, const SharedBytes& owner = nullptr) {
    if (auto valid = validateValue(type, bytes); !valid) return tl::unexpected(valid.error());
    const LeafCodec* codec = codecFor(type);
    auto value = codec ? codec->read(bytes, owner) : std::nullopt;
    if (!value)
        return fail(ErrorCode::InvalidValue,
                    "the value (" + typeName(type) + ") is not supported by this OpenUSD");
    return *std::move(value);
}

}  // namespace

Result<VtValue> decodeLeaf(const Value& value, BlobSource& blobs) {
    if (!value.isBlob()) return decodeBytes(value.type(), value.bytes());
    const SharedBytes bytes = blobs.blob(value.hash());
    if (!bytes)
        return fail(ErrorCode::BlobNotFound, "the value " + value.hash().hex() + " is missing");
    return decodeBytes(value.type(), *bytes, bytes);
}

// ------------------------------------------------------------------ list ops

namespace {

template <class T>
Result<std::vector<Value>> encodeItems(const std::vector<T>& items) {
    std::vector<Value> values;
    values.reserve(items.size());
    for (const T& item : items) {
        Bytes bytes;
        const bool written = Element<T>::write(bytes, item);
        if (!written || !validateValue(Element<T>::kType, bytes) ||
            !readsBack(*codecFor(Element<T>::kType), bytes))
            return fail(ErrorCode::UnsupportedValue, "an item of the list is not supported");
        values.emplace_back(Element<T>::kType, std::move(bytes));
    }
    return values;
}

template <class T>
Result<std::vector<T>> decodeItems(const ListItems& values) {
    std::vector<T> items;
    items.reserve(values.size());
    for (const Value& value : values) {
        const auto item = value.type() == Element<T>::kType
                              ? decodeBytes(value.type(), value.bytes())
                              : fail(ErrorCode::InvalidValue, "an item is of another type");
        if (!item) return tl::unexpected(item.error());
        items.push_back(item->template UncheckedGet<T>());
    }
    return items;
}

constexpr std::array<std::pair<ListName, pxr::SdfListOpType>, kListNames> kLists{{
    {ListName::Explicit, pxr::SdfListOpTypeExplicit},
    {ListName::Added, pxr::SdfListOpTypeAdded},
    {ListName::Prepended, pxr::SdfListOpTypePrepended},
    {ListName::Appended, pxr::SdfListOpTypeAppended},
    {ListName::Deleted, pxr::SdfListOpTypeDeleted},
    {ListName::Ordered, pxr::SdfListOpTypeOrdered},
}};

template <class T>
Result<ListOp> encodeListOpOf(const VtValue& value) {
    const auto& source = value.UncheckedGet<pxr::SdfListOp<T>>();
    ListOp list;
    list.itemType = Element<T>::kType;
    list.isExplicit = source.IsExplicit();
    for (const auto& [name, type] : kLists) {
        auto items = encodeItems<T>(source.GetItems(type));
        if (!items) return tl::unexpected(items.error());
        list[name] = *std::move(items);
    }
    return list;
}

template <class T>
Result<VtValue> decodeListOpOf(const ListOp& list) {
    pxr::SdfListOp<T> result;
    if (list.isExplicit) result.ClearAndMakeExplicit();
    for (const auto& [name, type] : kLists) {
        if (list[name].empty()) continue;
        if ((name == ListName::Explicit) != list.isExplicit)
            return fail(ErrorCode::InvalidValue, "a list has both explicit and other items");
        const auto items = decodeItems<T>(list[name]);
        if (!items) return tl::unexpected(items.error());
        result.SetItems(*items, type);
    }
    return VtValue::Take(result);
}

struct ListOpCodec {
    Result<ListOp> (*encode)(const VtValue&);
    Result<VtValue> (*decode)(const ListOp&);
};

struct ListOpTable {
    std::unordered_map<std::type_index, ListOpCodec> byCppType;
    std::unordered_map<ValueType, ListOpCodec> byItemType;

    template <class... T>
    static ListOpTable of() {
        ListOpTable table;
        (table.byCppType.emplace(typeid(pxr::SdfListOp<T>),
                                 ListOpCodec{&encodeListOpOf<T>, &decodeListOpOf<T>}),
         ...);
        (table.byItemType.emplace(Element<T>::kType,
                                  ListOpCodec{&encodeListOpOf<T>, &decodeListOpOf<T>}),
         ...);
        return table;
    }
};

const ListOpTable& listOpTable() {
    static const auto table =
        ListOpTable::of<int, unsigned int, std::int64_t, std::uint64_t, pxr::TfToken, std::string,
                        pxr::SdfPath, pxr::SdfReference, pxr::SdfPayload,
                        pxr::SdfUnregisteredValue>();
    return table;
}

}  // namespace

bool isListOp(const std::type_info& type) { return listOpTable().byCppType.contains(type); }

Result<ListOp> encodeListOp(const VtValue& value) {
    return listOpTable().byCppType.at(value.GetTypeid()).encode(value);
}

Result<VtValue> decodeListOp(const ListOp& list) {
    const auto codec = listOpTable().byItemType.find(list.itemType);
    if (codec == listOpTable().byItemType.end())
        return fail(ErrorCode::InvalidValue,
                    "Sdf has no lists with items of type " + typeName(list.itemType));
    return codec->second.decode(list);
}

}  // namespace usdlive::usd
