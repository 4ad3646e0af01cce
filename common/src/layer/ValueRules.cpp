// Checks the bytes of values and fields against V1-V10, without building them.
#include "ValueRules.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/FieldValue.h"

namespace usdlive {

namespace {

constexpr Problem kTooShort = "ends too early";
constexpr Problem kTooLong = "continues after its end";
constexpr Problem kTooDeep = "is nested too deeply";

// V4: what OpenUSD reads without filling its stack. A path has as many bytes and elements as that
// of a spec (PA1).
constexpr std::size_t kMaxValuePathBytes = 16 * 1024;
constexpr std::size_t kMaxValuePathElements = 1024;
constexpr std::size_t kMaxParentheses = 256;

constexpr std::uint16_t number(ValueType type) { return std::uint16_t(type); }
constexpr std::uint16_t kArray = number(ValueType::ArrayFlag);
constexpr std::uint16_t kArrayEdit = number(ValueType::ArrayEditFlag);

constexpr ValueType elementOf(ValueType type) {
    return ValueType(number(type) & ~(kArray | kArrayEdit));
}
constexpr bool isBetween(ValueType type, ValueType first, ValueType last) {
    return number(type) >= number(first) && number(type) <= number(last);
}
constexpr bool isTextType(ValueType type) {
    return isBetween(type, ValueType::String, ValueType::Path);
}

// Returns true for the element types of USD's arrays.
constexpr bool isElementType(ValueType type) {
    return isBetween(type, ValueType::Bool, ValueType::PathExpression) ||
           isBetween(type, ValueType::Matrix2d, ValueType::Double4);
}
constexpr bool isScalarType(ValueType type) {
    return isBetween(type, ValueType::Bool, ValueType::Opaque) ||
           isBetween(type, ValueType::Matrix2d, ValueType::Double4) ||
           isBetween(type, ValueType::Block, ValueType::LayerOffset);
}
// Returns true for the item types of Sdf's list ops, and for sublayers.
constexpr bool isItemType(ValueType type) {
    switch (type) {
        case ValueType::Int:
        case ValueType::UInt:
        case ValueType::Int64:
        case ValueType::UInt64:
        case ValueType::String:
        case ValueType::Token:
        case ValueType::Path:
        case ValueType::Reference:
        case ValueType::Payload:
        case ValueType::SubLayer:
        case ValueType::Unregistered:
            return true;
        default:
            return false;
    }
}
constexpr bool isKeyType(ValueType type) {
    return type == ValueType::String || type == ValueType::Token || type == ValueType::Path;
}

Problem problemOfPath(std::string_view path) {
    if (path.size() > kMaxValuePathBytes) return "holds a path with more than 16,384 bytes";
    const auto begins = [](char c) { return c == '/' || c == '.' || c == '{' || c == '['; };
    if (std::size_t(std::ranges::count_if(path, begins)) > kMaxValuePathElements)
        return "holds a path with more than 1,024 elements";
    return nullptr;
}

Problem problemOfExpression(std::string_view expression) {
    std::size_t open = 0;
    for (const char c : expression) {
        if (c == '(' && ++open > kMaxParentheses)
            return "holds a path expression with more than 256 open parentheses";
        if (c == ')' && open > 0) --open;
    }
    return nullptr;
}

// V2, V3: returns the size of a value of the type, or nothing if the bytes contain it.
constexpr std::optional<std::size_t> fixedSize(ValueType type) {
    switch (type) {
        case ValueType::Opaque:
        case ValueType::Block:
        case ValueType::AnimationBlock:
            return 0;
        case ValueType::Bool:
        case ValueType::UChar:
        case ValueType::Specifier:
        case ValueType::Variability:
        case ValueType::Permission:
            return 1;
        case ValueType::Half:
            return 2;
        case ValueType::Int:
        case ValueType::UInt:
        case ValueType::Float:
        case ValueType::Half2:
            return 4;
        case ValueType::Half3:
            return 6;
        case ValueType::Int64:
        case ValueType::UInt64:
        case ValueType::Double:
        case ValueType::TimeCode:
        case ValueType::Quath:
        case ValueType::Int2:
        case ValueType::Float2:
        case ValueType::Half4:
            return 8;
        case ValueType::Int3:
        case ValueType::Float3:
            return 12;
        case ValueType::Quatf:
        case ValueType::Double2:
        case ValueType::Int4:
        case ValueType::Float4:
        case ValueType::LayerOffset:
            return 16;
        case ValueType::Double3:
            return 24;
        case ValueType::Matrix2d:
        case ValueType::Quatd:
        case ValueType::Double4:
            return 32;
        case ValueType::Matrix3d:
            return 72;
        case ValueType::Matrix4d:
            return 128;
        default:
            return std::nullopt;
    }
}

// V2, V3: returns the highest valid byte of a one-byte type.
constexpr std::uint8_t highestByte(ValueType type) {
    switch (type) {
        case ValueType::Bool:
        case ValueType::Variability:
        case ValueType::Permission:
            return 1;
        case ValueType::Specifier:
            return 2;
        default:
            return 255;
    }
}

// The size arguments of an array edit may not make an array larger than this. A text counts as
// kTextBytes. Without a limit, a few bytes could use up the memory of every editor.
constexpr std::uint64_t kMaxEditedBytes = 1024UL * 1024 * 1024;
constexpr std::uint64_t kTextBytes = 32;

// The nesting of a value. Levels start again at 0 inside a leaf, so that the validity of a leaf
// does not depend on its container.
struct Nesting {
    std::size_t level = 0;  // enclosing composites
    bool inLeaf = false;

