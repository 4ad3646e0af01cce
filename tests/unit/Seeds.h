// Decides how often a test that repeats itself runs.
#pragma once

namespace usdlive {

/// Returns how many of `all` seeds a test runs. Under a sanitizer, and not optimized, each takes up
/// to a hundred times as long, and a quarter of the seeds finds the same errors of memory.
constexpr unsigned seedsOf(unsigned all) {
#ifdef USDLIVE_SANITIZED
    return all / 4;
#else
    return all;
#endif
}

}  // namespace usdlive
