// Encodes and decodes the content of a field (V10), and finds the blobs in it.
#include "usdlive/common/layer/FieldValue.h"

#include <algorithm>
#include <cstring>

#include "FieldLeaves.h"
#include "ValueRules.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

enum class Form : std::uint8_t { Inline = 0, Blob = 1 };

// ---- Writing

void appendHeader(Bytes& out, ValueType type, Form form, std::uint64_t size) {
    appendNumber<std::uint16_t>(out, std::uint16_t(type));
    appendNumber<std::uint8_t>(out, std::uint8_t(form));
    appendNumber<std::uint64_t>(out, size);
}

void append(Bytes& out, const Value& value) {
    appendHeader(out, value.type(), value.isBlob() ? Form::Blob : Form::Inline, value.size());
    appendBytes(out, value.isBlob() ? ByteView(value.hash().bytes) : value.bytes());
}

void appendBody(Bytes& out, const Dictionary& dictionary);
void appendBody(Bytes& out, const TimeSamples& samples);
void appendBody(Bytes& out, const ListOp& listOp);
void appendBody(Bytes& out, const Map& map);

// Appends a composite value. Its size is patched in afterwards.
template <class T>
void append(Bytes& out, ValueType type, const T& composite) {
    appendHeader(out, type, Form::Inline, 0);
    const std::size_t start = out.size();
    appendBody(out, composite);
    const std::uint64_t size = out.size() - start;
    std::memcpy(out.data() + start - sizeof size, &size, sizeof size);
}
void append(Bytes& out, const Dictionary& value) { append(out, ValueType::Dictionary, value); }
void append(Bytes& out, const TimeSamples& value) { append(out, ValueType::TimeSamples, value); }
void append(Bytes& out, const ListOp& value) { append(out, ValueType::ListOp, value); }
void append(Bytes& out, const Map& value) { append(out, ValueType::Map, value); }

void appendBody(Bytes& out, const Dictionary& dictionary) {
    appendNumber<std::uint32_t>(out, std::uint32_t(dictionary.entries.size()));
    for (const auto& [key, entry] : dictionary.entries) {
        appendText(out, key);
        std::visit([&](const auto& content) { append(out, content); }, entry);
    }
}

void appendBody(Bytes& out, const TimeSamples& samples) {
    appendNumber<std::uint64_t>(out, samples.samples.size());
    for (const auto& [time, value] : samples.samples) {
        appendNumber<double>(out, time);
        append(out, value);
    }
}

void appendBody(Bytes& out, const ListOp& listOp) {
    appendNumber<std::uint16_t>(out, std::uint16_t(listOp.itemType));
    appendNumber<std::uint8_t>(out, listOp.isExplicit ? 1 : 0);
    for (const auto& list : listOp.lists) {
        appendNumber<std::uint32_t>(out, std::uint32_t(list.size()));
        for (const Value& item : list) append(out, item);
    }
}

void appendBody(Bytes& out, const Map& map) {
    appendNumber<std::uint16_t>(out, std::uint16_t(map.keyType));
    appendNumber<std::uint32_t>(out, std::uint32_t(map.entries.size()));
    for (const auto& [key, value] : map.entries) {
        append(out, key);
        append(out, value);
    }
}

// ---- Reading bytes that problemOfField() has accepted

struct Header {
    ValueType type;
    Form form;
    std::uint64_t size;
};

Header readHeader(ByteReader& in) {
    const ValueType type{in.u16()};
    const Form form{in.u8()};
    return {type, form, in.u64()};
}

Value readLeaf(ByteReader& in, const Header& header) {
    if (header.form == Form::Inline) return {header.type, in.take(header.size)};
    Hash hash;
    std::ranges::copy(in.take(hash.bytes.size()), hash.bytes.begin());
    return Value::blob(header.type, hash, header.size);
}
Value readLeaf(ByteReader& in) {
    const Header header = readHeader(in);
    return readLeaf(in, header);
}

Dictionary readDictionary(ByteReader& in) {
    Dictionary dictionary;
    for (std::uint32_t left = in.u32(); left > 0; --left) {
        std::string key(in.text());
        const Header header = readHeader(in);
        Dictionary::Entry entry = header.type == ValueType::Dictionary
                                      ? Dictionary::Entry(readDictionary(in))
                                      : Dictionary::Entry(readLeaf(in, header));
        dictionary.entries.emplace_hint(dictionary.entries.end(), std::move(key), std::move(entry));
    }
    return dictionary;
}