    [[nodiscard]] Nesting below() const { return {level + 1, inLeaf}; }
};

// The types that are allowed in a place, besides leaves.
struct Allowed {
    bool dictionary = false;
    bool otherComposites = false;
    bool blob = false;
    std::optional<ValueType> only = std::nullopt;
};

// Checks bytes from left to right. Each function reads from `in_` the item of its name.
class Checker {
public:
    Checker(ByteView bytes, Nesting place, bool* holdsNul = nullptr)
        : in_(bytes), place_(place), holdsNul_(holdsNul) {}

    Problem leaf(ValueType type) {
        if (!isLeafType(type)) return "has a type that is unknown or not a single value";
        if (Problem problem = leafContent(type)) return problem;
        return end();
    }
    Problem whole(Allowed allowed) {
        if (Problem problem = field(allowed)) return problem;
        return end();
    }

private:
    Problem end() const {
        if (in_.failed()) return kTooShort;
        return in_.left() > 0 ? kTooLong : nullptr;
    }

    Problem leafContent(ValueType type) {
        const ValueType element = elementOf(type);
        if (number(type) & kArray) return elements(element, nullptr);
        if (number(type) & kArrayEdit) return arrayEdit(element);
        if (isTextType(type)) return text(type);
        if (const auto size = fixedSize(type)) return fixed(type, *size);
        switch (type) {
            case ValueType::Spline:
                return spline();
            case ValueType::TokenVector:
                return texts(ValueType::Token, in_.u32());
            case ValueType::StringVector:
                return texts(ValueType::String, in_.u32());
            case ValueType::Reference:
                if (Problem problem = payload()) return problem;
                return dictionary(place_.below());
            case ValueType::Payload:
                return payload();
            case ValueType::SubLayer:
                if (Problem problem = text(ValueType::Asset)) return problem;
                return offset();
            case ValueType::Unregistered:
                return unregistered();
            default:
                return "has a type that is unknown";
        }
    }

    Problem fixed(ValueType type, std::size_t size) {
        const ByteView bytes = in_.take(size);
        if (in_.failed()) return kTooShort;
        if (size == 1 && bytes[0] > highestByte(type))
            return "holds a number its type does not have";
        return nullptr;
    }

