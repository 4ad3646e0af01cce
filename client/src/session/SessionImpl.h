#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "BlobTransfer.h"
#include "Gesture.h"
#include "PendingTransactions.h"
#include "Prediction.h"
#include "session/Session.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

// What an error of the session's own is about.
[[nodiscard]] inline ErrorMessage about(std::uint64_t request) {
    ErrorMessage message;
    message.request = request;
    return message;
}
[[nodiscard]] inline ErrorMessage about(const Hash& blob) {
    ErrorMessage message;
    message.blob = blob;
    return message;
}
[[nodiscard]] inline ErrorMessage closing() {
    ErrorMessage message;
    message.closing = true;
    return message;
}

// The clock is looked at for every so many transactions.
inline constexpr std::size_t kClockEvery = 8;

/// A snapshot on its way.
struct Incoming {
    std::uint64_t request = 0;  ///< 0: not asked for on this connection
    std::optional<LayerOpened> opened;
    std::optional<LayerDoc> content;  ///< once it is whole
};
/// A layer whose content is not there yet.
struct Joining {
    Incoming snapshot;
    std::vector<std::pair<Revision, Edit>> later;  ///< committed while it is on its way
    bool again = false;                            ///< it was joined in a history that is gone
    std::optional<std::int64_t> askAtMs;           ///< the server could not read it; not asked now
};

/// Parts: Session.cpp (the class itself, layers), SessionConnection.cpp (what arrives, what is
/// sent), SessionCommits.cpp (the confirmed side), SessionView.cpp (the predicted side),
/// SessionAuthor.cpp (edits and gestures).
class Session::Impl {
public:
    Impl(Options options, SessionHost& host, LayerView& editor);

    void connected();
    void disconnected(Error reason);
    void received(ReceivedMessage message);

    void openLayer(const LayerId& layer);
    void closeLayer(const LayerId& layer);
    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* view(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* confirmed(const LayerId& layer) const;
    void peek(const LayerId& layer, Revision revision,
              std::function<void(Result<LayerDoc>, Revision)> done);
    void requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                    std::function<void(Result<void>)> done);
    std::uint64_t save(std::vector<LayerId> layers, bool force);
    std::uint64_t reload(std::vector<LayerId> layers);
    std::uint64_t createCheckpoint(std::string name);
    std::uint64_t listCheckpoints();
    void compactHistory(std::optional<std::uint64_t> days,
                        std::function<void(Result<HistoryCompacted>)> done);
    void requestStorage(std::function<void(Result<Storage>)> done);
    std::uint64_t createLayer(const LayerId& layer);
    std::uint64_t listSkipped();
    void requestBlob(const Hash& hash);
    [[nodiscard]] std::set<Hash> namedBlobs() const;

    void showPresence(Presence presence);
    void hidePresence();

    void author(std::vector<AuthoredEdit> edits);
    void beginGesture();
    void endGesture();

    bool advance(double budgetMs, std::int64_t nowMs);
    [[nodiscard]] std::size_t missed() const { return missed_.size(); }
    [[nodiscard]] std::uint64_t writtenAgain() const { return writtenAgain_; }

    const Options options_;
    std::vector<Event> events_;
    std::optional<Welcome> welcome_;
    Revision revision_ = 0;
    PendingTransactions pending_;
    std::optional<Gesture> gesture_;
    bool online_ = false;  ///< greeted
    std::map<LayerId, LayerState> layerStates_;
    std::map<ClientId, Presence> presences_;  ///< of others

private:
    struct OpenedLayer {
        // False: closed by the editor, kept until one's own work on it is answered.
        bool wanted = true;
        std::optional<Joining> joining;  // nothing: joined

        // What has come so far is of no use any more.
        void joinAnew() {
            const bool again = !joining || joining->again;
            joining.emplace().again = again;
        }
    };
    struct Peek {
        LayerId layer;
        Revision revision = 0;
        Incoming snapshot;
        std::function<void(Result<LayerDoc>, Revision)> done;
    };
    struct LogReader {
        std::uint64_t request = 0;
        bool begun = false;
        std::function<void(const Commit&)> each;
        std::function<void(Result<void>)> done;
    };
    // Work of one's own whose commit did not come here, until it has been read.
    struct Missed {
        Revision revision = 0;
        Pending pending;
        bool asked = false;  // for its commit, on this connection
    };
    // A gesture of somebody else. Of its previews the newest is shown whose big values are here.
    struct Preview {
        std::uint64_t slot = 0;               // in order of their beginning
        std::optional<PreviewFrame> frame;    // shown
        std::optional<PreviewFrame> waiting;  // for its big values
        std::set<Hash> missing;               // of these
        std::optional<PreviewFrame> newest;   // came while another one waits
    };
    using Previews = std::map<std::pair<ClientId, std::uint64_t>, Preview>;
    // While the layers are joined again in another history: what the editor sees meanwhile.
    struct Frozen {
        LayerDocs views;
    };
    // The prediction as it is made anew, some transactions at a time. Meanwhile the editor sees the
    // one before.
    struct Rebuild {
        Prediction next;
        std::size_t done = 0;   // pending transactions that are in it
        bool outdated = false;  // another one has to follow
    };
    // A transaction that goes in parts, and has not gone whole (FR8).
    struct Sending {
        std::uint64_t sequence = 0;
        PartsAt at;
    };
    // Edits the editor made that the model does not hold: what the editor is to be told.
    struct Repairs {
        std::set<LayerId> resets;
        std::vector<AuthoredEdit> fields;
    };

