// Uploads and downloads of big values, in chunks (V9, B1-B5).
#include "session/BlobTransfer.h"

#include <algorithm>

#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::client {

BlobFrame blobPart(const Hash& hash, const Bytes& bytes, std::uint64_t offset, std::size_t most) {
    const ByteView rest = ByteView(bytes).subspan(offset);
    const ByteView part = rest.first(std::min({most, kChunkBytes, rest.size()}));
    return {hash, bytes.size(), offset, std::uint32_t(part.size()), deflate(part)};
}

// ---- uploads

void SentParts::add(const Hash& hash, std::uint64_t offset, std::size_t frameBytes) {
    parts_.push_back({hash, offset, frameBytes});
    bytes_ += frameBytes;
    for (; bytes_ - parts_.front().frameBytes >= kKeptBytes; parts_.pop_front())
        bytes_ -= parts_.front().frameBytes;
}

std::map<Hash, std::uint64_t> SentParts::firstOf(std::size_t unconfirmed) const {
    std::map<Hash, std::uint64_t> first;
    for (auto part = parts_.rbegin(); part != parts_.rend() && unconfirmed > 0; ++part) {
        first[part->hash] = part->offset;
        unconfirmed -= std::min(unconfirmed, part->frameBytes);
    }
    return first;
}

std::uint64_t SentParts::lastOf(const Hash& hash) const {
    for (auto part = parts_.rbegin(); part != parts_.rend(); ++part)
        if (part->hash == hash) return part->offset;
    return 0;
}

void SentParts::clear() {
    parts_.clear();
    bytes_ = 0;
}

BlobUploads::Upload* BlobUploads::find(const Hash& hash) {
    const auto found = std::find_if(uploads_.begin(), uploads_.end(),
                                    [&](const Upload& upload) { return upload.hash == hash; });
    return found == uploads_.end() ? nullptr : &*found;
}

std::uint64_t BlobUploads::beginning(const Hash& hash) const {
    const auto found = interrupted_.find(hash);
    return found == interrupted_.end() ? 0 : found->second;
}

bool BlobUploads::ready(const std::vector<Value>& blobs) {
    bool ready = true;
    for (const Value& blob : blobs) {
        if (stored_.contains(blob.hash())) continue;
        if (Upload* upload = find(blob.hash()))
            upload->wanted = true;
        else if (host_.holdsBlob(blob.hash()))
            uploads_.push_back(
                {.hash = blob.hash(), .size = blob.size(), .offset = beginning(blob.hash())});
        else
            continue;  // the server has it, or refuses the transaction
        ready = false;
    }
    return ready;
}

void BlobUploads::dropUnwanted() {
    std::erase_if(uploads_, [](const Upload& upload) {
        return !upload.wanted && !upload.begun && !upload.sent;
    });
    for (Upload& upload : uploads_) upload.wanted = false;
}

void BlobUploads::send(std::size_t chunks, std::int64_t nowMs) {
    std::vector<Hash> unknown;
    std::size_t most = host_.bulkBytes();
    for (Upload& upload : uploads_) {
        if (chunks == 0 || most == 0) break;
        if (upload.sent || upload.notBeforeMs > nowMs) continue;
        if (!upload.bytes) upload.bytes = host_.localBlob(upload.hash);
        if (!upload.bytes) {  // it is not here any more: the server refuses the transaction
            unknown.push_back(upload.hash);
            continue;
        }
        const Bytes& bytes = *upload.bytes;
        for (; chunks > 0 && most > 0 && upload.offset < bytes.size(); --chunks) {
            const BlobFrame part = blobPart(upload.hash, bytes, upload.offset, most);
            auto frame = std::make_shared<const Bytes>(encodeFrame(part));
            parts_.add(upload.hash, upload.offset, frame->size());
            host_.send(std::move(frame));
            upload.begun = true;
            upload.offset += part.rawBytes;
            most = host_.bulkBytes();
        }
        if (upload.offset < bytes.size()) break;
        upload.sent = true;
        upload.bytes.reset();
    }
    for (const Hash& hash : unknown) stored(hash);
}

