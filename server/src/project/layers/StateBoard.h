// The states of layers that sessions are sent: dirty, locked, muted, opened by whom.
#pragma once

#include <map>
#include <set>

#include "Wiring.h"
#include "layers/FileStates.h"
#include "layers/LayerTable.h"
#include "layers/SuspectLayers.h"
#include "sessions/SessionTable.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server {

/// Computes the states of layers from their content, files and sessions, and sends those that
/// changed. What is not durable yet is not sent: it might be rolled back.
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

    /// Sends the states that changed to all sessions.
    void announce();
    /// Sends a session all there is to know.
    void sendAllTo(const Session& session);
    /// Also of a layer that is not loaded.
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

    std::map<LayerId, LayerState> sent_;          ///< as sessions were sent them last
    std::map<LayerId, LayerLock> locks_;          ///< as of the newest durable commit
    std::map<LayerId, std::set<LayerId>> mutes_;  ///< by root layer, for everybody (MU1)
};

}  // namespace usdlive::server
