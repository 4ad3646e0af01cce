// Converts metadata that was read as text to the type that a plug-in declares.
#include "RegisteredMetadata.h"

#include <pxr/base/gf/half.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <optional>
#include <string_view>
#include <vector>

#include "LeafCodec.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/NoBlobs.h"

namespace usdlive::usd {

using pxr::VtValue;

namespace {

// The number type of a value, the count of its numbers, and the number of tuples in its text.
struct Shape {
    ValueType number = ValueType::None;
    int count = 1;
    int rows = 1;
};

Shape shapeOf(ValueType type) {
    using enum ValueType;
    switch (type) {
        case Int2:
        case Int3:
        case Int4:
            return {Int, type == Int2 ? 2 : type == Int3 ? 3 : 4};
        case Half2:
        case Half3:
        case Half4:
            return {Half, type == Half2 ? 2 : type == Half3 ? 3 : 4};
        case Float2:
        case Float3:
        case Float4:
            return {Float, type == Float2 ? 2 : type == Float3 ? 3 : 4};
        case Double2:
        case Double3:
        case Double4:
            return {Double, type == Double2 ? 2 : type == Double3 ? 3 : 4};
        case Quath:
            return {Half, 4};
        case Quatf:
            return {Float, 4};
        case Quatd:
            return {Double, 4};
        case Matrix2d:
            return {Double, 2, 2};
        case Matrix3d:
            return {Double, 3, 3};
        case Matrix4d:
            return {Double, 4, 4};
        default:
            return {type};
    }
}

// Reads values of the text format and writes them as the bytes of V1-V6.
class ValueText {
public:
    explicit ValueText(std::string_view text) : rest_(text) {}

    [[nodiscard]] std::optional<Bytes> read(ValueType type) {
        const auto number = std::uint16_t(type), array = std::uint16_t(ValueType::ArrayFlag);
        const ValueType element{std::uint16_t(number & ~array)};
        Bytes out;
        const bool done = (number & array) != 0 ? readArray(element, out) : readItem(element, out);
        skipSpace();
        if (!done || !rest_.empty()) return std::nullopt;
        return out;
    }

    /// Reads items separated by commas, with or without brackets: one value each.
    [[nodiscard]] std::optional<std::vector<Bytes>> readItems(ValueType type) {
        std::vector<Bytes> items;
        const bool bracketed = take('[');
        skipSpace();
        while (!rest_.empty() && !(bracketed && rest_.front() == ']')) {
            if (!readItem(type, items.emplace_back())) return std::nullopt;
            if (!take(',')) break;
            skipSpace();
        }
        if (bracketed && !take(']')) return std::nullopt;
        skipSpace();
        if (!rest_.empty()) return std::nullopt;
        return items;
    }

private:
    void skipSpace() {
        while (!rest_.empty() && std::isspace(static_cast<unsigned char>(rest_.front())))
            rest_.remove_prefix(1);
    }
    bool take(char expected) {
        skipSpace();
        if (!rest_.starts_with(expected)) return false;
        rest_.remove_prefix(1);
        return true;
    }

    bool readArray(ValueType element, Bytes& out) {
        appendNumber<std::uint64_t>(out, 0);
        std::uint64_t count = 0;
        if (!take('[')) return false;
        while (!take(']')) {
            if (!readItem(element, out)) return false;
            ++count;
            if (!take(',')) {
                if (!take(']')) return false;
                break;
            }
        }
        std::memcpy(out.data(), &count, sizeof count);
        return true;
    }

    bool readItem(ValueType type, Bytes& out) {
        const Shape shape = shapeOf(type);
        if (shape.count == 1) return readScalar(type, out);
        if (shape.rows == 1) {
            const std::size_t start = out.size();
            if (!readTuple(shape, out)) return false;
            // The text of a quaternion has the real number first.
            const bool quaternion = type >= ValueType::Quath && type <= ValueType::Quatd;
            const auto begin = out.begin() + std::ptrdiff_t(start);
            if (quaternion)
                std::rotate(begin, begin + std::ptrdiff_t((out.size() - start) / 4), out.end());
            return true;
        }
        if (!take('(')) return false;
        for (int row = 0; row < shape.rows; ++row)
            if ((row > 0 && !take(',')) || !readTuple(shape, out)) return false;
        return take(')');
    }
    bool readTuple(const Shape& shape, Bytes& out) {
        if (!take('(')) return false;
        for (int at = 0; at < shape.count; ++at)
            if ((at > 0 && !take(',')) || !readScalar(shape.number, out)) return false;
        return take(')');
    }

