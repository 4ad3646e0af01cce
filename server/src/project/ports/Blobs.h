// The port to the store of big values.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "project/ports/Outbox.h"  // SessionId
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server::ports {

/// Asynchronous access to the BlobStore. Each function returns at once.
class Blobs {
public:
    virtual ~Blobs() = default;

    /// Finds out which of these values are stored. Answered by Project::blobsFound().
    virtual void findBlobs(std::vector<Hash> hashes) = 0;
    /// Decompresses a part and passes it to BlobStore::write(), with `session` as the writer,
    /// which takes of the limits of `share`. The parts of a session are written in the order of the
    /// calls. Each call is answered by Project::blobWritten(). If the value is already stored, the
    /// part is ignored, and only the answers to its first and its last part report that the value
    /// is complete.
    virtual void writeBlob(SessionId session, const std::string& share, BlobFrame part) = 0;
    /// Removes the values that are not complete and of which this session has sent parts.
    virtual void removeUnfinished(SessionId session) = 0;
    /// Sends a stored value from the byte `offset` on to the session, beside the stream of commits
    /// (as Outbox::sendBeside()). If it cannot be read, sends the session an error.
    virtual void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) = 0;
};

}  // namespace usdlive::server::ports
