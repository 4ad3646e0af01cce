// Makes the secrets of clients and their ids.
#include "usdlive/common/core/ClientSecret.h"

#include <algorithm>
#include <random>

namespace usdlive {

namespace {

constexpr char kMark = 'k';
constexpr std::size_t kIdBytes = 32;

}  // namespace

Hash newClientSecret() {
    std::random_device random;
    Hash secret;
    std::ranges::generate(secret.bytes, [&] { return std::uint8_t(random()); });
    return secret;
}

ClientId clientIdOf(const Hash& secret) {
    return {kMark + sha256(ByteView(secret.bytes)).hex().substr(0, kIdBytes - 1)};
}

bool needsSecret(const ClientId& id) {
    return id.value.size() == kIdBytes && id.value.front() == kMark;
}

}  // namespace usdlive
