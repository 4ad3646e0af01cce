// Makes random values.
#pragma once

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/FieldValue.h"

namespace usdlive {

/// Returns all types that a leaf may have.
inline std::vector<ValueType> allLeafTypes() {
    std::vector<ValueType> types;
    for (std::uint32_t number = 0; number <= 0xFFFF; ++number)
        if (isLeafType(ValueType(number))) types.push_back(ValueType(number));
    return types;
}

/// Random valid values of any type, from a seed.
class RandomValue {
public:
    explicit RandomValue(unsigned seed) : random_(seed) {}

    std::uint32_t below(std::uint32_t end) { return random_() % end; }

    std::string text() {
        static constexpr std::string_view kParts[] = {
            "a",      "B", "/", ".", ":", " ", "\xC3\xA4", "\xE2\x82\xAC", "\xF0\x9F\x98\x80",
            "longer_"};
        std::string out;
        for (auto left = below(8); left > 0; --left) out += kParts[below(std::size(kParts))];
        return out;
    }

    Bytes leafBytes(ValueType type, unsigned depth = 3) {
        Bytes out;
        const auto number = std::uint16_t(type);
        const auto element = ValueType(number & 0xFF);
        if (number & 0x300) {
            const std::uint32_t count = below(4);
            elements(out, element, count);
            if (number & 0x200) instructions(out, count);
            return out;
        }
        scalar(out, type, depth);
        return out;
    }

    Value leaf(ValueType type) { return {type, leafBytes(type)}; }

    Value leaf() {
        static const std::vector<ValueType> kTypes = allLeafTypes();
        return leaf(kTypes[below(std::uint32_t(kTypes.size()))]);
    }

    Value leafOrBlob() {
        const Value value = leaf();
        if (!canBeBlob(value.type()) || below(2) == 0) return value;
        return Value::blob(value.type(), sha256(value.bytes()), value.size());
    }

    Dictionary dictionary(unsigned depth = 3, bool blobs = true) {
        Dictionary out;
        for (auto left = below(4); left > 0; --left) {
            if (depth > 0 && below(3) == 0)
                out.entries.insert_or_assign(text(), dictionary(depth - 1, blobs));
            else
                out.entries.insert_or_assign(text(), blobs ? leafOrBlob() : plainLeaf());
        }
        return out;
    }

    TimeSamples timeSamples() {
        TimeSamples out;
        double time = -double(below(1000));
        for (auto left = below(5); left > 0; --left) {
            out.samples.emplace(time, leafOrBlob());
            time += 0.25 + below(9);
        }
        return out;
    }

    ListOp listOp() {
        static constexpr ValueType kTypes[] = {
            ValueType::Int,     ValueType::UInt,     ValueType::Int64,       ValueType::UInt64,
            ValueType::String,  ValueType::Token,    ValueType::Path,        ValueType::Reference,
            ValueType::Payload, ValueType::SubLayer, ValueType::Unregistered};
        return listOpOf(kTypes[below(std::size(kTypes))], 3);
    }

    Map map() {
        static constexpr ValueType kTypes[] = {ValueType::String, ValueType::Token,
                                               ValueType::Path};
        Map out;
        out.keyType = kTypes[below(std::size(kTypes))];
        for (auto left = below(5); left > 0; --left) {
            const Value key = leaf(out.keyType);
            const auto isKey = [&](const auto& entry) { return entry.first == key; };
            if (std::ranges::none_of(out.entries, isKey))
                out.entries.emplace_back(key, leafOrBlob());
        }
        return out;
    }

    FieldValue field() {
        switch (below(5)) {
            case 0:
                return leafOrBlob();
            case 1:
                return dictionary();
            case 2:
                return timeSamples();
            case 3:
                return listOp();
            default:
                return map();
        }
    }

private:
    void elements(Bytes& out, ValueType element, std::uint32_t count) {
        appendNumber<std::uint64_t>(out, count);
        for (; count > 0; --count) scalar(out, element, 0);
    }

    void instructions(Bytes& out, std::uint32_t literals) {
        std::vector<std::uint64_t> words;
        for (auto left = below(4); left > 0; --left) {
            const std::uint64_t count = 1 + below(2);
            // erase [index], write [index] to [index], resize size, write literal to [index]
            switch (below(literals > 0 ? 4 : 3)) {
                case 0:
                    words.push_back(4ULL << 56 | count);
                    words.insert(words.end(), count, below(9));
                    break;
                case 1:
                    words.push_back(1ULL << 56 | count);
                    words.insert(words.end(), 2 * count, std::uint64_t(-1));
                    break;
                case 2:
                    words.push_back(7ULL << 56 | count);
                    words.insert(words.end(), count, below(100));
                    break;
                default:
                    words.push_back(0ULL << 56 | count);
                    words.insert(words.end(), 2 * count, below(literals));
            }
        }
        appendNumber<std::uint64_t>(out, words.size());
        for (const auto word : words) appendNumber<std::uint64_t>(out, word);
    }

