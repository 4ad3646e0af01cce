// Runs one project: its ports, its periodic work and its restart after a fault.
#include "app/ProjectRuntime.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <thread>
#include <utility>

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kGoodbyeTime{2'000};
constexpr milliseconds kRetryPause{1'000};
// The pause between scans for new or changed files, and the share of time that scans may take.
constexpr milliseconds kScanPause{1'000};
constexpr int kScanPart = 20;
// The store remembers the transactions of this many clients (M14). The others are forgotten after
// this pause.
constexpr std::size_t kKnownClients = 20'000;
constexpr milliseconds kForgetPause{10 * 60'000};
// The pause between measurements of the free space.
constexpr milliseconds kSpacePause{500};
// The pause between looks at the access rules.
constexpr milliseconds kRulesPause{200}, kCopyPause{200};
// The pause between looks for sign-ins that have ended (AC23).
constexpr milliseconds kSignInsPause{250};
// Nobody's messages are handled while more than this waits for the store, and those of a party that
// works more than others only while at most this does (SE23).
constexpr std::size_t kFullStoreBytes = 8 * 1024 * 1024;
constexpr std::size_t kFreeStoreBytes = 16 * 1024;
// A worker's time is a part of the machine's, and takes nothing from the strand if there is another
// processor.
const unsigned kProcessors = std::max(1u, std::thread::hardware_concurrency());
// The pause between searches for commits that are too old.
constexpr milliseconds kHistoryPause{60 * 60 * 1'000};

}  // namespace

ProjectRuntime::ProjectRuntime(asio::io_context& network, WorkerShares& workers, SharedStore& store,
                               StorageThread& storage, BlobStore& blobs, ProjectFiles files,
                               milliseconds keepUnusedBlobs, Metrics& metrics, ports::Clock& clock,
                               ActivityLog activity, Log& log)
    : network_(network),
      workers_(workers),
      store_(store),
      storage_(storage),
      place_(std::move(files.place)),
      list_(std::move(files.list)),
      metrics_(metrics),
      clock_(clock),
      log_(log),
      work_(network,
            {[this](SessionId session, ByteView frames) { handle(session, frames); },
             [this](SessionId session, bool reading) {
                 transports_.of(session).setReading(session, reading);
             },
             [this](SessionId session) { return partyOf(session); }, [this] { return storeRoom(); },
             [this](SessionId session, const std::exception& fault) {
                 log_.write(LogLevel::Error, "session met a fault",
                            {{"session", session}, {"error", fault.what()}});
                 transports_.of(session).close(
                     session,
                     Error{ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))});
             }}),
      intake_({[this](SessionId session, bool held) { work_.setHeld(session, held); },
               [this](SessionId session, std::chrono::nanoseconds time) {
                   work_.spent(session, time / kProcessors);
               }}),
      // Called for a bug outside a session's message. The project is created again from its store.
      strand_(network, intake_,
              [this](const std::exception& fault) {
                  log_.write(LogLevel::Error, "project met a fault", {{"error", fault.what()}});
                  startAgain();
              }),
      outbox_(transports_),
      history_(strand_, intake_, workers, store, storage, place_.history() / "blobs", log),
      blobs_(strand_, workers, transports_, blobs, files.texts),
      files_(strand_, workers, files.layers, files.assets, blobs, store, log),
      activity_(std::move(activity)),
      rulesFile_(place_.folder),
      rulesFollower_(
          network, workers.files, rulesFile_, kRulesPause,
          [this](const std::string& stamp, Result<std::optional<AccessRules>> read) {
              if (!read)
                  log_.write(LogLevel::Error, "access rules stay as they were",
                             {{"error", read.error().message}});
              else if (*read)
                  takeRules(stamp, std::move(**read));
          },
          [this] {
              log_.write(LogLevel::Warning,
                         "the access rules are gone and stay in force; to end them, write rules "
                         "without entries",
                         {{"file", rulesFile_.path().string()}});
          }),
      copies_(network, workers.history, StoreCopyFile(place_.history()), kCopyPause,
              [this](const std::string&, const std::optional<std::string>& name) {
                  if (name) copyStore(*name);
              }),
      retryTimer_(network),
      scanTimer_(network),
      sweepTimer_(network),
      clientsTimer_(network),
      historyTimer_(network),
      spaceTimer_(network),
      signInsTimer_(network),
      collector_(network, *workers.history, store, blobs, keepUnusedBlobs, log) {}

Result<void> ProjectRuntime::start(ProjectSetup setup) {
    setup_ = std::move(setup);
    auto beginning = setup_.read();
    if (!beginning) return tl::unexpected(beginning.error());
    hasSpace_ = beginning->store.hasSpace;
    const auto rulesStamp = rulesFile_.stamp();
    if (rulesStamp) confirmRules(*rulesStamp);
    auto rules = rulesFile_.read();
    if (!rules) return tl::unexpected(rules.error());
    rulesFollower_.start(rulesStamp);
    const StoreCopyFile copies(place_.history());
    copies.removeCopies();
    copies_.start(copies.stamp());
    if (*rules) rules_ = std::make_shared<const AccessRules>(std::move(**rules));
    makeProject(std::move(*beginning));
    storage_.start({
        .appended =
            [this](Revision upTo) {
                strand_.post([this, upTo](Project& project) {
                    history_.appended(upTo);
                    project.appended(upTo);
                    work_.storeChanged();
                });
            },
        .failed =
            [this](Error error, CommitStore::Head head) {
                strand_.post([this, error = std::move(error), head](Project& project) {
                    if (!storage_.resume()) return;  // the project was created again meanwhile
                    history_.dropped();
                    project.appendFailed(error, head);
                    work_.storeChanged();
                });
            },
        .closed = [this] { strand_.post([](Project& project) { project.storeClosed(); }); },
        .measured = [this](std::size_t commits,
                           std::chrono::nanoseconds time) { metrics_.appended(commits, time); },
    });
    return {};
}

void ProjectRuntime::serve() {
    scanFilesIn(kScanPause);
    forgetClientsIn(kForgetPause);
    collector_.start([this](const std::vector<Hash>& unnamed, Revision upTo, std::int64_t nowMs) {
        std::vector<Hash> unused;
        strand_.use([&](Project& project) { unused = project.unusedBlobs(unnamed, upTo, nowMs); });
        return unused;
    });
    boundHistoryIn(milliseconds(0));
    lookForSpaceIn(milliseconds(0));
}

void ProjectRuntime::stop(std::function<void()> done) {
    history_.stop();
    // First waits for the commits that are being stored, so that their authors get the
    // acknowledgement before the session closes.
    storage_.flush([this, done = std::move(done)]() mutable {
        asio::post(network_, [this, done = std::move(done)]() mutable {
            const Error why{ErrorCode::ShuttingDown,
                            std::string(errorText(ErrorCode::ShuttingDown))};
            const auto left = std::make_shared<std::size_t>(0);
            transports_.forEach([&](Transport& transport) {
                ++*left;
                transport.stop(why, kGoodbyeTime, [left, done] {
                    if (--*left == 0) done();
                });
            });
        });
    });
}

ProjectHealth ProjectRuntime::health() const {
    const Project* project = strand_.project();
    if (!project) return {"starting"};
    return {hasSpace_ ? "ok" : "storageFull", project->durableRevision(), project->sessionCount(),
            project->users()};
}

std::shared_ptr<const MetricFamilies> ProjectRuntime::metrics() const {
    Figures figures;
    transports_.forEach([&](const Transport& transport) {
        figures.transports.emplace_back(nameOf(transport.carrier()), transport.counters());
    });
    figures.appendQueueBytes = intake_.storeBytes();
    figures.storageHasSpace = hasSpace_;
    figures.removedBlobs = collector_.removed();
    std::error_code ignored;
    figures.storageFreeBytes = std::filesystem::space(place_.folder, ignored).available;
    if (const Project* project = strand_.project()) {
        figures.project = project->counters();
        figures.sessions = project->sessionCount();
        figures.durableRevision = project->durableRevision();
    }
    return metrics_.collect(figures);
}

void ProjectRuntime::opened(SessionId session, const std::optional<SignedIn>& user) {
    Project* const project = strand_.project();
    if (!project)
        return transports_.of(session).close(session, Error{ErrorCode::Internal, "starting again"});
    auto present = user;
    // DD17: keys without a partition of their own prove that somebody may take part, not who it is.
    if (present && present->token == kByCertificate && present->user.value.empty()) {
        if (roleOf_)
            return transports_.of(session).close(
                session,
                Error{ErrorCode::SignInRequired,
                      "the permissions of this certificate name no user: they must let it write "
                      "usdlive_Submit in the partition usdlive/*/as/NAME only. "
                      "server/tools/dds-keys makes such keys"});
        present.reset();
    }
    if (present && present->token == kByCertificate && !roleOf_ &&
        setup_.options.administrators.contains(present->user))
        present->role = Role::Admin;
    if (present && roleOf_) present->role = roleOf_(*present);  // it may have changed meanwhile
    if (present && present->role == Role::None)
        return transports_.of(session).close(
            session, Error{ErrorCode::SignInRequired,
                           "the access of " + present->user.value + " to this project was ended"});
    const bool willEnd = present && present->end();
    project->connected(session, std::move(present), transports_.of(session).addressOf(session));
    if (willEnd && !std::exchange(watchesSignIns_, true)) endSignInsIn(kSignInsPause);
}

void ProjectRuntime::endSignInsIn(milliseconds pause) {
    signInsTimer_.expires_after(pause);
    signInsTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        strand_.use([this](Project& project) {
            watchesSignIns_ = project.endSignIns(clock_.wallClockMs() / 1'000);
        });
        if (watchesSignIns_) endSignInsIn(kSignInsPause);
    });
}

void ProjectRuntime::takeRules(const std::string& stamp, AccessRules rules) {
    rules_ = std::make_shared<const AccessRules>(std::move(rules));
    activity_.record({"access rules changed",
                      UserName(),
                      {},
                      "rules: " + std::to_string(rules_->rules().size())});
    strand_.use([this](Project& project) { project.setRules(rules_); });
    workers_.files->post([this, stamp] { confirmRules(stamp); });
}

/// The main line answers the command that has written the rules.
void ProjectRuntime::confirmRules(const std::string& stamp) const {
    if (!place_.isLiveSession()) rulesFile_.writeTaken(stamp);
}

/// The commits that were acknowledged before this are in the copy.
void ProjectRuntime::copyStore(const std::string& name) {
    workers_.history->post([this, name, file = StoreCopyFile(place_.history())] {
        const auto made =
            store_.use([&](CommitStore& store) { return store.copyTo(file.copy(name)); });
        file.writeAnswer(name, made);
        log_.write(made ? LogLevel::Info : LogLevel::Warning,
                   made ? "store copied" : "store not copied",
                   {{"error", made ? std::string() : made.error().message}});
    });
}

void ProjectRuntime::rolesChanged(const std::function<Role(const SignedIn&)>& roleOf) {
    roleOf_ = roleOf;
    strand_.use([&](Project& project) { project.rolesChanged(roleOf); });
}

void ProjectRuntime::received(SessionId session, ByteView message) {
    work_.received(session, message);
}

void ProjectRuntime::handle(SessionId session, ByteView frames) {
    Project* const project = strand_.project();
    if (!project) return;
    project->received(session, frames);
    sweepSoon();
}

/// SE23: nobody can choose the group.
Party ProjectRuntime::partyOf(SessionId session) {
    const Project* const project = strand_.project();
    const Subject* const subject = project ? project->subjectOf(session) : nullptr;
    if (!subject) return {};
    const bool isProved = subject->proof && !subject->proof->user.empty();
    return {shareOf(*subject, transports_.of(session).addressOf(session)),
            isProved ? std::string() : subject->user.value};
}

FairTurns::Store ProjectRuntime::storeRoom() const {
    const std::size_t waiting = intake_.storeBytes();
    if (waiting > kFullStoreBytes) return FairTurns::Store::Full;
    return waiting > kFreeStoreBytes ? FairTurns::Store::Busy : FairTurns::Store::Free;
}

void ProjectRuntime::closed(SessionId session) {
    work_.closed(session);
    intake_.closed(session);
    blobs_.removeUnfinished(session);
    strand_.use([&](Project& project) { project.disconnected(session); });
}

void ProjectRuntime::drained(SessionId session) {
    strand_.use([&](Project& project) { project.drained(session); });
}

/// Closes all sessions, which then reconnect. Commits that were handed to the store are kept.
void ProjectRuntime::startAgain() {
    strand_.reset();
    outbox_.closeAll(Error{ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))});
    storage_.flush([this] {
        asio::post(network_, [this] {
            history_.dropped();
            storage_.resume();
            work_.storeChanged();
            makeProjectAgain();
        });
    });
}

