// The connection of a session: hello and welcome, resuming, and what happens when it is lost.
#include <algorithm>
#include <iterator>

#include "session/SessionImpl.h"
#include "usdlive/common/core/ErrorPasses.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::client {

namespace {

constexpr std::string_view kPreviewValues = "previewValues";

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

// Removes layers from the end of the list, as many as fit into a control message of a client.
std::vector<LayerId> takeSome(std::vector<LayerId>& layers) {
    constexpr std::size_t kMostBytes = 1024 * 1024, kMost = 100'000;
    std::vector<LayerId> some;
    for (std::size_t bytes = 0; !layers.empty() && bytes < kMostBytes && some.size() < kMost;) {
        some.push_back(std::move(layers.back()));
        layers.pop_back();
        bytes += some.back().value.size();
    }
    return some;
}

}  // namespace

void Session::Impl::connected() {
    restartJoins();
    requests_.endAll("another connection took the place of the one that was to answer");
    linked_ = true;
    forgotten_.reset();
    diverged_ = false;
    inbox_.clear();
    nextProjectLayers_.clear();
    takesCompact_ = false;
    names_ = {};
    namesSent_ = {};
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
        toKeep_.clear();
        for (const auto& [layer, opened] : layers_)
            if (opened.wanted && !opened.joining) toKeep_.push_back(layer);
        hello.open = takeSome(toKeep_);
    }
    sendControl(hello);
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
    online_ = false;
    // Before the requests are ended: the layers are requested again with the next connection.
    restartJoins();
    // The next connection brings again what was received and not read, except errors.
    for (const Result<Received>& received : std::exchange(inbox_, {})) {
        const auto* control = received ? std::get_if<ControlMessage>(&*received) : nullptr;
        const auto* error = control ? std::get_if<ErrorMessage>(control) : nullptr;
        if (!error || (error->request && requests_.end(*error->request, tl::unexpected(*error))))
            continue;
        if (error->closing) noteRefusedPresence(toError(*error).code);
        events_.push_back(event::ServerError{*error});
    }
    pending_.markAllUnsent();
    sending_.reset();
    held_.reset();
    if (gesture_) gesture_->disconnected();
    uploads_.disconnected(unconfirmed_ = unconfirmed);
    downloads_.disconnected();
    forgetOthers();
    requests_.endAll(lostBefore(reason));
    if (!previews_.empty()) previewsChanged();
    for (const auto& [id, preview] : std::exchange(previews_, {}))
        events_.push_back(event::PreviewChanged{id.first, id.second, true});
    if (wasLinked) events_.push_back(event::Disconnected{std::move(reason)});
}

void Session::Impl::received(ReceivedMessage message) {
    std::ranges::move(message.frames, std::back_inserter(inbox_));
}

bool Session::Impl::advance(double budgetMs, std::int64_t nowMs) {
    nowMs_ = nowMs;
    deadlineMs_ = options_.clockMs() + budgetMs;
    while (!inbox_.empty()) {
        Result<Received> received = std::move(inbox_.front());
        inbox_.pop_front();
        if (received)
            std::visit([this](auto&& part) { handle(std::move(part)); }, std::move(*received));
        else
            protocolFault(received.error());
        if (outOfTime()) break;
    }
    completeJoins();
    completePeeks();
    updateView();
    sendAll();
    reportGesture();
    checkPrediction();
    return inbox_.empty() && !rebuild_ && !moreToSend_;
}

void Session::Impl::protocolFault(Error error) {
    // The host sees `closing` and ends the connection; the next one resumes.
    online_ = false;
    inbox_.clear();
    report(std::move(error), closing());
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
    auto added = replaceProjectLayers(message.layers);
    welcome_ = message;
    welcome_->layers.clear();
    epoch_ = message.epoch;
    store_ = message.store.value_or(store_);
    online_ = true;
    takesPreviewValues_ = std::ranges::count(message.features, kPreviewValues) > 0;
    takesParts_ = std::ranges::count(message.features, kPartsFeature) > 0;
    takesCompact_ = std::ranges::count(message.features, kCompactFeature) > 0;
    layerStates_.clear();  // the server sends them again
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
    keepLayers(message);
    for (auto& [layer, opened] : layers_)
        if (opened.joining) join(layer);
    for (Missed& missed : missed_) missed.asked = false;
    readMissed();
    if (gesture_) gesture_->changed = !gesture_->pending.authored.empty();
    events_.push_back(event::Connected{*welcome_, message.resumed, leaves, std::move(added)});
}

