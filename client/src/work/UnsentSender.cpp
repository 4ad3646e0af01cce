// Sends the unsent transactions of an ended connection.
#include "work/UnsentSender.h"

#include <algorithm>

#include "basics/Clocks.h"
#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::client {

namespace {

constexpr std::size_t kMessages = 4096;
constexpr double kBudgetMs = 50;
// The journal is updated after this number of transactions. It is less than the number that a
// server remembers of a client (M9), so that none is committed twice if this process is killed.
constexpr std::size_t kBatch = 500;

}  // namespace

UnsentSender::UnsentSender(Connection& connection, Session::Options options, LeftJournal& journal,
                           BlobSource& blobs)
    : connection_(connection),
      journal_(journal),
      ownBlobs_(journal.blobFolder()),
      blobs_(blobs),
      client_(options.client),
      session_(std::move(options), *this, *this) {}

std::size_t UnsentSender::bulkBytes() { return connection_.bulkBytes(); }

SharedBytes UnsentSender::localBlob(const Hash& hash) {
    auto bytes = ownBlobs_.blob(hash);
    return bytes ? bytes : blobs_.blob(hash);
}

bool UnsentSender::holdsBlob(const Hash& hash) {
    return ownBlobs_.holds(hash) || blobs_.blob(hash) != nullptr;
}

Result<SentWork> UnsentSender::send(double timeoutMs) {
    end_ = Clock::now() + std::chrono::microseconds(std::int64_t(timeoutMs * 1000));
    for (const auto& [sequence, work] : journal_.works()) wanted_[work.revision] = work.hash;
    if (wanted_.empty()) return sent_;
    nextFree_ = journal_.works().rbegin()->first + 1;
    if (auto ready = waitFor("connecting", [this] { return session_.isConnected(); }); !ready)
        return tl::unexpected(ready.error());
    if (auto read = readLog(); !read) return tl::unexpected(read.error());
    if (auto opened = openLayers(); !opened) return tl::unexpected(opened.error());
    if (auto authored = authorAll(); !authored) return tl::unexpected(authored.error());
    return sent_;
}

Result<void> UnsentSender::waitFor(const char* what, const std::function<bool()>& done) {
    for (;;) {
        work();
        if (failure_) return tl::unexpected(*failure_);
        if (done()) return {};
        if (Clock::now() > end_)
            return fail(delay_ ? delay_->code : ErrorCode::NotConnected,
                        std::string("the time limit was reached while ") + what +
                            (delay_ ? ": " + delay_->message : std::string()) +
                            ". Unsent edits stay in " + journal_.summary().file);
        connection_.wait(std::chrono::milliseconds(5));
    }
}

void UnsentSender::work() {
    for (auto& happening : connection_.poll(kMessages)) {
        if (std::holds_alternative<Connection::Opened>(happening)) {
            open_ = true;
            session_.connected();
        } else if (auto* message = std::get_if<Connection::Message>(&happening)) {
            if (open_) session_.received(std::get<ReceivedMessage>(std::move(message->content)));
        } else if (auto* lost = std::get_if<Connection::Lost>(&happening)) {
            delay_ = lost->reason;
            if (std::exchange(open_, false))
                session_.disconnected(std::move(lost->reason), lost->unconfirmed);
        }
    }
    session_.advance(kBudgetMs, steadyMs());
    for (Event& event : session_.takeEvents()) take(event);
}

Error UnsentSender::stays(const Error& reason) const {
    return {reason.code, reason.message + ". Unsent edits stay in " + journal_.summary().file +
                             ": send them again later"};
}

void UnsentSender::take(Event& one) {
    if (auto* lost = std::get_if<event::Lost>(&one)) {
        done_.push_back(lost->work.sequence);
        lost_.push_back(std::move(lost->work));
    } else if (const auto* failed = std::get_if<event::JoinFailed>(&one)) {
        if (errorPasses(failed->reason.code))
            failure_ = stays(failed->reason);
        else
            missing_[failed->layer] = failed->reason;
    } else if (const auto* error = std::get_if<event::ServerError>(&one)) {
        const Error reason = toError(error->message);
        if (errorPasses(reason.code)) delay_ = reason;
        if (!error->message.closing) return;
        if (!session_.welcome()) failure_ = reason;
        if (!std::exchange(open_, false)) return;
        connection_.reset();
        session_.disconnected(reason);
    }
}

