// Session: forwards to its parts; opening and closing layers.
#include "session/Session.h"

#include <algorithm>
#include <chrono>

#include "session/SessionImpl.h"

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
    : options_(withClock(std::move(options))), host_(host), editor_(editor) {
    pending_.onChange = [this](const Pending& pending) {
        host_.pending({pending.transaction.id.sequence, point_.revision(), point_.hash(),
                       point_.store(), pending.authored});
    };
    pending_.onTake = [this](std::uint64_t sequence) { host_.answered(sequence); };
}

// ---- layers

void Session::Impl::openLayer(const LayerId& layer) {
    if (opened_.open(layer)) view_.opened(layer);
}

void Session::Impl::closeLayer(const LayerId& layer) {
    opened_.close(layer);
    view_.closed(layer);
    undo_.forget(layer);
}

// A closed layer stays until own work on it is answered.
void Session::Impl::dropClosed() {
    const auto hasOwnWork = [this](const LayerId& layer) {
        const auto& edits = gesture_ ? gesture_->pending.authored : std::vector<AuthoredEdit>();
        return pending_.touches(layer) ||
               std::ranges::any_of(edits, [&](const auto& edit) { return edit.layer == layer; });
    };
    opened_.dropClosed(hasOwnWork, [this](const LayerId& layer) {
        if (auto closed = confirmed_.extract(layer))
            host_.discard(std::make_shared<LayerDoc>(std::move(closed.mapped())));
        view_.dropped(layer);
    });
}

const LayerDoc* Session::Impl::confirmed(const LayerId& layer) const {
    const auto entry = confirmed_.find(layer);
    return view_.isJoined(layer) && entry != confirmed_.end() ? &entry->second : nullptr;
}

std::set<Hash> Session::Impl::namedBlobs() const {
    std::set<Hash> named;
    const auto add = [&](const Pending& pending) {
        for (const AuthoredEdit& edit : pending.authored)
            forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    };
    for (const Pending& pending : pending_) add(pending);
    missed_.forEach(add);
    if (gesture_) add(gesture_->pending);
    undo_.forEachPendingBlob([&](const Value& blob) { named.insert(blob.hash()); });
    return named;
}

// ---- Session

Session::Session(Options options, SessionHost& host, LayerView& view)
    : impl_(std::make_unique<Impl>(std::move(options), host, view)) {}
Session::~Session() = default;

void Session::connected() { impl_->connected(); }
void Session::disconnected(Error reason, std::size_t unconfirmed) {
    impl_->disconnected(std::move(reason), unconfirmed);
}
std::size_t Session::unconfirmed() const { return impl_->unconfirmed_; }
void Session::received(ReceivedMessage message) { impl_->received(std::move(message)); }

const std::optional<OtherHistory>& Session::otherHistory() const { return impl_->point_.other(); }
Result<void> Session::joinOtherHistory() { return impl_->point_.acceptOther(); }

void Session::openLayer(const LayerId& layer) { impl_->openLayer(layer); }
void Session::closeLayer(const LayerId& layer) { impl_->closeLayer(layer); }
bool Session::isJoined(const LayerId& layer) const { return impl_->view_.isJoined(layer); }
const LayerDoc* Session::view(const LayerId& layer) const { return impl_->view_.find(layer); }
const LayerDoc* Session::confirmed(const LayerId& layer) const { return impl_->confirmed(layer); }
void Session::peek(const LayerId& layer, Revision revision,
                   std::function<void(Result<LayerDoc>, Revision)> done) {
    impl_->peek(layer, revision, std::move(done));
}
void Session::requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                         std::function<void(Result<void>)> done) {
    impl_->requests_.requestLog(from, to, std::move(each), std::move(done));
}
std::uint64_t Session::request(AnyRequest request) {
    return impl_->requests_.request(std::move(request));
}

void Session::author(std::vector<AuthoredEdit> edits) {
    impl_->authoring_.author(std::move(edits));
}
void Session::setNextSequence(std::uint64_t sequence) { impl_->pending_.setNextSequence(sequence); }
void Session::beginGesture() { impl_->authoring_.beginGesture(); }
void Session::endGesture() { impl_->authoring_.endGesture(); }
bool Session::inGesture() const { return impl_->gesture_.has_value(); }

void Session::beginUndoGroup(const std::string& label) { impl_->undo_.begin(label); }
void Session::endUndoGroup() { impl_->undo_.end(); }
Result<UndoResult> Session::undo() {
    return impl_->authoring_.takeBack(UndoStack::Direction::Undo);
}
Result<UndoResult> Session::redo() {
    return impl_->authoring_.takeBack(UndoStack::Direction::Redo);
}
UndoLabels Session::undoLabels() const { return impl_->undo_.labels(); }

bool Session::advance(double budgetMs, std::int64_t nowMs) {
    return impl_->advance(budgetMs, nowMs);
}
std::vector<Event> Session::takeEvents() { return impl_->events_.take(); }

bool Session::isConnected() const { return impl_->channel_.isOnline(); }
Revision Session::revision() const { return impl_->point_.revision(); }
const std::map<LayerId, LayerState>& Session::layerStates() const {
    return impl_->listed_.states();
}
const OwnRights& Session::rights() const { return impl_->rights_; }
Result<void> Session::showPresence(Presence presence) {
    return impl_->people_.show(std::move(presence));
}
void Session::hidePresence() { impl_->people_.hide(); }
const std::map<ClientId, Presence>& Session::presences() const { return impl_->people_.others(); }
std::size_t Session::pendingTransactions() const {
    return impl_->pending_.size() + impl_->missed_.size();
}
std::uint64_t Session::writtenAgain() const { return impl_->authoring_.writtenAgain(); }
const std::optional<Welcome>& Session::welcome() const { return impl_->channel_.welcome(); }
const std::set<LayerId>& Session::projectLayers() const { return impl_->listed_.all(); }
const ClientId& Session::id() const { return impl_->options_.client; }
void Session::requestBlob(const Hash& hash) { impl_->downloads_.want(hash, true); }
std::set<Hash> Session::namedBlobs() const { return impl_->namedBlobs(); }

}  // namespace usdlive::client
