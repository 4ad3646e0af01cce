// The functions that each fuzz target defines.
#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::fuzz {

/// Each target defines this function besides LLVMFuzzerTestOneInput(): it returns valid inputs to
/// begin with. `fuzz_NAME --seeds=FOLDER` writes them to FOLDER.
std::vector<Bytes> seeds();

/// Fails if an input has broken a rule: libFuzzer then keeps the input.
inline void require(bool holds, const char* rule) {
    if (holds) return;
    std::fprintf(stderr, "broken: %s\n", rule);
    std::abort();
}

inline Bytes copyOf(ByteView bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace usdlive::fuzz
