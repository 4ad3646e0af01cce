// Random numbers from a seed.
#pragma once

#include <cstddef>
#include <cstdint>

namespace usdlive::simulation {

/// Random numbers that depend only on a seed, on every machine (SplitMix64).
class SimRandom {
public:
    explicit SimRandom(std::uint64_t seed) : state_(seed * 0x9e3779b97f4a7c15ull + 1) {}

    std::uint64_t next() {
        std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ull);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return z ^ (z >> 31);
    }
    /// Returns a number from 0 to below - 1.
    std::uint64_t below(std::uint64_t below) { return next() % below; }
    /// Returns a number from `from` to `to`.
    std::int64_t between(std::int64_t from, std::int64_t to) {
        return from + std::int64_t(below(std::uint64_t(to - from + 1)));
    }
    bool chance(unsigned percent) { return below(100) < percent; }
    bool chancePerMille(unsigned perMille) { return below(1000) < perMille; }
    template <class List>
    const auto& pick(const List& list) {
        return list[std::size_t(below(std::size(list)))];
    }

private:
    std::uint64_t state_;
};

}  // namespace usdlive::simulation
