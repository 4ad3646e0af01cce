// Builds one project from its disk, threads and transports.
#include "app/ServedProject.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <ctime>
#include <set>
#include <span>
#include <utility>

#include "app/ProjectRuntime.h"
#include "app/RunningServer.h"
#include "app/ServedAssets.h"
#include "app/SharedStore.h"
#include "app/StorageThread.h"
#include "files/LayerFiles.h"
#include "storage/BlobStore.h"
#include "storage/RocksCommitStore.h"
#include "transport/DdsServer.h"
#include "transport/WebSocketTransport.h"

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

constexpr std::uint64_t kMib = 1024 * 1024;
constexpr std::size_t kMostSkippedLogged = 100;
constexpr unsigned kProjectClosed = 503;
// Space in a message for the lengths of its frames.
constexpr std::size_t kMessageSlack = 64 * 1024;
// Additional sessions, which only receive the error that there are too many.
constexpr std::size_t kMoreSessions = 256;
// A stop that takes longer, because a file system does not respond, is aborted. Nothing
// acknowledged is lost by that.
constexpr std::chrono::seconds kStopTime{8};

class MachineClock final : public ports::Clock {
public:
    std::int64_t wallClockMs() override { return milliseconds(CLOCK_REALTIME); }
    std::int64_t steadyMs() override { return milliseconds(CLOCK_BOOTTIME); }

private:
    static std::int64_t milliseconds(clockid_t clock) {
        timespec now{};
        ::clock_gettime(clock, &now);
        return std::int64_t(now.tv_sec) * 1'000 + now.tv_nsec / 1'000'000;
    }
};

/// Returns the place with the real path of the folder.
ProjectPlace realPlace(ProjectPlace place) {
    place.folder = std::filesystem::canonical(place.folder);
    return place;
}

/// Files are named as the folder was named, or by its real path.
PublicText textsFor(const std::filesystem::path& folder) {
    std::error_code ignored;
    return PublicText({std::filesystem::absolute(folder, ignored).lexically_normal().string(),
                       std::filesystem::weakly_canonical(folder, ignored).string()});
}

/// Returns the layers that are served: the files, and layers that exist only in the store.
Result<std::vector<LayerFile>> servedLayers(const LayerFiles& files, SharedStore& store) {
    auto listed = files.list();
    if (!listed) return listed;
    const auto stored = store.use([](CommitStore& opened) { return opened.layers(); });
    if (!stored) return tl::unexpected(stored.error());
    std::map<LayerId, LayerFile> all;
    for (LayerFile& file : *listed) all.emplace(file.layer, std::move(file));
    for (const LayerId& layer : *stored) all.try_emplace(layer, LayerFile{layer});
    std::vector<LayerFile> served;
    for (auto& [layer, file] : all) served.push_back(std::move(file));
    return served;
}

Project::Options projectOptions(const std::string& name, const ServerOptions& options) {
    Project::Options project;
    project.name = name;
    project.maxFrameBytes = project.wholeCommitBytes = options.maxFrameMib * kMib;
    project.maxBlobBytes = options.maxBlobMib * kMib;
    project.maxTransactionBytes = options.maxTransactionMib * kMib;
    project.maxSessions = options.maxSessions;
    project.maxUserSessions = options.maxUserSessions;
    project.maxUserLayers = options.maxUserLayers;
    for (const std::string& user : options.administrators) project.administrators.insert({user});
    project.historyDays = options.historyDays;
    project.reloadsFiles = options.reloadsFiles;
    project.lockTakeoverMs = std::int64_t(options.lockTakeoverMinutes) * 60'000;
    project.keepUnusedBlobsMs = std::int64_t(options.keepUnusedBlobsMinutes) * 60'000;
    return project;
}

WebSocketOptions webSocketOptions(const ServerOptions& options) {
    WebSocketOptions transport;
    transport.maxMessageBytes = options.maxFrameMib * kMib + kMessageSlack;
    transport.slowReaderBytes = options.slowReaderMib * kMib;
    transport.greetTime = std::chrono::seconds(options.guestSeconds);
    return transport;
}

