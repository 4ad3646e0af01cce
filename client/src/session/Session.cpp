#include "session/Session.h"

#include <algorithm>
#include <chrono>
#include <random>

#include "SessionImpl.h"

namespace usdlive::client {

namespace {

double machineClockMs() {
    using Milliseconds = std::chrono::duration<double, std::milli>;
    return Milliseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Session::Options withClock(Session::Options options) {
    if (!options.clockMs) options.clockMs = &machineClockMs;
    return options;
}

}  // namespace

Session::Impl::Impl(Options options, SessionHost& host, LayerView& editor)
    : options_(withClock(std::move(options))), host_(host), editor_(editor), uploads_(host) {
    pending_.onAdd = [this](const Pending& pending) { tellPending(pending); };
    pending_.onTake = [this](std::uint64_t sequence) { host_.answered(sequence); };
}

void Session::Impl::tellPending(const Pending& pending) {
    host_.pending({pending.transaction.id.sequence, revision_, hash_, pending.authored});
}

void Session::Impl::report(Error error, ErrorMessage about) {
    about.code = errorName(error.code);
    about.message = std::move(error.message);
    events_.push_back(event::ServerError{std::move(about)});
}

// ---- layers

void Session::Impl::openLayer(const LayerId& layer) {
    const auto [entry, added] = layers_.try_emplace(layer);
    OpenedLayer& opened = entry->second;
    if (!added) {
        if (!opened.wanted && !opened.joining) resets_.insert(layer);
        opened.wanted = true;
        return;
    }
    opened.joining.emplace();
    if (online_) ask(opened.joining->snapshot, layer, 0);
}

void Session::Impl::closeLayer(const LayerId& layer) {
    const auto entry = layers_.find(layer);
    if (entry == layers_.end()) return;
    entry->second.wanted = false;
    resets_.erase(layer);
}

bool Session::Impl::isJoined(const LayerId& layer) const {
    const auto entry = layers_.find(layer);
    if (entry == layers_.end() || !entry->second.wanted) return false;
    if (frozen_) return frozen_->views.contains(layer);
    return !entry->second.joining;
}

const LayerDoc* Session::Impl::view(const LayerId& layer) const {
    if (!isJoined(layer)) return nullptr;
    return frozen_ ? &frozen_->views.at(layer) : prediction_.find(layer);
}

const LayerDoc* Session::Impl::confirmed(const LayerId& layer) const {
    const auto entry = confirmed_.find(layer);
    return isJoined(layer) && entry != confirmed_.end() ? &entry->second : nullptr;
}

void Session::Impl::peek(const LayerId& layer, Revision revision,
                         std::function<void(Result<LayerDoc>, Revision)> done) {
    const LayerDoc* here = revision == 0 && online_ && isCaughtUp() ? confirmed(layer) : nullptr;
    if (here) return done(*here, revision_);
    Peek& peek = peeks_.emplace_back(Peek{layer, revision, Incoming{}, std::move(done)});
    if (online_) ask(peek.snapshot, layer, revision);
}

void Session::Impl::requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                               std::function<void(Result<void>)> done) {
    if (!online_) return done(fail(ErrorCode::NotConnected, "there is no connection to read from"));
    logs_.push_back({++lastRequest_, false, std::move(each), std::move(done)});
    sendControl(RequestLog{lastRequest_, from, to});
}

/// What the server does and an event answers.
template <class Request>
std::uint64_t Session::Impl::request(Request message) {
    message.request = ++lastRequest_;
    if (online_) {
        requests_.insert(message.request);
        sendControl(message);
    } else {
        report({ErrorCode::NotConnected, "only the server can do it, and there is no connection"},
               about(message.request));
    }
    return message.request;
}

std::uint64_t Session::Impl::save(std::vector<LayerId> layers, bool force) {
    return request(SaveLayers{0, std::move(layers), force ? std::optional(true) : std::nullopt});
}

std::uint64_t Session::Impl::reload(std::vector<LayerId> layers) {
    return request(ReloadLayers{0, std::move(layers)});
}

std::uint64_t Session::Impl::createCheckpoint(std::string name) {
    return request(CreateCheckpoint{0, std::move(name)});
}

std::uint64_t Session::Impl::createLayer(const LayerId& layer) {
    return requestFeature("createLayer", CreateLayer{0, layer});
}

std::uint64_t Session::Impl::listSkipped() { return requestFeature("skipped", ListSkipped{}); }

/// A server of an earlier version would end the session over a message that it does not know.
template <class Request>
std::uint64_t Session::Impl::requestFeature(std::string_view feature, Request message) {
    if (!online_ || std::ranges::count(welcome_->features, feature) > 0)
        return request(std::move(message));
    report({ErrorCode::InvalidArgument,
            "the server is of an earlier version of usdlive, which cannot do this"},
           about(++lastRequest_));
    return lastRequest_;
}

std::uint64_t Session::Impl::listCheckpoints() { return request(ListCheckpoints{}); }

/// What the server does and a call answers.
template <class Answer, class Request>
void Session::Impl::askStorage(Request message, std::function<void(Result<Answer>)> done) {
    if (!online_) return done(fail(ErrorCode::NotConnected, "there is no connection to ask over"));
    if (std::ranges::count(welcome_->features, "storage") == 0)
        return done(fail(ErrorCode::UnsupportedProtocol,
                         "the server is of a version that cannot do this: update it"));
    message.request = ++lastRequest_;
    asked_[message.request] = [done = std::move(done)](Result<ControlMessage> answer) {
        done(std::move(answer).map(
            [](ControlMessage&& said) { return std::get<Answer>(std::move(said)); }));
    };
    sendControl(message);
}

void Session::Impl::compactHistory(std::optional<std::uint64_t> days,
                                   std::function<void(Result<HistoryCompacted>)> done) {
    askStorage(CompactHistory{0, days}, std::move(done));
}

void Session::Impl::requestStorage(std::function<void(Result<Storage>)> done) {
    askStorage(RequestStorage{}, std::move(done));
}

void Session::Impl::requestBlob(const Hash& hash) {
    if (downloads_.want(hash, true, online_)) askForBlobs({hash});
}

std::set<Hash> Session::Impl::namedBlobs() const {
    std::set<Hash> named;
    const auto add = [&](const Pending& pending) {
        for (const AuthoredEdit& edit : pending.authored)
            forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    };
    for (const Pending& pending : pending_) add(pending);
    for (const Missed& missed : missed_) add(missed.pending);
    if (gesture_) add(gesture_->pending);
    return named;
}

// ---- Session

Session::Session(Options options, SessionHost& host, LayerView& view)
    : impl_(std::make_unique<Impl>(std::move(options), host, view)) {}
Session::~Session() = default;

void Session::connected() { impl_->connected(); }
void Session::disconnected(Error reason) { impl_->disconnected(std::move(reason)); }
void Session::received(ReceivedMessage message) { impl_->received(std::move(message)); }

void Session::openLayer(const LayerId& layer) { impl_->openLayer(layer); }
void Session::closeLayer(const LayerId& layer) { impl_->closeLayer(layer); }
bool Session::isJoined(const LayerId& layer) const { return impl_->isJoined(layer); }
const LayerDoc* Session::view(const LayerId& layer) const { return impl_->view(layer); }
const LayerDoc* Session::confirmed(const LayerId& layer) const { return impl_->confirmed(layer); }
void Session::peek(const LayerId& layer, Revision revision,
                   std::function<void(Result<LayerDoc>, Revision)> done) {
    impl_->peek(layer, revision, std::move(done));
}
void Session::requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                         std::function<void(Result<void>)> done) {
    impl_->requestLog(from, to, std::move(each), std::move(done));
}
std::uint64_t Session::save(std::vector<LayerId> layers, bool force) {
    return impl_->save(std::move(layers), force);
}
std::uint64_t Session::reload(std::vector<LayerId> layers) {
    return impl_->reload(std::move(layers));
}

