// The connection of a session: hello and welcome, resuming, received messages, and what happens
// when it is lost.
#include <algorithm>
#include <iterator>

#include "session/SessionImpl.h"
#include "usdlive/common/core/ErrorPasses.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::client {

namespace {

std::string named(const std::string& project, const StoreId& store) {
    return "\"" + project + "\" (store " + (store.empty() ? "unknown" : store.value.substr(0, 8)) +
           ")";
}

// ID2: another project, or a store that was restored from a copy. Names no revisions, so that the
// same situation is reported once.
Error explained(const OtherHistory& other) {
    const std::string expected = named(other.expectedProject, other.expectedStore);
    const std::string what =
        other.isOtherProject()
            ? "it serves another project, " + named(other.foundProject, other.foundStore) +
                  ", and this editor has " + expected +
                  " open. Another folder is served at this address, or the project's .usdlive was "
                  "deleted. Nothing was sent. Serve the right one again, and work continues"
            : "commits of " + expected +
                  " that this editor has received are not in it. The project's .usdlive was "
                  "replaced by an older one or by another copy. Nothing was sent. Put the right "
                  "one back and start the server again, and work continues";
    return {ErrorCode::HistoryDiverged,
            "the server has another history than this editor: " + what +
                "; or close this connection and connect again: what was not sent is kept, and "
                "unsent_work() shows it; or call join_other_history(): what the server lacks " +
                (other.isOtherProject() ? "and what was not sent become lost work"
                                        : "becomes lost work, and what was not sent is sent")};
}

std::string lostBefore(const Error& reason) {
    return "the connection was lost before the server answered" +
           (reason.message.empty() ? "" : ": " + reason.message);
}

}  // namespace

void Session::Impl::connected() {
    opened_.restart();
    requests_.endAll("another connection took the place of the one that was to answer");
    linked_ = true;
    forgotten_.reset();
    diverged_ = false;
    inbox_.clear();
    listed_.connected();
    channel_.connected();
    Hello hello{.protocol = kProtocolVersion,
                .oldestProtocol = kOldestProtocolVersion,
                .features = options_.features,
                .client = options_.client,
                .user = options_.user,
                .application = options_.application,
                .secret = options_.secret,
                .resume = {},
                .open = {}};
    if (hasHistory_) {
        hello.resume = Hello::Resume{commitEpoch_, revision_, hash_};
        if (!store_.empty()) hello.resume->store = store_;
        if (hasUnanswered()) hello.resume->unansweredSince = unanswered_->since;
        hello.open = opened_.forHello();
    }
    channel_.send(hello);
}

bool Session::Impl::hasUnanswered() const {
    return unanswered_ && std::ranges::any_of(pending_, [&](const Pending& pending) {
               return pending.everSent && pending.transaction.id.sequence <= unanswered_->last;
           });
}

void Session::Impl::noteUnanswered(Revision joined) {
    std::uint64_t last = 0;
    for (const Pending& pending : pending_)
        if (pending.everSent) last = std::max(last, pending.transaction.id.sequence);
    const Revision since = hasUnanswered() ? unanswered_->since : revision_;
    // Another history may be shorter than the one that the client leaves (ID4).
    if (last != 0) unanswered_ = {std::min(since, joined), last};
}

void Session::Impl::disconnected(Error reason, std::size_t unconfirmed) {
    const bool wasLinked = std::exchange(linked_, false);
    channel_.ended();
    // Before the requests are ended: the layers are requested again with the next connection.
    opened_.restart();
    // The next connection brings again what was received and not read, except errors.
    for (const Result<Received>& received : std::exchange(inbox_, {})) {
        const auto* control = received ? std::get_if<ControlMessage>(&*received) : nullptr;
        const auto* error = control ? std::get_if<ErrorMessage>(control) : nullptr;
        if (!error || (error->request && requests_.end(*error->request, tl::unexpected(*error))))
            continue;
        if (error->closing) people_.connectionRefused(toError(*error).code);
        events_.push(event::ServerError{*error});
    }
    submissions_.disconnected();
    if (gesture_) gesture_->disconnected();
    uploads_.disconnected(unconfirmed_ = unconfirmed);
    downloads_.disconnected();
    people_.disconnected();
    requests_.endAll(lostBefore(reason));
    previews_.endAll();
    if (wasLinked) events_.push(event::Disconnected{std::move(reason)});
}

void Session::Impl::received(ReceivedMessage message) {
    std::ranges::move(message.frames, std::back_inserter(inbox_));
}

bool Session::Impl::advance(double budgetMs, std::int64_t nowMs) {
    nowMs_ = nowMs;
    deadline_.set(budgetMs);
    while (!inbox_.empty()) {
        Result<Received> received = std::move(inbox_.front());
        inbox_.pop_front();
        if (received)
            std::visit([this](auto&& part) { handle(std::move(part)); }, std::move(*received));
        else
            protocolFault(received.error());
        if (deadline_.isOver()) break;
    }
    completeJoins();
    peeks_.complete();
    updateView();
    followUndo();
    sendAll();
    reportGesture();
    checkPrediction();
    return inbox_.empty() && !rebuild_ && !(maySend() && submissions_.hasMore());
}

