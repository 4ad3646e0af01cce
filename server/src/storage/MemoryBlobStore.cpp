// Stores big values in memory, for tests.
#include <algorithm>
#include <map>
#include <mutex>

#include "storage/BlobRules.h"
#include "storage/BlobStore.h"

namespace usdlive::server {

namespace {

class MemoryBlobStore final : public BlobStore {
public:
    explicit MemoryBlobStore(const BlobStoreOptions& options) : options_(options) {}

    [[nodiscard]] bool has(const Hash& hash) const override {
        const std::lock_guard lock(mutex_);
        return values_.contains(hash);
    }
    [[nodiscard]] Result<std::uint64_t> size(const Hash& hash) const override {
        const std::lock_guard lock(mutex_);
        const auto value = values_.find(hash);
        if (value == values_.end()) return missing(hash);
        return value->second.size();
    }
    Result<bool> write(const Hash& hash, std::uint64_t size, std::uint64_t offset, ByteView part,
                       const BlobWriter& writer) override {
        const std::lock_guard lock(mutex_);
        Bytes value;
        auto begun = unfinished_.extract({hash, writer.id});
        if (begun.empty()) begun = unfinished_.extract({hash, kLeft});
        if (!begun.empty() && offset > 0) value = std::move(begun.mapped());
        if (values_.contains(hash)) return true;
        offset = skipWritten(value.size(), offset, part);
        const auto fits =
            checkPart(hash, size, value.size(), offset, part.size(), options_.maxBytes);
        if (!fits) return tl::unexpected(fits.error());
        value.insert(value.end(), part.begin(), part.end());
        const bool whole = value.size() == size;
        if (whole && sha256(value) != hash)
            return blobError(ErrorCode::BlobMismatch, hash, "has another content");
        (whole ? values_[hash] : unfinished_[{hash, writer.id}]) = std::move(value);
        return whole;
    }
    [[nodiscard]] Result<Bytes> read(const Hash& hash, std::uint64_t offset,
                                     std::size_t count) const override {
        const std::lock_guard lock(mutex_);
        const auto value = values_.find(hash);
        if (value == values_.end()) return missing(hash);
        const ByteView all(value->second);
        const ByteView rest = all.subspan(std::min<std::uint64_t>(offset, all.size()));
        const ByteView part = rest.first(std::min(count, rest.size()));
        return Bytes(part.begin(), part.end());
    }
    void forget(std::uint64_t writer) override {
        const std::lock_guard lock(mutex_);
        for (auto one = unfinished_.begin(); one != unfinished_.end();) {
            const auto next = std::next(one);
            if (one->first.second == writer) {
                auto left = unfinished_.extract(one);
                left.key().second = kLeft;
                unfinished_.insert(std::move(left));
            }
            one = next;
        }
    }
    [[nodiscard]] Result<std::vector<Hash>> list() const override {
        const std::lock_guard lock(mutex_);
        std::vector<Hash> all;
        for (const auto& [hash, value] : values_) all.push_back(hash);
        return all;
    }
    void drop(std::span<const Hash> hashes) override {
        const std::lock_guard lock(mutex_);
        for (const Hash& hash : hashes)
            if (auto value = values_.extract(hash); !value.empty())
                dropped_.push_back(value.mapped().size());
    }
    Result<Purged> purge(std::size_t most) override {
        const std::lock_guard lock(mutex_);
        Purged purged;
        for (; purged.values < most && !dropped_.empty(); ++purged.values) {
            purged.bytes += dropped_.back();
            dropped_.pop_back();
        }
        return purged;
    }

private:
    static constexpr std::uint64_t kLeft = ~std::uint64_t(0);  // a writer that has left

    static tl::unexpected<Error> missing(const Hash& hash) {
        return blobError(ErrorCode::BlobNotFound, hash, "does not exist");
    }

    const BlobStoreOptions options_;
    mutable std::mutex mutex_;
    std::map<Hash, Bytes> values_;  // guarded by mutex_
    // Keyed by value and writer; guarded by mutex_.
    std::map<std::pair<Hash, std::uint64_t>, Bytes> unfinished_;
    std::vector<std::uint64_t> dropped_;  // sizes; guarded by mutex_
};

}  // namespace

std::unique_ptr<BlobStore> createMemoryBlobStore(const BlobStoreOptions& options) {
    return std::make_unique<MemoryBlobStore>(options);
}

}  // namespace usdlive::server