    // V4
    Problem text(ValueType type) {
        const std::string_view text = in_.text();
        if (in_.failed()) return kTooShort;
        if (!isUtf8(text)) return "holds text that is not UTF-8";
        if (type == ValueType::String)
            noteNul(text);
        else if (text.find('\0') != std::string_view::npos)
            return "holds a NUL in a text of names";
        if (type == ValueType::Path) return problemOfPath(text);
        if (type == ValueType::PathExpression) return problemOfExpression(text);
        return nullptr;
    }

    void noteNul(std::string_view text) {
        if (holdsNul_ && text.find('\0') != std::string_view::npos) *holdsNul_ = true;
    }

    Problem texts(ValueType type, std::uint64_t count) {
        if (count > in_.left() / sizeof(std::uint32_t)) return kTooShort;
        for (; count > 0; --count)
            if (Problem problem = text(type)) return problem;
        return nullptr;
    }

    // V5
    Problem elements(ValueType type, std::uint64_t* countOut) {
        const std::uint64_t count = in_.u64();
        if (countOut) *countOut = count;
        if (isTextType(type)) return texts(type, count);
        const std::size_t size = *fixedSize(type);
        if (count > in_.left() / size) return kTooShort;
        const ByteView bytes = in_.take(count * size);
        const auto isFlag = [](std::uint8_t byte) { return byte <= 1; };
        if (type == ValueType::Bool && !std::all_of(bytes.begin(), bytes.end(), isFlag))
            return "holds a number its type does not have";
        return nullptr;
    }

    // V6. Vt itself reads past its instructions if they claim more arguments than there are.
    Problem arrayEdit(ValueType type) {
        std::uint64_t literals = 0;
        if (Problem problem = elements(type, &literals)) return problem;
        const std::uint64_t words = in_.u64();
        if (in_.failed() || words > in_.left() / sizeof(std::int64_t)) return kTooShort;
        const std::uint64_t elementBytes = isTextType(type) ? kTextBytes : *fixedSize(type);
        const std::uint64_t end = in_.left() - words * sizeof(std::int64_t);
        while (in_.left() > end)
            if (Problem problem = instruction(literals, kMaxEditedBytes / elementBytes, end))
                return problem;
        return nullptr;
    }

    // Checks one operation with the arguments of all its repetitions. `end` bytes follow the last
    // one.
    Problem instruction(std::uint64_t literals, std::uint64_t maxSize, std::uint64_t end) {
        // The kinds of arguments, numbered as Vt_ArrayEditOps.
        enum Argument { None, Literal, Index, Size };
        static constexpr Argument kArguments[][2] = {
            {Literal, Index}, {Index, Index},  {Literal, Index}, {Index, Index},  {Index, None},
            {Size, None},     {Size, Literal}, {Size, None},     {Size, Literal}, {Size, None}};

        const std::uint64_t word = in_.u64();
        const std::uint64_t operation = word >> 56;
        std::uint64_t count = word & 0x00FF'FFFF'FFFF'FFFFU;
        if (operation >= std::size(kArguments)) return "holds an array edit that is unknown";
        const auto& arguments = kArguments[operation];
        const std::uint64_t perStep = arguments[1] == None ? 8 : 16;
        if (count == 0 || count > (in_.left() - end) / perStep)
            return "holds an array edit with missing arguments";
        for (; count > 0; --count) {
            for (const Argument argument : arguments) {
                if (argument == None) continue;
                const std::uint64_t given = in_.u64();  // negative ones become large
                if (argument == Literal && given >= literals)
                    return "holds an array edit with a missing literal";
                if (argument == Size && given > maxSize)
                    return "holds an array edit that makes an array too large";
            }
        }
        return nullptr;
    }

    // V7
    Problem spline() {
        in_.take(in_.u32());
        std::uint32_t count = in_.u32();
        std::optional<double> before;
        for (; count > 0; --count) {
            if (Problem problem = time(before)) return problem;
            if (Problem problem = dictionary(place_.below())) return problem;
        }
        return nullptr;
    }

    Problem time(std::optional<double>& before) {
        const double time = in_.f64();
        if (in_.failed()) return kTooShort;
        if (!std::isfinite(time)) return "holds a time that is not finite";
        if (before && !(*before < time)) return "holds times that do not ascend";
        before = time;
        return nullptr;
    }

