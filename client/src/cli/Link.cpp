// A session of the command line tool with a server.
#include "cli/Link.h"

#include <chrono>
#include <iostream>
#include <optional>
#include <set>

#include "cli/ProgressBar.h"
#include "cli/Text.h"
#include "usdlive/common/core/ClientSecret.h"

namespace usdlive::cli {

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::size_t kMessagesPerStep = 4096;
constexpr double kBudgetMs = 1000;
// The pause after which more of a file is sent, if nothing is received.
constexpr milliseconds kUploadPause{2};

client::Session::Options sessionOptions(UserName user) {
    client::Session::Options options;
    options.secret = newClientSecret();
    options.client = clientIdOf(*options.secret);
    options.user = std::move(user);
    options.application = "usdlive command line";
    std::erase(options.features, "conflation");  // because every commit is printed
    return options;
}

std::int64_t nowMs() {
    return std::chrono::duration_cast<milliseconds>(Clock::now().time_since_epoch()).count();
}

std::optional<client::event::Progress> progressOf(const client::Event& event) {
    if (const auto* progress = std::get_if<client::event::Progress>(&event)) return *progress;
    const auto* joining = std::get_if<client::event::Joining>(&event);
    if (!joining) return std::nullopt;
    return client::event::Progress{client::event::Progress::Task::Fetch, joining->progress.layer,
                                   joining->progress.specs, joining->progress.specsTotal, 0};
}

const ErrorMessage* closingError(const std::vector<client::Event>& events) {
    for (const auto& event : events)
        if (const auto* error = std::get_if<client::event::ServerError>(&event);
            error && error->message.closing)
            return &error->message;
    return nullptr;
}

}  // namespace

Link::Link(std::unique_ptr<client::Connection> connection, UserName user)
    : connection_(std::move(connection)),
      session_(std::make_unique<client::Session>(sessionOptions(std::move(user)), *this, *this)) {}

Result<std::unique_ptr<Link>> Link::connect(const client::ServerAddress& server, UserName user,
                                            double timeoutMs) {
    auto connection = client::createConnection(server);
    if (!connection) return tl::unexpected(connection.error());
    std::unique_ptr<Link> link(new Link(std::move(*connection), std::move(user)));
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(timeoutMs);
    while (!link->session().isConnected()) {
        const auto events = link->step();
        if (!events) return tl::unexpected(events.error());
        if (Clock::now() > end)
            return fail(ErrorCode::NotConnected, "no answer from " + server.url());
    }
    return link;
}

Result<std::vector<client::Event>> Link::step() {
    connection_->wait(uploads_ ? kUploadPause : milliseconds(100));
    std::optional<Error> lost;
    for (auto& happening : connection_->poll(kMessagesPerStep)) {
        if (std::holds_alternative<client::Connection::Opened>(happening)) {
            open_ = true;
            session_->connected();
        } else if (auto* gone = std::get_if<client::Connection::Lost>(&happening)) {
            lost = gone->reason;
            if (std::exchange(open_, false)) session_->disconnected(gone->reason);
        } else if (auto* message = std::get_if<client::Connection::Message>(&happening); open_) {
            session_->received(std::get<client::ReceivedMessage>(std::move(message->content)));
        }
    }
    while (!session_->advance(kBudgetMs, nowMs())) {
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

Result<void> Link::run(const std::function<bool(const std::vector<client::Event>&)>& done) {
    ProgressBar bar(std::cerr, Clock::now());
    std::optional<client::event::Progress> last;
    for (;;) {
        const auto events = step();
        if (!events) return tl::unexpected(events.error());
        if (showsProgress_) {
            for (const auto& one : *events)
                if (auto progress = progressOf(one)) last = std::move(progress);
            if (last) bar.show(describe(*last), last->done, last->total, Clock::now());
        }
        if (done(*events)) return {};
    }
}

Result<void> Link::upload(const std::string& file, const std::string& path, bool overwrite) {
    auto& uploads = uploads_.emplace(*session_, *this);
    static_cast<void>(uploads.add(file, path, overwrite));
    std::vector<client::FileUploads::Ended> ended;
    ProgressBar bar(std::cerr, Clock::now());
    const auto ran = run([&](const std::vector<client::Event>& events) {
        for (const auto& one : events) static_cast<void>(uploads.note(one));
        uploads.advance();
        if (const auto progress = uploads.progress(nowMs()); progress && showsProgress_)
            bar.show(describe(*progress), progress->done, progress->total, Clock::now());
        ended = uploads.takeEnded();
        return !ended.empty();
    });
    uploads_.reset();
    if (ended.empty())
        return fail(ran.error().code,
                    file + " was not uploaded: " + ran.error().message +
                        ". The project has the whole file or none of it: upload it again");
    return std::move(ended.front().outcome);
}

Result<std::vector<Commit>> Link::readLog(Revision from, Revision to) {
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

Result<client::HistoryReader::Content> Link::readLayer(const LayerId& layer, Revision revision) {
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

Result<void> Link::fetchBlobs(const LayerDoc& doc) {
    std::set<Hash> named;
    forEachBlob(doc, [&](const Value& blob) { named.insert(blob.hash()); });
    return fetchBlobs(std::move(named), true);
}

Result<void> Link::fetchBlobs(const Commit& commit) {
    std::set<Hash> named;
    for (const Edit& edit : commit.edits)
        forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    return fetchBlobs(std::move(named), false);
}

// `all`: a value that the server does not have is an error.
Result<void> Link::fetchBlobs(std::set<Hash> missing, bool all) {
    std::erase_if(missing, [this](const Hash& hash) { return blobs_.contains(hash); });
    if (missing.empty()) return {};
    for (const auto& hash : missing) session_->requestBlob(hash);
    std::optional<Error> error;
    const auto ran = run([&](const std::vector<client::Event>& events) {
        for (const auto& event : events) {
            const auto* failed = std::get_if<client::event::ServerError>(&event);
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

SharedBytes Link::blob(const Hash& hash) {
    const auto found = blobs_.find(hash);
    if (found != blobs_.end()) return found->second;
    return lender_ ? lender_->blob(hash) : nullptr;
}

void Link::send(SharedBytes frames) { connection_->send(std::move(frames)); }

void Link::blobArrived(const Hash& hash, SharedBytes bytes, bool) {
    blobs_[hash] = std::move(bytes);
}

}  // namespace usdlive::cli
