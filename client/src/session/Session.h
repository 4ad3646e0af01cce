// Session: one client's side of the protocol, without network, threads and USD.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "session/MessageReader.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/client/session/Undo.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

class OwnRights;

/// An own transaction, for a journal that keeps it until it is acknowledged.
struct PendingWork {
    std::uint64_t sequence = 0;
    Revision revision = 0;  ///< revision of the confirmed layers when it was submitted
    Hash hash;              ///< the chain hash of that revision
    StoreId store;          ///< the identity of the project's store (ID1); empty: unknown
    const std::vector<AuthoredEdit>& edits;
};

/// The interface that a session needs from its process. Called from within Session's functions.
class SessionHost {
public:
    virtual ~SessionHost() = default;
    /// Sends encoded frames, in order. Called between connected() and disconnected().
    virtual void send(SharedBytes frames) = 0;
    /// Returns the size of the next part of a big value, before compression; 0 while the connection
    /// is behind: such parts then wait, and other frames are sent nevertheless.
    [[nodiscard]] virtual std::size_t bulkBytes() { return kChunkBytes; }
    /// Returns the bytes of a big value that the editor authored; nullptr if they are not here.
    [[nodiscard]] virtual SharedBytes localBlob(const Hash& hash) = 0;
    /// Returns whether localBlob() has the value. Cheap.
    [[nodiscard]] virtual bool holdsBlob(const Hash& hash) { return localBlob(hash) != nullptr; }
    /// Called when the server has stored an uploaded big value.
    virtual void blobStored(const Hash& /*hash*/) {}
    /// Called when a big value is complete and has the right hash. The host keeps it. A value that
    /// is not `lasting` is only part of a preview, and is kept while there is room.
    virtual void blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) = 0;
    /// Called when a download has failed. Returns whether the value is still needed; the session
    /// then requests it again.
    [[nodiscard]] virtual bool needsBlob(const Hash&) { return true; }
    /// Called when a transaction becomes pending, with its edits. Called again with the same
    /// sequence number when its edits have changed (an open gesture, or SE15).
    virtual void pending(const PendingWork& /*work*/) {}
    /// Called when a transaction was acknowledged or refused.
    virtual void answered(std::uint64_t /*sequence*/) {}
    /// Takes what the session does not need any more. Destroying it can take milliseconds; a host
    /// may do that on another thread.
    virtual void discard(std::shared_ptr<void> /*garbage*/) {}
};

/// The editor's layers. Called from Session::advance() and Session::author() only.
class LayerView {
public:
    virtual ~LayerView() = default;
    /// Called for each part of a snapshot, so that a worker can start building the layer early. A
    /// first part replaces all parts before it.
    virtual void arriving(const LayerId& /*layer*/, std::shared_ptr<const SnapshotPart> /*part*/) {}
    /// Called after the last part, with the complete snapshot. reset() follows at once, and also
    /// contains the commits since the snapshot. Not every reset() follows a snapshot.
    virtual void arrived(const LayerId& /*layer*/, const LayerDoc& /*snapshot*/) {}
    /// Replaces the content of a layer (it was joined, or joined again).
    virtual void reset(const LayerId& layer, const LayerDoc& doc) = 0;
    /// Applies one change to the content that the editor shows. The path is absolute.
    virtual void apply(const LayerId& layer, const std::string& path, const EditAction& action) = 0;
    /// Called with each commit of another client.
    virtual void othersCommitted(const Commit& /*commit*/) {}
    /// Called with each commit of this client. Its author had received the commits up to `base`.
    virtual void ownCommitted(const Commit& /*commit*/, Revision /*base*/) {}
};

/// One client's side of the protocol: the confirmed layers, the pending transactions on top, and
/// the view, which is what the editor shows (M7). No I/O, no threads, no USD; used by one thread.
///
/// Only commits change the confirmed layers, in their order. The view is the confirmed layers, then
/// the previews of others, then the own pending transactions, executed by the same code that the
/// server runs. A commit that does not affect own work is applied to the view directly. Otherwise
/// the session computes the view again (LayerDocs share structure), and the LayerView gets the
/// difference.
class Session {
public:
    struct Options {
        ClientId client;                  ///< clientIdOf() of the secret
        std::optional<Hash> secret = {};  ///< newClientSecret(); without it the id proves nothing
        UserName user;
        std::string application;
        /// Number of transactions that are kept until they can be sent. author() loses what is
        /// beyond (event::Lost), and the editor's layers show what is kept. A transaction takes
        /// about a kilobyte.
        std::size_t maxUnsentTransactions = 1'000'000;
        /// Number of pending transactions that one advance() predicts and sends at least, whatever
        /// its budget is.
        std::size_t leastAtOnce = 64;
        std::vector<std::string> features = protocolFeatures();
        /// FR8: a larger transaction is sent in parts of about `partBytes`, so that other messages
        /// can be sent in between.
        std::uint64_t wholeBytes = 8 * 1024 * 1024;
        std::size_t partBytes = kPartBytes;
        std::size_t uploadWindowChunks = 4;  ///< blob chunks that one advance() sends
        /// Milliseconds of a steady clock, for the budget of advance(). Unset: the machine's clock.
        std::function<double()> clockMs = {};
        /// For tests: after every change the session computes the prediction again and compares. A
        /// difference throws.
        bool checksPrediction = false;
    };

