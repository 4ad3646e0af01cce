#pragma once

#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "StoreKeys.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/server/project/CommitStore.h"

// The records of the meta family: their keys and what stands in them.
namespace usdlive::server {

// Keys of the meta family. Lower-case names stand alone, a capital begins the key of each of many.
inline constexpr const char* kHeadKey = "head";            // revision, hash
inline constexpr const char* kEpochKey = "epoch";          // u64
inline constexpr const char* kBaseKey = "base";            // revision, hash; absent: 0
inline constexpr const char* kForgottenKey = "forgotten";  // revision; absent: 0
inline constexpr char kLayerPrefix = 'L';                  // name -> number
inline constexpr char kEditedPrefix = 'T';      // number, revision -> the last of a run of commits
inline constexpr char kSavedPrefix = 'S';       // number -> revision, file
inline constexpr char kLayerBasePrefix = 'B';   // number -> revision, SHA-256 of its file
inline constexpr char kCheckpointPrefix = 'K';  // name -> revision, time, user
inline constexpr char kNamespacePrefix = 'N';   // revision -> its moves and deletes
// In `clients`, behind them all: the revision that it is of.
inline const std::string kClientsRevisionKey(4, '\xff');

/// A run of commits for a layer, and another one that begins so close behind it, are read as one.
inline constexpr Revision kSmallGap = 8;

inline constexpr std::size_t kHashBytes = sizeof(Hash::bytes);

[[nodiscard]] std::string key(char prefix, std::string_view name);
[[nodiscard]] std::string key(char prefix, std::uint32_t number);
[[nodiscard]] std::string key(char prefix, Revision revision);
[[nodiscard]] std::string key(char prefix, std::uint32_t number, Revision revision);

template <Number T>
[[nodiscard]] Bytes encoded(T number) {
    Bytes bytes(sizeof(T));
    std::memcpy(bytes.data(), &number, sizeof(T));
    return bytes;
}
/// Nothing: the bytes are no such record. Likewise below.
template <Number T>
[[nodiscard]] std::optional<T> decoded(ByteView bytes) {
    ByteReader in(bytes);
    const T number = in.number<T>();
    return in.finished() ? std::optional(number) : std::nullopt;
}

/// Precondition: kHashBytes of them at least.
[[nodiscard]] Hash hashOf(ByteView bytes);

[[nodiscard]] Bytes encodedSaved(const SavedState& saved);
[[nodiscard]] std::optional<SavedState> decodedSaved(ByteView bytes);

/// A revision and a hash: the head, the base, and the file of a layer's base.
[[nodiscard]] Bytes encoded(Revision revision, const Hash& hash);
[[nodiscard]] std::optional<std::pair<Revision, Hash>> decodedRevision(ByteView bytes);

inline constexpr std::size_t kBigFrame = 256 * 1024;
/// What stands behind the hash in a commit's record. A small frame as it is, with its length in
/// front; one of kBigFrame or more, such as an import's, compressed: a length of 0, which no frame
/// has, then the size as a u64, then zstd. `storage` holds the latter while the view is used.
[[nodiscard]] ByteView recordOf(ByteView frame, Bytes& storage);
[[nodiscard]] SharedBytes frameOf(ByteView record);  ///< nullptr: it is none

[[nodiscard]] Bytes encodedCheckpoint(const Checkpoint& checkpoint);
[[nodiscard]] std::optional<Checkpoint> decodedCheckpoint(std::string_view name, ByteView bytes);

[[nodiscard]] Bytes encoded(std::span<const NamespaceChange> changes);
/// False: the bytes are none; `changes` has those before.
[[nodiscard]] bool decodeInto(std::vector<NamespaceChange>& changes, Revision revision,
                              ByteView bytes);

}  // namespace usdlive::server
