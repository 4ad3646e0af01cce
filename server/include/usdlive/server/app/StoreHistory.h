#pragma once

#include <atomic>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <filesystem>
#include <map>
#include <optional>

#include "usdlive/server/app/ProjectStrand.h"
#include "usdlive/server/app/SharedStore.h"
#include "usdlive/server/app/StorageThread.h"
#include "usdlive/server/app/WorkerLanes.h"
#include "usdlive/server/project/ports/History.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// A project's history in its store: appended on the storage thread, read by workers.
class StoreHistory final : public ports::History {
public:
    StoreHistory(ProjectStrand& strand, Intake& intake, WorkerLanes& workers, SharedStore& store,
                 StorageThread& storage, std::filesystem::path blobFolder, Log& log);
    ~StoreHistory() override;

    // The network thread.
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

    /// The storage thread has these commits in the store, or has thrown away all that waited.
    void appended(Revision upTo);
    void thrownAway();
    /// What takes long ends soon.
    void stop() { stopping_ = true; }

private:
    // What workers do.
    Result<std::optional<LoadedLayer>> loadStored(const LayerId& layer);
    Result<CompactOutcome> compactStore(Revision revision);
    /// Does what takes long go on?
    [[nodiscard]] CommitStore::GoesOn whileServing() const;

    ProjectStrand& strand_;
    Intake& intake_;
    WorkerLanes& workers_;
    // In order: checkpoints; snapshots.
    boost::asio::strand<boost::asio::thread_pool::executor_type> checkpoints_, snapshotWriter_;
    SharedStore& store_;
    StorageThread& storage_;
    const std::filesystem::path blobFolder_;
    Log& log_;
    std::map<Revision, std::size_t> appending_;  ///< bytes of commits on their way to the store
    std::atomic<bool> stopping_ = false;
    /// For what reads the whole history, which nobody waits for. The last member: its thread ends
    /// before what it uses.
    boost::asio::thread_pool keeper_{1};
};

}  // namespace usdlive::server