    void any(Bytes& out, std::size_t count) {
        for (; count > 0; --count) out.push_back(std::uint8_t(random_()));
    }

    void scalar(Bytes& out, ValueType type, unsigned depth) {
        switch (type) {
            case ValueType::Opaque:
            case ValueType::Block:
            case ValueType::AnimationBlock:
                return;
            case ValueType::Bool:
            case ValueType::Variability:
            case ValueType::Permission:
                return out.push_back(std::uint8_t(below(2)));
            case ValueType::Specifier:
                return out.push_back(std::uint8_t(below(3)));
            case ValueType::UChar:
                return any(out, 1);
            case ValueType::Half:
                return any(out, 2);
            case ValueType::Int:
            case ValueType::UInt:
            case ValueType::Float:
            case ValueType::Half2:
                return any(out, 4);
            case ValueType::Half3:
                return any(out, 6);
            case ValueType::Int64:
            case ValueType::UInt64:
            case ValueType::Double:
            case ValueType::TimeCode:
            case ValueType::Quath:
            case ValueType::Int2:
            case ValueType::Float2:
            case ValueType::Half4:
                return any(out, 8);
            case ValueType::Int3:
            case ValueType::Float3:
                return any(out, 12);
            case ValueType::Quatf:
            case ValueType::Double2:
            case ValueType::Int4:
            case ValueType::Float4:
            case ValueType::LayerOffset:
                return any(out, 16);
            case ValueType::Double3:
                return any(out, 24);
            case ValueType::Matrix2d:
            case ValueType::Quatd:
            case ValueType::Double4:
                return any(out, 32);
            case ValueType::Matrix3d:
                return any(out, 72);
            case ValueType::Matrix4d:
                return any(out, 128);
            case ValueType::TokenVector:
            case ValueType::StringVector: {
                const std::uint32_t count = below(4);
                appendNumber<std::uint32_t>(out, count);
                for (std::uint32_t index = 0; index < count; ++index) appendText(out, text());
                return;
            }
            case ValueType::Spline:
                return spline(out, depth);
            case ValueType::Reference:
            case ValueType::Payload:
                appendText(out, text());
                appendText(out, text());
                any(out, 16);
                if (type == ValueType::Reference) dictionaryBody(out, depth);
                return;
            case ValueType::SubLayer:
                appendText(out, text());
                return any(out, 16);
            case ValueType::Unregistered:
                return unregistered(out, depth);
            default:
                return appendText(out, text());
        }
    }

    void spline(Bytes& out, unsigned depth) {
        const std::uint32_t size = below(20), count = below(3);
        appendNumber<std::uint32_t>(out, size);
        any(out, size);
        appendNumber<std::uint32_t>(out, count);
        for (std::uint32_t index = 0; index < count; ++index) {
            appendNumber<double>(out, index * 1.5);
            dictionaryBody(out, depth);
        }
    }

    // Appends the body of an encoded composite, which follows its header of 11 bytes.
    void body(Bytes& out, const FieldValue& composite) {
        const Bytes encoded = encodeFieldValue(composite);
        appendBytes(out, ByteView(encoded).subspan(11));
    }
    void dictionaryBody(Bytes& out, unsigned depth) {
        body(out, depth > 0 ? dictionary(depth - 1, false) : Dictionary{});
    }
    void unregistered(Bytes& out, unsigned depth) {
        const auto kind = std::uint8_t(depth > 0 ? below(3) : 0);
        out.push_back(kind);
        if (kind == 0) return appendText(out, text());
        if (kind == 1) return dictionaryBody(out, depth);
        body(out, listOpOf(ValueType::Unregistered, depth - 1));
    }

    // Returns a value of a type that contains no dictionary, so that the nesting ends.
    Value plainLeaf() {
        static constexpr ValueType kTypes[] = {
            ValueType::Double,          ValueType::String,         ValueType::Bool,
            arrayOf(ValueType::Float3), arrayOf(ValueType::Token), ValueType::Matrix4d};
        return leaf(kTypes[below(std::size(kTypes))]);
    }

    ListOp listOpOf(ValueType type, unsigned depth) {
        ListOp out;
        out.itemType = type;
        out.isExplicit = below(2) == 1;
        for (std::size_t list = 0; list < kListNames; ++list) {
            if ((list == 0) != out.isExplicit) continue;
            for (auto left = below(3); left > 0; --left)
                out.lists[list].emplace_back(type, leafBytes(type, depth));
        }
        return out;
    }

    std::mt19937 random_;
};

}  // namespace usdlive
