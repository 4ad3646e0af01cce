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
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

/// One's own transaction, for whoever keeps it until it is acknowledged.
struct PendingWork {
    std::uint64_t sequence = 0;
    Revision revision = 0;  ///< that the confirmed layers had when it was made
    Hash hash;              ///< the chain hash of that revision
    const std::vector<AuthoredEdit>& edits;
};

/// What a session asks of the process around it. Called from within Session's functions.
class SessionHost {
public:
    virtual ~SessionHost() = default;
    /// Encoded frames, in order. Only between connected() and disconnected().
    virtual void send(SharedBytes frames) = 0;
    /// May parts of big values be sent now? False while the line is behind: they wait, others do
    /// not.
    [[nodiscard]] virtual bool takesMore() { return true; }
    /// The bytes of a big value the editor authored; nullptr: not here.
    [[nodiscard]] virtual SharedBytes localBlob(const Hash& hash) = 0;
    /// Would localBlob() have it? Cheap.
    [[nodiscard]] virtual bool holdsBlob(const Hash& hash) { return localBlob(hash) != nullptr; }
    /// A big value has arrived whole and right. Keep it; one that is not `lasting` is only of a
    /// preview so far, for as long as there is room.
    virtual void blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) = 0;
    /// A download has failed: is the value still needed, and to be asked for again?
    [[nodiscard]] virtual bool needsBlob(const Hash&) { return true; }
    /// A transaction is pending from now on; what it holds, as its author made it. Called again
    /// with the same sequence number when its content has changed (an open gesture, or what was
    /// written again before it was sent).
    virtual void pending(const PendingWork& /*work*/) {}
    /// It was acknowledged or refused: it is pending no longer.
    virtual void answered(std::uint64_t /*sequence*/) {}
    /// The session is done with it. To destroy it may take milliseconds: where that is too long,
    /// give it to another thread, which may destroy it.
    virtual void discard(std::shared_ptr<void> /*garbage*/) {}
};

/// Where what the editor shall see goes: the stores of its layers. Called from Session::advance()
/// and Session::author() only.
class LayerView {
public:
    virtual ~LayerView() = default;
    /// The content of a layer as it arrives, part by part: who makes what the editor is to see of
    /// it beside the editor's thread can begin. A first part makes those before it void.
    virtual void arriving(const LayerId& /*layer*/, std::shared_ptr<const SnapshotPart> /*part*/) {}
    /// That was all, and `snapshot` is what it says. The reset() that follows at once is with the
    /// commits made since. Not told of every content: a reset() without it is of a doc alone.
    virtual void arrived(const LayerId& /*layer*/, const LayerDoc& /*snapshot*/) {}
    /// The layer stands at this content now (joined, or joined again). What the editor had is
    /// replaced.
    virtual void reset(const LayerId& layer, const LayerDoc& doc) = 0;
    /// One change of what the editor shall see, absolute path; applies to what it shows now.
    virtual void apply(const LayerId& layer, const std::string& path, const EditAction& action) = 0;
};

/// One client's side of the protocol: the confirmed layers, its pending transactions on top, and
/// what the editor is to see of both (M7). Decides without I/O, threads or USD; used by one thread.
///
/// The confirmed layers change only by commits, in their order. The view is the confirmed layers,
/// then the previews of others, then one's own pending transactions executed by the very code the
/// server runs. When nothing of one's own is concerned, a commit goes to the view as it is;
/// otherwise the view is built anew (LayerDocs share structure) and the difference goes to the
/// LayerView.
class Session {
public:
    struct Options {
        ClientId client;  ///< see newClientId()
        UserName user;
        std::string application;
        /// Transactions that are kept until they can be sent. author() gives back what is beyond
        /// (event::Lost), and the editor's layers show what is kept. A transaction takes about a
        /// kilobyte.
        std::size_t maxUnsentTransactions = 1'000'000;
        /// So many pending transactions are predicted, and as many sent, in one advance() whatever
        /// its budget.
        std::size_t leastAtOnce = 64;
        std::vector<std::string> features{"history",  "log",         "previews",   "previewValues",
                                          "states",   "presence",    "conflation", "storage",
                                          "progress", "createLayer", "skipped",    kPartsFeature};
        /// FR8: a transaction of more bytes goes in parts of about `partBytes`, so that nobody
        /// waits for as long as all of it takes.
        std::uint64_t wholeBytes = 8 * 1024 * 1024;
        std::size_t partBytes = kPartBytes;
        std::size_t uploadWindowChunks = 4;  ///< blob chunks handed to the host in one advance()
        /// Milliseconds of a steady clock, by which advance() keeps its budget. Unset: the
        /// machine's.
        std::function<double()> clockMs = {};
        /// For tests: after every change the prediction is made anew and compared; a difference
        /// throws.
        bool checksPrediction = false;
    };

