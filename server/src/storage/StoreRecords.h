// Encodes the records of the store.
#pragma once

#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "project/CommitStore.h"
#include "storage/StoreKeys.h"
#include "usdlive/common/core/ByteStream.h"

// The records of the meta family: their keys and content.
namespace usdlive::server {

// Keys of the meta family. Lower-case keys are single records. An upper-case letter is the prefix
// of many.
inline constexpr const char* kHeadKey = "head";            // revision, hash
inline constexpr const char* kIdentityKey = "identity";    // text
inline constexpr const char* kEpochKey = "epoch";          // u64
inline constexpr const char* kBaseKey = "base";            // revision, hash; absent: 0
inline constexpr const char* kForgottenKey = "forgotten";  // revision; absent: 0
inline constexpr char kLayerPrefix = 'L';                  // name -> number
inline constexpr char kEditedPrefix = 'T';      // number, revision -> the last of a run of commits
inline constexpr char kSavedPrefix = 'S';       // number -> revision, file
inline constexpr char kLayerBasePrefix = 'B';   // number -> revision, SHA-256 of its file
inline constexpr char kCheckpointPrefix = 'K';  // name -> revision, time, user
inline constexpr char kNamespacePrefix = 'N';   // revision -> its moves and deletes
// Key of the last record in `clients`: the revision that the family corresponds to.
inline const std::string kClientsRevisionKey(4, '\xff');

/// Runs of a layer's commits with a gap of at most this size are joined.
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
/// Returns nothing if the bytes are not such a record. The same below.
template <Number T>
[[nodiscard]] std::optional<T> decoded(ByteView bytes) {
    ByteReader in(bytes);
    const T number = in.number<T>();
    return in.finished() ? std::optional(number) : std::nullopt;
}

/// Precondition: at least kHashBytes.
[[nodiscard]] Hash hashOf(ByteView bytes);

[[nodiscard]] Bytes encodedSaved(const SavedState& saved);
[[nodiscard]] std::optional<SavedState> decodedSaved(ByteView bytes);

/// A revision and a hash: the head, the base, or the file of a layer's base.
[[nodiscard]] Bytes encoded(Revision revision, const Hash& hash);
[[nodiscard]] std::optional<std::pair<Revision, Hash>> decodedRevision(ByteView bytes);

inline constexpr std::size_t kBigFrame = 256 * 1024;
/// Returns the part of a commit's record after the hash. A small frame is stored unchanged after
/// its length. A frame of kBigFrame or more, such as an import's, is compressed: the length 0,
/// which no frame has, then the size as a u64, then zstd. `storage` holds the compressed bytes
/// while the view is used.
[[nodiscard]] ByteView recordOf(ByteView frame, Bytes& storage);
[[nodiscard]] SharedBytes frameOf(ByteView record);  ///< nullptr: not a record

[[nodiscard]] Bytes encodedCheckpoint(const Checkpoint& checkpoint);
[[nodiscard]] std::optional<Checkpoint> decodedCheckpoint(std::string_view name, ByteView bytes);

[[nodiscard]] Bytes encoded(std::span<const NamespaceChange> changes);
/// Returns false if the bytes are invalid; `changes` has then the ones before.
[[nodiscard]] bool decodeInto(std::vector<NamespaceChange>& changes, Revision revision,
                              ByteView bytes);

}  // namespace usdlive::server
