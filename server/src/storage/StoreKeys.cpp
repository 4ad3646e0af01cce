#include "StoreKeys.h"

#include <bit>

namespace usdlive::server::storekeys {

namespace {

constexpr std::size_t kNumberBytes = 8;
constexpr std::size_t kLengthBytes = 4;
constexpr std::uint64_t kSign = std::uint64_t(1) << 63;

template <class T>
void append(std::string& key, T number) {
    for (int shift = int(sizeof(T)) * 8 - 8; shift >= 0; shift -= 8)
        key.push_back(char(number >> shift));
}

std::uint64_t number(std::string_view bytes, std::size_t count) {
    std::uint64_t number = 0;
    for (std::size_t at = 0; at < count; ++at)
        number = number << 8 | static_cast<unsigned char>(bytes[at]);
    return number;
}

}  // namespace

void appendBigEndian(std::string& key, std::uint32_t number) { append(key, number); }
void appendBigEndian(std::string& key, std::uint64_t number) { append(key, number); }
std::uint64_t bigEndian64(std::string_view bytes) { return number(bytes, kNumberBytes); }

std::string commit(Revision revision) {
    std::string key;
    append(key, revision);
    return key;
}

std::string transaction(const ClientId& client, std::uint64_t sequence) {
    std::string key;
    append(key, std::uint32_t(client.value.size()));
    key += client.value;
    append(key, sequence);
    return key;
}

std::string layerPart(std::uint32_t layer, char part) {
    std::string key;
    append(key, layer);
    key.push_back(part);
    return key;
}

std::string node(std::uint32_t layer, NodeId node) {
    std::string key = layerPart(layer, kNodes);
    append(key, node);
    return key;
}

std::string fields(std::uint32_t layer, NodeId node) {
    std::string key = layerPart(layer, kFields);
    append(key, node);
    return key;
}

std::string field(std::uint32_t layer, NodeId node, std::string_view name) {
    std::string key = fields(layer, node);
    append(key, std::uint32_t(name.size()));
    key += name;
    return key;
}

std::string sample(std::string_view field, double time) {
    std::string key(field);
    append(key, orderedTime(time));
    return key;
}
std::string samplesBegin(std::string_view field) { return std::string(field) + '\0'; }
std::string samplesEnd(std::string_view field) {
    return std::string(field) + std::string(kNumberBytes + 1, '\xff');
}

FieldKey splitField(std::string_view key) {
    constexpr std::size_t kNameAt = kNodeKeyBytes + kLengthBytes;
    if (key.size() < kNameAt) return {};
    const std::uint64_t length = number(key.substr(kNodeKeyBytes), kLengthBytes);
    if (length > key.size() - kNameAt) return {};
    const std::string_view time = key.substr(kNameAt + length);
    if (!time.empty() && time.size() != kNumberBytes) return {};
    return {number(key.substr(kLayerBytes + 1), kNumberBytes), key.substr(kNameAt, length),
            key.substr(0, kNameAt + length), time};
}

// Negative numbers sort the other way round, and before the others.
std::uint64_t orderedTime(double time) {
    const auto bits = std::bit_cast<std::uint64_t>(time == 0 ? 0.0 : time);
    return bits & kSign ? ~bits : bits | kSign;
}
double timeOf(std::uint64_t ordered) {
    return std::bit_cast<double>(ordered & kSign ? ordered & ~kSign : ~ordered);
}

}  // namespace usdlive::server::storekeys