    Session(Options options, SessionHost& host, LayerView& view);
    ~Session();

    // The owner of the connection reports about it. Each connection is new; the session resumes.
    void connected();
    /// `unconfirmed`: the bytes that were passed to SessionHost::send() and perhaps did not arrive.
    /// Uploads continue before them (TL2).
    void disconnected(Error reason, std::size_t unconfirmed = kAllUnconfirmed);
    static constexpr std::size_t kAllUnconfirmed = ~std::size_t(0);
    /// Returns that number of the last disconnected().
    [[nodiscard]] std::size_t unconfirmed() const;
    /// Queues a message that this connection's MessageReader has read. Cheap.
    void received(ReceivedMessage message);

    /// ID2: set while the session has stopped because the server has another history. Nothing is
    /// sent; each further connection compares again.
    [[nodiscard]] const std::optional<OtherHistory>& otherHistory() const;
    /// ID4: joins that history with the next connection, if it is still the one that was found.
    /// What the editor was told is committed and the history lacks becomes lost work; so does
    /// unsent work if it is another project's. Error: InvalidArgument (the session has not
    /// stopped).
    Result<void> joinOtherHistory();

    // Layers.
    void openLayer(const LayerId& layer);
    void closeLayer(const LayerId& layer);
    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    /// The content that the editor shows; nullptr if not joined. Valid until the next call that
    /// changes it.
    [[nodiscard]] const LayerDoc* view(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* confirmed(const LayerId& layer) const;

    // Requests. Each ends once: with its answer, with an error of the server, or with NotConnected
    // when there is no connection or it is lost before the answer.
    /// Sends a request and returns its number, which the session chooses. The request ends with one
    /// event that has this number: event::Answered, or event::ServerError. UnsupportedProtocol: the
    /// server is of an earlier version, which does not know the request.
    std::uint64_t request(AnyRequest request);
    /// Reads a layer without joining it, as it was at a revision or (0) as it is now. Calls `done`.
    void peek(const LayerId& layer, Revision revision,
              std::function<void(Result<LayerDoc>, Revision)> done);
    /// Reads commits of the past; 0 is the oldest and the newest one. Calls `done` after the last.
    void requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                    std::function<void(Result<void>)> done);

    /// States of layers, as the server sends them. Layers that are saved, unlocked and open nowhere
    /// have none.
    [[nodiscard]] const std::map<LayerId, LayerState>& layerStates() const;

    /// Role and access rules of this user, as the server sent them last.
    [[nodiscard]] const OwnRights& rights() const;

    // Presence (PS1-PS3). Others see it within a tenth of a second while there is a connection.
    /// Errors: those of encodeChecked() and checkPresence(). The presence shown before stays.
    Result<void> showPresence(Presence presence);
    void hidePresence();
    /// Presences of others.
    [[nodiscard]] const std::map<ClientId, Presence>& presences() const;

    // Editing.
    /// Takes what the editor has written since the last call, as one transaction, or during a
    /// gesture as part of the gesture. The editor's layers show it already. The LayerView is called
    /// only for an edit that is impossible: it is reported as Lost and undone.
    void author(std::vector<AuthoredEdit> edits);
    /// Sets the number of the next transaction, for work that is sent again under its own number
    /// (M9). Precondition: it is greater than all before.
    void setNextSequence(std::uint64_t sequence);
    /// M11. Gestures do not nest.
    void beginGesture();
    void endGesture();
    [[nodiscard]] bool inGesture() const;

    // Undo of own work.
    /// What is authored until endUndoGroup() is one step of the undo. Calls nest: the outermost two
    /// count. `label`: for users.
    void beginUndoGroup(const std::string& label);
    void endUndoGroup();
    /// Takes the newest step of own work back, as an own transaction against the present. The
    /// LayerView gets its edits. Keeps and returns what others have written since. Errors:
    /// InvalidArgument (a gesture or group is open), NotConnected (too many transactions wait).
    Result<UndoResult> undo();
    /// Takes the newest undo back in the same way.
    Result<UndoResult> redo();
    [[nodiscard]] UndoLabels undoLabels() const;

    /// Processes what was received and sends what was authored. Returns false if `budgetMs` ended
    /// first: call it again next frame. `nowMs`: any steady clock. With many pending transactions,
    /// the view of their layers may follow commits some calls later; until then it does not change.
    bool advance(double budgetMs, std::int64_t nowMs);

    [[nodiscard]] std::vector<Event> takeEvents();

    [[nodiscard]] bool isConnected() const;   ///< the welcome was received
    [[nodiscard]] Revision revision() const;  ///< revision of the confirmed layers
    [[nodiscard]] std::size_t pendingTransactions() const;
    /// Number of edits that later ones replaced before they were sent (SE15).
    [[nodiscard]] std::uint64_t writtenAgain() const;
    /// The answer of the server to the last connection, without the list of layers.
    [[nodiscard]] const std::optional<Welcome>& welcome() const;
    /// The layers of the project, as the server listed them last.
    [[nodiscard]] const std::set<LayerId>& projectLayers() const;
    [[nodiscard]] const ClientId& id() const;
    /// Requests a big value that the view names and that is not here.
    void requestBlob(const Hash& hash);
    /// Big values that the host has to keep (SessionHost::localBlob), because pending transactions
    /// or an open gesture name them. Takes time if many are pending.
    [[nodiscard]] std::set<Hash> namedBlobs() const;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::client
