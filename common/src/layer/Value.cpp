// Holds the bytes or the blob name of a value, and names its type.
#include "usdlive/common/layer/Value.h"

#include <algorithm>
#include <cstring>

#include "ValueRules.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

std::strong_ordering compare(ByteView left, ByteView right) {
    const std::size_t shared = std::min(left.size(), right.size());
    if (shared > 0)
        if (const int order = std::memcmp(left.data(), right.data(), shared); order != 0)
            return order <=> 0;
    return left.size() <=> right.size();
}

Value textValue(ValueType type, std::string_view text) {
    Bytes bytes;
    bytes.reserve(sizeof(std::uint32_t) + text.size());
    appendText(bytes, text);
    return {type, std::move(bytes)};
}

}  // namespace

static_assert(sizeof(Value) <= 40);

Value::Value(ValueType type, Bytes bytes)
    : Value(type, bytes.size() > kInlineBytes ? ByteView() : ByteView(bytes)) {
    if (bytes.size() > kInlineBytes) content_ = std::make_shared<const Bytes>(std::move(bytes));
}

Value::Value(ValueType type, ByteView bytes) : type_(type) {
    if (bytes.size() > kInlineBytes) {
        content_ = std::make_shared<const Bytes>(bytes.begin(), bytes.end());
    } else if (!bytes.empty()) {
        std::memcpy(std::get<Inline>(content_).data(), bytes.data(), bytes.size());
        inlineSize_ = std::uint8_t(bytes.size());
    }
}

Value Value::blob(ValueType type, const Hash& hash, std::uint64_t size) {
    Value value;
    value.type_ = type;
    value.content_ = std::make_shared<const BlobName>(BlobName{hash, size});
    return value;
}

bool Value::isBlob() const { return std::holds_alternative<SharedBlobName>(content_); }

ByteView Value::bytes() const {
    if (const auto* small = std::get_if<Inline>(&content_)) return {small->data(), inlineSize_};
    if (const auto* shared = std::get_if<SharedBytes>(&content_)) return **shared;
    return {};
}

std::uint64_t Value::size() const {
    if (const auto* name = std::get_if<SharedBlobName>(&content_)) return (*name)->size;
    return bytes().size();
}

const Hash& Value::hash() const { return std::get<SharedBlobName>(content_)->hash; }

bool operator==(const Value& left, const Value& right) {
    if (left.type_ != right.type_ || left.content_.index() != right.content_.index()) return false;
    return left.size() == right.size() && (left <=> right) == std::strong_ordering::equal;
}

std::strong_ordering operator<=>(const Value& left, const Value& right) {
    if (const auto order = left.type_ <=> right.type_; order != 0) return order;
    if (const auto order = left.isBlob() <=> right.isBlob(); order != 0) return order;
    if (left.isBlob()) {
        if (const auto order = left.hash() <=> right.hash(); order != 0) return order;
        return left.size() <=> right.size();
    }
    const ByteView leftBytes = left.bytes(), rightBytes = right.bytes();
    if (leftBytes.data() == rightBytes.data()) return leftBytes.size() <=> rightBytes.size();
    return compare(leftBytes, rightBytes);
}

Result<void> validateValue(ValueType type, ByteView bytes) {
    if (Problem problem = problemOfLeaf(type, bytes))
        return fail(ErrorCode::InvalidValue, "the value (" + typeName(type) + ") " + problem);
    return {};
}

Value tokenValue(std::string_view text) { return textValue(ValueType::Token, text); }
Value stringValue(std::string_view text) { return textValue(ValueType::String, text); }
Value pathValue(std::string_view text) { return textValue(ValueType::Path, text); }

Value doubleValue(double number) {
    return {ValueType::Double, ByteView(reinterpret_cast<const std::uint8_t*>(&number), 8)};
}
Value boolValue(bool flag) {
    const std::uint8_t byte = flag ? 1 : 0;
    return {ValueType::Bool, ByteView(&byte, 1)};
}

std::optional<std::string_view> textOf(const Value& value) {
    if (value.type() < ValueType::String || value.type() > ValueType::Path) return std::nullopt;
    ByteReader in(value.bytes());
    const std::string_view text = in.text();
    return in.finished() ? std::optional(text) : std::nullopt;
}

}  // namespace usdlive
