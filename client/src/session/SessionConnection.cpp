// The connection of a session: hello and welcome, resuming, another history, what is received and
// sent, and what happens when the connection is lost.
#include <algorithm>
#include <iterator>

#include "session/SessionImpl.h"
#include "usdlive/common/core/ErrorPasses.h"
#include "usdlive/common/layer/MatchedSpecs.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::client {

namespace {

std::string lostBefore(const Error& reason) {
    return "the connection was lost before the server answered" +
           (reason.message.empty() ? "" : ": " + reason.message);
}

}  // namespace

void Session::Impl::connected() {
    opened_.restart();
    requests_.endAll("another connection took the place of the one that was to answer");
    linked_ = true;
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
                .resume = point_.connecting(),
                .open = {}};
    if (hello.resume) hello.open = opened_.forHello();
    channel_.send(hello);
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
    if (view_.isFrozen() && !opened_.areJoiningAgain()) thaw();
    if (!view_.isFrozen()) {
        dropClosed();
        view_.update();
    }
    view_.followUndo();
    sendAll();
    authoring_.reportGesture(nowMs_);
    view_.check();
    return inbox_.empty() && !view_.isComputing() && !(maySend() && submissions_.hasMore());
}

// Own work: transactions, big values, previews and presence.
void Session::Impl::sendAll() {
    if (channel_.isOnline()) {
        downloads_.requestDue(nowMs_, [this](const Hash& hash) { return host_.needsBlob(hash); });
        opened_.askAgain(nowMs_);
    }
    if (!maySend()) return;
    sendTransactions();
    uploads_.dropUnwanted();
    uploads_.send(options_.uploadWindowChunks, nowMs_);
    if (const auto progress = uploads_.progress(nowMs_)) events_.push(*progress);
    if (gesture_) ownPreviews_.send(*gesture_, nowMs_);
    people_.send(nowMs_);
}

void Session::Impl::sendTransactions() {
    auto tooLarge = submissions_.send(nowMs_, !view_.isOutdated());
    for (auto& [sequence, error] : tooLarge) lose(*pending_.take(sequence), std::move(error));
    if (!tooLarge.empty()) view_.recompute();
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
    using Found = HistoryPoint::Found;
    const auto& before = channel_.welcome();
    const Found found = point_.compare(message, before ? before->project : "");
    if (found == Found::Other) return protocolFault(point_.other()->reason);
    const bool leaves = found == Found::AcceptedOther && !message.resumed;
    if (leaves) abandonHistory(*point_.other());
    point_.welcomed(message);
    auto added = listed_.welcomed(message);
    channel_.welcomed(message);
    rights_.welcomed(message);
    if (!message.resumed) {
        if (point_.forgotten()) loseSent(*point_.forgotten());
        if (point_.isKnown()) {
            point_.leaveUnanswered(message.revision);
            freeze();
        }
        point_.beginAt(message);
    }
    opened_.welcomed(message);
    missed_.welcomed();
    if (gesture_) gesture_->changed = !gesture_->pending.authored.empty();
    events_.push(event::Connected{*channel_.welcome(), message.resumed, leaves, std::move(added)});
}

// ID3, ID4: keeps what the editor was told is committed, until it is known what the joined history
// lacks of it. Unsent work does not reach another project.
void Session::Impl::abandonHistory(const OtherHistory& other) {
    if (!abandoned_) abandoned_.emplace();
    abandoned_->reason = {ErrorCode::HistoryDiverged,
                          "it was committed in a history that this editor has left, and " +
                              namedHistory(other.foundProject, other.foundStore) + " lacks it"};
    opened_.forEachWanted([this](const LayerId& layer) {
        const auto* doc = confirmed(layer);
        if (!doc) doc = view_.find(layer);  // it was being joined again
        if (doc) abandoned_->docs.try_emplace(layer, *doc);
    });
    if (!other.isOtherProject()) return;
    const Error why{ErrorCode::HistoryDiverged,
                    "it was not sent to " +
                        namedHistory(other.expectedProject, other.expectedStore) +
                        ", and this editor has joined another project"};
    if (gesture_) authoring_.endGesture();
    while (!pending_.empty()) lose(*pending_.take(pending_.begin()->transaction.id.sequence), why);
}

// ID4: what the editor was told is committed, and the joined history lacks, becomes lost work: the
// edits that turn the present layers into those of then.
void Session::Impl::reportAbandoned() {
    if (!abandoned_) return;
    const LayerDoc none;
    LostWork work{.sequence = 0,
                  .gesture = 0,
                  .reason = std::move(abandoned_->reason),
                  .refused = false,
                  .edits = {}};
    for (const auto& [layer, then] : abandoned_->docs) {
        const auto found = confirmed_.find(layer);
        const LayerDoc& now = found == confirmed_.end() ? none : found->second;
        for (auto& [path, action] : difference(now, matchedSpecs(now, then)))
            work.edits.push_back({layer, std::move(path), std::move(action)});
    }
    abandoned_.reset();
    if (!work.edits.empty()) events_.push(event::Lost{std::move(work)});
}

// Called when the confirmed layers are not valid any more. The view stays until all layers have
// been joined again. Own work is carried over by its paths in the view.
void Session::Impl::freeze() {
    if (!view_.isFrozen()) previews_.endAll();
    view_.freeze();
    undo_.clear();
    submissions_.restart();
    // Also those that are being joined: the commits that follow their content are unknown.
    opened_.restartAll();
    host_.discard(std::make_shared<LayerDocs>(std::exchange(confirmed_, {})));
    log_ = {};
    creations_ = {};
    committed_.clear();
}

// All layers have been joined again.
void Session::Impl::thaw() {
    view_.thaw();
    reportAbandoned();
    const auto withoutLayer = [this](const Pending& pending) {
        return std::ranges::any_of(pending.carried, [&](const auto& edit) {
            return edit && !confirmed_.contains(edit->layer);
        });
    };
    for (Pending& pending : pending_.takeAll()) {
        if (withoutLayer(pending)) {
            lose(std::move(pending), {ErrorCode::LayerNotFound, "its layer is gone"});
            continue;
        }
        view_.carried(pending);
        pending_.add(std::move(pending));
    }
    if (gesture_) view_.carried(gesture_->pending);
    view_.showAll();
    previews_.presentAgain();
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
    if (!channel_.isOnline() || point_.isPast(commit)) return;
    if (auto advanced = point_.advance(received); !advanced)
        return protocolFault(std::move(advanced.error()));
    apply(commit);
    events_.push(event::Committed{std::move(received.commit), false});
}

// FR11: the commit has the edits of the own transaction.
void Session::Impl::handle(Acceptance&& accepted) {
    if (!channel_.isOnline() || accepted.revision <= point_.revision()) return;
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
    return channel_.welcome() && point_.revision() >= channel_.welcome()->revision;
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
    if (!channel_.isOnline() && point_.takesBeforeWelcome(message)) return;
    const Error error = toError(message);
    if (message.closing) people_.connectionRefused(error.code);
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
    if (message.revision > point_.revision()) return;
    auto pending = pending_.take(message.sequence);
    if (!pending) return;
    submissions_.answered();
    undo_.lost(message.sequence);
    view_.restart();
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
    if (const LayerDoc* here = isNow ? confirmed(layer) : nullptr)
        return done(*here, point_.revision());
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
