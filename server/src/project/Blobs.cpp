// Big values (V9): they travel beside the stream and have to be here before a transaction names
// them.
#include <algorithm>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMostBlobRequests = 10'000;  // of one session at once, not answered yet

}  // namespace

void Project::Impl::requestBlob(Session& session, const RequestBlob& request) {
    if (knownBlobs_.has(request.hash))
        return ports_.blobs.sendBlob(session.id, request.hash, request.offset);
    if (session.blobRequests.size() >= kMostBlobRequests)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    session.blobRequests.push_back(request);
    findBlobs({request.hash});
}

void Project::Impl::findBlobs(std::vector<Hash> hashes) {
    knownBlobs_.ask(hashes);
    ports_.blobs.findBlobs(std::move(hashes));
}

void Project::Impl::blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored) {
    knownBlobs_.answered(asked);
    for (const Hash& hash : stored) knownBlobs_.stored(hash);
    const std::unordered_set<Hash> known(asked.begin(), asked.end());
    for (auto& [id, session] : sessions_) {
        std::vector<RequestBlob> answered;
        std::erase_if(session.blobRequests, [&](const RequestBlob& request) {
            const bool isAnswered = known.contains(request.hash);
            if (isAnswered) answered.push_back(request);
            return isAnswered;
        });
        if (!session.isGreeted()) continue;
        for (const RequestBlob& request : answered) answerRequest(session, request);
    }
    workAll();
}

void Project::Impl::answerRequest(Session& session, const RequestBlob& request) {
    if (knownBlobs_.has(request.hash))
        ports_.blobs.sendBlob(session.id, request.hash, request.offset);
    else if (const auto* frames = previews_.values.find(request.hash))
        ports_.outbox.sendBeside(session.id, *frames);
    else
        sendError(session,
                  {ErrorCode::BlobNotFound, "the value " + request.hash.hex() + " is not here"}, {},
                  request.hash);
}

void Project::Impl::receiveBlob(Session& session, BlobFrame part) {
    const auto refuse = [&](ErrorCode code, std::string message) {
        sendError(session, {code, std::move(message)}, {}, part.hash);
    };
    if (part.size > options_.maxBlobBytes)
        return refuse(ErrorCode::BlobTooLarge,
                      "a value of " + std::to_string(part.size) + " bytes; at most " +
                          std::to_string(options_.maxBlobBytes) + " are accepted");
    if (part.rawBytes > kChunkBytes || part.offset > part.size ||
        part.rawBytes > part.size - part.offset)
        return refuse(ErrorCode::BlobMismatch, "a part that is not within its value");
    if (part.gesture != 0) return previews_.values.add(session.client, std::move(part));
    session.uploads = true;
    // The rest of what is here already is on its way and passed over, but for the last part:
    // another one's may have completed the value since this one's first, which was then not
    // answered.
    if (knownBlobs_.has(part.hash)) {
        if (part.offset == 0 || part.offset + part.rawBytes == part.size)
            sendStored(session, part.hash);
        return;
    }
    if (storeClosed_) return refuse(ErrorCode::StorageFailed, "the store has failed");
    if (!hasSpace_) return refuse(ErrorCode::StorageFull, "the disk of the server is full");
    knownBlobs_.write(part.hash);
    ports_.blobs.writeBlob(session.id, std::move(part));
}

void Project::Impl::blobWritten(SessionId id, const Hash& hash, const Result<bool>& whole) {
    knownBlobs_.written(hash);
    if (whole && *whole) knownBlobs_.stored(hash);
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (!whole)
        sendError(*session, whole.error(), {}, hash);
    else if (*whole)
        sendStored(*session, hash);
}

void Project::Impl::sendStored(Session& session, const Hash& hash) {
    unusedBlobs_.stored(hash, session.id);
    send(session, BlobStored{hash});
}

// ---- what is of no use any more (B6)

std::vector<Hash> Project::Impl::unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                             std::int64_t nowMs) {
    // A project that was made after the store was looked through does not know what was committed
    // in between; what is in a failed store nobody knows.
    if (upTo < firstRevision_ || storeClosed_ || handlesFiles()) return {};
    const std::unordered_set<Hash> named = namedHere();
    auto unused = unusedBlobs_.take(
        {unnamed, upTo, nowMs, options_.keepUnusedBlobsMs,
         [&](const Hash& hash) { return named.contains(hash) || !knownBlobs_.mayDrop(hash); },
         [&](SessionId id) {
             const Session* session = find(id);
             return session && session->uploads;
         }});
    for (auto& [id, session] : sessions_) session.uploads = false;
    knownBlobs_.dropped(unused);
    return unused;
}

/// Files that are read have big values that no commit names yet, and files that are written may
/// have some that none names any more.
bool Project::Impl::handlesFiles() const {
    return savesUnderWay_ > 0 || !reloads_.empty() ||
           std::ranges::any_of(layers_, [](const auto& one) {
               return std::holds_alternative<Loading>(one.second.state);
           });
}

/// By what is not executed yet, or never will be.
std::unordered_set<Hash> Project::Impl::namedHere() const {
    std::unordered_set<Hash> named;
    const auto add = [&](const std::vector<Edit>& edits) {
        for (const Edit& edit : edits)
            forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    };
    for (const auto& [id, session] : sessions_) {
        for (const QueuedTransaction& queued : session.transactions) add(queued.transaction.edits);
        if (session.coming) add(session.coming->parts.edits());
    }
    previews_.forEach([&](const ClientId&, const Previews::Preview& preview) {
        named.insert(preview.named.begin(), preview.named.end());
    });
    return named;
}

}  // namespace usdlive::server
