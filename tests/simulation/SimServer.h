#pragma once

#include <deque>
#include <map>
#include <memory>
#include <set>

#include "SimDisk.h"
#include "SimNetwork.h"
#include "usdlive/server/project/NamedBlobs.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::simulation {

/// The real Project with a made-up process around it, that can be killed and started again.
class SimServer : public server::AllPorts {
public:
    SimServer(SimClock& clock, SimRandom& random, SimNetwork& network,
              std::map<LayerId, LayerDoc> files, server::Project::Options options);

    void start();
    /// kill -9: what is not appended is gone; what is being appended may be there or not.
    void kill();
    [[nodiscard]] bool isRunning() const { return project_ != nullptr; }
    [[nodiscard]] const server::Project& project() const { return *project_; }
    /// An editor's connection has been made.
    void connected(server::SessionId session);
    [[nodiscard]] server::CommitStore& store() const { return disk.store(); }
    [[nodiscard]] bool isIdle() const { return appends_.empty() && !appending_; }

    SimDisk disk;
    int slowness = 1;  ///< multiplies the time that disks take

    // Ports
    void send(server::SessionId session, SharedBytes frames) override;
    void sendCommit(std::span<const server::SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    bool holdCommits(server::SessionId session) override;
    void releaseCommits(server::SessionId session, Revision next) override;
    [[nodiscard]] bool congested(server::SessionId session) override;
    [[nodiscard]] bool lags(server::SessionId session) override;
    void close(server::SessionId session) override;
    void append(server::CommitRecord commit) override;
    void keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                      const Hash& hash) override;
    void loadLayer(const LayerId& layer) override;
    void readCommits(server::SessionId session, Revision from, Revision to) override;
    void readHistory(server::SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override;
    void sendSnapshot(server::SessionId session, std::uint64_t request, LayerDoc doc) override;
    void sendBlob(server::SessionId session, const Hash& hash, std::uint64_t offset) override;
    void writeBlob(server::SessionId session, BlobFrame part) override;
    void findBlobs(std::vector<Hash> hashes) override;
    void saveLayers(server::SessionId session, std::uint64_t request,
                    std::vector<server::SaveJob> jobs) override;
    void addCheckpoint(server::SessionId session, std::uint64_t request,
                       const Checkpoint& checkpoint) override;
    void readCheckpoints(server::SessionId session, std::uint64_t request) override;
    void reloadLayer(server::SessionId session, std::uint64_t request, const LayerId& layer,
                     LayerDoc present) override;
    void createLayerFile(server::SessionId session, std::uint64_t request,
                         const LayerId& layer) override;
    void listSkipped(server::SessionId session, std::uint64_t request) override;
    void happened(const server::Happening&) override {}  // a log decides nothing
    [[nodiscard]] std::int64_t wallClockMs() override { return clock_.nowMs(); }
    void readClient(const ClientId& client) override;
    void importLayer(const LayerId& layer) override;
    void readLayer(server::SessionId session, std::uint64_t request, const LayerId& layer) override;
    void sendBeside(server::SessionId session, std::vector<SharedBytes> frames) override;
    void tell(std::span<const server::SessionId> sessions, const server::News& news) override;
    void tellFirst(server::SessionId session, const server::News& all) override;
    // Nobody of the simulation asks for these.
    void checkFile(const LayerId&) override {}
    void setSaved(const LayerId&, const server::SavedState&) override {}
    void measureStorage(server::SessionId, std::uint64_t) override {}
    /// The disk has room again, or none.
    void setSpace(bool full, bool reportsSpace);
    void findBase(std::int64_t beforeMs, Revision upTo) override;
    void compact(Revision revision) override;

    /// Has all commits so far replaced, as far as nobody needs them.
    void boundHistory() {
        if (project_) project_->boundHistory();
    }
    std::uint64_t compactions = 0;

    std::uint64_t snapshots = 0;  ///< that were kept
    std::uint64_t collected = 0;  ///< big values that nothing named
    std::uint64_t forgotten = 0;  ///< clients

    /// Removes big values that nothing names (B6), in steps between which other things happen.
    void collect();
    /// The store forgets what clients have committed (M14).
    void forgetClients();
    /// What commits name is there, and nothing else is when nothing goes on any more.
    void checkBlobs();

    /// A layer at a revision, from all commits there ever were.
    [[nodiscard]] LayerDoc replay(const LayerId& layer, Revision revision) const;

private:
    void drop(const std::vector<Hash>& unused);
    [[nodiscard]] std::set<Hash> namedByCommits() const;
    void appendNext();
    void appendDone();
    // Answers of this process come to this process only.
    void later(std::int64_t delayUs, std::function<void()> what);
    std::int64_t diskUs();

    SimClock& clock_;
    SimRandom& random_;
    SimNetwork& network_;
    std::map<LayerId, LayerDoc> files_;
    const server::Project::Options options_;
    std::unique_ptr<server::Project> project_;
    std::uint64_t process_ = 0;

    std::deque<server::CommitRecord> appends_;
    std::size_t appending_ = 0;
    bool closed_ = false;  // the store has failed and is not opened again yet
    std::int64_t blobUs_ = 0;
    server::NamedBlobs named_;
    std::uint64_t rounds_ = 0;     // of collection
    std::set<Hash> dropped_;       // by one of them
    std::uint64_t questions_ = 0;  // to the store
};

}  // namespace usdlive::simulation
