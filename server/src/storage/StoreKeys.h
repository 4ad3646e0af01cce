#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The keys of the store's records. Numbers are big-endian, so that keys sort as the numbers do.
namespace storekeys {

void appendBigEndian(std::string& key, std::uint32_t number);
void appendBigEndian(std::string& key, std::uint64_t number);
/// Precondition: at least so many bytes.
[[nodiscard]] std::uint64_t bigEndian64(std::string_view bytes);

// Column family `commits`.
[[nodiscard]] std::string commit(Revision revision);
inline constexpr std::size_t kCommitBeginning = 4;  ///< of a key, which rarely changes

// Column family `clients`: a transaction's number and revision. Each takes the place of the one
// kRemembered numbers before. Slot 0 holds the highest number so far.
[[nodiscard]] std::string transaction(const ClientId& client, std::uint64_t sequence);
[[nodiscard]] std::string highestTransaction(const ClientId& client);
/// One that comes behind those that are remembered (SE4): of its number alone, for ever.
[[nodiscard]] std::string lateTransaction(const ClientId& client, std::uint64_t sequence);
/// Whose record it is; nothing: no client's.
[[nodiscard]] std::optional<ClientId> clientOf(std::string_view key);
/// Behind all keys of the client, and before those of the next one.
[[nodiscard]] std::string behindClient(const ClientId& client);
inline constexpr std::size_t kClientBeginning = 4 + 32;  ///< the same in all keys of a client

}  // namespace storekeys
}  // namespace usdlive::server