void ProjectRuntime::makeProject(ProjectBeginning beginning) {
    const Ports ports{outbox_, history_, blobs_, files_, clock_, activity_};
    strand_.set(std::make_unique<Project>(setup_.options, ports, std::move(beginning.store),
                                          beginning.files));
    strand_.use([this](Project& project) { project.setRules(rules_); });
}

void ProjectRuntime::makeProjectAgain() {
    workers_.joins->post([this] {
        auto beginning = resultOf(setup_.read);
        asio::post(network_, [this, beginning = std::move(beginning)]() mutable {
            if (beginning) {
                makeProject(std::move(*beginning));
                return log_.write(LogLevel::Warning, "project started again");
            }
            log_.write(LogLevel::Error, "project cannot start again",
                       {{"error", beginning.error().message}});
            retryTimer_.expires_after(kRetryPause);
            retryTimer_.async_wait([this](const boost::system::error_code& error) {
                if (!error) makeProjectAgain();
            });
        });
    });
}

// Polls, because the folder may be on a network share, which sends no notifications.
void ProjectRuntime::scanFilesIn(milliseconds pause) {
    scanTimer_.expires_after(pause);
    scanTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        workers_.files->post([this] {
            const auto begin = steady_clock::now();
            auto files = resultOf(list_);
            const auto time = std::chrono::duration_cast<milliseconds>(steady_clock::now() - begin);
            asio::post(network_, [this, time, files = std::move(files)]() mutable {
                filesScanned(std::move(files), time);
            });
        });
    });
}