    bool readScalar(ValueType type, Bytes& out) {
        using enum ValueType;
        switch (type) {
            case Bool:
                return readBool(out);
            case UChar:
                return readWhole<std::uint8_t>(out);
            case Int:
                return readWhole<std::int32_t>(out);
            case UInt:
                return readWhole<std::uint32_t>(out);
            case Int64:
                return readWhole<std::int64_t>(out);
            case UInt64:
                return readWhole<std::uint64_t>(out);
            case Half:
                return readReal<pxr::GfHalf>(out);
            case Float:
                return readReal<float>(out);
            case Double:
            case TimeCode:
                return readReal<double>(out);
            case String:
            case Token:
                return readString(out);
            case Asset:
                return readAsset(out);
            default:
                return false;
        }
    }

    std::string_view takeWord() {
        skipSpace();
        const auto end = std::min(rest_.find_first_of(",()[] \t\r\n"), rest_.size());
        const std::string_view word = rest_.substr(0, end);
        rest_.remove_prefix(end);
        return word;
    }
    bool readBool(Bytes& out) {
        const std::string_view word = takeWord();
        const bool yes = word == "1" || word == "true";
        out.push_back(yes ? 1 : 0);
        return yes || word == "0" || word == "false";
    }
    template <class T>
    bool readWhole(Bytes& out) {
        const std::string_view word = takeWord();
        T number{};
        const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), number);
        appendNumber<T>(out, number);
        return problem == std::errc() && end == word.data() + word.size();
    }
    template <class T>
    bool readReal(Bytes& out) {
        const std::string_view word = takeWord();
        double number{};
        const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), number);
        if constexpr (std::same_as<T, pxr::GfHalf>)
            appendNumber<std::uint16_t>(out, pxr::GfHalf(float(number)).bits());
        else
            appendNumber<T>(out, T(number));
        return problem == std::errc() && end == word.data() + word.size();
    }

    // Reads text in one or three quotation marks of either kind.
    bool readString(Bytes& out) {
        skipSpace();
        if (!rest_.starts_with('"') && !rest_.starts_with('\'')) return false;
        const std::string three(3, rest_.front());
        const std::string quote = rest_.starts_with(three) ? three : three.substr(0, 1);
        rest_.remove_prefix(quote.size());
        std::size_t end = 0;
        while (!rest_.substr(end).starts_with(quote)) {
            if (end >= rest_.size()) return false;
            end += rest_[end] == '\\' ? 2 : 1;
        }
        appendText(out, pxr::TfEscapeString(std::string(rest_.substr(0, end))));
        rest_.remove_prefix(end + quote.size());
        return true;
    }
    // Reads text between `@` or `@@@`; a backslash escapes an inner `@@@`.
    bool readAsset(Bytes& out) {
        constexpr std::string_view kThree = "@@@";
        skipSpace();
        const bool three = rest_.starts_with(kThree);
        if (!rest_.starts_with('@')) return false;
        const std::string_view mark = kThree.substr(0, three ? 3 : 1);
        rest_.remove_prefix(mark.size());
        auto end = rest_.find(mark);
        while (three && end != std::string_view::npos && end > 0 && rest_[end - 1] == '\\')
            end = rest_.find(mark, end + mark.size());
        if (end == std::string_view::npos) return false;
        const std::string text(rest_.substr(0, end));
        appendText(out, three ? pxr::TfStringReplace(text, "\\@@@", "@@@") : text);
        rest_.remove_prefix(end + mark.size());
        return true;
    }

    std::string_view rest_;
};

std::optional<VtValue> decode(ValueType type, Bytes bytes) {
    NoBlobs none;
    auto value = decodeLeaf(Value(type, std::move(bytes)), none);
    if (!value) return std::nullopt;
    return *std::move(value);
}

std::optional<VtValue> parse(const std::string& text, ValueType type) {
    auto bytes = ValueText(text).read(type);
    return bytes ? decode(type, *std::move(bytes)) : std::nullopt;
}

const std::string* textIn(const pxr::SdfUnregisteredValue& value) {
    const VtValue& content = value.GetValue();
    return content.IsHolding<std::string>() ? &content.UncheckedGet<std::string>() : nullptr;
}

