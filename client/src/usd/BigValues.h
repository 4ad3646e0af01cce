// The big values of one client: which are here, asked for, and still needed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <vector>

#include "session/Session.h"
#include "usd/BlobCache.h"
#include "usd/LiveSet.h"

namespace usdlive::client {

/// Keeps the big values of a client (B2-B7): asks the server for those that layers name and that
/// are not here, brings them to the layers, and releases those that nothing names any more.
class BigValues {
public:
    BigValues(std::filesystem::path folder, std::uint64_t folderBytes);

    [[nodiscard]] BlobCache& cache() { return cache_; }
    /// For layers: a value that is not here is asked for by the next requestMissing().
    [[nodiscard]] usd::BlobSource& source() { return source_; }

    /// A value has arrived whole. One that is not `lasting` is only of a preview.
    void arrived(const Hash& hash, SharedBytes bytes, bool lasting);
    /// The server cannot give the value.
    void failed(const Hash& hash) { awaited_.erase(hash); }
    /// Notes the values of a commit of one's own: the server has them.
    void committed(const Commit& commit);

    /// Brings the values that have arrived to the layers that wait for them.
    void deliver(const LiveSet& layers);
    void requestMissing(Session& session);
    [[nodiscard]] bool isAwaitedBy(const LiveLayer& layer) const;
    /// B7: releases values that neither pending work nor `needed` names. Cheap when there is little
    /// to release.
    template <class Needed>
    void release(const Session& session, const std::set<Hash>& lost, Needed needed) {
        if (!isWorthReleasing(session, lost)) return;
        auto named = session.namedBlobs();
        named.insert(lost.begin(), lost.end());
        named.merge(needed());
        keepOnly(named);
    }

private:
    class Source final : public usd::BlobSource {
    public:
        explicit Source(BigValues& values) : values_(values) {}
        SharedBytes blob(const Hash& hash) override;

    private:
        BigValues& values_;
    };

    [[nodiscard]] bool isWorthReleasing(const Session& session, const std::set<Hash>& lost);
    void keepOnly(const std::set<Hash>& named);

    BlobCache cache_;
    Source source_{*this};
    std::set<Hash> missing_;  // noticed within a tick
    std::set<Hash> awaited_;  // asked for
    std::vector<Hash> arrived_;
    std::set<Hash> committed_;   // of one's own commits, since the last release
    std::size_t stillKept_ = 0;  // values that the last release kept
};

}  // namespace usdlive::client
