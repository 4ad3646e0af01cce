// Computes SHA-256 hashes.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

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

}  // namespace usdlive::resolver