DdsServerOptions ddsOptions(const std::string& name, const ServerOptions& options, std::string url,
                            StoreId store, Revision revision) {
    DdsServerOptions transport;
    transport.domain = {options.ddsInterface, std::uint32_t(options.ddsDomain), options.ddsConfig,
                        options.ddsSecurity};
    transport.project = name;
    transport.url = std::move(url);
    transport.store = std::move(store);
    transport.revision = revision;
    transport.maxMessageBytes = options.maxFrameMib * kMib + kMessageSlack;
    transport.maxSessions = options.maxSessions + kMoreSessions;
    transport.greetTime = std::chrono::seconds(options.guestSeconds);
    transport.slowReaderBytes = options.slowReaderMib * kMib;
    return transport;
}

/// Opens the store of a project. A process that has served a project never starts a new history in
/// place of the one it served.
Result<std::unique_ptr<CommitStore>> openStore(const std::filesystem::path& folder,
                                               const RocksCommitStoreOptions& options,
                                               bool& wasOpened) {
    std::error_code error;
    if (wasOpened && !std::filesystem::exists(folder / "store" / "head", error))
        return fail(ErrorCode::StorageFailed,
                    "the project's history " + folder.lexically_normal().string() +
                        " was deleted or moved while the server runs. Put it back to continue "
                        "editing. If it is lost, export what open editors show, then stop the "
                        "server and start it again: the project begins with its files as they "
                        "were saved last");
    auto opened = createRocksCommitStore(folder / "store", options);
    wasOpened = wasOpened || opened.has_value();
    return opened;
}

/// Adds advice to an error: names the server that has the folder's store open, or explains how to
/// continue with a damaged history.
Error explained(const Error& error, const ProjectPlace& place) {
    const std::string history = place.history().lexically_normal().string();
    if (error.code == ErrorCode::StorageCorrupt && place.isLiveSession())
        return {error.code, error.message + ". The history of the live session in " + history +
                                " is damaged, that of the project is not. Delete the session: "
                                "usdlive session end, then usdlive session delete"};
    if (error.code == ErrorCode::StorageCorrupt)
        return {
            error.code,
            error.message + ". The project's history in " + history +
                " is damaged. Put a backup of it in its place. If there is none, move it aside "
                "(mv " +
                history + " " + history +
                "-damaged) and start again: the project then begins with its files, as they were "
                "saved last"};
    if (error.code != ErrorCode::StorageLocked) return error;
    const auto running = RunningServer::find(place.folder);
    if (!running) return error;
    return {error.code, place.folder.string() + " is already served at " + running->url +
                            " by process " + std::to_string(running->process) +
                            ". Connect there, or stop that process first"};
}

/// FI5: returns the number of files that are not served, and logs the first ones with the reason.
std::size_t logSkipped(const LayerFiles& files, Log& log) {
    const auto skipped = files.skipped();
    if (!skipped) return 0;
    for (const SkippedFile& file :
         std::span(*skipped).first(std::min(skipped->size(), kMostSkippedLogged)))
        log.write(LogLevel::Warning, "file skipped",
                  {{"file", file.path}, {"reason", file.reason}});
    if (skipped->size() > kMostSkippedLogged)
        log.write(LogLevel::Warning, "more files skipped",
                  {{"count", skipped->size() - kMostSkippedLogged}});
    return skipped->size();
}

}  // namespace

/// The objects that exist while a project is served. Created, used and destroyed on the project's
/// thread.
class ServedProject::Running {
public:
    static Result<std::unique_ptr<Running>> open(const ServedProject& project) {
        std::error_code error;
        const std::filesystem::path& folder = project.place_.folder;
        if (!std::filesystem::is_directory(folder, error))
            return fail(ErrorCode::InvalidConfiguration, folder.string() + " is not a folder" +
                                                             (error ? ": " + error.message() : ""));
        std::unique_ptr<Running> running(new Running(project));
        if (const auto opened = running->open(); !opened) return tl::unexpected(opened.error());
        return running;
    }

    ~Running() {
        dds_.reset();
        webSockets_.reset();
        workers_.stop();
        storage_.stop();
        store_.close();
    }

