// The keys of the store's records.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The keys of the store's records. Numbers are big-endian, so that keys sort like the numbers.
namespace storekeys {

void appendBigEndian(std::string& key, std::uint32_t number);
void appendBigEndian(std::string& key, std::uint64_t number);
/// Precondition: at least 8 bytes.
[[nodiscard]] std::uint64_t bigEndian64(std::string_view bytes);

// Column family `commits`.
[[nodiscard]] std::string commit(Revision revision);
inline constexpr std::size_t kCommitBeginning = 4;  ///< length of the key's rarely changing prefix

// Column family `clients`: a transaction's number and revision. Each replaces the one kRemembered
// numbers before. Slot 0 holds the highest number.
[[nodiscard]] std::string transaction(const ClientId& client, std::uint64_t sequence);
[[nodiscard]] std::string highestTransaction(const ClientId& client);
/// The key of a transaction that is committed after kRemembered later ones (SE4). It has its number
/// only and is kept for ever.
[[nodiscard]] std::string lateTransaction(const ClientId& client, std::uint64_t sequence);
/// Returns the client of a record, or nothing for other keys.
[[nodiscard]] std::optional<ClientId> clientOf(std::string_view key);
/// Returns the key after all keys of the client and before those of the next one.
[[nodiscard]] std::string behindClient(const ClientId& client);
/// The length of the prefix that all keys of a client share.
inline constexpr std::size_t kClientBeginning = 4 + 32;

}  // namespace storekeys
}  // namespace usdlive::server