    // Session.cpp
    template <class Request>
    std::uint64_t request(Request message);
    template <class Answer, class Request>
    void askStorage(Request message, std::function<void(Result<Answer>)> done);
    template <class Request>
    std::uint64_t requestFeature(std::string_view feature, Request message);

    // SessionConnection.cpp
    void handle(ControlMessage&& message);
    void handle(ReceivedCommit&& received);
    void handle(PreviewFrame&& frame);
    void handle(ReceivedSnapshot&& received);
    void handle(RefusalFrame&& frame);
    void handle(ReceivedBlob&& blob);
    template <class Event, class Answer>
    void answer(const Answer& message);
    void on(const Welcome& message);
    void on(const ProjectLayers& message);
    void on(const LayerOpened& message);
    void on(const BlobStored& message);
    void on(const AlreadyCommitted& message);
    void on(const LayersSaved& message);
    void on(const LayersReloaded& message);
    void on(const CheckpointCreated& message);
    void on(const Checkpoints& message);
    void on(const HistoryCompacted& message) { answerAsked(message.request, message); }
    void on(const Storage& message) { answerAsked(message.request, message); }
    void answerAsked(std::uint64_t request, Result<ControlMessage> answer);
    void on(const LayerCreated& message);
    void on(const SkippedFiles& message);
    void on(const RequestProgress& message);
    void on(const LayerStates& message);
    void on(const Presences& message);
    void on(const LogBegin& message);
    void on(const LogEnd& message);
    void on(const ErrorMessage& message);
    void on(const auto&) {}  // messages to a server
    void loseSent(const Error& why);
    void readMissed();
    void readMissed(const Missed& missed);
    [[nodiscard]] bool answered(const ErrorMessage& message, const Error& error);
    void protocolFault(Error error);
    void report(Error error, ErrorMessage about = {});
    void sendControl(const ControlMessage& message);
    void sendAll();
    void sendTransactions();
    [[nodiscard]] bool sendParts();
    [[nodiscard]] std::uint64_t frameLimit() const;
    [[nodiscard]] std::uint64_t transactionLimit() const;
    void sendPreview();
    [[nodiscard]] bool preparePreview();
    [[nodiscard]] bool sendPreviewValues();
    void sendPresence();
    void askForBlobs(const std::vector<Hash>& hashes);
    void blobCame(const Hash& hash, SharedBytes bytes);
    void blobFailed(const Hash& hash, Error error);
    void present(Previews::value_type& entry, PreviewFrame frame);
    void presentNewest(Previews::value_type& entry);
    void presentAgain();
    [[nodiscard]] std::set<Hash> missingOf(const PreviewFrame& frame);
    void forgetOthers();
    void withdrawPreview(std::uint64_t gesture);
    void tellPending(const Pending& pending);
    void tellGesture();
    void ask(Incoming& snapshot, const LayerId& layer, Revision revision);
    void askAgain();

    // SessionCommits.cpp
    void apply(const Commit& commit);
    static void keepForLater(Joining& joining, const LayerId& layer, const Commit& commit);
    void applyToEditor(const Commit& commit, bool own, Prediction* current);
    Prediction* follow(const Commit& commit, const Pending* own);
    void acknowledge(const Commit& commit, Prediction* current);
    [[nodiscard]] bool isPending(std::uint64_t sequence) const;
    void reportDropped(const Pending& pending, const Commit& commit);
    void completeJoins();
    void completePeeks();
    bool completeJoin(const LayerId& layer, Joining& joining);
    void prune();
    void lose(Pending pending, Error reason);
    bool resubmit(std::uint64_t sequence);
    [[nodiscard]] bool isCaughtUp() const;

