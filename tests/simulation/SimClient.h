// An editor of the simulation.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "EditScript.h"
#include "NamespaceEdits.h"
#include "SimNetwork.h"
#include "SimServer.h"
#include "UndoCheck.h"
#include "session/Session.h"

namespace usdlive::simulation {

/// The properties of the editors that a seed decides.
struct SimStyle {
    std::vector<LayerId> layers;
    std::optional<LayerId> newLayer;  ///< layers that do not exist until a client creates one
    unsigned editPercent = 30;        ///< percentage of the ticks
    unsigned gesturePercent = 3;
    unsigned openPercent = 4;
    unsigned cutPerMille = 3;
    unsigned requestPerMille = 4;   ///< peeks, saves, reloads and logs
    unsigned namespacePercent = 0;  ///< moves prims in all layers, and writes to prims
    unsigned lockPerMille = 0;      ///< takes and ends locks of layers and of specs
    unsigned awayPerMille = 0;      ///< edits hundreds or thousands of frames offline
    bool bigValues = false;
    bool smallBudgets = false;
    bool inParts = false;  ///< sends transactions and commits in parts from some hundred bytes on
    bool slidesOffline = false;  ///< writes values again and again without a connection
    bool checksPrediction = false;
    unsigned undoPercent = 0;  ///< undoes and redoes own work, also offline
};

/// The real Session with a simulated editor, whose layers are LayerDocs.
class SimClient : public client::SessionHost, public client::LayerView {
public:
    SimClient(std::size_t number, const SimStyle& style, SimClock& clock, SimRandom& random,
              SimNetwork& network, SimServer& server);

    void start();
    /// Stops editing; with `all` it opens every layer of the project.
    void stopEditing(bool all);
    /// True if nothing of its own is pending.
    [[nodiscard]] bool isQuiet() const;
    [[nodiscard]] std::string describe() const;

    [[nodiscard]] const NamespaceEdits& namespaceEdits() const { return namespace_; }

    /// Compares its layers with the content of the server's store.
    void check(const std::map<LayerId, std::string>& truth) const;

    [[nodiscard]] const client::Session& session() const { return session_; }
    [[nodiscard]] UserName user() const { return {"user" + std::to_string(number_)}; }
    [[nodiscard]] const std::map<LayerId, LayerDoc>& editor() const { return editor_; }

    /// It could not resume while work was pending. It does not know the moves since, and sends this
    /// work with the paths that it shows.
    bool hasSentByPath = false;
    // Counters; gestures are not counted.
    std::uint64_t authoredEdits = 0;
    std::uint64_t lostEdits = 0;
    std::uint64_t forbidden = 0;       ///< refusals by roles and rules
    std::uint64_t uncertainEdits = 0;  ///< a base replaced their commits before it received them
    std::uint64_t transactions = 0;
    std::uint64_t commitsSeen = 0;
    std::uint64_t commitsAccepted = 0, commitsTogether = 0;
    std::uint64_t connections = 0, rejoins = 0;
    std::uint64_t previewedBlobs = 0;  ///< requested for a preview
    std::uint64_t undos = 0, redos = 0, kept = 0, keptOfOthers = 0;
    std::uint64_t undosChecked = 0;  ///< those that were compared with what others have written

    /// The identity of the store for which each transaction was made (ID3).
    std::map<std::uint64_t, StoreId> madeFor;
    std::uint64_t joinsOfOther = 0;  ///< decisions to join another history
    std::uint64_t regained = 0;      ///< edits that another history lacks (ID4)

    /// Transactions that were returned because the server does not know whether it has committed
    /// them (M14).
    std::set<std::uint64_t> uncertain;
    std::map<std::uint64_t, std::size_t> editsOf;  ///< how many edits a transaction has

    struct Peeked {
        LayerId layer;
        Revision revision;
        std::string dump;
    };
    std::vector<Peeked> peeked;
    std::vector<Checkpoint> checkpoints;  ///< the server has acknowledged them

    // SessionHost
    void send(SharedBytes frames) override;
    [[nodiscard]] std::size_t bulkBytes() override {
        return style_.inParts && ++asked_ % 3 == 0 ? 0 : kChunkBytes;
    }
    SharedBytes localBlob(const Hash& hash) override;
    void blobArrived(const Hash& hash, SharedBytes bytes, bool) override;
    void pending(const client::PendingWork& work) override;
    [[nodiscard]] bool needsBlob(const Hash& hash) override;
    // LayerView
    void reset(const LayerId& layer, const LayerDoc& doc) override;
    void apply(const LayerId& layer, const std::string& path, const EditAction& action) override;

private:
    void connect();
    void receive(ByteView message);
    void connectLater();
    [[nodiscard]] std::size_t unconfirmed() const;
    void tick();
    void editSomething();
    void makeRequests();
    void editNamespace();
    void editAway();
    void slideOffline();
    void openAndClose();
    void authorRandom(std::size_t count);
    void lockSomething();
    void undoSomething();
    void undo(bool redo);
    void author(std::vector<client::AuthoredEdit> edits);
    [[nodiscard]] std::vector<LayerId> joinedLayers() const;
    void handleEvents();
    std::uint64_t request(AnyRequest request);
    void requestEnded(std::uint64_t number);
    void on(const client::event::Committed& event);
    void on(const client::event::Connected& event);
    void on(const client::event::Joined& event);
    void on(const client::event::Lost& event);
    void on(const client::event::CheckpointMade& event);
    void on(const client::event::CheckpointsListed& event);
    void on(const client::event::ServerError& event);
    void on(const client::event::JoinFailed& event);
    void on(const client::event::LayerMade& event);
    void on(const auto&) {}
    void noteTold();
    void checkTold();
    [[nodiscard]] std::string differenceFromTold(
        const std::vector<client::AuthoredEdit>& regained) const;
    void checkAnswered() const;
    void checkRights() const;
    void compareEditor() const;
    void need(const Hash& hash);
    client::Session::Options options();

    const std::size_t number_;
    const SimStyle& style_;
    SimClock& clock_;
    SimRandom& random_;
    SimNetwork& network_;
    SimServer& server_;
    SimRandom undos_;  // separate, so that the seeds that failed once still produce the same run
    UndoCheck others_;
    std::string keptText_;  // lists what the undos and redos of one tick did, for failures
    std::optional<std::vector<client::AuthoredEdit>> undoing_;  // the edits of the present undo
    EditScript script_;
    NamespaceEdits namespace_;

    std::uint64_t lastValue_;
    unsigned asked_ = 0;
    double fakeMs_ = 0;
    std::map<LayerId, LayerDoc> editor_;
    std::map<Hash, SharedBytes> blobs_;
    std::set<Hash> askedFor_;
    std::map<std::uint64_t, bool> requests_;    // by number: has it ended?
    std::map<std::uint64_t, Revision> naming_;  // by request: the revision that was confirmed then
    std::set<LayerId> opened_;
    server::SessionId link_ = 0;  // 0: no connection
    bool settling_ = false;
    Revision lastSeen_ = 0;
    std::set<std::uint64_t> acknowledged_;  // own transactions
    std::set<std::uint64_t> lost_;          // own transactions
    // ID4: the confirmed layers of the history that it has stopped in or is leaving.
    LayerDocs told_;
    Revision toldRevision_ = 0;
    std::vector<client::AuthoredEdit> regained_;
    bool leaving_ = false, hasAll_ = false, left_ = false, deciding_ = false;
    bool hasMoved_ = false;  // a commit followed the lost work of the history before
    std::optional<client::MessageReader> reader_;  // belongs to the current connection
    client::Session session_;
};

}  // namespace usdlive::simulation
