#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>

#include "usdlive/server/app/BlobCollector.h"
#include "usdlive/server/app/Intake.h"
#include "usdlive/server/app/LogLimit.h"
#include "usdlive/server/app/Metrics.h"
#include "usdlive/server/app/SharedStore.h"
#include "usdlive/server/app/StorageThread.h"
#include "usdlive/server/files/LayerFiles.h"
#include "usdlive/server/project/Project.h"
#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/Transport.h"
#include "usdlive/server/transport/WebSocketServer.h"  // HttpReply

namespace usdlive::server {

using WallClock = std::function<std::int64_t()>;  ///< milliseconds since 1970; the network thread
/// What a project is made with.
struct ProjectBeginning {
    StoreState store;
    std::vector<LayerFile> files;
};
struct ProjectSetup {
    Project::Options options;
    std::function<Result<ProjectBeginning>()> read;  ///< any thread; takes time
};

/// The project's folder and what is done to the files in it. Any thread.
struct ProjectFiles {
    std::filesystem::path folder;
    /// What is served: the files, and the layers that only the store holds by now.
    std::function<Result<std::vector<LayerFile>>()> list;
    LayerFiles& layers;
};

/// The threads that block for the project, by how long somebody may have to wait for them.
struct WorkerLanes {
    /// Layers that the store has, commits for who resumes, parts of big values, what transports
    /// send: quick, and people wait for it.
    boost::asio::thread_pool joins{2};
    /// Imports, saves and whatever else reads and writes the project's files.
    boost::asio::thread_pool files{2};
    /// Layers as they were, checkpoints; snapshots, which nobody waits for.
    boost::asio::thread_pool history{2};

    /// Ends what is at work and drops the rest.
    void stop() {
        for (boost::asio::thread_pool* lane : {&joins, &files, &history}) lane->stop();
        for (boost::asio::thread_pool* lane : {&joins, &files, &history}) lane->join();
    }
};

/// The process around a project: passes between it and sockets, store, files and disk. The
/// project's strand is the network thread, so that what a client sends is ordered and sent on
/// without a hand-over; what blocks runs on the storage thread and on workers and comes back by a
/// post.
class ServerHost final : public AllPorts, public SessionHandler {
public:
    ServerHost(boost::asio::io_context& network, WorkerLanes& workers, SharedStore& store,
               StorageThread& storage, BlobStore& blobs, ProjectFiles files,
               std::chrono::milliseconds keepUnusedBlobs, Metrics& metrics, WallClock clock,
               Log& log);
    ~ServerHost() override;

    // Network thread, as all that is not said otherwise.
    Result<void> start(ProjectSetup setup);
    /// Who carries the messages, number n of them the sessions of Transport::kSessions * n and on;
    /// from now on new files are noticed, too.
    void serve(std::vector<Transport*> transports);
    /// Sends what is acknowledged, says goodbye, appends the rest; then `done`.
    void stop(std::function<void()> done);

    [[nodiscard]] Revision durableRevision() const {
        return project_ ? project_->durableRevision() : 0;
    }
    [[nodiscard]] HttpReply health();
    [[nodiscard]] HttpReply metricsPage();

private:
    // SessionHandler
    void opened(SessionId session) override;
    void received(SessionId session, ByteView message) override;
    void closed(SessionId session) override;
    void drained(SessionId session) override;

