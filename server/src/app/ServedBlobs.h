// The big values of a project in its store.
#pragma once

#include <vector>

#include "app/ProjectStrand.h"
#include "app/SessionOutbox.h"
#include "app/Workers.h"
#include "project/ports/Blobs.h"

namespace usdlive::server {

/// The big values of a project in its store, read and written by workers. Network thread.
class ServedBlobs final : public ports::Blobs {
public:
    ServedBlobs(ProjectStrand& strand, WorkerShares& workers, const TransportTable& transports,
                BlobStore& blobs, const PublicText& texts);

    void findBlobs(std::vector<Hash> hashes) override;
    void writeBlob(SessionId session, const std::string& share, BlobFrame part) override;
    void removeUnfinished(SessionId session) override;
    void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) override;

private:
    Result<bool> write(const BlobWriter& writer, const BlobFrame& part);

    ProjectStrand& strand_;
    WorkerShares& workers_;
    SerialJobs writer_;  // keeps parts in order
    const TransportTable& transports_;
    BlobStore& blobs_;
    const PublicText& texts_;
};

}  // namespace usdlive::server