    // V8
    Problem payload() {
        if (Problem problem = text(ValueType::Asset)) return problem;
        if (Problem problem = text(ValueType::Path)) return problem;
        return offset();
    }
    Problem offset() {
        in_.take(2 * sizeof(double));
        return in_.failed() ? kTooShort : nullptr;
    }
    Problem unregistered() {
        switch (in_.u8()) {
            case 0:
                return in_.failed() ? kTooShort : text(ValueType::String);
            case 1:
                return dictionary(place_.below());
            case 2:
                return listOp(place_.below(), true);
            default:
                return "is unregistered and of an unknown kind";
        }
    }

    // V10: the following check encoded fields.
    Problem field(Allowed allowed) {
        const ValueType type{in_.u16()};
        const std::uint8_t form = in_.u8();
        const std::uint64_t size = in_.u64();
        if (in_.failed()) return kTooShort;
        if (allowed.only && type != *allowed.only) return "holds an item or key of another type";
        if (form == 1) return blob(type, allowed);
        if (form != 0) return "has an unknown form";
        const ByteView bytes = in_.take(size);
        if (in_.failed()) return kTooShort;
        Checker inner(bytes, innerPlace(type), holdsNul_);
        return inner.content(type, allowed);
    }

    // A leaf starts a new count of levels, unless it is inside another leaf.
    [[nodiscard]] Nesting innerPlace(ValueType type) const {
        if (place_.inLeaf || !isLeafType(type)) return place_;
        return {0, true};
    }

    Problem blob(ValueType type, const Allowed& allowed) {
        if (!allowed.blob) return "names a blob where none is allowed";
        if (!canBeBlob(type)) return "names a blob of a type that is always inline";
        in_.take(sizeof(Hash));
        return in_.failed() ? kTooShort : nullptr;
    }

    Problem content(ValueType type, const Allowed& allowed) {
        Problem problem = nullptr;
        if (isLeafType(type))
            problem = leafContent(type);
        else if (type == ValueType::Dictionary && allowed.dictionary)
            problem = dictionary(place_.below());
        else if (type == ValueType::TimeSamples && allowed.otherComposites)
            problem = timeSamples();
        else if (type == ValueType::ListOp && allowed.otherComposites)
            problem = listOp(place_.below(), false);
        else if (type == ValueType::Map && allowed.otherComposites)
            problem = map();
        else
            problem = "holds a type that is unknown or not allowed there";
        return problem ? problem : end();
    }

    // `place` is that of the dictionary, which counts as a level.
    Problem dictionary(Nesting place) {
        if (place.level > kMaxNesting) return kTooDeep;
        const Nesting outer = std::exchange(place_, place);
        std::uint32_t count = in_.u32();
        std::optional<std::string_view> before;
        for (; count > 0; --count) {
            const std::string_view key = in_.text();
            if (in_.failed()) return kTooShort;
            if (!isUtf8(key)) return "holds a key that is not UTF-8";
            noteNul(key);
            if (before && !(*before < key)) return "holds keys that do not ascend";
            before = key;
            if (Problem problem = field({.dictionary = true, .blob = !place_.inLeaf}))
                return problem;
        }
        place_ = outer;
        return in_.failed() ? kTooShort : nullptr;
    }

    Problem timeSamples() {
        std::uint64_t count = in_.u64();
        std::optional<double> before;
        for (; count > 0; --count) {
            if (Problem problem = time(before)) return problem;
            if (Problem problem = field({.blob = true})) return problem;
        }
        return nullptr;
    }

    Problem listOp(Nesting place, bool unregistered) {
        if (place.level > kMaxNesting) return kTooDeep;
        const Nesting outer = std::exchange(place_, place);
        const ValueType type{in_.u16()};
        const std::uint8_t isExplicit = in_.u8();
        if (in_.failed()) return kTooShort;
        if (unregistered ? type != ValueType::Unregistered : !isItemType(type))
            return "is a list with an item type that no list has";
        if (isExplicit > 1) return "has an invalid flag for an explicit list";
        for (std::size_t list = 0; list < kListNames; ++list) {
            std::uint32_t count = in_.u32();
            const bool isOpen = (ListName(list) == ListName::Explicit) == (isExplicit == 1);
            if (count > 0 && !isOpen) return "is an explicit list with items of other lists";
            for (; count > 0; --count)
                if (Problem problem = field({.only = type})) return problem;
        }
        place_ = outer;
        return in_.failed() ? kTooShort : nullptr;
    }

