// The port to the store of commits.
#pragma once

#include <cstdint>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/server/project/CommitStore.h"
#include "usdlive/server/project/ports/CommitLog.h"
#include "usdlive/server/project/ports/Outbox.h"  // SessionId

namespace usdlive::server::ports {

/// The project's commits, and what is kept with them: the CommitStore, without waiting for it.
class History : public CommitLog {
public:
    /// CommitStore::keepSnapshot(), of a revision that is durable; answered by snapshotKept().
    /// Nothing waits for it.
    virtual void keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                              const Hash& hash) = 0;
    /// Answered by layerLoaded(), or by layerNotStored() if no commit is for the layer.
    virtual void loadLayer(const LayerId& layer) = 0;
    /// Commits of [from, to], answered by commitsRead(): all of them, or the first of them.
    virtual void readCommits(SessionId session, Revision from, Revision to) = 0;
    /// The layer as it was; answered by historyRead(), or by historyNotStored() if no commit is for
    /// it.
    virtual void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                             Revision revision) = 0;
    /// CommitStore::clientRecord(); answered by clientRead().
    virtual void readClient(const ClientId& client) = 0;

    /// CommitStore::addCheckpoint(), in the order asked; answered by checkpointAdded().
    virtual void addCheckpoint(SessionId session, std::uint64_t request,
                               const Checkpoint& checkpoint) = 0;
    /// CommitStore::checkpoints(), after those added so far; answered by checkpointsRead().
    virtual void readCheckpoints(SessionId session, std::uint64_t request) = 0;

    /// server::findBase() in the store, after the checkpoints added so far; answered by
    /// baseFound().
    virtual void findBase(std::int64_t beforeMs, Revision upTo) = 0;
    /// CommitStore::compact(); takes long, without delaying anything else; answered by
    /// baseChanged(), then compacted().
    virtual void compact(Revision revision) = 0;
    /// Measures the space that the store takes; answered by storageMeasured().
    virtual void measureStorage(SessionId session, std::uint64_t request) = 0;
};

}  // namespace usdlive::server::ports