void Session::Impl::protocolFault(Error error) {
    // The host sees `closing` and ends the connection; the next one resumes.
    channel_.ended();
    inbox_.clear();
    ErrorMessage about;
    about.closing = true;
    events_.report(std::move(error), std::move(about));
}

void Session::Impl::handle(ControlMessage&& message) {
    std::visit([this](const auto& part) { on(part); }, message);
}

void Session::Impl::on(const Welcome& message) {
    bool leaves = false;
    if (auto other = compareHistory(message)) {
        other_ = std::move(other);
        if (accepted_ != other_->foundStore) return protocolFault(other_->reason);
        leaves = !message.resumed;
        if (leaves) abandonHistory(*other_);
    }
    other_.reset();
    accepted_.reset();
    auto added = listed_.welcomed(message);
    channel_.welcomed(message);
    rights_.welcomed(message);
    epoch_ = message.epoch;
    store_ = message.store.value_or(store_);
    if (!message.resumed) {
        if (forgotten_) loseSent(*forgotten_);
        if (hasHistory_) {
            noteUnanswered(message.revision);
            freeze();
        }
        revision_ = message.revision;
        hash_ = message.hash;
        commitEpoch_ = 0;
        hasHistory_ = true;
    }
    opened_.welcomed(message);
    missed_.welcomed();
    if (gesture_) gesture_->changed = !gesture_->pending.authored.empty();
    events_.push(event::Connected{*channel_.welcome(), message.resumed, leaves, std::move(added)});
}

// ID2: returns how the history of the server differs from the one that the client has.
std::optional<OtherHistory> Session::Impl::compareHistory(const Welcome& found) const {
    if (!hasHistory_) return std::nullopt;
    OtherHistory other{.expectedProject = channel_.welcome()->project,
                       .foundProject = found.project,
                       .expectedStore = store_,
                       .foundStore = found.store.value_or(StoreId{}),
                       .reason = {}};
    if (!other.isOtherProject() && !diverged_ && found.epoch >= epoch_) return std::nullopt;
    other.reason = explained(other);
    return other;
}

Result<void> Session::Impl::joinOtherHistory() {
    if (!other_)
        return fail(ErrorCode::InvalidArgument,
                    "the server has no other history than this editor: there is none to join");
    accepted_ = other_->foundStore;
    return {};
}

// ID3, ID4: keeps what the editor was told is committed, until it is known what the joined history
// lacks of it. Unsent work does not reach another project.
void Session::Impl::abandonHistory(const OtherHistory& other) {
    if (!abandoned_) abandoned_.emplace();
    abandoned_->reason = {ErrorCode::HistoryDiverged,
                          "it was committed in a history that this editor has left, and " +
                              named(other.foundProject, other.foundStore) + " lacks it"};
    opened_.forEachWanted([this](const LayerId& layer) {
        const auto* doc = confirmed(layer);
        if (!doc) doc = view(layer);  // it was being joined again
        if (doc) abandoned_->docs.try_emplace(layer, *doc);
    });
    if (!other.isOtherProject()) return;
    const Error why{ErrorCode::HistoryDiverged,
                    "it was not sent to " + named(other.expectedProject, other.expectedStore) +
                        ", and this editor has joined another project"};
    if (gesture_) endGesture();
    while (!pending_.empty()) lose(*pending_.take(pending_.begin()->transaction.id.sequence), why);
}

// M14: it is unknown whether unanswered transactions are committed.
void Session::Impl::loseSent(const Error& why) {
    std::vector<std::uint64_t> sent;
    for (const Pending& pending : pending_)
        if (pending.everSent) sent.push_back(pending.transaction.id.sequence);
    for (const std::uint64_t sequence : sent) lose(*pending_.take(sequence), why);
}

void Session::Impl::on(const LayerList& message) {
    if (auto received = listed_.received(message); !received)
        protocolFault(std::move(received.error()));
}

void Session::Impl::handle(ReceivedCommit&& received) {
    Commit& commit = received.commit;
    if (requests_.takes(commit)) return;
    if (!channel_.isOnline() || commit.revision <= revision_ || commit.epoch < commitEpoch_) return;
    const bool continues =
        received.isCompact ? beginsLike(commit.previous, hash_) : commit.previous == hash_;
    if (commit.revision - commit.conflated != revision_ + 1 || !continues) {
        return protocolFault(
            {ErrorCode::HistoryDiverged,
             "commit " + std::to_string(commit.revision) + " does not follow the one before"});
    }
    commit.previous = std::exchange(hash_, received.hashAfter);
    commitEpoch_ = commit.epoch;
    apply(commit);
    events_.push(event::Committed{std::move(received.commit), false});
}