void BlobUploads::disconnected(std::size_t unconfirmed) {
    const auto first = parts_.firstOf(unconfirmed);
    if (interrupted_.size() > kMostInterrupted) interrupted_.clear();  // they begin anew
    for (const Upload& upload : uploads_) {
        if (!upload.begun) continue;
        const auto part = first.find(upload.hash);
        // The server answers the last part of a value again.
        const std::uint64_t confirmed = upload.sent ? parts_.lastOf(upload.hash) : upload.offset;
        interrupted_[upload.hash] = part == first.end() ? confirmed : part->second;
    }
    uploads_.clear();
    parts_.clear();
    reportedMs_.reset();
}

std::optional<event::Progress> BlobUploads::progress(std::int64_t nowMs) {
    if (uploads_.empty()) {
        reportedMs_.reset();
        return std::nullopt;
    }
    if (!reportedMs_) {
        reportedMs_ = nowMs;
        storedBytes_ = 0;
    }
    if (nowMs - *reportedMs_ < kReportEveryMs) return std::nullopt;
    reportedMs_ = nowMs;
    event::Progress progress{event::Progress::Task::Upload, {}, storedBytes_, storedBytes_, 0};
    for (const Upload& upload : uploads_) {
        progress.done += upload.offset;
        progress.total += upload.size;
    }
    return progress;
}

void BlobUploads::stored(const Hash& hash) {
    stored_.insert(hash);
    interrupted_.erase(hash);
    if (const Upload* upload = find(hash)) storedBytes_ += upload->size;
    std::erase_if(uploads_, [&](const Upload& upload) { return upload.hash == hash; });
}

void BlobUploads::refused(const Hash& hash, ErrorCode why, std::int64_t nowMs) {
    Upload* upload = find(hash);
    if (!upload) return;
    // The server also refuses the chunks that were sent before its first refusal arrived.
    if (upload->offset == 0) return;
    const bool again = why == ErrorCode::BlobMismatch && ++upload->mismatches < kMaxMismatches;
    if (!errorPasses(why) && !again) return stored(hash);
    interrupted_.erase(hash);
    upload->offset = 0;
    upload->sent = false;
    upload->bytes.reset();
    upload->notBeforeMs = nowMs + kAgainMs;
}

// ---- downloads

void BlobDownloads::want(const Hash& hash, bool lasting) {
    Wanted& wanted = wanted_[hash];
    wanted.lasting = wanted.lasting || lasting;
    if (!channel_.isOnline() || wanted.failures > 0) return;  // requestDue() does it later
    if (!std::exchange(wanted.asked, true)) channel_.send(RequestBlob{hash, wanted.here});
}

BlobDownloads::Done BlobDownloads::arrived(const Hash& hash) {
    const auto found = wanted_.extract(hash);
    if (found.empty()) return {};
    return {Outcome::Arrived, found.mapped().lasting, false};
}

BlobDownloads::Done BlobDownloads::failed(const Hash& hash, std::int64_t nowMs) {
    const auto found = wanted_.find(hash);
    // Chunks that were sent before the first failure arrive and fail, too.
    if (found == wanted_.end() || !found->second.asked) return {};
    Wanted& wanted = found->second;
    if (!wanted.lasting) {
        wanted_.erase(found);
        return {Outcome::GivenUp, false, true};
    }
    const std::int64_t pause =
        std::min(kLongestPauseMs, kFirstPauseMs << std::min(wanted.failures, 10));
    wanted.asked = false;
    wanted.here = 0;
    wanted.notBeforeMs = nowMs + pause;
    return {Outcome::TriedAgain, true, ++wanted.failures == 1};
}

void BlobDownloads::requestDue(std::int64_t nowMs, const std::function<bool(const Hash&)>& needed) {
    for (auto entry = wanted_.begin(); entry != wanted_.end();) {
        auto& [hash, wanted] = *entry;
        if (wanted.asked || wanted.notBeforeMs > nowMs) {
            ++entry;
        } else if (wanted.failures > 0 && !needed(hash)) {
            entry = wanted_.erase(entry);
        } else {
            wanted.asked = true;
            channel_.send(RequestBlob{hash, wanted.here});
            ++entry;
        }
    }
}

void BlobDownloads::disconnected() {
    std::erase_if(wanted_, [](const auto& entry) { return !entry.second.lasting; });
    for (auto& [hash, wanted] : wanted_) wanted = {.lasting = true, .here = wanted.here};
}

}  // namespace usdlive::client
