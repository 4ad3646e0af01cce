// The implementation of Session.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "session/Authoring.h"
#include "session/BlobTransfer.h"
#include "session/CommittedWork.h"
#include "session/EditorView.h"
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
#include "session/Requests.h"
#include "session/UndoStack.h"

namespace usdlive::client {

/// Holds the parts of a session, and passes to them what is received. Each part owns its state, and
/// knows the parts that its constructor is given. This class itself has what concerns several
/// parts: Session.cpp (layers), SessionConnection.cpp (messages, resuming, another history) and
/// SessionCommits.cpp (the confirmed layers).
class Session::Impl {
public:
    Impl(Options options, SessionHost& host, LayerView& editor);

    void connected();
    void disconnected(Error reason, std::size_t unconfirmed);
    void received(ReceivedMessage message);

    void openLayer(const LayerId& layer);
    void closeLayer(const LayerId& layer);
    [[nodiscard]] const LayerDoc* confirmed(const LayerId& layer) const;
    void peek(const LayerId& layer, Revision revision, Peeks::Done done);
    [[nodiscard]] std::set<Hash> namedBlobs() const;

    bool advance(double budgetMs, std::int64_t nowMs);

    const Options options_;
    std::size_t unconfirmed_ = 0;  ///< see Session::unconfirmed()

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
    HistoryPoint point_{pending_};
    std::optional<Gesture> gesture_;
    UndoStack undo_;

private:
    // The content that the editor was told is committed, in a history that it has left (ID4).
    struct Abandoned {
        LayerDocs docs;
        Error reason;
    };

    // Session.cpp
    void dropClosed();

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
    void abandonHistory(const OtherHistory& other);
    void reportAbandoned();
    void freeze();
    void thaw();
    void protocolFault(Error error);
    void blobArrived(const Hash& hash, SharedBytes bytes);
    void blobFailed(const Hash& hash, Error error);
    [[nodiscard]] bool maySend() const {
        return channel_.isOnline() && isCaughtUp() && !view_.isFrozen();
    }
    void sendAll();
    void sendTransactions();

    // SessionCommits.cpp
    void apply(const Commit& commit);
    void acknowledge(const Commit& commit);
    class OwnCommit;
    void completeJoins();
    void prune();
    void lose(Pending pending, Error reason);
    bool resubmit(std::uint64_t sequence);
    [[nodiscard]] bool isCaughtUp() const;

    // The other parts.
    BlobUploads uploads_{host_};
    OwnPreviews ownPreviews_{options_, host_, channel_, uploads_};
    OthersPreviews previews_{options_.client, host_,      downloads_,
                             events_,         confirmed_, [this] { view_.previewsChanged(); }};
    OpenedLayers opened_{channel_, requests_, events_, editor_,
                         [this](const LayerId& layer) { view_.joinFailed(layer); }};
    Peeks peeks_{channel_, requests_, events_, opened_};

    // The connection.
    bool linked_ = false;
    std::deque<Result<Received>> inbox_;
    std::int64_t nowMs_ = 0;
    Deadline deadline_{options_};  // the end of this advance()

    // The confirmed side.
    NamespaceLog log_;
    OwnCreations creations_;
    CommittedWork committed_;
    OwnAddresses addresses_{options_.client, log_, creations_, point_.revision(), pending_};
    OwnSubmissions submissions_{options_, host_,      channel_,  uploads_,
                                pending_, addresses_, deadline_, events_};
    std::optional<Abandoned> abandoned_;

    // The view, and edits of it.
    const Prediction::Confirmed confirmedSide_{confirmed_, log_, creations_, point_.revision(),
                                               options_.client};

public:
    EditorView view_{{.options = options_,
                      .confirmed = confirmedSide_,
                      .pending = pending_,
                      .gesture = gesture_,
                      .previews = previews_,
                      .opened = opened_,
                      .addresses = addresses_,
                      .undo = undo_,
                      .deadline = deadline_,
                      .host = host_,
                      .editor = editor_,
                      .events = events_}};
    Authoring authoring_{{.options = options_,
                          .point = point_,
                          .gesture = gesture_,
                          .pending = pending_,
                          .addresses = addresses_,
                          .undo = undo_,
                          .view = view_,
                          .previews = ownPreviews_,
                          .host = host_,
                          .editor = editor_,
                          .events = events_}};
};

}  // namespace usdlive::client