// SE9: replaces the list by the one that came before the welcome or, from a server without the
// feature, with it. Returns the new ones.
std::vector<LayerId> Session::Impl::replaceProjectLayers(const std::vector<LayerInfo>& listed) {
    std::set<LayerId> before = std::exchange(projectLayers_, std::exchange(nextProjectLayers_, {}));
    for (const LayerInfo& info : listed) projectLayers_.insert(info.layer);
    std::vector<LayerId> added;
    std::ranges::set_difference(projectLayers_, before, std::back_inserter(added));
    return added;
}

// SE2: names the open layers for which the hello had no room. A server that does not know the
// message would end the session: it gets them as layers that are opened again.
void Session::Impl::keepLayers(const Welcome& welcome) {
    const bool knows = std::ranges::count(welcome.features, kLayerListFeature) > 0;
    while (welcome.resumed && knows && !toKeep_.empty()) sendControl(KeepLayers{takeSome(toKeep_)});
    if (welcome.resumed)
        for (const LayerId& layer : toKeep_)
            if (const auto opened = layers_.find(layer); opened != layers_.end())
                opened->second.restart();
    toKeep_.clear();
}

// ID2: returns how the history of the server differs from the one that the client has.
std::optional<OtherHistory> Session::Impl::compareHistory(const Welcome& found) const {
    if (!hasHistory_) return std::nullopt;
    OtherHistory other{.expectedProject = welcome_->project,
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
    for (const auto& [layer, opened] : layers_) {
        const auto* doc = opened.wanted ? confirmed(layer) : nullptr;
        if (!doc) doc = view(layer);  // it was being joined again
        if (doc) abandoned_->docs.try_emplace(layer, *doc);
    }
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
    std::set<LayerId>& list = online_ ? projectLayers_ : nextProjectLayers_;
    event::LayersChanged changed;
    for (const LayerId& layer : message.removed)
        if (list.erase(layer) > 0) changed.removed.push_back(layer);
    for (const LayerId& layer : message.added)
        if (list.insert(layer).second) changed.added.push_back(layer);
    if (list.size() > kMaxLayers)
        return protocolFault({ErrorCode::MalformedControl,
                              "the server listed more than " + std::to_string(kMaxLayers) +
                                  " layers, the most that a project has"});
    if (online_ && !(changed.added.empty() && changed.removed.empty()))
        events_.push_back(std::move(changed));
}

void Session::Impl::on(const ProjectLayers& message) {
    if (!online_) return;
    std::set<LayerId> before = projectLayers_;
    event::LayersChanged changed{.added = replaceProjectLayers(message.layers), .removed = {}};
    std::ranges::set_difference(before, projectLayers_, std::back_inserter(changed.removed));
    events_.push_back(std::move(changed));
}

void Session::Impl::on(const LayerStates& message) {
    for (const LayerState& state : message.layers) layerStates_[state.layer] = state;
    events_.push_back(event::LayerStatesChanged{message.layers});
}

void Session::Impl::handle(ReceivedCommit&& received) {
    Commit& commit = received.commit;
    if (!logs_.empty() && logs_.front().begun) return logs_.front().each(commit);
    if (!online_ || commit.revision <= revision_ || commit.epoch < commitEpoch_) return;
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
    events_.push_back(event::Committed{std::move(received.commit), false});
}

// FR11: the commit has the edits of the own transaction.
void Session::Impl::handle(Acceptance&& accepted) {
    if (!online_ || accepted.revision <= revision_) return;
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
    commit.previous = accepted.previous;
    handle(std::move(received));
}

bool Session::Impl::isCaughtUp() const { return welcome_ && revision_ >= welcome_->revision; }

void Session::Impl::handle(RefusalFrame&& frame) {
    if (errorPasses(frame.error.code)) return hold(frame.sequence, frame.error);
    held_.reset();
    const bool mendable =
        frame.error.code == ErrorCode::StaleBase || frame.error.code == ErrorCode::BlobNotFound;
    if (mendable && resubmit(frame.sequence)) return;
    if (auto pending = pending_.take(frame.sequence))
        lose(std::move(*pending), std::move(frame.error));
}

}  // namespace usdlive::client
