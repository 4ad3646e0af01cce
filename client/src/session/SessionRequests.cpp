// The requests of a session and what ends them; layers and commits of the past that arrive for
// them.
#include <algorithm>

#include "session/SessionImpl.h"
#include "usdlive/common/core/ErrorPasses.h"
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client {

namespace {

constexpr std::int64_t kAskAgainMs = 1000;
constexpr std::size_t kJoinsAtOnce = 1'000;

}  // namespace

std::uint64_t Session::Impl::request(AnyRequest request) {
    return std::visit([this](auto& each) { return sendRequest(each); }, request);
}

template <class Request>
std::uint64_t Session::Impl::sendRequest(Request& request) {
    request.request = requests_.nextNumber();
    auto refused = whyNot(request.request, Request::kType, featureOf<Request>());
    // The server would end the session over a request that it cannot read.
    auto control = encodeChecked(request);
    if (!control && !refused)
        refused = PendingRequests::errorOf(request.request, control.error().code,
                                           "the request '" + std::string(Request::kType) +
                                               "' is not valid: " + control.error().message);
    if (refused) {
        events_.push_back(event::ServerError{*std::move(refused)});
        return request.request;
    }
    requests_.add(request, [this](auto outcome) {
        if (outcome)
            events_.push_back(event::Answered<Request>{std::move(*outcome)});
        else
            events_.push_back(event::ServerError{std::move(outcome.error())});
    });
    sendJson(std::move(*control));
    return request.request;
}

// A server of an earlier version would end the session over a message that it does not know.
std::optional<ErrorMessage> Session::Impl::whyNot(std::uint64_t number, std::string_view type,
                                                  std::string_view feature) const {
    const std::string request = "the request '" + std::string(type) + "'";
    if (!online_)
        return PendingRequests::errorOf(number, ErrorCode::NotConnected,
                                        request + " needs a connection, and there is none");
    if (!feature.empty() && std::ranges::count(welcome_->features, feature) == 0)
        return PendingRequests::errorOf(
            number, ErrorCode::UnsupportedProtocol,
            "the server is of an earlier version, which does not know " + request + ": update it");
    return std::nullopt;
}

void Session::Impl::on(const ErrorMessage& message) {
    if (message.request && requests_.end(*message.request, tl::unexpected(message))) return;
    const Error error = toError(message);
    if (error.code == ErrorCode::ClientForgotten && !online_) {
        forgotten_ = error;
        if (diverged_) return;
    }
    if (message.closing) noteRefusedPresence(error.code);
    const bool differs =
        error.code == ErrorCode::HistoryDiverged || error.code == ErrorCode::FutureRevision;
    if (differs && !online_ && !message.closing) {
        diverged_ = true;  // reported when the welcome has come
        return;
    }
    if (message.blob) {
        if (downloads_.isAsked(*message.blob)) return blobFailed(*message.blob, error);
        uploads_.refused(*message.blob, error.code, nowMs_);
    }
    events_.push_back(event::ServerError{message});
}

void Session::Impl::on(const RequestProgress& message) {
    using Task = event::Progress::Task;
    if (message.task != "import" && message.task != "save") return;
    const Task task = message.task == "save" ? Task::Save : Task::Import;
    events_.push_back(
        event::Progress{task, message.layer, message.done, message.total, message.request});
}

// ---- a layer's content

Joining* Session::Impl::joiningOf(const LayerId& layer) {
    const auto opened = layers_.find(layer);
    return opened != layers_.end() && opened->second.joining ? &*opened->second.joining : nullptr;
}

Joining* Session::Impl::joiningOf(std::uint64_t request) {
    const auto join = joins_.find(request);
    return join == joins_.end() ? nullptr : joiningOf(join->second);
}

void Session::Impl::join(const LayerId& layer) {
    toJoin_.push_back(layer);
    sendJoins();
}

// A server keeps requests until they are answered, so it does not get those of all layers at once.
void Session::Impl::sendJoins() {
    while (!toJoin_.empty() && joins_.size() < kJoinsAtOnce) {
        const OpenLayer open{requests_.nextNumber(), std::move(toJoin_.front()), 0};
        toJoin_.pop_front();
        Joining* joining = joiningOf(open.layer);
        if (!joining || joining->snapshot.request != 0) continue;
        joining->snapshot = {open.request, {}, {}};
        joins_.emplace(open.request, open.layer);
        requests_.add(open, [this, open](const auto& outcome) {
            if (!outcome) joinFailed(open, outcome.error());
        });
        sendControl(open);
    }
}

// Drops what has arrived of layers that are being joined.
void Session::Impl::restartJoins() {
    for (auto& [layer, opened] : layers_)
        if (opened.joining) opened.restart();
    joins_.clear();
    toJoin_.clear();
    joinAgainAt_.clear();
}

void Session::Impl::joinFailed(const OpenLayer& open, const ErrorMessage& message) {
    if (joins_.erase(open.request) == 0) return;  // requested again, or closed
    const auto entry = layers_.find(open.layer);
    const Error error = toError(message);
    if (entry->second.joining->again && errorPasses(error.code)) {
        // Own work may wait for this layer.
        entry->second.restart();
        joinAgainAt_[open.layer] = nowMs_ + kAskAgainMs;
        events_.push_back(event::ServerError{message});
    } else {
        if (entry->second.wanted) events_.push_back(event::JoinFailed{entry->first, error});
        if (frozen_) frozen_->views.erase(entry->first);
        closed_.erase(entry->first);
        layers_.erase(entry);
    }
    sendJoins();
}

// Requests again what the server could not read.
void Session::Impl::joinAgain() {
    for (auto entry = joinAgainAt_.begin(); entry != joinAgainAt_.end();) {
        if (entry->second <= nowMs_) toJoin_.push_back(entry->first);
        entry = entry->second <= nowMs_ ? joinAgainAt_.erase(entry) : std::next(entry);
    }
    sendJoins();
}

void Session::Impl::peek(const LayerId& layer, Revision revision,
                         std::function<void(Result<LayerDoc>, Revision)> done) {
    const LayerDoc* here = revision == 0 && online_ && isCaughtUp() ? confirmed(layer) : nullptr;
    if (here) return done(*here, revision_);
    const OpenLayer open{requests_.nextNumber(), layer, revision};
    if (const auto refused = whyNot(open.request, open.kType, {}))
        return done(tl::unexpected(toError(*refused)), 0);
    peeks_.push_back({layer, revision, {open.request, {}, {}}, std::move(done)});
    requests_.add(open, [this, open](const auto& outcome) {
        const auto peek = std::ranges::find(peeks_, open.request,
                                            [](const Peek& one) { return one.snapshot.request; });
        if (outcome || peek == peeks_.end()) return;
        const auto failed = std::move(peek->done);
        peeks_.erase(peek);
        failed(tl::unexpected(toError(outcome.error())), 0);
    });
    sendControl(open);
}

void Session::Impl::completePeeks() {
    for (std::size_t index = 0; index < peeks_.size();) {
        Incoming& snapshot = peeks_[index].snapshot;
        if (!snapshot.content || !snapshot.opened) {
            ++index;
            continue;
        }
        Peek peek = std::move(peeks_[index]);
        peeks_.erase(peeks_.begin() + std::ptrdiff_t(index));
        requests_.forget(peek.snapshot.request);
        if (peek.revision == 0 && online_ && !layers_.contains(peek.layer))
            sendControl(CloseLayer{peek.layer});
        peek.done(std::move(*peek.snapshot.content), peek.snapshot.opened->revision);
    }
}

void Session::Impl::on(const LayerOpened& message) {
    if (Joining* joining = joiningOf(message.request)) joining->snapshot.opened = message;
    for (Peek& peek : peeks_)
        if (peek.snapshot.request == message.request) peek.snapshot.opened = message;
}

void Session::Impl::handle(ReceivedSnapshot&& received) {
    if (Joining* joining = joiningOf(received.request)) {
        const LayerId& layer = joins_.at(received.request);
        Incoming& snapshot = joining->snapshot;
        snapshot.content = std::move(received.whole);
        if (closed_.contains(layer)) return;
        editor_.arriving(layer, std::move(received.part));
        const std::uint64_t total = snapshot.opened ? snapshot.opened->specs : 0;
        events_.push_back(event::Joining{{layer, received.specs, total}});
        return;
    }
    for (Peek& peek : peeks_) {
        if (peek.snapshot.request != received.request) continue;
        peek.snapshot.content = std::move(received.whole);
        const std::uint64_t total = peek.snapshot.opened ? peek.snapshot.opened->specs : 0;
        events_.push_back(event::Progress{event::Progress::Task::Fetch, peek.layer, received.specs,
                                          total, received.request});
    }
}

// ---- commits of the past

void Session::Impl::requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                               std::function<void(Result<void>)> done) {
    const RequestLog log{requests_.nextNumber(), from, to};
    if (const auto refused = whyNot(log.request, log.kType, {}))
        return done(tl::unexpected(toError(*refused)));
    logs_.push_back({log.request, false, std::move(each)});
    requests_.add(log, [this, log, done = std::move(done)](const auto& outcome) {
        std::erase_if(logs_, [&](const LogReader& one) { return one.request == log.request; });
        if (outcome)
            done({});
        else
            done(tl::unexpected(toError(outcome.error())));
    });
    sendControl(log);
}