// Checks that the project's history contains the revisions of the transactions, and reads the later
// moves and deletes.
Result<void> UnsentSender::readLog() {
    const Revision first = wanted_.begin()->first, newest = session_.revision();
    const auto other = [this](const std::string& why) {
        return fail(
            ErrorCode::HistoryDiverged,
            why + ". Keep the edits as layers, or discard them: " + journal_.summary().file);
    };
    if (journal_.isOfOther(session_.welcome()->store.value_or(StoreId{})))  // ID3
        return other(
            "these edits were made in another project of the same name. Connect to that "
            "project to send them");
    if (wanted_.rbegin()->first > newest)
        return other("the project has not reached the revision at which these edits were made");
    if (const auto here = wanted_.find(newest); here != wanted_.end() &&
                                                here->second != session_.welcome()->hash &&
                                                session_.welcome()->revision == newest)
        return other("the project has another history than the one in which these edits were made");
    if (first == newest) return {};

    std::optional<Result<void>> read;
    bool same = true;
    session_.requestLog(
        first + 1, newest,
        [&](const Commit& commit) {
            const auto before = wanted_.find(commit.revision - 1);
            same = same && (before == wanted_.end() || before->second == commit.previous);
            note(commit);
        },
        [&](Result<void> done) { read = std::move(done); });
    if (auto waited = waitFor("reading the log", [&] { return read.has_value(); }); !waited)
        return waited;
    if (!*read && errorPasses(read->error().code)) return tl::unexpected(stays(read->error()));
    if (!*read) return other("the log since then cannot be read: " + read->error().message);
    if (!same)
        return other("the project has another history than the one in which these edits were made");
    return {};
}

void UnsentSender::note(const Commit& commit) {
    if (commit.id.client == client_) {
        committed_.insert(commit.id.sequence);
        return;
    }
    for (const Edit& edit : commit.edits)
        recordMove(moves_, commit.revision, commit.id.client, edit);
}

Result<void> UnsentSender::openLayers() {
    std::vector<LayerId> layers = journal_.summary().layers;
    for (const LayerId& layer : layers) session_.openLayer(layer);
    return waitFor("opening layers", [&] {
        return std::all_of(layers.begin(), layers.end(), [&](const LayerId& layer) {
            return session_.isJoined(layer) || missing_.contains(layer);
        });
    });
}

Result<void> UnsentSender::authorAll() {
    const auto works = journal_.works();
    std::size_t inBatch = 0;
    for (const auto& [sequence, work] : works) {
        if (committed_.contains(sequence)) {
            ++sent_.before;
            done_.push_back(sequence);
            continue;
        }
        author(work);
        ++sent_.committed;
        if (++inBatch < kBatch) continue;
        inBatch = 0;
        if (auto finished = finishBatch(); !finished) return finished;
    }
    if (auto finished = finishBatch(); !finished) return finished;
    const std::size_t refused = std::size_t(std::count_if(
        lost_.begin(), lost_.end(), [](const LostWork& lost) { return lost.refused; }));
    sent_.committed -= std::min(refused, sent_.committed);
    return {};
}

Result<void> UnsentSender::finishBatch() {
    auto waited = waitFor("sending", [this] { return session_.pendingTransactions() == 0; });
    const auto noted = journal_.answered(std::exchange(done_, {}));
    if (!waited) return waited;
    return noted;
}

void UnsentSender::author(const JournaledWork& work) {
    LostWork lost;
    lost.sequence = work.sequence;
    std::vector<AuthoredEdit> edits;
    for (const AuthoredEdit& edit : work.edits) {
        auto now = carried(edit, work.revision);
        if (now) {
            edits.push_back(std::move(*now));
            continue;
        }
        if (lost.edits.empty()) lost.reason = now.error();
        lost.edits.push_back(edit);
    }
    if (!lost.edits.empty()) {
        lost.refused = edits.empty();
        lost_.push_back(std::move(lost));
    }
    if (edits.empty()) {
        done_.push_back(work.sequence);
        return;
    }
    session_.setNextSequence(work.sequence);
    session_.author(std::move(edits));
    session_.setNextSequence(nextFree_);
}

// If the server refuses a transaction for a reason that can be corrected, the session sends it
// again with another number. The journal must contain that number before.
void UnsentSender::pending(const PendingWork& work) {
    if (work.sequence < nextFree_) return;
    nextFree_ = work.sequence + 1;
    JournaledWork renumbered{work.sequence, wallClockMs(), work.revision,
                             work.hash,     work.store,    work.edits};
    const auto noted = journal_.answered(std::exchange(done_, {}), std::move(renumbered));
    if (!noted) failure_ = noted.error();
}

// Returns the edit with the present path of its spec.
Result<AuthoredEdit> UnsentSender::carried(const AuthoredEdit& edit, Revision since) const {
    if (const auto missing = missing_.find(edit.layer); missing != missing_.end())
        return tl::unexpected(missing->second);
    const auto gone = [&](const std::string& path) {
        return fail(ErrorCode::SpecDeleted,
                    edit.layer.value + " <" + path + "> was deleted by somebody else meanwhile");
    };
    const auto path = moves_.translate(edit.layer, edit.path, since);
    if (!path) return gone(edit.path);
    AuthoredEdit now{edit.layer, *path, edit.action};
    if (auto* move = std::get_if<MoveSpec>(&now.action)) {
        const auto parent = moves_.translate(edit.layer, move->parent.path, since);
        if (!parent) return gone(move->parent.path);
        move->parent.path = *parent;
    }
    return now;
}

}  // namespace usdlive::client
