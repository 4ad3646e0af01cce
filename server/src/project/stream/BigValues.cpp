// Receives and sends big values.
#include "project/stream/BigValues.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

namespace {

constexpr std::size_t kMostBlobRequests = 10'000;  // unanswered requests of one session

}  // namespace

// ---- requests

void BigValues::request(Session& session, const RequestBlob& request) {
    if (known_.has(request.hash)) return blobs_->sendBlob(session.id, request.hash, request.offset);
    auto& requests = requests_[session.id];
    if (requests.size() >= kMostBlobRequests)
        return sessions_->close(session,
                                {ErrorCode::MalformedControl, "too many requests at once"});
    requests.push_back(request);
    seek({request.hash});
}

void BigValues::seek(std::vector<Hash> hashes) {
    known_.ask(hashes);
    blobs_->findBlobs(std::move(hashes));
}

void BigValues::found(const std::vector<Hash>& asked, const std::vector<Hash>& stored) {
    known_.answered(asked);
    for (const Hash& hash : stored) known_.stored(hash);
    const std::unordered_set<Hash> answers(asked.begin(), asked.end());
    for (auto& [id, requests] : requests_) {
        std::vector<RequestBlob> answered;
        std::erase_if(requests, [&](const RequestBlob& request) {
            const bool isAnswered = answers.contains(request.hash);
            if (isAnswered) answered.push_back(request);
            return isAnswered;
        });
        const Session* session = sessions_->greeted(id);
        if (!session) continue;
        for (const RequestBlob& request : answered) answer(*session, request);
    }
}

void BigValues::answer(const Session& session, const RequestBlob& request) {
    if (known_.has(request.hash))
        blobs_->sendBlob(session.id, request.hash, request.offset);
    else if (const auto* frames = previews_->values.find(request.hash))
        outbox_->sendBeside(session.id, *frames);
    else
        sessions_->sendError(
            session,
            {ErrorCode::BlobNotFound, "the server does not have the value " + request.hash.hex()},
            {}, request.hash);
}

// ---- uploads

void BigValues::receive(Session& session, BlobFrame part) {
    const auto refuse = [&](const Error& error) {
        sessions_->sendError(session, error, {}, part.hash);
    };
    if (part.size > limits_.maxBytes)
        return refuse({ErrorCode::BlobTooLarge,
                       "a value of " + std::to_string(part.size) + " bytes; at most " +
                           std::to_string(limits_.maxBytes) + " are accepted"});
    if (part.rawBytes > kChunkBytes || part.offset > part.size ||
        part.rawBytes > part.size - part.offset)
        return refuse({ErrorCode::BlobMismatch, "a part that is not within its value"});
    if (part.gesture != 0)
        return previews_->values.add(session.client, session.share, std::move(part));
    uploading_.insert(session.id);
    // The value is already stored, so its parts are ignored. The last part is answered like the
    // first one: another session may have completed the value after the first part of this session,
    // which was then not answered.
    if (known_.has(part.hash)) {
        if (part.offset == 0 || part.offset + part.rawBytes == part.size)
            sendStored(session, part.hash);
        return;
    }
    if (const auto error = store_->whyNotWritable()) {
        // The parts that have come would keep a full disk full.
        blobs_->removeUnfinished(session.id);
        return refuse(*error);
    }
    known_.write(part.hash);
    blobs_->writeBlob(session.id, session.share, std::move(part));
}

void BigValues::written(SessionId id, const Hash& hash, const Result<bool>& whole) {
    known_.written(hash);
    if (whole && *whole) known_.stored(hash);
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (!whole)
        sessions_->sendError(*session, whole.error(), {}, hash);
    else if (*whole)
        sendStored(*session, hash);
}

void BigValues::sendStored(const Session& session, const Hash& hash) {
    unused_.stored(hash, session.id);
    sessions_->send(session, BlobStored{hash});
}

void BigValues::left(const Session& session) {
    requests_.erase(session.id);
    uploading_.erase(session.id);
}

// ---- unused values (B6)

std::vector<Hash> BigValues::takeUnused(const Round& round) {
    std::unordered_set<Hash> previewed;
    previews_->forEach([&](const ClientId&, const Previews::Preview& preview) {
        previewed.insert(preview.named.begin(), preview.named.end());
    });
    auto unused = unused_.take({round.unnamed, round.upTo, round.nowMs, limits_.keepUnusedMs,
                                [&](const Hash& hash) {
                                    return round.named.contains(hash) || previewed.contains(hash) ||
                                           !known_.mayDrop(hash);
                                },
                                [&](SessionId session) { return uploading_.contains(session); }});
    uploading_.clear();
    known_.dropped(unused);
    return unused;
}

void BigValues::ordered(const OrderedCommit& commit) {
    unused_.named(commit.blobs, commit.revision);
}

/// An earlier durable commit may name the same values.
void BigValues::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    unused_.rolledBack(lost.commits.front().revision - 1);
}

}  // namespace usdlive::server
