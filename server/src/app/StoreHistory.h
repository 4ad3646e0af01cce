// The history of a project in its store.
#pragma once

#include <atomic>
#include <filesystem>
#include <map>
#include <optional>

#include "app/ProjectStrand.h"
#include "app/SharedStore.h"
#include "app/StorageThread.h"
#include "app/Workers.h"
#include "project/ports/History.h"
#include "transport/Log.h"

namespace usdlive::server {

/// A project's history in its store, appended by the storage thread and read by workers.
class StoreHistory final : public ports::History {
public:
    StoreHistory(ProjectStrand& strand, Intake& intake, WorkerShares& workers, SharedStore& store,
                 StorageThread& storage, std::filesystem::path blobFolder, Log& log);

    // Call these on the network thread.
    void append(CommitRecord commit) override;
    void keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                      const Hash& hash) override;
    void loadLayer(const LayerId& layer) override;
    void readCommits(SessionId session, Revision from, Revision to) override;
    void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override;
    void readClient(const ClientId& client) override;
    void addCheckpoint(SessionId session, std::uint64_t request,
                       const Checkpoint& checkpoint) override;
    void readCheckpoints(SessionId session, std::uint64_t request) override;
    void findBase(std::int64_t beforeMs, Revision upTo) override;
    void compact(Revision revision) override;
    void measureStorage(SessionId session, std::uint64_t request) override;

    /// Call when the storage thread has stored these commits, or has dropped the waiting ones.
    void appended(Revision upTo);
    void dropped();
    /// Makes long operations end soon.
    void stop() { stopping_ = true; }

private:
    // Run by workers.
    Result<std::optional<LoadedLayer>> loadStored(const LayerId& layer);
    Result<CompactOutcome> compactStore(Revision revision);
    /// Returns a function that returns false after stop().
    [[nodiscard]] CommitStore::KeepRunning whileServing() const;

    ProjectStrand& strand_;
    Intake& intake_;
    WorkerShares& workers_;
    // Run checkpoints in order, snapshots in order, and one job at a time that reads the whole
    // history and has no waiting user.
    SerialJobs checkpoints_, snapshotWriter_, keeper_;
    SharedStore& store_;
    StorageThread& storage_;
    const std::filesystem::path blobFolder_;
    Log& log_;
    std::map<Revision, std::size_t> appending_;  ///< bytes of commits that are not stored yet
    std::atomic<bool> stopping_ = false;
};

}  // namespace usdlive::server
