// Shows the progress of slow operations on a terminal.
#pragma once

#include <chrono>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <string_view>

namespace usdlive::cli {

/// A line that is drawn repeatedly, starting one second after the beginning, and erased at the end.
/// The time is passed in.
class ProgressBar {
public:
    using Time = std::chrono::steady_clock::time_point;

    ProgressBar(std::ostream& out, Time begin) : out_(out), begin_(begin) {}
    ~ProgressBar() { erase(); }
    ProgressBar(const ProgressBar&) = delete;
    ProgressBar& operator=(const ProgressBar&) = delete;

    /// `what` is a short text without control characters; `total` is 0 if unknown.
    void show(std::string_view what, std::uint64_t done, std::uint64_t total, Time now);
    void erase();

private:
    std::ostream& out_;
    const Time begin_;
    bool drawn_ = false;
};

/// Returns true if both outputs are terminals, so that no program reads the progress bar.
[[nodiscard]] bool isForPeople();

}  // namespace usdlive::cli
