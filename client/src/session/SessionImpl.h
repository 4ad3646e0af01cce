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
#include "session/ListedLayers.h"
#include "session/MissedWork.h"
#include "session/OpenedLayers.h"
#include "session/OthersPreviews.h"
#include "session/OwnAddresses.h"
#include "session/OwnPreviews.h"
#include "session/OwnRights.h"
#include "session/OwnSubmissions.h"
#include "session/Peeks.h"
#include "session/PendingTransactions.h"
#include "session/People.h"
#include "session/Prediction.h"
#include "session/Requests.h"
#include "session/UndoStack.h"

namespace usdlive::client {

/// Holds the parts of a session, and passes to them what is received. Each part owns its state, and
/// knows the parts that its constructor is given. This class itself has what concerns the confirmed
/// layers and the view as a whole: Session.cpp (layers), SessionConnection.cpp (hello, resuming,
/// received messages), SessionSending.cpp (own work), SessionCommits.cpp (the confirmed side),
/// SessionView.cpp (the predicted side), SessionAuthor.cpp (edits and gestures).
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
    void peek(const LayerId& layer, Revision revision, Peeks::Done done);
    [[nodiscard]] std::set<Hash> namedBlobs() const;

    void author(std::vector<AuthoredEdit> edits);
    void beginGesture();
    void endGesture();
    Result<UndoResult> takeBack(UndoStack::Direction direction);

    bool advance(double budgetMs, std::int64_t nowMs);

    const Options options_;
    Revision revision_ = 0;              ///< the revision of the confirmed layers
    std::optional<OtherHistory> other_;  ///< the session has stopped (ID2)
    std::size_t unconfirmed_ = 0;        ///< see Session::unconfirmed()
    std::uint64_t writtenAgain_ = 0;     ///< see Session::writtenAgain()

private:
    SessionHost& host_;
    LayerView& editor_;
    LayerDocs confirmed_;

public:
    // The parts that Session also calls.
    SessionEvents events_;
    Channel channel_{host_};
    Requests requests_{channel_, events_};
    ListedLayers listed_{channel_, events_};
    People people_{options_, channel_, events_};
    OwnRights rights_{options_.user, events_};
    BlobDownloads downloads_{channel_};
    MissedWork missed_{channel_, requests_, events_};
    PendingTransactions pending_;
    std::optional<Gesture> gesture_;
    UndoStack undo_;

private:
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
    // Edits of the editor that the view does not have, and that have to be undone there.
    struct Repairs {
        std::set<LayerId> resets;
        std::vector<AuthoredEdit> fields;
    };

    // SessionConnection.cpp
    void handle(ControlMessage&& message);
    void handle(ReceivedCommit&& received);
    void handle(Acceptance&& accepted);
    void handle(PreviewFrame&& frame) { previews_.received(std::move(frame)); }
    void handle(ReceivedSnapshot&& received);
    void handle(RefusalFrame&& frame);
    void handle(ReceivedBlob&& blob);
    void on(const Welcome& message);
    void on(const LayerList& message);
    void on(const ProjectLayers& message) { listed_.received(message); }
    void on(const LayerOpened& message);
    void on(const BlobStored& message);
    void on(const AlreadyCommitted& message);
    void on(const RequestProgress& message);
    void on(const LayerStates& message) { listed_.received(message); }
    void on(const Presences& message) { people_.received(message); }
    void on(const AccessChanged& message) { rights_.received(message); }
    void on(const LogBegin& message) { requests_.received(message); }
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
    void protocolFault(Error error);
    void blobArrived(const Hash& hash, SharedBytes bytes);
    void blobFailed(const Hash& hash, Error error);
    [[nodiscard]] bool hasUnanswered() const;
    void noteUnanswered(Revision joined);

    // SessionSending.cpp
    [[nodiscard]] bool maySend() const { return channel_.isOnline() && isCaughtUp() && !frozen_; }
    void sendAll();
    void sendTransactions();
    void reportPending(const Pending& pending);
    void reportGesture();

