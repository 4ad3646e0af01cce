// Fuzzes contents of fields: checks the rules of the protocol, then the conversion to a value of
// USD.
#include <pxr/usd/sdf/schema.h>

#include "Fuzz.h"
#include "unit/common/layer/RandomValue.h"
#include "usdlive/common/layer/NoBlobs.h"
#include "usdlive/common/usd/TfComplaints.h"
#include "usdlive/common/usd/ValueCodec.h"

using namespace usdlive;

namespace {

/// Checks that USD returns a value unchanged if it accepts it.
void throughUsd(const pxr::TfToken& field, const FieldValue& value) {
    const usd::TfComplaints silent;
    NoBlobs blobs;
    const auto decoded = usd::decodeValue(field, value, blobs);
    if (!decoded) return;
    const auto encoded = usd::encodeValue(*decoded, blobs);
    fuzz::require(encoded && *encoded == value, "decoding and encoding returns the same value");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const ByteView bytes(data, size);
    const auto value = decodeFieldValue(bytes);
    if (!value) return 0;
    fuzz::require(encodeFieldValue(*value) == fuzz::copyOf(bytes), "V10: there is one encoding");
    throughUsd(pxr::SdfFieldKeys->Default, *value);
    // These are the two fields whose C++ types do not follow from their content.
    if (value->type() == ValueType::Map) throughUsd(pxr::SdfFieldKeys->Relocates, *value);
    if (value->type() == ValueType::Token) throughUsd(pxr::SdfFieldKeys->DisplayUnit, *value);
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    RandomValue random(1);
    for (const ValueType type : allLeafTypes()) {
        const auto number = std::uint16_t(type);
        // One array type and one array edit represent all others.
        if (number < 0x100 || (number & 0xFF) == std::uint16_t(ValueType::Token))
            all.push_back(encodeFieldValue(FieldValue(random.leaf(type))));
    }
    for (int number = 0; number < 20; ++number) all.push_back(encodeFieldValue(random.field()));
    return all;
}
