// Derives the colour of a user from a hash of the name (PS3).
#include "usdlive/common/core/UserColour.h"

#include <algorithm>
#include <cmath>

#include "usdlive/common/core/Hash.h"

namespace usdlive {

namespace {

constexpr float kSaturation = 0.65f, kValue = 0.95f;
constexpr float kSextants = 6;

}  // namespace

std::array<float, 3> userColour(const UserName& user) {
    const Hash hash = sha256(asBytes(user.value));
    const float hue = float(hash.bytes[0] << 8 | hash.bytes[1]) / 65536.f * kSextants;
    const auto part = [hue](float offset) {
        const float at = std::fmod(hue + offset, kSextants);
        return kValue - kValue * kSaturation * std::clamp(std::min(at, 4 - at), 0.f, 1.f);
    };
    return {part(5), part(3), part(1)};
}

}  // namespace usdlive
