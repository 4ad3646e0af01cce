// Connects the codec of USD values with the blob store.
#include "files/BlobBridge.h"

namespace usdlive::server {

void BlobKeeper::keepBlob(const Hash& hash, SharedBytes bytes) {
    if (!kept_) return;
    const std::lock_guard lock(writing_);
    if (store_.has(hash)) return;
    const auto written = store_.write(hash, bytes->size(), 0, *bytes);
    if (!written) kept_ = tl::unexpected(written.error());
}

SharedBytes StoredBlobs::blob(const Hash& hash) {
    const auto size = store_.size(hash);
    if (!size) return nullptr;
    auto bytes = store_.read(hash, 0, std::size_t(*size));
    if (!bytes || bytes->size() != *size) return nullptr;
    return std::make_shared<const Bytes>(*std::move(bytes));
}

}  // namespace usdlive::server
