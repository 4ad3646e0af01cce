// The implementation of Session.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "session/BlobTransfer.h"
#include "session/CommittedWork.h"
#include "session/Gesture.h"
#include "session/PendingRequests.h"
#include "session/PendingTransactions.h"
#include "session/Prediction.h"
#include "session/Session.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

// Error messages of the session itself.
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

// The clock is read once for so many transactions.
inline constexpr std::size_t kClockEvery = 8;

/// A snapshot that was requested.
struct Incoming {
    std::uint64_t request = 0;  ///< 0: not requested on this connection
    std::optional<LayerOpened> opened;
    std::optional<LayerDoc> content;  ///< when it is complete
};
/// A layer whose content has not arrived.
struct Joining {
    Incoming snapshot;
    std::vector<std::pair<Revision, Edit>> later;  ///< committed since the request
    bool again = false;                            ///< it was joined before, in another history
};

/// Parts: Session.cpp (layers), SessionConnection.cpp (hello, resuming, received messages),
/// SessionRequests.cpp (requests, content that arrives for them), SessionSending.cpp,
/// SessionCommits.cpp (the confirmed side), SessionView.cpp (the predicted side), SessionAuthor.cpp
/// (edits and gestures), SessionPreviews.cpp (previews of others), SessionPresence.cpp.
class Session::Impl {
public:
    Impl(Options options, SessionHost& host, LayerView& editor);

    void connected();
    void disconnected(Error reason, std::size_t unconfirmed);
    void received(ReceivedMessage message);
    Result<void> joinOtherHistory();

    void openLayer(const LayerId& layer);
    void closeLayer(const LayerId& layer);
    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* view(const LayerId& layer) const;
    [[nodiscard]] const LayerDoc* confirmed(const LayerId& layer) const;
    void peek(const LayerId& layer, Revision revision,
              std::function<void(Result<LayerDoc>, Revision)> done);
    void requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                    std::function<void(Result<void>)> done);
    std::uint64_t request(AnyRequest request);
    void requestBlob(const Hash& hash);
    [[nodiscard]] std::set<Hash> namedBlobs() const;

    Result<void> showPresence(Presence presence);
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
    std::set<LayerId> projectLayers_;
    Revision revision_ = 0;
    PendingTransactions pending_;
    std::optional<Gesture> gesture_;
    bool online_ = false;                ///< the welcome was received
    std::optional<OtherHistory> other_;  ///< the session has stopped (ID2)
    std::size_t unconfirmed_ = 0;        ///< see Session::unconfirmed()
    std::map<LayerId, LayerState> layerStates_;
    std::map<ClientId, Presence> presences_;  ///< presences of other clients

