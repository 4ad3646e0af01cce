#include "BlobTransfer.h"

#include <algorithm>

namespace usdlive::client {

BlobUploads::Upload* BlobUploads::find(const Hash& hash) {
    const auto found = std::find_if(uploads_.begin(), uploads_.end(),
                                    [&](const Upload& upload) { return upload.hash == hash; });
    return found == uploads_.end() ? nullptr : &*found;
}

bool BlobUploads::ready(const std::vector<Value>& blobs) {
    bool ready = true;
    for (const Value& blob : blobs) {
        if (stored_.contains(blob.hash())) continue;
        if (!find(blob.hash())) {
            SharedBytes bytes = host_.localBlob(blob.hash());
            if (!bytes) continue;  // the server's own, or its refusal will say so
            uploads_.push_back({blob.hash(), std::move(bytes), 0, 0});
        }
        ready = false;
    }
    return ready;
}

void BlobUploads::send(std::size_t chunks, std::int64_t nowMs) {
    for (Upload& upload : uploads_) {
        if (upload.notBeforeMs > nowMs) continue;
        const ByteView all(*upload.bytes);
        for (; chunks > 0 && upload.offset < all.size(); --chunks) {
            const ByteView part = all.subspan(
                upload.offset, std::min<std::size_t>(kChunkBytes, all.size() - upload.offset));
            host_.send(std::make_shared<const Bytes>(
                encodeFrame(BlobFrame{upload.hash, all.size(), upload.offset,
                                      std::uint32_t(part.size()), deflate(part)})));
            upload.offset += part.size();
        }
        if (chunks == 0) return;
    }
}

void BlobUploads::stored(const Hash& hash) {
    stored_.insert(hash);
    std::erase_if(uploads_, [&](const Upload& upload) { return upload.hash == hash; });
}

void BlobUploads::again(const Hash& hash, std::int64_t nowMs) {
    if (Upload* upload = find(hash)) {
        upload->offset = 0;
        upload->notBeforeMs = nowMs + kAgainMs;
    }
}

void BlobUploads::forget(const Hash& hash) { stored_.erase(hash); }

void BlobUploads::disconnected() { uploads_.clear(); }

void BlobUploads::forgetAll() {
    uploads_.clear();
    stored_.clear();
}

Result<void> BlobDownloads::received(ReceivedBlob&& blob) {
    if (blob.whole && !*blob.whole) return {};  // more is to come
    if (wanted_.erase(blob.hash) == 0) return {};
    return std::move(blob.whole).map([&](SharedBytes whole) {
        host_.blobArrived(blob.hash, std::move(whole));
    });
}

}  // namespace usdlive::client
