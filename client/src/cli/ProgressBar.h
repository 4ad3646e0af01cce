// Shows people at a terminal how far something is that takes long.
#pragma once

#include <chrono>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <string_view>

namespace usdlive::cli {

/// A line that is drawn over itself, from a second after its beginning on, and wiped off at the
/// end. Everybody's clock is passed in.
class ProgressBar {
public:
    using Time = std::chrono::steady_clock::time_point;

    ProgressBar(std::ostream& out, Time begin) : out_(out), begin_(begin) {}
    ~ProgressBar() { wipe(); }
    ProgressBar(const ProgressBar&) = delete;
    ProgressBar& operator=(const ProgressBar&) = delete;

    /// `what` in a few words, without control characters; `total` 0: not known.
    void show(std::string_view what, std::uint64_t done, std::uint64_t total, Time now);
    void wipe();

private:
    std::ostream& out_;
    const Time begin_;
    bool drawn_ = false;
};

/// Are both outputs terminals? A bar never goes where somebody else reads.
[[nodiscard]] bool isForPeople();

}  // namespace usdlive::cli
