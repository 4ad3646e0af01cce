// Encodes and decodes the store's records.
#include "storage/StoreRecords.h"

#include <algorithm>
#include <limits>

#include "project/CommitContent.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kCompressedHeader = sizeof(std::uint32_t) + sizeof(std::uint64_t);

}  // namespace

namespace {

constexpr std::uint8_t kHasFile = 1, kHasPending = 2;

}  // namespace

std::string key(char prefix, std::string_view name) { return prefix + std::string(name); }
std::string key(char prefix, std::uint32_t number) {
    std::string key(1, prefix);
    storekeys::appendBigEndian(key, number);
    return key;
}
std::string key(char prefix, Revision revision) { return prefix + storekeys::commit(revision); }
std::string key(char prefix, std::uint32_t number, Revision revision) {
    return key(prefix, number) + storekeys::commit(revision);
}

Hash hashOf(ByteView bytes) {
    Hash hash;
    std::ranges::copy(bytes.first(kHashBytes), hash.bytes.begin());
    return hash;
}

Bytes encodedSaved(const SavedState& saved) {
    Bytes bytes = encoded<Revision>(saved.revision);
    appendNumber<std::uint8_t>(bytes,
                               (saved.file ? kHasFile : 0) | (saved.pending ? kHasPending : 0));
    if (saved.file) {
        const auto& [trace, hash] = *saved.file;
        appendNumber<std::uint64_t>(bytes, trace.size);
        appendNumber<std::uint64_t>(bytes, trace.inode);
        appendNumber<std::int64_t>(bytes, trace.modifiedNs);
        appendNumber<std::int64_t>(bytes, trace.changedNs);
        appendBytes(bytes, hash.bytes);
    }
    if (saved.pending) {
        appendNumber<Revision>(bytes, saved.pending->revision);
        appendBytes(bytes, saved.pending->hash.bytes);
    }
    return bytes;
}
std::optional<SavedState> decodedSaved(ByteView bytes) {
    ByteReader in(bytes);
    SavedState saved;
    saved.revision = in.u64();
    const std::uint8_t has = in.left() > 0 ? in.u8() : 0;  // records of earlier versions end here
    const auto hash = [&] {
        const ByteView bytes = in.take(kHashBytes);
        return bytes.empty() ? Hash() : hashOf(bytes);
    };
    if (has & kHasFile) {
        FileStamp& file = saved.file.emplace();
        file.trace.size = in.u64();
        file.trace.inode = in.u64();
        file.trace.modifiedNs = in.i64();
        file.trace.changedNs = in.i64();
        file.hash = hash();
    }
    if (has & kHasPending) {
        const Revision revision = in.u64();
        saved.pending = SavedState::PendingSave{revision, hash()};
    }
    return in.finished() ? std::optional(saved) : std::nullopt;
}

Bytes encoded(Revision revision, const Hash& hash) {
    Bytes bytes = encoded<Revision>(revision);
    appendBytes(bytes, hash.bytes);
    return bytes;
}
std::optional<std::pair<Revision, Hash>> decodedRevision(ByteView bytes) {
    if (bytes.size() != sizeof(Revision) + kHashBytes) return std::nullopt;
    ByteReader in(bytes);
    const Revision revision = in.u64();
    return std::pair(revision, hashOf(in.take(kHashBytes)));
}

ByteView recordOf(ByteView frame, Bytes& storage) {
    if (frame.size() < kBigFrame) return frame;
    const Bytes deflated = deflate(frame);
    appendNumber<std::uint32_t>(storage, 0);
    appendNumber<std::uint64_t>(storage, frame.size());
    appendBytes(storage, deflated);
    return storage;
}

SharedBytes frameOf(ByteView record) {
    ByteReader in(record);
    if (record.size() < kCompressedHeader || in.u32() != 0)
        return std::make_shared<const Bytes>(record.begin(), record.end());
    const std::uint64_t size = in.u64();
    const ByteView deflated = in.take(record.size() - kCompressedHeader);
    auto frame = inflate(deflated, size, std::numeric_limits<std::size_t>::max());
    if (!frame || frame->size() < kFrameLengthBytes) return nullptr;
    return std::make_shared<const Bytes>(std::move(*frame));
}

Bytes encodedCheckpoint(const Checkpoint& checkpoint) {
    Bytes bytes = encoded<Revision>(checkpoint.revision);
    appendNumber<std::uint64_t>(bytes, checkpoint.timeMs);
    appendText(bytes, checkpoint.user.value);
    return bytes;
}
std::optional<Checkpoint> decodedCheckpoint(std::string_view name, ByteView bytes) {
    ByteReader in(bytes);
    Checkpoint checkpoint{std::string(name), in.u64(), {}, 0};
    checkpoint.timeMs = in.u64();
    checkpoint.user.value = in.text();
    return in.finished() ? std::optional(std::move(checkpoint)) : std::nullopt;
}

namespace {

// Flags of a NamespaceChange.
constexpr std::uint8_t kHasTo = 1, kIsPlace = 2;

}  // namespace

Bytes encoded(std::span<const NamespaceChange> changes) {
    Bytes bytes;
    for (const NamespaceChange& change : changes) {
        appendText(bytes, change.layer.value);
        appendText(bytes, change.from);
        appendNumber<std::uint8_t>(bytes, (change.to ? kHasTo : 0) | (change.place ? kIsPlace : 0));
        if (change.to) appendText(bytes, *change.to);
    }
    return bytes;
}
bool decodeInto(std::vector<NamespaceChange>& changes, Revision revision, ByteView bytes) {
    ByteReader in(bytes);
    while (in.left() > 0) {
        NamespaceChange change{revision, {std::string(in.text())}, std::string(in.text()), {}};
        const std::uint8_t flags = in.u8();
        if ((flags & kHasTo) != 0) change.to = in.text();
        change.place = (flags & kIsPlace) != 0;
        changes.push_back(std::move(change));
    }
    return in.finished();
}

}  // namespace usdlive::server