std::uint64_t Session::createCheckpoint(std::string name) {
    return impl_->createCheckpoint(std::move(name));
}
std::uint64_t Session::createLayer(const LayerId& layer) { return impl_->createLayer(layer); }
std::uint64_t Session::listSkipped() { return impl_->listSkipped(); }
std::uint64_t Session::listCheckpoints() { return impl_->listCheckpoints(); }
void Session::compactHistory(std::optional<std::uint64_t> days,
                             std::function<void(Result<HistoryCompacted>)> done) {
    impl_->compactHistory(days, std::move(done));
}
void Session::requestStorage(std::function<void(Result<Storage>)> done) {
    impl_->requestStorage(std::move(done));
}

void Session::author(std::vector<AuthoredEdit> edits) { impl_->author(std::move(edits)); }
void Session::setNextSequence(std::uint64_t sequence) { impl_->pending_.setNextSequence(sequence); }
void Session::beginGesture() { impl_->beginGesture(); }
void Session::endGesture() { impl_->endGesture(); }
bool Session::inGesture() const { return impl_->gesture_.has_value(); }

bool Session::advance(double budgetMs, std::int64_t nowMs) {
    return impl_->advance(budgetMs, nowMs);
}
std::vector<Event> Session::takeEvents() { return std::exchange(impl_->events_, {}); }

bool Session::isConnected() const { return impl_->online_; }
Revision Session::revision() const { return impl_->revision_; }
const std::map<LayerId, LayerState>& Session::layerStates() const { return impl_->layerStates_; }
void Session::showPresence(Presence presence) { impl_->showPresence(std::move(presence)); }
void Session::hidePresence() { impl_->hidePresence(); }
const std::map<ClientId, Presence>& Session::presences() const { return impl_->presences_; }
std::size_t Session::pendingTransactions() const {
    return impl_->pending_.size() + impl_->missed();
}
std::uint64_t Session::writtenAgain() const { return impl_->writtenAgain(); }
const std::optional<Welcome>& Session::welcome() const { return impl_->welcome_; }
const ClientId& Session::id() const { return impl_->options_.client; }
void Session::requestBlob(const Hash& hash) { impl_->requestBlob(hash); }
std::set<Hash> Session::namedBlobs() const { return impl_->namedBlobs(); }

ClientId newClientId() {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::random_device random;
    ClientId id;
    while (id.value.size() < 32) id.value += kDigits[random() & 15];
    return id;
}

}  // namespace usdlive::client
