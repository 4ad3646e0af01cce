#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "EditScript.h"
#include "SimNetwork.h"
#include "SimServer.h"
#include "usdlive/client/session/Session.h"

namespace usdlive::simulation {

/// What a seed decides about the editors.
struct SimStyle {
    std::vector<LayerId> layers;
    std::optional<LayerId> newLayer;  ///< one of these, that is not there until a client creates it
    unsigned editPercent = 30;        ///< of the ticks
    unsigned gesturePercent = 3;
    unsigned openPercent = 4;
    unsigned cutPerMille = 3;
    unsigned requestPerMille = 4;  ///< peeks, saves, reloads, logs
    unsigned lockPerMille = 0;     ///< locks of layers and of specs, taken and ended
    unsigned awayPerMille = 0;     ///< hundreds or thousands of frames are edited offline
    bool bigValues = false;
    bool smallBudgets = false;
    bool inParts = false;  ///< transactions and commits go in parts from some hundred bytes on
    bool slidesOffline = false;  ///< values are written again and again without a connection
    bool checksPrediction = false;
};

/// The real Session with a made-up editor around it, whose layers are LayerDocs.
class SimClient : public client::SessionHost, public client::LayerView {
public:
    SimClient(std::size_t number, const SimStyle& style, SimClock& clock, SimRandom& random,
              SimNetwork& network, SimServer& server);

    void start();
    /// Stops editing; `all`: opens every layer there is.
    void settle(bool all);
    /// Nothing of its own is under way.
    [[nodiscard]] bool isSettled() const;
    [[nodiscard]] std::string describe() const;

    /// Compares what it has with what the server's store holds.
    void check(const std::map<LayerId, std::string>& truth) const;

    [[nodiscard]] const client::Session& session() const { return session_; }
    [[nodiscard]] const std::map<LayerId, LayerDoc>& editor() const { return editor_; }

    // Not of gestures.
    bool knowsParts = true;  ///< FR8
    std::uint64_t authoredEdits = 0;
    std::uint64_t lostEdits = 0;
    std::uint64_t uncertainEdits = 0;  ///< of commits that were replaced before they were seen
    std::uint64_t transactions = 0;
    std::uint64_t commitsSeen = 0;
    std::uint64_t commitsTogether = 0;
    std::uint64_t connections = 0, rejoins = 0;
    std::uint64_t previewedBlobs = 0;  ///< that came for a preview

    /// Is lost because the server does not know whether it has committed it (M14).
    std::set<std::uint64_t> uncertain;

    struct Peeked {
        LayerId layer;
        Revision revision;
        std::string dump;
    };
    std::vector<Peeked> peeked;
    std::vector<Checkpoint> checkpoints;  ///< of which it was told that they are stored

    // SessionHost
    void send(SharedBytes frames) override;
    [[nodiscard]] bool takesMore() override { return !style_.inParts || ++asked_ % 3 != 0; }
    SharedBytes localBlob(const Hash& hash) override;
    void blobArrived(const Hash& hash, SharedBytes bytes, bool) override;
    [[nodiscard]] bool needsBlob(const Hash& hash) override;
    // LayerView
    void reset(const LayerId& layer, const LayerDoc& doc) override;
    void apply(const LayerId& layer, const std::string& path, const EditAction& action) override;

private:
    void connect();
    void connectLater();
    void tick();
    void editSomething();
    void makeRequests();
    void editAway();
    void slideOffline();
    void openAndClose();
    void authorRandom(std::size_t count);
    void lockSomething();
    void author(std::vector<client::AuthoredEdit> edits);
    [[nodiscard]] std::vector<LayerId> joinedLayers() const;
    void handleEvents();
    void on(const client::event::Committed& event);
    void on(const client::event::Connected& event);
    void on(const client::event::Lost& event);
    void on(const client::event::CheckpointMade& event);
    void on(const client::event::CheckpointsListed& event);
    void on(const client::event::ServerError& event);
    void on(const client::event::JoinFailed& event);
    void on(const client::event::LayerMade& event);
    void on(const auto&) {}
    void compareEditor() const;
    void need(const Hash& hash);
    client::Session::Options options();

    const std::size_t number_;
    const SimStyle& style_;
    SimClock& clock_;
    SimRandom& random_;
    SimNetwork& network_;
    SimServer& server_;
    EditScript script_;

    std::uint64_t lastValue_;
    unsigned asked_ = 0;
    double fakeMs_ = 0;
    std::map<LayerId, LayerDoc> editor_;
    std::map<Hash, SharedBytes> blobs_;
    std::set<Hash> askedFor_;
    std::map<std::uint64_t, Revision> naming_;  // by request: what was confirmed then
    std::set<LayerId> opened_;
    server::SessionId link_ = 0;  // 0: none
    bool settling_ = false;
    Revision lastSeen_ = 0;
    std::set<std::uint64_t> toldCommitted_;        // own transactions
    std::optional<client::MessageReader> reader_;  // of the present link
    client::Session session_;
};

}  // namespace usdlive::simulation