// FR11: the commit has the edits of the own transaction.
void Session::Impl::handle(Acceptance&& accepted) {
    if (!channel_.isOnline() || accepted.revision <= revision_) return;
    const Pending* own = pending_.find(accepted.sequence);
    if (!own || !own->sent || own->changedSince)
        return protocolFault(
            {ErrorCode::NotConnected, "the client connects again to receive the whole commit " +
                                          std::to_string(accepted.revision)});
    ReceivedCommit received{{}, accepted.hashAfter, true};
    Commit& commit = received.commit;
    commit.revision = accepted.revision;
    commit.epoch = accepted.epoch;
    commit.id = own->transaction.id;
    commit.user = options_.user;
    commit.timeMs = accepted.timeMs;
    commit.gesture = own->transaction.gesture;
    commit.edits = own->transaction.edits;
    commit.label = own->transaction.label;
    commit.previous = accepted.previous;
    handle(std::move(received));
}

bool Session::Impl::isCaughtUp() const {
    return channel_.welcome() && revision_ >= channel_.welcome()->revision;
}

void Session::Impl::handle(RefusalFrame&& frame) {
    if (errorPasses(frame.error.code))
        return submissions_.hold(frame.sequence, frame.error, nowMs_);
    submissions_.answered();
    const bool mendable =
        frame.error.code == ErrorCode::StaleBase || frame.error.code == ErrorCode::BlobNotFound;
    if (mendable && resubmit(frame.sequence)) return;
    if (auto pending = pending_.take(frame.sequence))
        lose(std::move(*pending), std::move(frame.error));
}

void Session::Impl::on(const ErrorMessage& message) {
    if (message.request && requests_.end(*message.request, tl::unexpected(message))) return;
    const Error error = toError(message);
    if (error.code == ErrorCode::ClientForgotten && !channel_.isOnline()) {
        forgotten_ = error;
        if (diverged_) return;
    }
    if (message.closing) people_.connectionRefused(error.code);
    const bool differs =
        error.code == ErrorCode::HistoryDiverged || error.code == ErrorCode::FutureRevision;
    if (differs && !channel_.isOnline() && !message.closing) {
        diverged_ = true;  // reported when the welcome has come
        return;
    }
    if (message.blob) {
        if (downloads_.isAsked(*message.blob)) return blobFailed(*message.blob, error);
        uploads_.refused(*message.blob, error.code, nowMs_);
    }
    events_.push(event::ServerError{message});
}

void Session::Impl::on(const RequestProgress& message) {
    using Task = event::Progress::Task;
    if (message.task != "import" && message.task != "save") return;
    const Task task = message.task == "save" ? Task::Save : Task::Import;
    events_.push(
        event::Progress{task, message.layer, message.done, message.total, message.request});
}

// If the commit was missed because the history was replaced, the layers that were joined again
// contain its edits, and only the commit itself names the dropped ones (M12). Otherwise the commit
// is still to be received.
void Session::Impl::on(const AlreadyCommitted& message) {
    if (message.revision > revision_) return;
    auto pending = pending_.take(message.sequence);
    if (!pending) return;
    submissions_.answered();
    undo_.lost(message.sequence);
    restartPrediction();
    missed_.add(message.revision, *std::move(pending));
}

void Session::Impl::on(const LayerOpened& message) {
    opened_.received(message);
    peeks_.received(message);
}

void Session::Impl::handle(ReceivedSnapshot&& received) {
    if (!opened_.received(received)) peeks_.received(received);
}

void Session::Impl::peek(const LayerId& layer, Revision revision, Peeks::Done done) {
    const bool isNow = revision == 0 && channel_.isOnline() && isCaughtUp();
    if (const LayerDoc* here = isNow ? confirmed(layer) : nullptr) return done(*here, revision_);
    peeks_.ask(layer, revision, std::move(done));
}

// ---- big values

void Session::Impl::handle(ReceivedBlob&& blob) {
    if (!blob.whole)
        blobFailed(blob.hash, blob.whole.error());
    else if (*blob.whole)
        blobArrived(blob.hash, std::move(*blob.whole));
    else
        downloads_.progressed(blob.hash, blob.bytes);
}

void Session::Impl::blobArrived(const Hash& hash, SharedBytes bytes) {
    const auto done = downloads_.arrived(hash);
    if (done.outcome != BlobDownloads::Outcome::Arrived) return;
    host_.blobArrived(hash, std::move(bytes), done.lasting);
    previews_.blobArrived(hash);
}

void Session::Impl::blobFailed(const Hash& hash, Error error) {
    const auto done = downloads_.failed(hash, nowMs_);
    if (done.lasting && done.first) {
        ErrorMessage about;
        about.blob = hash;
        events_.report(std::move(error), std::move(about));
    }
    if (done.outcome != BlobDownloads::Outcome::NotWanted) previews_.blobFailed(hash);
}

void Session::Impl::on(const BlobStored& message) {
    uploads_.stored(message.hash);
    host_.blobStored(message.hash);
}

}  // namespace usdlive::client