    [[nodiscard]] asio::io_context& io() { return network_; }
    [[nodiscard]] WebSocketTransport& webSockets() { return *webSockets_; }
    [[nodiscard]] ProjectRuntime& runtime() { return *runtime_; }
    [[nodiscard]] Status status() const {
        const auto layers = servedLayers(*files_, store_);
        return {State::Serving, {}, layers ? layers->size() : 0, logSkipped(*files_, log_)};
    }

    void answerFile(const FileRequest& request, const HttpAnswer& answer) {
        assets_->answer(request, answer);
    }

    Result<void> announce(const std::string& url) {
        if (!place_.isLiveSession()) runningServer_.emplace(place_.folder, url);
        if (!options_.dds) return {};
        auto store =
            store_.use([](CommitStore& opened) -> Result<StoreId> { return opened.identity(); });
        if (!store) return tl::unexpected(store.error());
        auto made = createDdsServer(
            network_,
            ddsOptions(name_, options_, url, std::move(*store), runtime_->durableRevision()),
            *runtime_, background_, log_);
        if (!made) return tl::unexpected(made.error());
        dds_ = std::move(*made);
        runtime_->carry(*dds_);
        return {};
    }

    void run() {
        // An exception in a handler is a bug that affects only this project.
        for (;;) try {
                network_.run();
                return;
            } catch (const std::exception& fault) {
                log_.write(LogLevel::Error, "project met a fault", {{"error", fault.what()}});
            }
    }

    void branch(LiveSessionRecord wanted, std::function<void(Result<LiveSessionRecord>)> done) {
        workers_.history->post([this, wanted = std::move(wanted), done = std::move(done)] {
            done(LiveSessionFolder(place_.folder)
                     .create(
                         wanted,
                         [this](const std::filesystem::path& to) {
                             return store_.use(
                                 [&](CommitStore& store) { return store.copyTo(to); });
                         },
                         storeOptions_));
        });
    }

    void stop() {
        if (std::exchange(isStopping_, true)) return;
        stopTimer_.expires_after(kStopTime);
        stopTimer_.async_wait([this](const boost::system::error_code& error) {
            if (!error) network_.stop();
        });
        runtime_->stop([this] { network_.stop(); });
    }

private:
    explicit Running(const ServedProject& project)
        : place_(project.place_),
          name_(project.name_),
          texts_(project.texts_),
          options_(project.options_),
          log_(*project.log_),
          audit_(project.audit_),
          storeOptions_(storeOptions(options_)),
          store_([this] { return openStore(place_.history(), storeOptions_, wasOpened_); }),
          workers_(project.workers_),
          storage_(store_, std::chrono::milliseconds(options_.flushIntervalMs), log_) {}

    static RocksCommitStoreOptions storeOptions(const ServerOptions& options) {
        RocksCommitStoreOptions store;
        if (options.durability == "os") store.durability = Durability::OperatingSystem;
        if (options.minFreeMib) store.minFreeBytes = *options.minFreeMib * kMib;
        return store;
    }

    Result<void> open() {
        if (const auto opened = store_.open(); !opened)
            return tl::unexpected(explained(opened.error(), place_));
        BlobStoreOptions blobOptions;
        if (options_.minFreeMib) blobOptions.minFreeBytes = *options_.minFreeMib * kMib;
        blobOptions.maxBytes = options_.maxBlobMib * kMib;
        blobOptions.keepLeft = std::chrono::minutes(options_.keepUnusedBlobsMinutes);
        auto blobs = createFileBlobStore(place_.history() / "blobs", blobOptions);
        if (!blobs) return tl::unexpected(blobs.error());
        blobs_ = std::move(*blobs);
        auto files = place_.isLiveSession()
                         ? createLiveSessionFiles(place_.folder, place_.liveSession, *blobs_)
                         : createLayerFiles(place_.folder, *blobs_);
        if (!files) return tl::unexpected(files.error());
        files_ = std::move(*files);

        assetFiles_ = std::make_unique<AssetFiles>(files_->folder());
        assets_ = std::make_unique<ServedAssets>(name_, *assetFiles_, *files_, store_, workers_,
                                                 texts_, log_);

        const auto list = [this] { return servedLayers(*files_, store_); };
        runtime_ = std::make_unique<ProjectRuntime>(
            network_, workers_, store_, storage_, *blobs_,
            ProjectFiles{realPlace(place_), list, *files_, *assetFiles_, texts_},
            std::chrono::minutes(options_.keepUnusedBlobsMinutes), metrics_, clock_,
            ActivityLog(name_, log_, audit_), log_);
        if (auto made = runtime_->start(setup()); !made) return made;
        webSockets_ = createWebSocketTransport(network_, webSocketOptions(options_), *runtime_,
                                               background_, log_);
        runtime_->carry(*webSockets_);
        runtime_->serve();
        return {};
    }