void ProjectRuntime::filesScanned(Result<std::vector<LayerFile>> files, milliseconds time) {
    scanFilesIn(std::max(kScanPause, time * kScanPart));
    strand_.use([&](Project& project) { project.unloadIdle(); });
    if (!files || *files == scanned_) return;
    scanned_ = std::move(*files);
    strand_.use([&](Project& project) { project.setFiles(scanned_); });
}

void ProjectRuntime::sweepSoon() {
    const Project* project = strand_.project();
    if (sweeping_ || !project || !project->hasPresence()) return;
    sweeping_ = true;
    sweepTimer_.expires_after(milliseconds(Project::kSweepMs));
    sweepTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        sweeping_ = false;
        const auto now =
            std::chrono::duration_cast<milliseconds>(steady_clock::now().time_since_epoch());
        strand_.use([&](Project& project) { project.sweep(now.count()); });
        sweepSoon();
    });
}

void ProjectRuntime::forgetClientsIn(milliseconds pause) {
    clientsTimer_.expires_after(pause);
    clientsTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        std::set<ClientId> kept;
        strand_.use([&](Project& project) { kept = project.activeClients(); });
        workers_.history->post([this, kept = std::move(kept)] {
            Revision upTo = 0;
            const auto forgotten = store_.use([&](CommitStore& store) {
                const auto some = store.forgetClients(kKnownClients, kept);
                upTo = store.forgottenUpTo();
                return some;
            });
            strand_.post([upTo](Project& project) { project.clientsForgotten(upTo); });
            if (forgotten && *forgotten > 0)
                log_.write(LogLevel::Info, "clients forgotten", {{"clients", *forgotten}});
            asio::post(network_, [this] { forgetClientsIn(kForgetPause); });
        });
    });
}

void ProjectRuntime::boundHistoryIn(milliseconds pause) {
    historyTimer_.expires_after(pause);
    historyTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        strand_.use([&](Project& project) { project.boundHistory(); });
        boundHistoryIn(kHistoryPause);
    });
}

// Measured repeatedly, because other programs also use the disk.
void ProjectRuntime::lookForSpaceIn(milliseconds pause) {
    spaceTimer_.expires_after(pause);
    spaceTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        workers_.joins->post([this] {
            const auto found =
                store_.use([](CommitStore& store) -> Result<bool> { return store.hasSpace(); });
            asio::post(network_, [this, found] {
                hasSpace_ = found.value_or(hasSpace_);
                if (!hasSpace_) blobs_.removeUnfinished({});  // those of clients that have left
                strand_.use([&](Project& project) { project.setSpace(hasSpace_); });
                lookForSpaceIn(kSpacePause);
            });
        });
    });
}

}  // namespace usdlive::server
