// Writes std::cout to standard output, and knows why that failed.
#pragma once

#include <array>
#include <streambuf>

#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

/// The buffer of std::cout while this object exists. After a failed write std::cout is bad and the
/// rest of the output is dropped; the command continues, so that its work on the server is not left
/// half done.
class StandardOutput final : public std::streambuf {
public:
    StandardOutput();
    ~StandardOutput() override;
    StandardOutput(const StandardOutput&) = delete;
    StandardOutput& operator=(const StandardOutput&) = delete;

    /// Writes what is buffered. Error: StorageFailed if anything since the start was not written.
    [[nodiscard]] Result<void> finish();

private:
    int overflow(int character) override;
    int sync() override;
    bool writeBuffered();

    std::array<char, 64 * 1024> buffer_;
    std::streambuf* before_;
    int error_ = 0;  // errno of the first failed write
};

}  // namespace usdlive::cli