    Problem map() {
        const ValueType type{in_.u16()};
        if (!isKeyType(type)) return "is a map with a key type that no map has";
        std::uint32_t count = in_.u32();
        // Grows with the bytes read, not with the claimed count.
        std::vector<std::string_view> keys;
        for (; count > 0; --count) {
            ByteReader ahead = in_;
            if (Problem problem = field({.only = type})) return problem;
            ahead.take(kHeaderBytes);
            keys.push_back(ahead.text());
            if (Problem problem = field({.blob = true})) return problem;
        }
        std::sort(keys.begin(), keys.end());
        if (std::adjacent_find(keys.begin(), keys.end()) != keys.end())
            return "is a map with a duplicate key";
        return nullptr;
    }

    static constexpr std::size_t kHeaderBytes = 11;  // type, form, size

    ByteReader in_;
    Nesting place_;
    bool* const holdsNul_;
};

constexpr const char* kNames[] = {
    "None",   "Bool",    "UChar",    "Int",    "UInt",     "Int64",    "UInt64",         "Half",
    "Float",  "Double",  "TimeCode", "String", "Token",    "Asset",    "PathExpression", "Path",
    "Opaque", nullptr,   nullptr,    nullptr,  "Matrix2d", "Matrix3d", "Matrix4d",       "Quath",
    "Quatf",  "Quatd",   "Int2",     "Half2",  "Float2",   "Double2",  "Int3",           "Half3",
    "Float3", "Double3", "Int4",     "Half4",  "Float4",   "Double4",
};
constexpr const char* kOtherNames[] = {
    "Block",      "AnimationBlock", "Spline",       "Specifier", "Variability",
    "Permission", "TokenVector",    "StringVector", "Reference", "Payload",
    "SubLayer",   "Unregistered",   "LayerOffset",
};
constexpr const char* kCompositeNames[] = {"Dictionary", "TimeSamples", "ListOp", "Map"};

const char* baseName(ValueType type) {
    const std::size_t at = number(type);
    const auto in = [&](const auto& names, ValueType first) -> const char* {
        const std::size_t index = at - number(first);  // huge if below `first`
        return index < std::size(names) ? names[index] : nullptr;
    };
    if (const char* name = in(kNames, ValueType::None)) return name;
    if (const char* name = in(kOtherNames, ValueType::Block)) return name;
    return in(kCompositeNames, ValueType::Dictionary);
}

}  // namespace

Problem problemOfLeaf(ValueType type, ByteView bytes, bool* holdsNul) {
    return Checker(bytes, {0, true}, holdsNul).leaf(type);
}

Problem problemOfField(ByteView bytes) {
    return Checker(bytes, {}).whole({.dictionary = true, .otherComposites = true, .blob = true});
}

bool isLeafType(ValueType type) {
    const std::uint16_t flags = number(type) & (kArray | kArrayEdit);
    if (flags == 0) return isScalarType(type);
    return flags != (kArray | kArrayEdit) && isElementType(elementOf(type));
}

bool canBeBlob(ValueType type) {
    if (!isLeafType(type)) return false;
    return elementOf(type) != type || isTextType(type) || type == ValueType::Spline;
}

std::string typeName(ValueType type) {
    const std::uint16_t flags = number(type) & (kArray | kArrayEdit);
    const char* base = baseName(elementOf(type));
    if (!base || (flags != 0 && !isLeafType(type))) return "type " + std::to_string(number(type));
    return std::string(base) + (flags == kArray ? "[]" : flags == kArrayEdit ? "[edit]" : "");
}

}  // namespace usdlive
