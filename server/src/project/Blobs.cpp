// Big values (V9): they travel beside the stream and have to be here before a transaction names
// them.
#include "ProjectImpl.h"

namespace usdlive::server {

void Project::Impl::requestBlob(Session& session, const RequestBlob& request) {
    if (host_.hasBlob(request.hash))
        host_.sendBlob(session.id, request.hash, request.offset);
    else if (const auto* frames = previews_.values.find(request.hash))
        host_.sendBeside(session.id, *frames);
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
    // The rest of what is here already is on its way and passed over, but for the last part:
    // another one's may have completed the value since this one's first, which was then not
    // answered.
    if (host_.hasBlob(part.hash)) {
        if (part.offset == 0 || part.offset + part.rawBytes == part.size)
            send(session, BlobStored{part.hash});
        return;
    }
    if (storeClosed_) return refuse(ErrorCode::StorageFailed, "the store has failed");
    if (!host_.hasSpace()) return refuse(ErrorCode::StorageFull, "the disk of the server is full");
    host_.writeBlob(session.id, std::move(part));
}

void Project::Impl::blobWritten(SessionId id, const Hash& hash, const Result<bool>& whole) {
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (!whole)
        sendError(*session, whole.error(), {}, hash);
    else if (*whole)
        send(*session, BlobStored{hash});
}

}  // namespace usdlive::server
