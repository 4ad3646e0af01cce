// Owns a file descriptor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

namespace usdlive {

/// An open file descriptor, or -1. The destructor closes it.
class Descriptor {
public:
    explicit Descriptor(int number = -1) : number_(number) {}
    Descriptor(Descriptor&& other) noexcept : number_(other.release()) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
        std::swap(number_, other.number_);
        return *this;
    }
    /// Keeps errno, which the caller may still need.
    ~Descriptor();

    [[nodiscard]] int get() const { return number_; }
    /// Returns the descriptor, which the caller has to close.
    [[nodiscard]] int release() { return std::exchange(number_, -1); }
    explicit operator bool() const { return number_ >= 0; }

private:
    int number_;
};

/// Fills as much of `part` as the file has from `offset` on. Returns the count of bytes, or nothing
/// on an error, which errno names.
[[nodiscard]] std::optional<std::size_t> readPart(const Descriptor& file, std::uint64_t offset,
                                                  std::span<std::uint8_t> part);

}  // namespace usdlive
