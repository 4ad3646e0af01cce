// Reads and writes a project's big values on workers.
#include "app/ServedBlobs.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>

#include "project/SharedFrame.h"

namespace usdlive::server {

namespace {

/// Returns the parts of a big value, one per call.
class BlobSource {
public:
    BlobSource(const BlobStore& blobs, const PublicText& texts, const Hash& hash,
               std::uint64_t offset)
        : blobs_(blobs), texts_(texts), hash_(hash), offset_(offset) {}

    SharedBytes operator()(std::size_t most) {
        if (done_) return nullptr;
        const auto size = blobs_.size(hash_);
        if (!size) return failed(size.error());
        const auto part = blobs_.read(hash_, offset_, std::min(most, kChunkBytes));
        if (!part) return failed(part.error());
        done_ = part->empty() || offset_ + part->size() >= *size;
        if (part->empty()) return nullptr;
        return sharedFrame(BlobFrame{hash_, *size, std::exchange(offset_, offset_ + part->size()),
                                     std::uint32_t(part->size()), deflate(*part)});
    }

private:
    SharedBytes failed(const Error& error) {
        done_ = true;
        return sharedFrame(ErrorMessage{
            std::string(errorName(error.code)), texts_(error).message, false, {}, hash_});
    }

    const BlobStore& blobs_;
    const PublicText& texts_;
    Hash hash_;
    std::uint64_t offset_;
    bool done_ = false;
};

}  // namespace

ServedBlobs::ServedBlobs(ProjectStrand& strand, WorkerShares& workers,
                         const TransportTable& transports, BlobStore& blobs,
                         const PublicText& texts)
    : strand_(strand),
      workers_(workers),
      writer_(workers.joins),
      transports_(transports),
      blobs_(blobs),
      texts_(texts) {}

void ServedBlobs::removeUnfinished(SessionId session) {
    writer_.post([this, session] { blobs_.forget(session); });
}

void ServedBlobs::findBlobs(std::vector<Hash> hashes) {
    auto asked = std::make_shared<const std::vector<Hash>>(std::move(hashes));
    strand_.inBackground(
        *workers_.joins, 0, 0,
        [this, asked] {
            std::vector<Hash> stored;
            std::ranges::copy_if(*asked, std::back_inserter(stored),
                                 [this](const Hash& hash) { return blobs_.has(hash); });
            return Result<std::vector<Hash>>(std::move(stored));
        },
        [asked](Project& project, const Result<std::vector<Hash>>& stored) {
            project.blobsFound(*asked, stored.value_or(std::vector<Hash>()));
        });
}

void ServedBlobs::writeBlob(SessionId session, const std::string& share, BlobFrame part) {
    const Hash hash = part.hash;
    const std::size_t bytes = Intake::kJobBytes + part.data.size();
    strand_.inBackground(
        writer_, session, bytes,
        [this, writer = BlobWriter(session, share), part = std::move(part)] {
            return write(writer, part);
        },
        [session, hash](Project& project, Result<bool> whole) {
            project.blobWritten(session, hash, std::move(whole));
        });
}

Result<bool> ServedBlobs::write(const BlobWriter& writer, const BlobFrame& part) {
    if (blobs_.has(part.hash)) return part.offset == 0 || part.offset + part.rawBytes == part.size;
    return inflate(part.data, part.rawBytes, kChunkBytes).and_then([&](const Bytes& raw) {
        return blobs_.write(part.hash, part.size, part.offset, raw, writer);
    });
}

void ServedBlobs::sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) {
    transports_.of(session).sendBeside(session, BlobSource(blobs_, texts_, hash, offset));
}

}  // namespace usdlive::server