TimeSamples readTimeSamples(ByteReader& in) {
    TimeSamples samples;
    for (std::uint64_t left = in.u64(); left > 0; --left) {
        const double time = in.f64();
        samples.samples.emplace_hint(samples.samples.end(), time, readLeaf(in));
    }
    return samples;
}

ListOp readListOp(ByteReader& in) {
    ListOp listOp;
    listOp.itemType = ValueType{in.u16()};
    listOp.isExplicit = in.u8() == 1;
    for (auto& list : listOp.lists)
        for (std::uint32_t left = in.u32(); left > 0; --left) list.push_back(readLeaf(in));
    return listOp;
}

Map readMap(ByteReader& in) {
    Map map;
    map.keyType = ValueType{in.u16()};
    for (std::uint32_t left = in.u32(); left > 0; --left) {
        Value key = readLeaf(in);
        map.entries.emplace_back(std::move(key), readLeaf(in));
    }
    return map;
}

FieldValue readField(ByteReader& in) {
    const Header header = readHeader(in);
    switch (header.type) {
        case ValueType::Dictionary:
            return readDictionary(in);
        case ValueType::TimeSamples:
            return readTimeSamples(in);
        case ValueType::ListOp:
            return readListOp(in);
        case ValueType::Map:
            return readMap(in);
        default:
            return readLeaf(in, header);
    }
}

// ---- Walking

using Visit = std::function<void(const Value&)>;

void visitLeaves(const Value& value, const Visit& visit) { visit(value); }
void visitLeaves(const Dictionary& dictionary, const Visit& visit) {
    for (const auto& [key, entry] : dictionary.entries)
        std::visit([&](const auto& content) { visitLeaves(content, visit); }, entry);
}
void visitLeaves(const TimeSamples& samples, const Visit& visit) {
    for (const auto& [time, value] : samples.samples) visit(value);
}
void visitLeaves(const ListOp& listOp, const Visit& visit) {
    for (const auto& list : listOp.lists)
        for (const Value& item : list) visit(item);
}
void visitLeaves(const Map& map, const Visit& visit) {
    for (const auto& [key, value] : map.entries) {
        visit(key);
        visit(value);
    }
}

struct TypeOf {
    ValueType operator()(const Value& value) const { return value.type(); }
    ValueType operator()(const Dictionary&) const { return ValueType::Dictionary; }
    ValueType operator()(const TimeSamples&) const { return ValueType::TimeSamples; }
    ValueType operator()(const ListOp&) const { return ValueType::ListOp; }
    ValueType operator()(const Map&) const { return ValueType::Map; }
};

}  // namespace

ValueType FieldValue::type() const { return visit(TypeOf{}); }

Value itemKey(const Value& item) {
    if (item.type() != ValueType::SubLayer) return item;
    ByteReader in(item.bytes());
    const std::string_view path = in.text();
    return {ValueType::Asset, item.bytes().first(sizeof(std::uint32_t) + path.size())};
}

std::size_t nesting(const Dictionary& dictionary) {
    std::size_t below = 0;
    for (const auto& [key, entry] : dictionary.entries)
        if (const auto* inner = std::get_if<Dictionary>(&entry))
            below = std::max(below, nesting(*inner));
    return below + 1;
}

void encodeFieldValue(const FieldValue& value, Bytes& out) {
    value.visit([&](const auto& content) { append(out, content); });
}

Bytes encodeFieldValue(const FieldValue& value) {
    Bytes out;
    encodeFieldValue(value, out);
    return out;
}

Result<FieldValue> decodeFieldValue(ByteView bytes) {
    if (Problem problem = problemOfField(bytes))
        return fail(ErrorCode::InvalidValue, std::string("the field's content ") + problem);
    ByteReader in(bytes);
    return readField(in);
}

void forEachLeaf(const FieldValue& field, const Visit& visit) {
    field.visit([&](const auto& content) { visitLeaves(content, visit); });
}

void forEachBlob(const FieldValue& value, const Visit& visit) {
    forEachLeaf(value, [&](const Value& leaf) {
        if (leaf.isBlob()) visit(leaf);
    });
}

}  // namespace usdlive