    ProjectSetup setup() {
        Project::Options project = projectOptions(name_, options_);
        project.texts = texts_;
        // A live session has no files that it could be equal to.
        project.reloadsFiles = project.reloadsFiles && !place_.isLiveSession();
        const auto read = [this, project]() -> Result<ProjectBeginning> {
            auto served = servedLayers(*files_, store_);
            if (!served) return tl::unexpected(served.error());
            return store_.use([&](CommitStore& opened) { return readState(opened, project); })
                .map([&](StoreState&& state) {
                    return ProjectBeginning{std::move(state), std::move(*served)};
                });
        };
        return {project, read};
    }

    const ProjectPlace place_;
    const std::string name_;
    const PublicText& texts_;
    const ServerOptions& options_;
    Log& log_;
    AuditLog& audit_;

    const RocksCommitStoreOptions storeOptions_;
    bool wasOpened_ = false;
    mutable SharedStore store_;
    std::unique_ptr<BlobStore> blobs_;
    std::unique_ptr<LayerFiles> files_;
    std::unique_ptr<AssetFiles> assetFiles_;

    // Run by the project's thread.
    asio::io_context network_{1};
    asio::steady_timer stopTimer_{network_};
    WorkerShares workers_;
    const Background background_ = [this](std::function<void()> job) {
        workers_.joins->post(std::move(job));
    };
    StorageThread storage_;
    Metrics metrics_;
    std::unique_ptr<ServedAssets> assets_;
    MachineClock clock_;
    std::unique_ptr<ProjectRuntime> runtime_;
    std::shared_ptr<WebSocketTransport> webSockets_;
    std::unique_ptr<Transport> dds_;
    std::optional<RunningServer> runningServer_;
    bool isStopping_ = false;
};

ServedProject::ServedProject(ProjectPlace place, const ServerOptions& options, Workers& workers,
                             AuditLog& audit, std::unique_ptr<Log> log,
                             std::function<void()> changed)
    : place_(std::move(place)),
      name_(place_.name()),
      texts_(textsFor(place_.folder)),
      options_(options),
      workers_(workers),
      audit_(audit),
      log_(std::move(log)),
      changed_(std::move(changed)) {}

ServedProject::~ServedProject() {
    stop();
    if (thread_.joinable()) thread_.join();
}

void ServedProject::start() {
    {
        const std::lock_guard lock(mutex_);
        const bool hasThread = thread_.joinable() && !lacksThreads_;
        if (stopping_ || hasThread) return;
        lacksThreads_ = false;
    }
    if (thread_.joinable()) thread_.join();
    try {
        thread_ = startThread(name_, [this] { run(); });
    } catch (const ThreadRefused& why) {
        refused(why);
    }
}

bool ServedProject::lacksThreads() const {
    const std::lock_guard lock(mutex_);
    return lacksThreads_;
}

void ServedProject::refused(const ThreadRefused& why) {
    {
        const std::lock_guard lock(mutex_);
        lacksThreads_ = !stopping_;
        status_ = stopping_
                      ? Status{State::Stopped}
                      : Status{State::Failed, Error{ErrorCode::InvalidConfiguration, why.what()}};
    }
    changed_();
}

ServedProject::Status ServedProject::status() const {
    const std::lock_guard lock(mutex_);
    return status_;
}

void ServedProject::change(Status status) {
    {
        const std::lock_guard lock(mutex_);
        status_ = std::move(status);
    }
    changed_();
}