private:
    struct OpenedLayer {
        // False: the editor has closed it. It is kept until own work on it is answered.
        bool wanted = true;
        std::optional<Joining> joining;  // nothing: joined

        // Drops what has arrived so far.
        void restart() {
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
    };
    // Own work whose commit was not received. It is read from the log.
    struct Missed {
        Revision revision = 0;
        Pending pending;
        bool asked = false;  // its commit was requested on this connection
    };
    // A gesture of another client. The view shows its newest preview whose big values are here.
    struct Preview {
        std::uint64_t slot = 0;               // the order in which gestures began
        std::optional<PreviewFrame> frame;    // shown
        std::optional<PreviewFrame> waiting;  // waits for its big values
        std::set<Hash> missing;               // those that are not here
        std::optional<PreviewFrame> newest;   // arrived while another one waits
    };
    using Previews = std::map<std::pair<ClientId, std::uint64_t>, Preview>;
    // The view while the layers are joined again in another history.
    struct Frozen {
        LayerDocs views;
    };
    // The content that the editor was told is committed, in a history that it has left (ID4).
    struct Abandoned {
        LayerDocs docs;
        Error reason;
    };
    // The prediction that is being computed, some transactions at a time. Until it is complete, the
    // view is the one before.
    struct Rebuild {
        Prediction next;
        std::size_t done = 0;   // number of pending transactions that it contains
        bool outdated = false;  // it has to be computed again afterwards
    };
    // A transaction of which some parts have been sent (FR8).
    struct Sending {
        std::uint64_t sequence = 0;
        PartsAt at;
    };
    // SE21: the server has refused own transactions for a reason that passes.
    struct Held {
        std::int64_t pauseMs = 0;
        std::int64_t untilMs = 0;  // nothing is sent before
        bool tried = false;        // one of them was sent again
    };
    // Edits of the editor that the view does not have, and that have to be undone there.
    struct Repairs {
        std::set<LayerId> resets;
        std::vector<AuthoredEdit> fields;
    };

    // SessionConnection.cpp, SessionRequests.cpp, SessionPreviews.cpp, SessionSending.cpp
    void handle(ControlMessage&& message);
    void handle(ReceivedCommit&& received);
    void handle(Acceptance&& accepted);
    void handle(PreviewFrame&& frame);
    void handle(ReceivedSnapshot&& received);
    void handle(RefusalFrame&& frame);
    void handle(ReceivedBlob&& blob);
    void on(const Welcome& message);
    void on(const LayerList& message);
    void on(const ProjectLayers& message);
    void on(const LayerOpened& message);
    void on(const BlobStored& message);
    void on(const AlreadyCommitted& message);
    void on(const RequestProgress& message);
    void on(const LayerStates& message);
    void on(const Presences& message);
    void on(const LogBegin& message);
    void on(const ErrorMessage& message);
    /// An answer ends its request. Messages for a server are ignored.
    template <class Message>
    void on(const Message& message) {
        if constexpr (requires { message.request; } && !IsRequest<Message>)
            requests_.end(message.request, message);
    }
    void loseSent(const Error& why);
    [[nodiscard]] std::optional<OtherHistory> compareHistory(const Welcome& found) const;
    void abandonHistory(const OtherHistory& other);
    void reportAbandoned();
    void readMissed();
    void readMissed(const Missed& missed);
    void protocolFault(Error error);
    void report(Error error, ErrorMessage about = {});
    void sendControl(const ControlMessage& message) { sendJson(encodeControl(message)); }
    void sendJson(std::string control);
    void sendAll();
    void sendTransactions();
    template <class Content>
    [[nodiscard]] Bytes compactFrames(const Content& content, std::uint64_t mostBytes);
    [[nodiscard]] bool sendParts();
    [[nodiscard]] std::uint64_t frameLimit() const;
    [[nodiscard]] std::uint64_t transactionLimit() const;
    void sendPreview();
    [[nodiscard]] bool preparePreview();
    [[nodiscard]] bool sendPreviewValues();
    void sendPresence();
    void noteRefusedPresence(ErrorCode closing);
    void requestBlobs(const std::vector<Hash>& hashes);
    void blobReceived(const Hash& hash, SharedBytes bytes);
    void blobFailed(const Hash& hash, Error error);
    void present(Previews::value_type& entry, PreviewFrame frame);
    void presentNewest(Previews::value_type& entry);
    void presentAgain();
    [[nodiscard]] std::set<Hash> missingOf(const PreviewFrame& frame);
    void forgetOthers();
    void withdrawPreview(std::uint64_t gesture);
    void reportPending(const Pending& pending);
    void reportGesture();
    template <class Request>
    std::uint64_t sendRequest(Request& request);
    [[nodiscard]] std::optional<ErrorMessage> whyNot(std::uint64_t number, std::string_view type,
                                                     std::string_view feature) const;
    void join(const LayerId& layer);
    void sendJoins();
    void restartJoins();
    [[nodiscard]] Joining* joiningOf(const LayerId& layer);
    [[nodiscard]] Joining* joiningOf(std::uint64_t request);
    void joinFailed(const OpenLayer& open, const ErrorMessage& message);
    void joinAgain();

    // SessionCommits.cpp
    void apply(const Commit& commit);
    void keepForLater(const Commit& commit);
    void applyToEditor(const Commit& commit, bool own, Prediction* current);
    Prediction* follow(const Commit& commit, const Pending* own);
    void acknowledge(const Commit& commit, Prediction* current);
    [[nodiscard]] bool isPending(std::uint64_t sequence) const;
    void reportDropped(const Pending& pending, const Commit& commit);
    void completeJoins();
    void completePeeks();
    bool completeJoin(const LayerId& layer);
    void prune();
    void lose(Pending pending, Error reason);
    bool resubmit(std::uint64_t sequence);
    void hold(std::uint64_t sequence, const Error& reason);
    [[nodiscard]] bool isCaughtUp() const;

    // SessionView.cpp
    void updateView();
    void restartPrediction();
    void discard(Prediction old);
    void previewsChanged();
    void rebuild();
    void predictPreviews(Prediction& prediction) const;
    void predictGesture(Prediction& prediction);
    void checkPrediction() const;
    void readdress(Edit& edit, Revision since, const Creation& number,
                   bool isRenewed = false) const;
    void renewNames(Edit& edit, const AddressResolver& resolver, const Creation& number) const;
    void readdress(Pending& pending);
    void rebase(Pending& pending);
    bool objectsMovedSince(Revision base) const;
    void notePlaces();
    void notePlaces(Pending& pending);
    std::optional<std::string> placeOf(const Creation& creation, const Pending& later);
    [[nodiscard]] bool followPlace(Pending& pending, std::uint32_t index) const;
    void readdressGesture();
    void addressCarried(Pending& pending, std::vector<std::optional<AuthoredEdit>> edits);
    void showDifference(const LayerDocs& before);
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
    void noteSeen(Transaction& transaction, const LayerId& layer) const;
    void noteRepair(const AuthoredEdit& edit, Repairs& repairs) const;
    void repair(const Repairs& repairs);

    SessionHost& host_;
    LayerView& editor_;

    // The connection.
    bool linked_ = false;
    std::optional<Error> forgotten_;  // an error before the welcome (M14)
    bool diverged_ = false;  // an error before the welcome says that the histories differ (ID2)
    std::optional<StoreId> accepted_;  // joinOtherHistory(): the history that was found
    std::deque<Result<Received>> inbox_;
    PendingRequests requests_;
    bool takesPreviewValues_ = false;  // the server forwards them (B3)
    bool takesParts_ = false;          // the server knows FR8
    bool takesCompact_ = false;        // the server knows FR9
    NameNumbers names_;
    KnownNames namesSent_;
    std::optional<Sending> sending_;
    std::optional<Held> held_;
    std::int64_t nowMs_ = 0;
    std::int64_t gestureReportedMs_ = 0;
    double deadlineMs_ = 0;  // end of this advance(), by options_.clockMs
    /// The editor has created a spec that the prediction already has, from a preview of another.
    bool createdExisting_ = false;
    bool moreToSend_ = false;  // the time was over first

    // The own presence.
    std::optional<Presence> presence_;
    std::optional<Presence> presenceSent_;  // on this connection
    std::int64_t presenceSentMs_ = 0;
    int presenceRefusals_ = 0;  // connections that ended after it was sent

    // The confirmed side.
    bool hasHistory_ = false;
    StoreId store_;
    Epoch epoch_ = 0;        // epoch of the server
    Epoch commitEpoch_ = 0;  // epoch of the newest commit
    Hash hash_;
    /// Transactions up to `last` were sent when the client had the history up to `since`, and are
    /// not answered. Until they are, hello names `since`: the server then knows whether it has
    /// forgotten what it knew about them (M14).
    struct Unanswered {
        Revision since = 0;
        std::uint64_t last = 0;
    };
    std::optional<Unanswered> unanswered_;
    [[nodiscard]] bool hasUnanswered() const;
    void noteUnanswered(Revision joined);
    std::vector<LayerId> replaceProjectLayers(const std::vector<LayerInfo>& listed);
    void keepLayers(const Welcome& welcome);
    LayerDocs confirmed_;
    NamespaceLog log_;
    OwnCreations creations_;
    std::map<LayerId, OpenedLayer> layers_;
    std::set<LayerId> closed_;                     // those of layers_ that are not wanted
    std::map<std::uint64_t, LayerId> joins_;       // by unanswered request
    std::deque<LayerId> toJoin_;                   // requested when others are answered
    std::map<LayerId, std::int64_t> joinAgainAt_;  // layers that the server could not read
    std::set<LayerId> nextProjectLayers_;          // those that were listed before the welcome
    std::vector<LayerId> toKeep_;                  // open layers for which the hello had no room
    CommittedWork committed_;
    std::optional<Frozen> frozen_;
    std::optional<Abandoned> abandoned_;

    // The predicted side.
    const Prediction::Confirmed confirmedSide_{confirmed_, log_, creations_, revision_,
                                               options_.client};
    Prediction prediction_{confirmedSide_};
    Previews previews_;
    std::uint64_t lastSlot_ = 0;
    std::deque<Missed> missed_;
    bool dirty_ = false;              // the prediction has to be computed again
    std::optional<Rebuild> rebuild_;  // only when dirty_
    std::size_t answered_ = 0;        // own structural edits since the prediction was made
    std::set<LayerId> resets_;        // layers whose whole content the editor gets next

    BlobUploads uploads_;
    BlobDownloads downloads_;
    std::vector<Peek> peeks_;
    std::deque<LogReader> logs_;
    std::uint64_t writtenAgain_ = 0;
};

}  // namespace usdlive::client
