// The samples of tests/vectors as the tests of C++ read them.
#pragma once

#include <cstdlib>
#include <string>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::test {

/// USDLIVE_WRITE_VECTORS is set: samples that have no bytes yet get them.
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

/// Precondition: pairs of hexadecimal digits.
inline Bytes fromHex(const std::string& hex) {
    Bytes bytes;
    for (std::size_t at = 0; at + 1 < hex.size(); at += 2)
        bytes.push_back(std::uint8_t(std::stoi(hex.substr(at, 2), nullptr, 16)));
    return bytes;
}

}  // namespace usdlive::test
