// The real project of a server, in memory, for tests of clients.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "project/Project.h"
#include "transport/Connection.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::tests {

class MemoryConnection;

/// The real project of a server, in this process and in memory. It works whenever one of its
/// connections is polled.
class MemoryServer final : public server::AllPorts {
public:
    explicit MemoryServer(std::map<LayerId, LayerDoc> files);

    [[nodiscard]] std::unique_ptr<client::Connection> connect();
    /// False cuts every connection and refuses new ones until it is set to true.
    void setReachable(bool reachable);
    [[nodiscard]] const LayerDoc& doc(const LayerId& layer) const {
        return *project_->layer(layer);
    }
    [[nodiscard]] Revision head() const { return commits_.size(); }
    void setFiles(const std::vector<server::LayerFile>& files) { project_->setFiles(files); }

    std::map<LayerId, LayerDoc> files;
    std::set<LayerId> unreadable;  ///< layers of `files` that do not parse
    std::map<Hash, Bytes> blobs;
    std::map<std::string, Bytes> uploaded;  ///< by path
    std::vector<LayerId> saved;
    std::vector<std::string> logged;

    // Ports
    void send(server::SessionId session, SharedBytes frames) override;
    void close(server::SessionId session) override;
    void append(server::CommitRecord commit) override;
    void loadLayer(const LayerId& layer) override;
    void readCommits(server::SessionId session, Revision from, Revision to) override;
    void readHistory(server::SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override;
    void sendSnapshot(server::SessionId session, std::uint64_t request, LayerDoc doc) override;
    void sendBlob(server::SessionId session, const Hash& hash, std::uint64_t offset) override;
    void writeBlob(server::SessionId session, const std::string& share, BlobFrame part) override;
    void removeUnfinished(server::SessionId /*session*/) override {}
    void findBlobs(std::vector<Hash> hashes) override;
    void readClient(const ClientId& client) override;
    void sendCommit(std::span<const server::SessionId> sessions, SharedBytes frame,
                    Revision revision) override;
    void sendUpdate(std::span<const server::SessionId> sessions,
                    const server::StateUpdate& update) override;
    void sendInitialState(server::SessionId session, const server::StateUpdate& all) override;
    void sendBeside(server::SessionId session, std::vector<SharedBytes> frames) override;
    void saveLayers(server::SessionId session, std::uint64_t request,
                    std::vector<server::SaveJob> jobs) override;
    void createLayerFile(server::SessionId session, std::uint64_t request,
                         const LayerId& layer) override;
    void storeFile(server::SessionId session, std::uint64_t request,
                   server::UploadJob job) override;
    void listSkipped(server::SessionId session, std::uint64_t request) override;
    void record(const server::ActivityEvent& event) override { logged.emplace_back(event.what); }
    // A connection accepts all data, and these tests need none of the other functions.
    bool holdCommits(server::SessionId) override { return false; }
    void releaseCommits(server::SessionId, Revision) override {}
    bool congested(server::SessionId) override { return false; }
    bool lags(server::SessionId) override { return false; }
    void keepSnapshot(const LayerId&, LayerDoc, Revision, const Hash&) override {}
    void setSaved(const LayerId&, const server::SavedState&) override {}
    void addCheckpoint(server::SessionId, std::uint64_t, const Checkpoint&) override {}
    void readCheckpoints(server::SessionId, std::uint64_t) override {}
    void findBase(std::int64_t, Revision) override {}
    void compact(Revision) override {}
    void measureStorage(server::SessionId, std::uint64_t) override {}
    void importLayer(const LayerId&) override {}
    void readLayer(server::SessionId, std::uint64_t, const LayerId&) override {}
    void checkFile(const LayerId&) override {}
    void reloadLayer(server::SessionId, std::uint64_t, const LayerId&, LayerDoc) override {}
    [[nodiscard]] std::int64_t wallClockMs() override { return 1'700'000'000'000; }
    [[nodiscard]] std::int64_t steadyMs() override { return 0; }

private:
    friend class MemoryConnection;

    void post(std::function<void()> task) { tasks_.push_back(std::move(task)); }
    void work();
    bool open(MemoryConnection& connection);
    void disconnect(MemoryConnection& connection);

    std::unique_ptr<server::Project> project_;
    std::deque<std::function<void()>> tasks_;
    std::map<server::SessionId, MemoryConnection*> lines_;
    server::SessionId lastSession_ = 0;
    std::vector<server::StoredCommit> commits_;
    std::map<TransactionId, Revision> transactions_;
    bool reachable_ = true;
};

}  // namespace usdlive::tests