    // SessionCommits.cpp
    void apply(const Commit& commit);
    void applyToEditor(const Commit& commit, bool own, Prediction* current);
    Prediction* follow(const Commit& commit, const Pending* own);
    void acknowledge(const Commit& commit, Prediction* current);
    [[nodiscard]] bool isPending(std::uint64_t sequence) const;
    class OwnCommit;
    void followUndo();
    void completeJoins();
    void prune();
    void lose(Pending pending, Error reason);
    bool resubmit(std::uint64_t sequence);
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
    void readdressGesture();
    void addressCarried(Pending& pending, std::vector<std::optional<AuthoredEdit>> edits);
    void showDifference(const LayerDocs& before);
    void flushResets();
    void freeze();
    void carryOver();
    void thaw();
    void dropClosed();
    [[nodiscard]] bool ownWorkOn(const LayerId& layer) const;

    // SessionAuthor.cpp
    [[nodiscard]] bool writeAgain(std::vector<AuthoredEdit>& edits);
    Pending newPending();
    void authorInto(Pending& pending, std::vector<AuthoredEdit> edits, LostWork& lost,
                    Repairs& repairs);
    Result<Edit> predictEdit(Pending& pending, const AuthoredEdit& edit);
    void accept(Pending& pending, Edit addressed, AuthoredEdit edit, Inverse inverse);
    [[nodiscard]] std::optional<Error> tooManyUnsent() const;
    [[nodiscard]] Inverse inverseOf(const Pending& pending, const AuthoredEdit& edit) const;
    void noteForUndo(std::uint64_t sequence, std::size_t index, const AuthoredEdit& edit,
                     Inverse inverse);
    void finishRebuild();
    void show(const LayerId& layer, const std::string& path, const EditAction& action);
    void noteSeen(Transaction& transaction, const LayerId& layer) const;
    void noteRepair(const AuthoredEdit& edit, Repairs& repairs) const;
    void repair(const Repairs& repairs);

    // The other parts.
    BlobUploads uploads_{host_};
    OwnPreviews ownPreviews_{options_, host_, channel_, uploads_};
    OthersPreviews previews_{options_.client, host_,      downloads_,
                             events_,         confirmed_, [this] { previewsChanged(); }};
    OpenedLayers opened_{channel_, requests_, events_, editor_, [this](const LayerId& layer) {
                             if (frozen_) frozen_->views.erase(layer);
                         }};
    Peeks peeks_{channel_, requests_, events_, opened_};

    // The connection.
    bool linked_ = false;
    std::optional<Error> forgotten_;  // an error before the welcome (M14)
    bool diverged_ = false;  // an error before the welcome says that the histories differ (ID2)
    std::optional<StoreId> accepted_;  // joinOtherHistory(): the history that was found
    std::deque<Result<Received>> inbox_;
    std::int64_t nowMs_ = 0;
    std::int64_t gestureReportedMs_ = 0;
    Deadline deadline_{options_};  // the end of this advance()
    /// The editor has created a spec that the prediction already has, from a preview of another.
    bool createdExisting_ = false;

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
    NamespaceLog log_;
    OwnCreations creations_;
    CommittedWork committed_;
    OwnAddresses addresses_{options_.client, log_, creations_, revision_, pending_};
    OwnSubmissions submissions_{options_, host_,      channel_,  uploads_,
                                pending_, addresses_, deadline_, events_};
    std::optional<Frozen> frozen_;
    std::optional<Abandoned> abandoned_;

    // The predicted side.
    const Prediction::Confirmed confirmedSide_{confirmed_, log_, creations_, revision_,
                                               options_.client};
    Prediction prediction_{confirmedSide_};
    bool dirty_ = false;              // the prediction has to be computed again
    std::optional<Rebuild> rebuild_;  // only when dirty_
    std::size_t answered_ = 0;        // own structural edits since the prediction was made
    std::set<LayerId> resets_;        // layers whose whole content the editor gets next
};

}  // namespace usdlive::client