    // SessionView.cpp
    void settle();
    void disturb();
    void discard(Prediction old);
    void previewsChanged();
    void rebuild();
    void predictPreviews(Prediction& prediction) const;
    void predictGesture(Prediction& prediction);
    void checkPrediction() const;
    [[nodiscard]] bool readdress(Address& address, const LayerId& layer, Revision since,
                                 bool creates) const;
    void readdress(Edit& edit, Revision since, const Creation& number) const;
    void readdress(Pending& pending);
    void readdressGesture();
    void seal(Pending& pending, std::vector<std::optional<AuthoredEdit>> edits);
    void tellEditor(const LayerDocs& before);
    void flushResets();
    void freeze();
    void carryOver();
    void thaw();
    void dropClosed();
    [[nodiscard]] bool outOfTime() const { return options_.clockMs() >= deadlineMs_; }
    /// Before transaction number `count` of this advance().
    [[nodiscard]] bool outOfTime(std::size_t count) const {
        return count > options_.leastAtOnce && count % kClockEvery == 1 && outOfTime();
    }
    [[nodiscard]] bool ownWorkOn(const LayerId& layer) const;

    // SessionAuthor.cpp
    [[nodiscard]] bool writeAgain(std::vector<AuthoredEdit>& edits);
    Pending newPending();
    void authorInto(Pending& pending, std::vector<AuthoredEdit> edits, LostWork& lost,
                    Repairs& repairs);
    Result<Edit> predictEdit(Pending& pending, const AuthoredEdit& edit);
    void noteRepair(const AuthoredEdit& edit, Repairs& repairs) const;
    void repair(const Repairs& repairs);

    SessionHost& host_;
    LayerView& editor_;

    // The connection.
    bool linked_ = false;
    std::optional<Error> forgotten_;          // the server said so before its welcome (M14)
    std::optional<ErrorMessage> notResumed_;  // the same, of another history (SE3)
    std::deque<Result<Received>> inbox_;
    std::uint64_t lastRequest_ = 0;
    bool takesPreviewValues_ = false;  // the server does (B3)
    bool takesParts_ = false;          // likewise (FR8)
    std::optional<Sending> sending_;
    std::int64_t nowMs_ = 0;
    std::int64_t gestureToldMs_ = 0;
    double deadlineMs_ = 0;  // of this advance(), by options_.clockMs
    /// A spec was authored that the editor does not show and the prediction has: another's preview
    /// brought it.
    bool createdExisting_ = false;
    bool moreToSend_ = false;  // than there was time for

    // One's own presence.
    std::optional<Presence> presence_;
    std::optional<Presence> presenceSent_;  // on this connection
    std::int64_t presenceSentMs_ = 0;

    // The confirmed side.
    bool hasHistory_ = false;
    Epoch epoch_ = 0;        // of the server
    Epoch commitEpoch_ = 0;  // of the newest commit
    Hash hash_;
    /// Transactions up to `last` were sent when the history at `since` was the client's, and are
    /// not answered. A client that loses the line again says that it is still there: were they
    /// committed and the client forgotten meanwhile, the server could not tell (M14).
    struct Unsettled {
        Hello::Resume since;
        std::uint64_t last = 0;
    };
    std::optional<Unsettled> unsettled_;
    bool saidSince_ = false;  // by the last hello
    [[nodiscard]] Hello::Resume here() const;
    [[nodiscard]] bool isUnsettled() const;
    void noteUnsettled();
    LayerDocs confirmed_;
    NamespaceLog log_;
    OwnCreations creations_;
    std::map<LayerId, OpenedLayer> layers_;
    std::optional<Frozen> frozen_;

    // The predicted side.
    const Prediction::Confirmed confirmedSide_{confirmed_, log_, creations_, revision_};
    Prediction prediction_{confirmedSide_};
    Previews previews_;
    std::uint64_t lastSlot_ = 0;
    std::deque<Missed> missed_;
    bool dirty_ = false;              // the prediction has to be made anew
    std::optional<Rebuild> rebuild_;  // as far as that was done; only when dirty_
    std::size_t answered_ = 0;        // own structural edits since the prediction was made
    std::set<LayerId> resets_;        // the editor gets their whole content next

    BlobUploads uploads_;
    BlobDownloads downloads_;
    std::vector<Peek> peeks_;
    std::deque<LogReader> logs_;
    std::uint64_t writtenAgain_ = 0;
    std::set<std::uint64_t> requests_;  ///< that an event answers, and has not
    /// By request: what is to be called with the answer.
    std::map<std::uint64_t, std::function<void(Result<ControlMessage>)>> asked_;
};

}  // namespace usdlive::client
