// The identity of a project's store.
#pragma once

#include <optional>
#include <random>
#include <string>

#include "usdlive/common/core/Id.h"

namespace usdlive {

/// The random identity of a project's store (ID1): 32 hexadecimal digits, made once with the store.
/// A copy of a store has the identity of its original. Empty: unknown, of an earlier version.
using StoreId = Id<struct StoreIdTag>;

/// Returns 32 hexadecimal digits from the system's random source.
[[nodiscard]] inline std::string randomIdDigits() {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::random_device random;
    std::string digits;
    while (digits.size() < 32) digits += kDigits[random() & 15];
    return digits;
}

/// Returns whether both identities are known and differ.
[[nodiscard]] inline bool isOtherStore(const StoreId& one, const StoreId& other) {
    return !one.empty() && !other.empty() && one != other;
}

}  // namespace usdlive
