// Draws a progress bar on the terminal.
#include "cli/ProgressBar.h"

#include <unistd.h>

#include <algorithm>
#include <ostream>

namespace usdlive::cli {

namespace {

constexpr std::chrono::seconds kDrawDelay{1};
constexpr std::size_t kWidth = 24;

std::string barOf(std::uint64_t done, std::uint64_t total) {
    const double part = std::min(1.0, double(done) / double(total));
    const auto full = std::size_t(part * kWidth);
    return "[" + std::string(full, '#') + std::string(kWidth - full, '.') + "] " +
           std::to_string(int(part * 100)) + " %";
}

}  // namespace

void ProgressBar::show(std::string_view what, std::uint64_t done, std::uint64_t total, Time now) {
    if (now - begin_ < kDrawDelay) return;
    out_ << "\r\x1b[K" << what << " " << (total > 0 ? barOf(done, total) : "...") << std::flush;
    drawn_ = true;
}

void ProgressBar::erase() {
    if (drawn_) out_ << "\r\x1b[K" << std::flush;
    drawn_ = false;
}

bool isForPeople() { return ::isatty(STDOUT_FILENO) == 1 && ::isatty(STDERR_FILENO) == 1; }

}  // namespace usdlive::cli
