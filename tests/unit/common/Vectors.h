// Reads the samples of tests/vectors for the C++ tests.
#pragma once

#include <cstdlib>
#include <string>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::test {

/// True if USDLIVE_WRITE_VECTORS is set: the tests then fill in the bytes of samples that have
/// none.
inline bool writesVectors() { return std::getenv("USDLIVE_WRITE_VECTORS") != nullptr; }

inline std::string vectorsFile(const char* name) { return std::string(USDLIVE_VECTORS "/") + name; }

inline std::string toHex(ByteView bytes) {
    constexpr const char* kDigits = "0123456789abcdef";
    std::string hex;
    for (const std::uint8_t byte : bytes) {
        hex += kDigits[byte >> 4];
        hex += kDigits[byte & 15];
    }
    return hex;
}

/// Precondition: `hex` consists of pairs of hexadecimal digits.
inline Bytes fromHex(const std::string& hex) {
    Bytes bytes;
    for (std::size_t at = 0; at + 1 < hex.size(); at += 2)
        bytes.push_back(std::uint8_t(std::stoi(hex.substr(at, 2), nullptr, 16)));
    return bytes;
}

}  // namespace usdlive::test
