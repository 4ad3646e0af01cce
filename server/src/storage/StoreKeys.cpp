// Builds and parses the keys of the store's records.
#include "storage/StoreKeys.h"

#include "storage/StoreRules.h"

namespace usdlive::server::storekeys {

namespace {

template <class T>
void append(std::string& key, T number) {
    for (int shift = int(sizeof(T)) * 8 - 8; shift >= 0; shift -= 8)
        key.push_back(char(number >> shift));
}

std::string slot(const ClientId& client, std::uint32_t slot) {
    std::string key;
    append(key, std::uint32_t(client.value.size()));
    key += client.value;
    append(key, slot);
    return key;
}

}  // namespace

void appendBigEndian(std::string& key, std::uint32_t number) { append(key, number); }
void appendBigEndian(std::string& key, std::uint64_t number) { append(key, number); }

std::uint64_t bigEndian64(std::string_view bytes) {
    std::uint64_t number = 0;
    for (const char byte : bytes.substr(0, sizeof number))
        number = number << 8 | static_cast<unsigned char>(byte);
    return number;
}

std::string commit(Revision revision) {
    std::string key;
    append(key, revision);
    return key;
}

std::string transaction(const ClientId& client, std::uint64_t sequence) {
    return slot(client, std::uint32_t(1 + sequence % kRemembered));
}
std::string highestTransaction(const ClientId& client) { return slot(client, 0); }
std::string lateTransaction(const ClientId& client, std::uint64_t sequence) {
    std::string key = slot(client, ~std::uint32_t(0));
    append(key, sequence);
    return key;
}

std::optional<ClientId> clientOf(std::string_view key) {
    std::uint32_t size = 0;
    if (key.size() < sizeof size) return std::nullopt;
    for (const char byte : key.substr(0, sizeof size))
        size = size << 8 | static_cast<unsigned char>(byte);
    if (key.size() < 2 * sizeof size + size) return std::nullopt;
    return ClientId{std::string(key.substr(sizeof size, size))};
}

// No slot number is that high. Late transactions have their keys after it.
std::string behindClient(const ClientId& client) {
    return lateTransaction(client, ~std::uint64_t(0)) + '\0';
}

}  // namespace usdlive::server::storekeys
