// Computes SHA-256 hashes.
#pragma once

#include <array>
#include <condition_variable>
#include <cstddef>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>

namespace usdlive::resolver {

/// The SHA-256 of data that arrives in parts, as 64 hexadecimal digits.
class Digest {
public:
    Digest();
    ~Digest();
    Digest(const Digest&) = delete;
    void add(const void* data, std::size_t size);
    [[nodiscard]] std::string hex();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The SHA-256 of parts in its own memory. A thread hashes them while the caller receives the next
/// ones. A content of one part needs no thread.
class PartsDigest {
public:
    static constexpr std::size_t kParts = 4, kPartBytes = 512 * 1024;

    PartsDigest() = default;
    ~PartsDigest() { end(); }
    PartsDigest(const PartsDigest&) = delete;

    /// Returns the memory of the next part. Waits while all other memory has parts to be hashed.
    [[nodiscard]] std::span<char> space();
    /// Adds the first `size` bytes of that memory. The caller may read them until the next call of
    /// `space()`.
    void add(std::size_t size);
    /// Returns the hash of all parts. Nothing can be added after it.
    [[nodiscard]] std::string hex();

private:
    [[nodiscard]] char* memoryOf(std::size_t part);
    void hash();
    void end();

    // Not filled with zeros: most files use little of it.
    const std::unique_ptr<char[]> memory_ =
        std::make_unique_for_overwrite<char[]>(kParts * kPartBytes);
    Digest digest_;
    std::thread thread_;

    std::mutex mutex_;  // guards the next members
    std::condition_variable changed_;
    std::array<std::size_t, kParts> sizes_{};
    std::size_t added_ = 0, hashed_ = 0;  // counts of parts
    bool isEnded_ = false;
};

}  // namespace usdlive::resolver
