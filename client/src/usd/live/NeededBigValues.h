// The big values of one client: available, requested and still needed ones.
#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <vector>

#include "session/Session.h"
#include "usd/live/LiveSet.h"
#include "values/BlobCache.h"

namespace usdlive::client {

/// Keeps the big values of a client (B2-B7): requests missing values that layers name from the
/// server, delivers them to the layers, and releases values that nothing names any more.
class NeededBigValues {
public:
    NeededBigValues(std::filesystem::path folder, std::uint64_t folderBytes);

    [[nodiscard]] BlobCache& cache() { return cache_; }
    /// The source for layers. A missing value is requested by the next requestMissing().
    [[nodiscard]] BlobSource& source() { return source_; }

    /// Receives a complete value. One that is not `lasting` belongs to a preview only.
    void arrived(const Hash& hash, SharedBytes bytes, bool lasting);
    /// Call it when the server does not have the value.
    void failed(const Hash& hash) { awaited_.erase(hash); }
    /// Notes the values of an own commit: the server has them.
    void committed(const Commit& commit);

    /// Delivers received values to the layers that wait for them.
    void deliver(const LiveSet& layers);
    void requestMissing(Session& session);
    [[nodiscard]] bool isAwaitedBy(const LiveLayer& layer) const;
    /// B7: releases values that neither pending edits nor `needed` name. Cheap if there is little
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
    class Source final : public BlobSource {
    public:
        explicit Source(NeededBigValues& values) : values_(values) {}
        SharedBytes blob(const Hash& hash) override;

    private:
        NeededBigValues& values_;
    };

    [[nodiscard]] bool isWorthReleasing(const Session& session, const std::set<Hash>& lost);
    void keepOnly(const std::set<Hash>& named);

    BlobCache cache_;
    Source source_{*this};
    std::set<Hash> missing_;  // values that a layer was missing during this tick
    std::set<Hash> awaited_;  // requested values
    std::vector<Hash> arrived_;
    std::set<Hash> committed_;   // values of own commits since the last release
    std::size_t stillKept_ = 0;  // values that the last release kept
};

}  // namespace usdlive::client
