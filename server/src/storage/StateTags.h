#pragma once

#include <cstdint>

namespace usdlive::server {

/// The first byte of a field's record.
enum class FieldTag : std::uint8_t {
    Whole = 0,      ///< the content follows (V10)
    Samples = 1,    ///< the samples are records of their own; there is no field when there are none
    NoSamples = 2,  ///< a field that was authored without samples
};

}  // namespace usdlive::server