template <class T>
std::optional<VtValue> listOf(const VtValue& content, ValueType itemType) {
    const auto& source = content.UncheckedGet<pxr::SdfUnregisteredValueListOp>();
    pxr::SdfListOp<T> list;
    if (source.IsExplicit()) list.ClearAndMakeExplicit();
    for (const auto type :
         {pxr::SdfListOpTypeExplicit, pxr::SdfListOpTypeAdded, pxr::SdfListOpTypePrepended,
          pxr::SdfListOpTypeAppended, pxr::SdfListOpTypeDeleted, pxr::SdfListOpTypeOrdered}) {
        std::vector<T> items;
        // Sdf keeps the text of a whole list as one item.
        for (const auto& texts : source.GetItems(type)) {
            const std::string* text = textIn(texts);
            auto read = text ? ValueText(*text).readItems(itemType) : std::nullopt;
            if (!read) return std::nullopt;
            for (Bytes& item : *read) {
                const auto value = decode(itemType, std::move(item));
                if (!value) return std::nullopt;
                items.push_back(value->UncheckedGet<T>());
            }
        }
        if (!items.empty()) list.SetItems(items, type);
    }
    return VtValue::Take(list);
}

std::optional<VtValue> listAs(const VtValue& content, const VtValue& declared) {
    if (declared.IsHolding<pxr::SdfTokenListOp>())
        return listOf<pxr::TfToken>(content, ValueType::Token);
    if (declared.IsHolding<pxr::SdfStringListOp>())
        return listOf<std::string>(content, ValueType::String);
    if (declared.IsHolding<pxr::SdfIntListOp>()) return listOf<int>(content, ValueType::Int);
    if (declared.IsHolding<pxr::SdfUIntListOp>())
        return listOf<unsigned int>(content, ValueType::UInt);
    if (declared.IsHolding<pxr::SdfInt64ListOp>())
        return listOf<std::int64_t>(content, ValueType::Int64);
    if (declared.IsHolding<pxr::SdfUInt64ListOp>())
        return listOf<std::uint64_t>(content, ValueType::UInt64);
    return std::nullopt;
}

std::optional<VtValue> readAs(const VtValue& content, const VtValue& declared) {
    if (content.IsHolding<pxr::VtDictionary>())
        return declared.IsHolding<pxr::VtDictionary>() ? std::optional(content) : std::nullopt;
    if (content.IsHolding<pxr::SdfUnregisteredValueListOp>()) return listAs(content, declared);
    if (!content.IsHolding<std::string>() || declared.IsEmpty()) return std::nullopt;
    // The text alone does not distinguish an explicit list from an array.
    const pxr::SdfUnregisteredValue text(content.UncheckedGet<std::string>());
    if (auto list =
            listAs(VtValue(pxr::SdfUnregisteredValueListOp::CreateExplicit({text})), declared))
        return list;
    NoBlobs none;
    const auto encoded = encodeLeaf(declared, none);
    return encoded ? parse(content.UncheckedGet<std::string>(), encoded->type()) : std::nullopt;
}

// Returns the default of a metadata field that is declared for specs as at `path`. Empty if it is
// not declared.
VtValue declaredDefault(const pxr::SdfPath& path, const pxr::TfToken& field) {
    const auto& schema = pxr::SdfSchema::GetInstance();
    const auto declares = [&](pxr::SdfSpecType type) {
        const auto* spec = schema.GetSpecDefinition(type);
        return spec && spec->IsMetadataField(field);
    };
    const bool declared = path.IsAbsoluteRootPath() ? declares(pxr::SdfSpecTypePseudoRoot)
                          : path.IsPropertyPath()   ? declares(pxr::SdfSpecTypeAttribute) ||
                                                        declares(pxr::SdfSpecTypeRelationship)
                          : path.IsPrimVariantSelectionPath() ? declares(pxr::SdfSpecTypeVariant)
                                                              : declares(pxr::SdfSpecTypePrim);
    return declared ? schema.GetFallback(field) : VtValue();
}

}  // namespace

VtValue asRegistered(const pxr::SdfPath& path, const pxr::TfToken& field, VtValue value) {
    if (!value.IsHolding<pxr::SdfUnregisteredValue>()) return value;
    const VtValue declared = declaredDefault(path, field);
    if (declared.IsEmpty()) return value;
    auto read = readAs(value.UncheckedGet<pxr::SdfUnregisteredValue>().GetValue(), declared);
    return read ? *std::move(read) : value;
}

}  // namespace usdlive::usd
