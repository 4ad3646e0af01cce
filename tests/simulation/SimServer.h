// The simulated server process with the real Project.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <set>

#include "SimDisk.h"
#include "SimNetwork.h"
#include "project/NamedBlobs.h"
#include "project/Project.h"
#include "usdlive/common/access/AccessRules.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::simulation {

/// The real Project with a simulated process around it, which can be killed and started again.
class SimServer : public server::AllPorts {
public:
    SimServer(SimClock& clock, SimRandom& random, SimNetwork& network,
              std::map<LayerId, LayerDoc> files, server::Project::Options options);

    void start();
    /// Simulates kill -9: commits that were not appended are lost; those being appended may be lost
    /// or not.
    void kill();
    [[nodiscard]] bool isRunning() const { return project_ != nullptr; }
    [[nodiscard]] const server::Project& project() const { return *project_; }
    /// Called when an editor has connected.
    void connected(server::SessionId session, const UserName& user);
    /// Lets users sign in: from now on they have roles.
    void signUsersIn() { signsIn_ = true; }
    /// Change what users may do. When they return, no edit that this forbids may be ordered any
    /// more.
    void setRole(const UserName& user, Role role);
    void setRules(AccessRules rules);
    [[nodiscard]] Role roleOf(const UserName& user) const;
    [[nodiscard]] const AccessRules& rules() const { return *rules_; }
    /// Returns whether the history has the layers at the revision. True as well if `welcome` is of
    /// a history that has been replaced since, or begins later: nobody can tell (ID2).
    [[nodiscard]] bool serves(const Welcome& welcome, Revision revision,
                              const LayerDocs& layers) const;
    [[nodiscard]] server::CommitStore& store() const { return disk.store(); }
    [[nodiscard]] bool isIdle() const { return appends_.empty() && !appending_; }

    SimDisk disk;
    int slowness = 1;  ///< multiplies the time that disks take

    // Ports
    void send(server::SessionId session, SharedBytes frames) override;
    void sendCommit(std::span<const server::SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    [[nodiscard]] bool isMulticast(server::SessionId session) const override;
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
    void writeBlob(server::SessionId session, const std::string& share, BlobFrame part) override;
    void removeUnfinished(server::SessionId session) override;
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
    void storeFile(server::SessionId session, std::uint64_t request,
                   server::UploadJob job) override;
    void listSkipped(server::SessionId session, std::uint64_t request) override;
    // The simulation does not test the entries of the activity log.
    void record(const server::ActivityEvent&) override {}
    [[nodiscard]] std::int64_t wallClockMs() override { return clock_.nowMs(); }
    [[nodiscard]] std::int64_t steadyMs() override { return clock_.nowMs(); }
    void readClient(const ClientId& client) override;
    void importLayer(const LayerId& layer) override;
    void readLayer(server::SessionId session, std::uint64_t request, const LayerId& layer) override;
    void sendBeside(server::SessionId session, std::vector<SharedBytes> frames) override;
    void sendUpdate(std::span<const server::SessionId> sessions,
                    const server::StateUpdate& update) override;
    void sendInitialState(server::SessionId session, const server::StateUpdate& all) override;
    // The simulation never requests these.
    void checkFile(const LayerId&) override {}
    void setSaved(const LayerId&, const server::SavedState&) override {}
    void measureStorage(server::SessionId, std::uint64_t) override {}
    /// Sets whether the disk has space.
    void setSpace(bool full, bool reportsSpace);
    void findBase(std::int64_t beforeMs, Revision upTo) override;
    void compact(Revision revision) override;

    /// Replaces all commits so far with a base, except those that are still needed.
    void boundHistory() {
        if (project_) project_->boundHistory();
    }
    std::uint64_t compactions = 0;

    std::uint64_t snapshots = 0;  ///< snapshots that were kept
    std::uint64_t collected = 0;  ///< big values that nothing named
    std::uint64_t forgotten = 0;  ///< clients

    /// Removes big values that nothing names (B6), in steps between which other events happen.
    void collect();
    /// Makes the store forget what clients have committed (M14).
    void forgetClients();
    /// Checks that every value which commits name exists, and that in the end no other value
    /// exists.
    void checkBlobs();

    /// Computes a layer at a revision from all commits that were ever made.
    [[nodiscard]] LayerDoc replay(const LayerId& layer, Revision revision) const;

private:
    /// AC4, AC6: checks that the role and the rules of now allow what is ordered now.
    void checkAllowed(const server::CommitRecord& record) const;
    [[nodiscard]] bool allows(const UserName& user, const Edit& edit) const;
    void drop(const std::vector<Hash>& unused);
    [[nodiscard]] std::set<Hash> namedByCommits() const;
    void appendNext();
    void appendDone();
    // Runs `what` later, unless the process has ended: answers reach only the process that asked.
    void later(std::int64_t delayUs, std::function<void()> what);
    std::int64_t diskUs();

    SimClock& clock_;
    SimRandom& random_;
    SimNetwork& network_;
    std::map<LayerId, LayerDoc> files_;
    const server::Project::Options options_;
    std::unique_ptr<server::Project> project_;
    std::uint64_t process_ = 0;

    bool signsIn_ = false;
    std::map<UserName, Role> roles_;  // those that were set
    std::shared_ptr<const AccessRules> rules_ = std::make_shared<const AccessRules>();

    std::deque<server::CommitRecord> appends_;
    std::size_t appending_ = 0;
    bool closed_ = false;  // the store has failed and is not opened again yet
    std::int64_t blobUs_ = 0;
    server::NamedBlobs named_;
    std::uint64_t rounds_ = 0;     // rounds of collection
    std::uint64_t questions_ = 0;  // questions to the store
};

}  // namespace usdlive::simulation
