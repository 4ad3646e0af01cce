#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// The keys of the store's records. Numbers are big-endian, so that keys sort as the numbers do.
namespace storekeys {

void appendBigEndian(std::string& key, std::uint32_t number);
void appendBigEndian(std::string& key, std::uint64_t number);
/// Precondition: at least so many bytes.
[[nodiscard]] std::uint64_t bigEndian64(std::string_view bytes);

// Column family `commits`.
[[nodiscard]] std::string commit(Revision revision);

// Column family `clients`: the revision of a transaction. Number 0, which no transaction has, holds
// the highest number so far.
[[nodiscard]] std::string transaction(const ClientId& client, std::uint64_t sequence);

// Column family `state`: of each layer first the nodes, then the fields, then by node.
//   layer 0 node                      -> parent, order, kind, name
//   layer 1 node length name          -> a field: whole, or its samples follow
//   layer 1 node length name time     -> a sample
inline constexpr char kNodes = 0, kFields = 1;
inline constexpr std::size_t kLayerBytes = 4, kNodeKeyBytes = kLayerBytes + 1 + 8;
[[nodiscard]] std::string layerPart(std::uint32_t layer, char part);
[[nodiscard]] std::string node(std::uint32_t layer, NodeId node);
[[nodiscard]] std::string fields(std::uint32_t layer,
                                 NodeId node);  ///< what all of its fields begin with
[[nodiscard]] std::string field(std::uint32_t layer, NodeId node, std::string_view name);
[[nodiscard]] std::string sample(std::string_view field, double time);
/// All samples of a field are in [first, second).
[[nodiscard]] std::string samplesBegin(std::string_view field);
[[nodiscard]] std::string samplesEnd(std::string_view field);

/// Splits a key of the part kFields. Empty views when it is none.
struct FieldKey {
    NodeId node = 0;
    std::string_view name;
    std::string_view field;  ///< the key of the field itself
    std::string_view time;   ///< 8 bytes for a sample, else none
};
[[nodiscard]] FieldKey splitField(std::string_view key);

/// Eight bytes that sort as the times do. -0 becomes 0, as they are the same time.
[[nodiscard]] std::uint64_t orderedTime(double time);
[[nodiscard]] double timeOf(std::uint64_t ordered);

}  // namespace storekeys
}  // namespace usdlive::server
