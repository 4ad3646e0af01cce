// The connection of a session: hello and welcome, resuming, and what happens when it is lost.
#include <algorithm>

#include "SessionImpl.h"

namespace usdlive::client {

namespace {

constexpr std::string_view kPreviewValues = "previewValues";

// SE3: another server, or a store that was deleted or restored from a copy.
Error otherHistory(Epoch epoch, Epoch seen) {
    return {ErrorCode::HistoryDiverged,
            "the server has another history than this editor: its epoch is " +
                std::to_string(epoch) + ", and this editor has seen " + std::to_string(seen) +
                ". The project's .usdlive was deleted or replaced by an older one, or another "
                "server answers at this address. Put .usdlive back and start the server again, or "
                "close this connection and connect again: what was not sent is kept, and "
                "unsent_work() shows it"};
}

std::string lostBefore(const Error& reason) {
    return "the connection was lost before the server answered" +
           (reason.message.empty() ? "" : ": " + reason.message);
}

// Called before requests are ended: layers that are being joined are requested again with the next
// connection, whatever the answer was.
void restartJoins(auto& layers) {
    for (auto& [layer, opened] : layers)
        if (opened.joining) opened.restart();
}

}  // namespace

void Session::Impl::connected() {
    restartJoins(layers_);
    requests_.endAll("another connection took the place of the one that was to answer");
    linked_ = true;
    forgotten_.reset();
    notResumed_.reset();
    inbox_.clear();
    Hello hello{.protocol = kProtocolVersion,
                .oldestProtocol = kOldestProtocolVersion,
                .features = options_.features,
                .client = options_.client,
                .user = options_.user,
                .application = options_.application,
                .resume = {},
                .open = {}};
    if (hasHistory_) {
        saidSince_ = hasUnanswered();
        hello.resume = saidSince_ ? unanswered_->since : here();
        hello.open.emplace();
        for (const auto& [layer, opened] : layers_)
            if (opened.wanted && !opened.joining) hello.open->push_back(layer);
    }
    sendControl(hello);
}

Hello::Resume Session::Impl::here() const { return {commitEpoch_, revision_, hash_}; }

bool Session::Impl::hasUnanswered() const {
    return unanswered_ && std::ranges::any_of(pending_, [&](const Pending& pending) {
               return pending.everSent && pending.transaction.id.sequence <= unanswered_->last;
           });
}

void Session::Impl::noteUnanswered() {
    std::uint64_t last = 0;
    for (const Pending& pending : pending_)
        if (pending.everSent) last = std::max(last, pending.transaction.id.sequence);
    if (last != 0) unanswered_ = {hasUnanswered() ? unanswered_->since : here(), last};
}

void Session::Impl::disconnected(Error reason) {
    const bool wasLinked = std::exchange(linked_, false);
    online_ = false;
    restartJoins(layers_);
    // The next connection brings again what was received and not read, except errors.
    for (const Result<Received>& received : std::exchange(inbox_, {})) {
        const auto* control = received ? std::get_if<ControlMessage>(&*received) : nullptr;
        const auto* error = control ? std::get_if<ErrorMessage>(control) : nullptr;
        if (!error || (error->request && requests_.end(*error->request, tl::unexpected(*error))))
            continue;
        events_.push_back(event::ServerError{*error});
    }
    pending_.markAllUnsent();
    sending_.reset();
    if (gesture_) gesture_->disconnected();
    uploads_.disconnected();
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
    if (message.epoch < epoch_) return protocolFault(otherHistory(message.epoch, epoch_));
    if (auto why = std::exchange(notResumed_, std::nullopt))
        events_.push_back(event::ServerError{*std::move(why)});
    welcome_ = message;
    epoch_ = message.epoch;
    online_ = true;
    takesPreviewValues_ = std::ranges::count(message.features, kPreviewValues) > 0;
    takesParts_ = std::ranges::count(message.features, kPartsFeature) > 0;
    layerStates_.clear();  // the server sends them again
    // The hello named an older revision than the one that the client has.
    const bool resumed = message.resumed && !std::exchange(saidSince_, false);
    if (!resumed && forgotten_) loseSent(*forgotten_);
    if (!resumed) {
        if (hasHistory_) {
            noteUnanswered();
            freeze();
        }
        revision_ = message.revision;
        hash_ = message.hash;
        commitEpoch_ = 0;
        hasHistory_ = true;
    }
    for (auto& [layer, opened] : layers_)
        if (opened.joining) join(layer, *opened.joining);
    for (Missed& missed : missed_) missed.asked = false;
    readMissed();
    if (gesture_) gesture_->changed = !gesture_->pending.authored.empty();
    events_.push_back(event::Connected{message, resumed});
}

// M14: it is unknown whether unanswered transactions are committed.
void Session::Impl::loseSent(const Error& why) {
    std::vector<std::uint64_t> sent;
    for (const Pending& pending : pending_)
        if (pending.everSent) sent.push_back(pending.transaction.id.sequence);
    for (const std::uint64_t sequence : sent) lose(*pending_.take(sequence), why);
}

void Session::Impl::on(const ProjectLayers& message) {
    if (!welcome_) return;
    welcome_->layers = message.layers;
    event::LayersChanged changed;
    for (const LayerInfo& info : message.layers) changed.layers.push_back(info.layer);
    events_.push_back(std::move(changed));
}

void Session::Impl::on(const LayerStates& message) {
    for (const LayerState& state : message.layers) layerStates_[state.layer] = state;
    events_.push_back(event::LayerStatesChanged{message.layers});
}

void Session::Impl::handle(ReceivedCommit&& received) {
    const Commit& commit = received.commit;
    if (!logs_.empty() && logs_.front().begun) return logs_.front().each(commit);
    if (!online_ || commit.revision <= revision_ || commit.epoch < commitEpoch_) return;
    if (commit.revision - commit.conflated != revision_ + 1 || commit.previous != hash_) {
        hasHistory_ = false;
        freeze();
        return protocolFault(
            {ErrorCode::HistoryDiverged,
             "commit " + std::to_string(commit.revision) + " does not follow the one before"});
    }
    hash_ = received.hashAfter;
    commitEpoch_ = commit.epoch;
    apply(commit);
    events_.push_back(event::Committed{std::move(received.commit), false});
}

bool Session::Impl::isCaughtUp() const { return welcome_ && revision_ >= welcome_->revision; }

void Session::Impl::handle(RefusalFrame&& frame) {
    const bool mendable =
        frame.error.code == ErrorCode::StaleBase || frame.error.code == ErrorCode::BlobNotFound;
    if (mendable && resubmit(frame.sequence)) return;
    if (auto pending = pending_.take(frame.sequence))
        lose(std::move(*pending), std::move(frame.error));
}

}  // namespace usdlive::client
