#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::fuzz {

/// What a target defines besides LLVMFuzzerTestOneInput(): valid inputs to begin with.
/// `fuzz_NAME --seeds=FOLDER` writes them there.
std::vector<Bytes> seeds();

/// A rule that an input has broken: libFuzzer keeps it.
inline void require(bool holds, const char* rule) {
    if (holds) return;
    std::fprintf(stderr, "broken: %s\n", rule);
    std::abort();
}

inline Bytes copyOf(ByteView bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace usdlive::fuzz
