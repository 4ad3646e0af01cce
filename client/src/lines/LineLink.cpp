// A session with one line of history, without an editor.
#include "lines/LineLink.h"

#include <chrono>
#include <optional>
#include <set>

#include "usdlive/common/core/ClientSecret.h"

namespace usdlive::client {

namespace {

using LinkClock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::size_t kMessagesPerLinkStep = 4096;
constexpr double kLinkBudgetMs = 1000;
// The pause after which more of a file is sent, if nothing is received.
constexpr milliseconds kLinkUploadPause{2};

Session::Options linkOptions(UserName user) {
    Session::Options options;
    options.secret = newClientSecret();
    options.client = clientIdOf(*options.secret);
    options.user = std::move(user);
    options.application = "usdlive command line";
    std::erase(options.features, "conflation");  // because every commit is read
    return options;
}

std::int64_t linkNowMs() {
    return std::chrono::duration_cast<milliseconds>(LinkClock::now().time_since_epoch()).count();
}

const ErrorMessage* closingError(const std::vector<Event>& events) {
    for (const auto& event : events)
        if (const auto* error = std::get_if<event::ServerError>(&event);
            error && error->message.closing)
            return &error->message;
    return nullptr;
}

}  // namespace

LineLink::LineLink(std::unique_ptr<Connection> connection, UserName user)
    : connection_(std::move(connection)),
      session_(std::make_unique<Session>(linkOptions(std::move(user)), *this, *this)) {}

Result<std::unique_ptr<LineLink>> LineLink::connect(const ServerAddress& server, UserName user,
                                                    double timeoutMs) {
    auto connection = createConnection(server);
    if (!connection) return tl::unexpected(connection.error());
    std::unique_ptr<LineLink> link(new LineLink(std::move(*connection), std::move(user)));
    if (auto done = link->waitForWelcome(server, timeoutMs); !done)
        return tl::unexpected(done.error());
    return link;
}

Result<void> LineLink::waitForWelcome(const ServerAddress& server, double timeoutMs) {
    const auto end = LinkClock::now() + std::chrono::duration<double, std::milli>(timeoutMs);
    while (!session_->isConnected()) {
        const auto events = step();
        if (!events) return tl::unexpected(events.error());
        if (LinkClock::now() > end)
            return fail(ErrorCode::NotConnected, "no answer from " + server.url());
    }
    return {};
}

Result<std::vector<Event>> LineLink::step() {
    connection_->wait(uploads_ ? kLinkUploadPause : milliseconds(100));
    std::optional<Error> lost;
    for (auto& happening : connection_->poll(kMessagesPerLinkStep)) {
        if (std::holds_alternative<Connection::Opened>(happening)) {
            open_ = true;
            session_->connected();
        } else if (auto* gone = std::get_if<Connection::Lost>(&happening)) {
            lost = gone->reason;
            if (std::exchange(open_, false)) session_->disconnected(gone->reason);
        } else if (auto* message = std::get_if<Connection::Message>(&happening); open_) {
            session_->received(std::get<ReceivedMessage>(std::move(message->content)));
        }
    }
    while (!session_->advance(kLinkBudgetMs, linkNowMs())) {
    }
    auto events = session_->takeEvents();
    // An error that the server sent before closing explains more than the loss itself.
    if (const auto* error = closingError(events)) lost = toError(*error);
    if (!lost) return events;
    if (std::exchange(open_, false)) {
        session_->disconnected(*lost);
        connection_->reset();
    }
    return tl::unexpected(*lost);
}

Result<void> LineLink::run(const std::function<bool(const std::vector<Event>&)>& done) {
    for (;;) {
        const auto events = step();
        if (!events) return tl::unexpected(events.error());
        if (done(*events)) return {};
    }
}

Result<std::vector<Commit>> LineLink::readLog(Revision from, Revision to) {
    std::vector<Commit> commits;
    std::optional<Result<void>> done;
    session_->requestLog(
        from, to, [&](const Commit& commit) { commits.push_back(commit); },
        [&](Result<void> result) { done = std::move(result); });
    const auto ran = run([&](const auto&) { return done.has_value(); });
    if (!ran && (!done || !*done)) return tl::unexpected(ran.error());
    if (!*done) return tl::unexpected(done->error());
    return commits;
}

Result<HistoryReader::Content> LineLink::readLayer(const LayerId& layer, Revision revision) {
    std::optional<Result<Content>> answer;
    session_->peek(layer, revision, [&](Result<LayerDoc> doc, Revision at) {
        if (doc)
            answer = Content{*std::move(doc), at};
        else
            answer = tl::unexpected(doc.error());
    });
    const auto ran = run([&](const auto&) { return answer.has_value(); });
    if (!ran && !answer) return tl::unexpected(ran.error());
    return std::move(*answer);
}

Result<void> LineLink::fetchBlobs(const LayerDoc& doc) {
    std::set<Hash> named;
    forEachBlob(doc, [&](const Value& blob) { named.insert(blob.hash()); });
    return fetchBlobs(std::move(named), true);
}

Result<void> LineLink::fetchBlobs(const Commit& commit) {
    std::set<Hash> named;
    for (const Edit& edit : commit.edits)
        forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    return fetchBlobs(std::move(named), false);
}

// `all`: a value that the server does not have is an error.
Result<void> LineLink::fetchBlobs(std::set<Hash> missing, bool all) {
    std::erase_if(missing, [this](const Hash& hash) { return blobs_.contains(hash); });
    if (missing.empty()) return {};
    for (const auto& hash : missing) session_->requestBlob(hash);
    std::optional<Error> error;
    const auto ran = run([&](const std::vector<Event>& events) {
        for (const auto& event : events) {
            const auto* failed = std::get_if<event::ServerError>(&event);
            if (!failed || !failed->message.blob) continue;
            missing.erase(*failed->message.blob);
            if (all) error = toError(failed->message);
        }
        std::erase_if(missing, [this](const Hash& hash) { return blobs_.contains(hash); });
        return missing.empty() || error;
    });
    if (!ran) return ran;
    if (error) return tl::unexpected(*error);
    return {};
}

SharedBytes LineLink::blob(const Hash& hash) {
    const auto found = blobs_.find(hash);
    if (found != blobs_.end()) return found->second;
    return lender_ ? lender_->blob(hash) : nullptr;
}

void LineLink::send(SharedBytes frames) { connection_->send(std::move(frames)); }

void LineLink::blobArrived(const Hash& hash, SharedBytes bytes, bool) {
    blobs_[hash] = std::move(bytes);
}

}  // namespace usdlive::client