void ServedProject::run() {
    do {
        Result<std::unique_ptr<Running>> running = fail(ErrorCode::Internal, "not opened");
        try {
            running = Running::open(*this);
        } catch (const ThreadRefused& why) {
            return refused(why);  // leaves its thread to others
        } catch (const std::exception& fault) {
            running = fail(ErrorCode::Internal, fault.what());
        }
        if (running) {
            serve(std::move(*running));
            break;
        }
        change({State::Failed, running.error()});
    } while (waitForRetry());
    change({State::Stopped});
}

/// Returns false if the project is being stopped.
bool ServedProject::waitForRetry() {
    std::unique_lock lock(mutex_);
    return !stop_.wait_for(lock, kRetryPause, [this] { return stopping_; });
}

void ServedProject::serve(std::unique_ptr<Running> running) {
    Status status = running->status();
    {
        const std::lock_guard lock(mutex_);
        running_ = running.get();
        status_ = std::move(status);
        if (stopping_) asio::post(running->io(), [&] { running->stop(); });
        if (!url_.empty())
            asio::post(running->io(), [&, url = url_, done = std::exchange(announced_, nullptr)] {
                done(running->announce(url));
            });
    }
    changed_();
    running->run();
    const std::lock_guard lock(mutex_);
    running_ = nullptr;
}

bool ServedProject::post(std::function<void(Running&)> use) {
    const std::lock_guard lock(mutex_);
    if (!running_) return false;
    asio::post(running_->io(), [running = running_, use = std::move(use)] { use(*running); });
    return true;
}

void ServedProject::announce(std::string url, std::function<void(Result<void>)> done) {
    {
        const std::lock_guard lock(mutex_);
        url_ = url;
        announced_ = done;
        if (!running_) return;
        announced_ = nullptr;
    }
    post([url = std::move(url), done = std::move(done)](Running& running) {
        done(running.announce(url));
    });
}

WebSocketTransport* ServedProject::sessions() const {
    const std::lock_guard lock(mutex_);
    return running_ && !stopping_ ? &running_->webSockets() : nullptr;
}

void ServedProject::report(bool hasMetrics, std::function<void(Report)> done) {
    const bool isPosted = post([hasMetrics, done](Running& running) {
        const ProjectHealth health = running.runtime().health();
        done({std::string(health.status),
              {},
              health.revision,
              health.sessions,
              health.users,
              hasMetrics ? running.runtime().metrics() : nullptr});
    });
    if (isPosted) return;
    const Status now = status();
    if (now.state == State::Failed) return done({"failed", texts_(*now.error).message});
    done({now.state == State::Opening ? "opening" : "stopping"});
}

void ServedProject::answerFile(FileRequest request, HttpAnswer answer) {
    const bool isPosted = post([request = std::move(request), answer](Running& running) {
        running.answerFile(request, answer);
    });
    if (!isPosted) answer({"text/plain", "the project is being closed\n", kProjectClosed});
}

void ServedProject::rolesChanged(std::shared_ptr<const Accounts> accounts,
                                 std::function<void()> done) {
    const bool isPosted = post([accounts, name = place_.project, done](Running& running) {
        running.runtime().rolesChanged([accounts, name](const SignedIn& user) {
            return SignIn::in(*accounts, user, name).role;
        });
        done();
    });
    if (!isPosted) done();
}

void ServedProject::branch(LiveSessionRecord wanted,
                           std::function<void(Result<LiveSessionRecord>)> done) {
    const bool isPosted = post(
        [wanted = std::move(wanted), done](Running& running) { running.branch(wanted, done); });
    if (!isPosted) done(fail(ErrorCode::ShuttingDown, "the project is not served now"));
}

void ServedProject::stop() {
    bool hasThread = false;
    {
        const std::lock_guard lock(mutex_);
        if (std::exchange(stopping_, true)) return;
        hasThread = thread_.joinable() && !std::exchange(lacksThreads_, false);
        if (!hasThread) status_ = {State::Stopped};
    }
    stop_.notify_all();
    if (!hasThread) return changed_();
    post([](Running& running) { running.stop(); });
}

}  // namespace usdlive::server
