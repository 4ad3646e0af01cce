// The port to the store of big values.
#pragma once

#include <cstdint>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/ports/Outbox.h"  // SessionId

namespace usdlive::server::ports {

/// Big values: the BlobStore, without waiting for it.
class Blobs {
public:
    virtual ~Blobs() = default;

    /// Which of these are stored? Answered by blobsFound().
    virtual void findBlobs(std::vector<Hash> hashes) = 0;
    /// Adds a part; answered by blobWritten(). Sessions that upload the same value do so
    /// independently. Parts of a value that is stored already are ignored: the answer to the first
    /// and to the last of them is that the value is whole.
    virtual void writeBlob(SessionId session, BlobFrame part) = 0;
    /// Sends a value that is stored from `offset` on, beside the stream.
    virtual void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) = 0;
};

}  // namespace usdlive::server::ports