    Session(Options options, SessionHost& host, LayerView& view);
    ~Session();

    // The connection, by whoever owns it. Each connection is new; the session resumes by itself.
    void connected();
    void disconnected(Error reason);
    /// A message, as a MessageReader of this connection has read it; cheap (queues it).
    void received(ReceivedMessage message);

    // Layers.
    void openLayer(const LayerId& layer);
    void closeLayer(const LayerId& layer);
    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    /// What the editor sees; nullptr when not joined. Valid until the next call that changes it.
    [[nodiscard]] const LayerDoc* view(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* confirmed(const LayerId& layer) const;
    /// A layer as it was at a revision, or is now, without joining; the answer comes by `done`.
    void peek(const LayerId& layer, Revision revision,
              std::function<void(Result<LayerDoc>, Revision)> done);
    void requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                    std::function<void(Result<void>)> done);
    /// Answered by event::Saved, or event::ServerError, with the number that this returns; `force`:
    /// over what somebody else has put into the files, too.
    std::uint64_t save(std::vector<LayerId> layers, bool force = false);
    /// Has the server take the layers' files (none: all that are outdated) as commits; answered by
    /// event::Reloaded.
    std::uint64_t reload(std::vector<LayerId> layers);

    /// Makes a new, empty layer of the project; answered by event::LayerMade, or event::ServerError
    /// (LayerExists), with the number that this returns. NotConnected: only the server knows which
    /// names are free. InvalidArgument: the server is of an earlier version.
    std::uint64_t createLayer(const LayerId& layer);
    /// Which files are not served, and why; answered by event::SkippedListed.
    std::uint64_t listSkipped();

    /// Names what the project is now, with all that was acknowledged to this session. The answer is
    /// event::CheckpointMade, or event::ServerError, with the number that this returns.
    std::uint64_t createCheckpoint(std::string name);
    /// Likewise event::CheckpointsListed.
    std::uint64_t listCheckpoints();

    /// Has the server replace the commits that are older than so many days (nothing: as it was told
    /// when it started) by what the layers held then (CH4).
    void compactHistory(std::optional<std::uint64_t> days,
                        std::function<void(Result<HistoryCompacted>)> done);
    /// Asks the server what its store takes.
    void requestStorage(std::function<void(Result<Storage>)> done);

    /// What the server says of layers beside their content; none of layers that are saved,
    /// unlocked and open nowhere.
    [[nodiscard]] const std::map<LayerId, LayerState>& layerStates() const;

    // Presence (PS1-PS3): others see it within a tenth of a second, as long as there is a
    // connection.
    void showPresence(Presence presence);
    void hidePresence();
    /// Where the others are.
    [[nodiscard]] const std::map<ClientId, Presence>& presences() const;

    // Editing.
    /// What the editor has written since the last call, as one transaction. The editor's layers
    /// show it already, so the LayerView is told only where the model differs from what was written
    /// (an edit that cannot be: it is then reported as Lost and undone in the view). During a
    /// gesture it becomes part of the gesture instead.
    void author(std::vector<AuthoredEdit> edits);
    /// The number that the next transaction gets, for work that is sent again under its own name
    /// (M9). Precondition: greater than all before.
    void setNextSequence(std::uint64_t sequence);
    /// M11. Gestures do not nest.
    void beginGesture();
    void endGesture();
    [[nodiscard]] bool inGesture() const;

    /// Works off what has arrived and sends what was authored. Returns false when `budgetMs` was
    /// over before all was done: call it again next frame. `nowMs`: any steady clock. Where many
    /// transactions are pending, the view of their layers follows commits that concern them some
    /// calls later: until then the editor goes on with what it saw.
    bool advance(double budgetMs, std::int64_t nowMs);

    [[nodiscard]] std::vector<Event> takeEvents();

    [[nodiscard]] bool isConnected() const;   ///< greeted
    [[nodiscard]] Revision revision() const;  ///< of the confirmed layers
    [[nodiscard]] std::size_t pendingTransactions() const;
    /// Edits that later ones took the place of before they were sent: a frame that only sets the
    /// registers that an unsent transaction sets takes its place, under its number (SE15).
    [[nodiscard]] std::uint64_t writtenAgain() const;
    [[nodiscard]] const std::optional<Welcome>& welcome() const;
    [[nodiscard]] const ClientId& id() const;
    /// Big values that the view names and that are not here: asks for them, beside the stream.
    void requestBlob(const Hash& hash);
    /// Big values of one's own work that the host has to keep (SessionHost::localBlob): pending
    /// transactions and an open gesture, as it is now, name them. Takes time with many pending.
    [[nodiscard]] std::set<Hash> namedBlobs() const;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

/// 32 hexadecimal digits from the system's random source.
[[nodiscard]] ClientId newClientId();

}  // namespace usdlive::client
