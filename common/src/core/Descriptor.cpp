// Closes and reads files.
#include "usdlive/common/core/Descriptor.h"

#include <unistd.h>

#include <cerrno>

namespace usdlive {

Descriptor::~Descriptor() {
    if (number_ < 0) return;
    const int problem = errno;
    ::close(number_);
    errno = problem;
}

std::optional<std::size_t> readPart(const Descriptor& file, std::uint64_t offset,
                                    std::span<std::uint8_t> part) {
    std::size_t filled = 0;
    while (filled < part.size()) {
        const ssize_t count =
            ::pread(file.get(), part.data() + filled, part.size() - filled, off_t(offset + filled));
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return std::nullopt;
        if (count == 0) break;
        filled += std::size_t(count);
    }
    return filled;
}

}  // namespace usdlive
