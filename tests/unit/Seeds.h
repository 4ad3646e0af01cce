// Decides how often a test that repeats itself runs.
#pragma once

namespace usdlive {

/// Returns how many of `all` seeds a test runs. Under a sanitizer, and not optimized, each takes up
/// to a hundred times as long, and a few of the seeds find the same errors of memory.
constexpr unsigned seedsOf(unsigned all) {
#ifdef USDLIVE_SANITIZED
    return all / 8;
#else
    return all;
#endif
}

}  // namespace usdlive
