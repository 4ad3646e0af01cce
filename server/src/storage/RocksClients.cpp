// Keeps the transactions of the clients that committed last (M9).
#include <algorithm>

#include "storage/RocksCommitStoreImpl.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

namespace {

// The most records of one write. No commit is appended during it.
constexpr std::size_t kForgottenAtOnce = 2'000;

}  // namespace

/// Returns the ids. Finds them by key, with one search for each client.
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

/// Calls `visit(key, number, revision)` for all recorded transactions of a client, as of one
/// moment.
template <class Visit>
Result<void> RocksCommitStore::forEachTransaction(const ClientId& client, Visit visit) const {
    const std::string first = storekeys::highestTransaction(client),
                      end = storekeys::behindClient(client);
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Clients)));
    for (at->Seek(first); at->Valid() && text(at->key()) < end; at->Next()) {
        if (text(at->key()) == first) continue;
        ByteReader in(bytes(at->value()));
        const std::uint64_t sequence = in.u64();
        const Revision revision = in.u64();
        if (!in.finished()) return damaged("a record of a transaction cannot be read");
        visit(text(at->key()), sequence, revision);
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return {};
}

Result<ClientRecord> RocksCommitStore::clientRecord(const ClientId& client) const {
    ClientRecord record;
    std::vector<std::pair<std::uint64_t, Revision>> late;
    const auto read =
        forEachTransaction(client, [&](auto key, std::uint64_t sequence, Revision revision) {
            const bool isLate = key == storekeys::lateTransaction(client, sequence);
            (isLate ? late : record.committed).emplace_back(sequence, revision);
        });
    if (!read) return tl::unexpected(read.error());
    std::ranges::sort(record.committed);
    // An old number stays in its slot until another one replaces it.
    const std::uint64_t last = record.committed.empty() ? 0 : record.committed.back().first;
    std::erase_if(record.committed,
                  [&](const auto& one) { return last - one.first >= kRemembered; });
    record.committed.insert(record.committed.begin(), late.begin(), late.end());
    std::ranges::sort(record.committed);
    // Read after the transactions: for a client that is being forgotten, at least this shows it.
    record.forgottenUpTo = forgotten_;
    return record;
}

/// Returns the newest commit of a client. `keys` receives the keys of its records.
Result<Revision> RocksCommitStore::newestOf(const ClientId& client,
                                            std::vector<std::string>* keys) const {
    Revision newest = 0;
    if (keys) keys->push_back(storekeys::highestTransaction(client));
    return forEachTransaction(client,
                              [&](auto key, std::uint64_t, Revision revision) {
                                  if (keys) keys->emplace_back(key);
                                  newest = std::max(newest, revision);
                              })
        .map([&] { return newest; });
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
    // Forgets some more, so that it is not necessary again soon.
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

/// Forgets the first of these clients, except those that have committed meanwhile. Returns the
/// number of examined and of forgotten clients.
Result<std::pair<std::size_t, std::size_t>> RocksCommitStore::forgetSome(
    std::span<const std::pair<Revision, ClientId>> byAge) {
    const std::lock_guard lock(clientsMutex_);  // no commit is appended meanwhile
    rocksdb::WriteBatch batch;
    std::vector<ClientId> inactive;
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
        inactive.push_back(client);
    }
    batch.Put(family(Family::Meta), kForgottenKey, slice(encoded<Revision>(upTo)));
    const auto written =
        checkFailed().and_then([&] { return checkSpace(batch.GetDataSize()); }).and_then([&] {
            return write(batch);
        });
    if (!written) return tl::unexpected(written.error());
    for (const ClientId& client : inactive) highest_.erase(client);
    forgotten_ = upTo;
    return std::pair(looked, inactive.size());
}

}  // namespace usdlive::server
