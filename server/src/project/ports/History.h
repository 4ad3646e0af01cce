// The port to the store of commits.
#pragma once

#include <cstdint>

#include "project/CommitStore.h"
#include "project/ports/CommitLog.h"
#include "project/ports/Outbox.h"  // SessionId
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server::ports {

/// Asynchronous access to the project's CommitStore. Each function returns at once. The requests of
/// one session are identified by `request`, which the answer repeats. Several requests may be
/// executed at the same time, unless a comment says otherwise.
class History : public CommitLog {
public:
    /// Calls CommitStore::keepSnapshot() for a durable `revision`. May take long. Answered by
    /// Project::snapshotKept().
    virtual void keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                              const Hash& hash) = 0;
    /// Calls CommitStore::loadLayer(). Answered by Project::layerLoaded(), or by layerNotStored()
    /// if no commit concerns the layer.
    virtual void loadLayer(const LayerId& layer) = 0;
    /// Reads the commits [from, to] for a session. Answered by Project::commitsRead() with all of
    /// them, or with the first ones (at least one) if they are large.
    virtual void readCommits(SessionId session, Revision from, Revision to) = 0;
    /// Calls CommitStore::layerAt() for a session. Answered by Project::historyRead(), or by
    /// historyNotStored() if no commit concerns the layer.
    virtual void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                             Revision revision) = 0;
    /// Calls CommitStore::clientRecord(). Answered by Project::clientRead().
    virtual void readClient(const ClientId& client) = 0;

    /// Calls CommitStore::addCheckpoint(), in the order of the requests. Answered by
    /// Project::checkpointAdded().
    virtual void addCheckpoint(SessionId session, std::uint64_t request,
                               const Checkpoint& checkpoint) = 0;
    /// Calls CommitStore::checkpoints(), after the addCheckpoint() calls so far. Answered by
    /// Project::checkpointsRead().
    virtual void readCheckpoints(SessionId session, std::uint64_t request) = 0;

    /// Calls server::findBase(), after the addCheckpoint() calls so far. Answered by
    /// Project::baseFound().
    virtual void findBase(std::int64_t beforeMs, Revision upTo) = 0;
    /// Calls CommitStore::compact(). Takes long, and must not delay other requests. Answered by
    /// Project::baseChanged(), then compacted().
    virtual void compact(Revision revision) = 0;
    /// Measures the disk space of the store and the big values. Answered by
    /// Project::storageMeasured().
    virtual void measureStorage(SessionId session, std::uint64_t request) = 0;
};

}  // namespace usdlive::server::ports
