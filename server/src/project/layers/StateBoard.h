// The states of layers for sessions: dirty, locked, muted, and the users that have them open.
#pragma once

#include <map>
#include <set>

#include "project/Wiring.h"
#include "project/layers/FileStates.h"
#include "project/layers/LayerTable.h"
#include "project/layers/SuspectLayers.h"
#include "project/sessions/SessionTable.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server {

/// Computes the states of layers from their content, files and sessions, and sends the changed
/// ones. Depends on durable commits only, because others may be rolled back.
class StateBoard : public LineListener, public LayerListener, public SessionListener {
public:
    StateBoard(const HistoryLine& line, const LayerTable& layers, const FileStates& files,
               SessionTable& sessions, SuspectLayers& suspects, const Ports& ports)
        : line_(line),
          layers_(layers),
          files_(files),
          sessions_(sessions),
          suspects_(suspects),
          outbox_(ports.outbox),
          activity_(ports.activity) {}

    /// Sends the changed states to all sessions.
    void announce();
    /// Sends the present states to a session.
    void sendAllTo(const Session& session);
    /// Returns the lock of a layer, loaded or not.
    [[nodiscard]] LayerLock lockAt(const LayerId& layer) const;

    void ordered(const OrderedCommit& commit) override;
    void durable(const OrderedCommit& commit) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void removed(const LayerId& layer) override;
    void openChanged(const LayerId& layer) override { suspects_->insert(layer); }

private:
    [[nodiscard]] LayerState stateOf(const LayerId& layer, const std::set<LayerId>& muted) const;
    [[nodiscard]] std::set<LayerId> mutedLayers() const;
    [[nodiscard]] std::set<LayerId> mutedBy(const LayerId& root) const;
    void updateMutes(const LayerId& layer, const LayerDoc& doc);
    void logMutes(const UserName& user, const LayerId& root, const std::set<LayerId>& before);
    void updateLock(const UserName& user, const LayerId& layer, const LayerDoc& doc);

    Wire<const HistoryLine> line_;
    Wire<const LayerTable> layers_;
    Wire<const FileStates> files_;
    Wire<SessionTable> sessions_;
    Wire<SuspectLayers> suspects_;
    Wire<ports::Outbox> outbox_;
    Wire<ports::Activity> activity_;

    std::map<LayerId, LayerState> sent_;  ///< the states that were sent last
    std::map<LayerId, LayerLock> locks_;  ///< at the newest durable commit
    /// Muted layers by root layer, for all users (MU1).
    std::map<LayerId, std::set<LayerId>> mutes_;
};

}  // namespace usdlive::server
