// What clients have committed (M9): kept of those that came last.
#include <algorithm>

#include "RocksCommitStoreImpl.h"
#include "StoreRules.h"

namespace usdlive::server {

namespace {

// A write of so many records, during which no commit is appended.
constexpr std::size_t kForgottenAtOnce = 2'000;

}  // namespace

/// The ids, by their keys, without a look at each key.
Result<std::vector<ClientId>> RocksCommitStore::clients() const {
    std::vector<ClientId> all;
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Clients)));
    for (at->SeekToFirst(); at->Valid() && text(at->key()) != kClientsRevisionKey;) {
        auto client = storekeys::clientOf(text(at->key()));
        if (!client) return damaged("a record of a transaction cannot be read");
        all.push_back(std::move(*client));
        at->Seek(storekeys::behindClient(all.back()));
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return all;
}

/// The newest commit of a client. `keys`: of its records.
Result<Revision> RocksCommitStore::newestOf(const ClientId& client,
                                            std::vector<std::string>* keys) const {
    const std::string first = storekeys::highestTransaction(client),
                      end = storekeys::behindClient(client);
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Clients)));
    Revision newest = 0;
    for (at->Seek(first); at->Valid() && text(at->key()) < end; at->Next()) {
        if (keys) keys->emplace_back(text(at->key()));
        if (text(at->key()) == first) continue;
        ByteReader in(bytes(at->value()));
        (void)in.u64();
        newest = std::max<Revision>(newest, in.u64());
        if (!in.finished()) return damaged("a record of a transaction cannot be read");
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return newest;
}

Result<std::size_t> RocksCommitStore::forgetClients(std::size_t most,
                                                    const std::set<ClientId>& kept) {
    const auto known = clients();
    if (!known) return tl::unexpected(known.error());
    if (known->size() <= most) return 0;
    std::vector<std::pair<Revision, ClientId>> byAge;
    for (const ClientId& client : *known) {
        const auto newest = newestOf(client, nullptr);
        if (!newest) return tl::unexpected(newest.error());
        byAge.emplace_back(*newest, client);
    }
    std::ranges::sort(byAge);
    // Some more, so that it is not due again at once.
    byAge.resize(byAge.size() - most / kForgetPart * (kForgetPart - 1));
    std::erase_if(byAge, [&](const auto& one) { return kept.contains(one.second); });
    std::size_t forgotten = 0;
    for (std::size_t next = 0; next < byAge.size();) {
        const auto some = forgetSome(std::span(byAge).subspan(next));
        if (!some) return tl::unexpected(some.error());
        next += some->first;
        forgotten += some->second;
    }
    return forgotten;
}

/// Forgets the first of these, but for those that have committed meanwhile. How many were looked
/// at, and how many were forgotten.
Result<std::pair<std::size_t, std::size_t>> RocksCommitStore::forgetSome(
    std::span<const std::pair<Revision, ClientId>> byAge) {
    const std::lock_guard lock(clientsMutex_);  // nothing is appended
    rocksdb::WriteBatch batch;
    std::vector<ClientId> gone;
    std::size_t looked = 0;
    Revision upTo = forgotten_;
    for (; looked < byAge.size() && std::size_t(batch.Count()) < kForgottenAtOnce; ++looked) {
        const auto& [revision, client] = byAge[looked];
        std::vector<std::string> keys;
        const auto newest = newestOf(client, &keys);
        if (!newest) return tl::unexpected(newest.error());
        if (*newest != revision) continue;
        for (const std::string& key : keys) batch.Delete(family(Family::Clients), key);
        upTo = std::max(upTo, revision);
        gone.push_back(client);
    }
    batch.Put(family(Family::Meta), kForgottenKey, slice(encoded<Revision>(upTo)));
    const auto written =
        checkFailed().and_then([&] { return checkSpace(batch.GetDataSize()); }).and_then([&] {
            return write(batch);
        });
    if (!written) return tl::unexpected(written.error());
    for (const ClientId& client : gone) highest_.erase(client);
    forgotten_ = upTo;
    return std::pair(looked, gone.size());
}

}  // namespace usdlive::server