void Session::Impl::on(const LogBegin& message) {
    if (!logs_.empty() && logs_.front().request == message.request) logs_.front().begun = true;
}

// If the commit was missed because the history was replaced, the layers that were joined again
// contain its edits, and only the commit itself names the dropped ones (M12). Otherwise the commit
// is still to be received.
void Session::Impl::on(const AlreadyCommitted& message) {
    if (message.revision > revision_) return;
    auto pending = pending_.take(message.sequence);
    if (!pending) return;
    held_.reset();
    restartPrediction();
    missed_.push_back({message.revision, std::move(*pending)});
    readMissed();
}

// A server reads a few logs at once for a client, and there may be many of these.
void Session::Impl::readMissed() {
    constexpr std::ptrdiff_t kAtOnce = 8;
    auto asked = std::ranges::count(missed_, true, &Missed::asked);
    for (std::size_t index = 0; index < missed_.size() && asked < kAtOnce; ++index) {
        if (missed_[index].asked) continue;
        missed_[index].asked = true;
        ++asked;
        readMissed(missed_[index]);
    }
}

void Session::Impl::readMissed(const Missed& missed) {
    const std::uint64_t sequence = missed.pending.transaction.id.sequence;
    const auto found = [this, sequence] {
        return std::find_if(missed_.begin(), missed_.end(), [&](const Missed& other) {
            return other.pending.transaction.id.sequence == sequence;
        });
    };
    const auto each = [this, found](const Commit& commit) {
        const auto entry = found();
        if (entry == missed_.end() || commit.id != entry->pending.transaction.id) return;
        if (!commit.dropped.empty()) reportDropped(entry->pending, commit);
        missed_.erase(entry);
        events_.push_back(event::Committed{commit, true});
        readMissed();
    };
    const auto done = [this, found](const Result<void>& read) {
        const auto entry = found();
        if (!online_ || entry == missed_.end()) return;  // asked again, or answered
        events_.push_back(
            event::Lost{{.sequence = entry->pending.transaction.id.sequence,
                         .gesture = entry->pending.transaction.gesture,
                         .reason = {read ? ErrorCode::HistoryDiverged : read.error().code,
                                    "it was committed in a history that cannot be read any more"},
                         .refused = false,
                         .edits = std::move(entry->pending.authored)}});
        missed_.erase(entry);
        readMissed();
    };
    requestLog(missed.revision, missed.revision, each, done);
}

}  // namespace usdlive::client