    // Outbox
    void send(SessionId session, SharedBytes frames) override;
    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    bool holdCommits(SessionId session) override;
    void releaseCommits(SessionId session, Revision next) override;
    void tell(std::span<const SessionId> sessions, const News& news) override;
    void tellFirst(SessionId session, const News& all) override;
    bool congested(SessionId session) override;
    bool lags(SessionId session) override;
    void close(SessionId session) override;
    void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) override;
    void sendBeside(SessionId session, std::vector<SharedBytes> frames) override;
    // History
    void append(CommitRecord commit) override;
    void keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                      const Hash& hash) override;
    void loadLayer(const LayerId& layer) override;
    void readCommits(SessionId session, Revision from, Revision to) override;
    void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override;
    void readClient(const ClientId& client) override;
    void setSaved(const LayerId& layer, const SavedState& saved) override;
    void addCheckpoint(SessionId session, std::uint64_t request,
                       const Checkpoint& checkpoint) override;
    void readCheckpoints(SessionId session, std::uint64_t request) override;
    void findBase(std::int64_t beforeMs, Revision upTo) override;
    void compact(Revision revision) override;
    void measureStorage(SessionId session, std::uint64_t request) override;
    // Blobs
    void findBlobs(std::vector<Hash> hashes) override;
    void writeBlob(SessionId session, BlobFrame part) override;
    void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) override;
    // Files
    void importLayer(const LayerId& layer) override;
    void readLayer(SessionId session, std::uint64_t request, const LayerId& layer) override;
    void saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) override;
    void checkFile(const LayerId& layer) override;
    void reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                     LayerDoc present) override;
    void createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) override;
    void listSkipped(SessionId session, std::uint64_t request) override;
    // Clock, Activity
    std::int64_t wallClockMs() override { return clock_(); }
    void happened(const Happening& happening) override;

    Transport& transportOf(SessionId session);
    template <class Each>
    void forTransports(std::span<const SessionId> sessions, Each each);
    void closeAll(const Error& why);

    // What workers do.
    Result<std::optional<LoadedLayer>> loadStored(const LayerId& layer);
    Result<LoadedLayer> import(const LayerId& layer);
    SaveOutcome save(SessionId session, std::uint64_t request, const std::vector<SaveJob>& jobs);
    Result<FileStamp> save(const SaveJob& job);
    Result<bool> write(SessionId session, const BlobFrame& part);
    Result<CompactOutcome> compactStore(Revision revision);

    template <class Executor, class Work, class Tell>
    void inBackground(Executor& executor, SessionId session, std::size_t bytes, Work work,
                      Tell tell);
    template <class Tell>
    void onProject(Tell tell);
    template <class Tell>
    void guarded(Tell&& tell);
    void startAgain();
    void makeProject(ProjectBeginning beginning);
    void makeProjectAgain();
    void scanFilesIn(std::chrono::milliseconds pause);
    void sweepSoon();
    void forgetClientsIn(std::chrono::milliseconds pause);
    void boundHistoryIn(std::chrono::milliseconds pause);
    void lookForSpaceIn(std::chrono::milliseconds pause);
    /// Does what takes long go on?
    [[nodiscard]] CommitStore::GoesOn whileServing() const;
    void filesScanned(Result<std::vector<LayerFile>> files, std::chrono::milliseconds time);

    boost::asio::io_context& network_;
    WorkerLanes& workers_;
    // In order: parts of a big value; saves of a layer, of which the last has to win; checkpoints;
    // snapshots.
    boost::asio::strand<boost::asio::thread_pool::executor_type> blobWriter_, saver_, checkpoints_,
        snapshotWriter_;
    SharedStore& store_;
    StorageThread& storage_;
    BlobStore& blobs_;
    const ProjectFiles files_;
    Metrics& metrics_;
    const WallClock clock_;
    Log& log_;
    boost::asio::steady_timer retryTimer_, scanTimer_, sweepTimer_, clientsTimer_, historyTimer_,
        spaceTimer_;
    BlobCollector collector_;

    ProjectSetup setup_;
    std::unique_ptr<Project> project_;  ///< missing while it is made again
    std::uint64_t generation_ = 0;      ///< answers to a project before are dropped
    std::vector<Transport*> transports_;
    bool sweeping_ = false;
    bool hasSpace_ = true;  ///< as the store said last
    LogLimit logLimit_;
    Intake intake_;
    std::map<Revision, std::size_t> appending_;  ///< bytes of commits on their way to the store
    std::vector<LayerFile> scanned_;             ///< the last time
    std::atomic<bool> stopping_ = false;
    /// For what reads the whole history, which nobody waits for. The last member: its thread ends
    /// before what it uses.
    boost::asio::thread_pool keeper_{1};
};

}  // namespace usdlive::server
