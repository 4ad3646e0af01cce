// Checks that the decoders of frames share.
#include "Decoding.h"

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

FieldValue DecodingBudget::content(ByteView encoded) {
    const bool isLeaf = isLeafType(ValueType(ByteReader(encoded).u16()));
    spend(encoded.size(), isLeaf ? 1 : kCompositeFactor);
    auto value = decodeFieldValue(encoded);
    if (!value) throw Undecodable{value.error()};
    return std::move(*value);
}

Value DecodingBudget::leaf(ByteView encoded) {
    FieldValue content = this->content(encoded);
    Value* value = content.as<Value>();
    if (!value) stop(ErrorCode::InvalidValue, "an item or key is a composite value");
    return std::move(*value);
}

SpecKind checkedKind(std::uint8_t kind) {
    switch (SpecKind(kind)) {
        case SpecKind::Attribute:
        case SpecKind::Prim:
        case SpecKind::PseudoRoot:
        case SpecKind::Relationship:
        case SpecKind::Variant:
        case SpecKind::VariantSet:
            return SpecKind(kind);
    }
    stop(ErrorCode::MalformedFrame, "a spec is of an unknown kind");
}

std::string checkedField(std::string_view name) {
    require(!name.empty() && name.size() <= 1024, "a field's name is empty or too long");
    return std::string(name);
}

SampleTime checkedTime(double time) {
    if (!std::isfinite(time)) stop(ErrorCode::InvalidValue, "a time sample's time is not finite");
    return {time};
}

ListName checkedList(std::uint8_t list) {
    require(list < kListNames, "a list item is of an unknown list");
    return ListName(list);
}

void checkKeyParts(std::size_t count) {
    require(count >= 1 && count <= std::size_t(kMaxNesting),
            "a dictionary key has no or too many parts");
}

void checkForm(ValueType form, const Value& item) {
    require(form == ValueType::None || form == item.type(),
            "an item or key is not of the type given");
}

Address checkedAddress(std::string path, std::uint64_t sequence, std::uint32_t edit) {
    require(sequence != 0 || edit == 0, "an address names an edit of no transaction");
    Address address{std::move(path), {}};
    if (sequence != 0) address.creation = Creation{sequence, edit};
    return address;
}

}  // namespace usdlive
