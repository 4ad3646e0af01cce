#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/transport/Connection.h"
#include "usdlive/common/protocol/Snapshot.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::tests {

class MemoryConnection;

/// The real project of a server, in this process and in memory. It works when one of its
/// connections is polled.
class MemoryServer final : public server::ProjectHost {
public:
    explicit MemoryServer(std::map<LayerId, LayerDoc> files);

    [[nodiscard]] std::unique_ptr<client::Connection> connect();
    /// Cuts every connection, and lets none be made until it is true again.
    void setReachable(bool reachable);
    [[nodiscard]] const LayerDoc& doc(const LayerId& layer) const {
        return *project_->layer(layer);
    }
    [[nodiscard]] Revision head() const { return commits_.size(); }
    void setFiles(const std::vector<server::LayerFile>& files) { project_->setFiles(files); }

    std::map<LayerId, LayerDoc> files;
    std::map<Hash, Bytes> blobs;
    std::vector<LayerId> saved;
    std::vector<std::string> logged;

    // ProjectHost
    void send(server::SessionId session, SharedBytes frames) override;
    void close(server::SessionId session) override;
    void append(server::CommitRecord commit) override;
    void loadLayer(const LayerId& layer) override;
    void readCommits(server::SessionId session, Revision from, Revision to) override;
    void readHistory(server::SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override;
    void sendSnapshot(server::SessionId session, std::uint64_t request, LayerDoc doc) override;
    void sendBlob(server::SessionId session, const Hash& hash, std::uint64_t offset) override;
    void writeBlob(server::SessionId session, BlobFrame part) override;
    [[nodiscard]] bool hasBlob(const Hash& hash) override { return blobs.contains(hash); }
    [[nodiscard]] bool hasSpace() override { return true; }
    void saveLayers(server::SessionId session, std::uint64_t request,
                    std::vector<SaveJob> jobs) override;
    void createLayerFile(server::SessionId session, std::uint64_t request,
                         const LayerId& layer) override;
    void listSkipped(server::SessionId session, std::uint64_t request) override;
    void happened(const Happening& happening) override { logged.emplace_back(happening.what); }
    [[nodiscard]] std::optional<Revision> committed(const TransactionId& transaction) override;
    [[nodiscard]] std::int64_t wallClockMs() override { return 1'700'000'000'000; }

private:
    friend class MemoryConnection;

    void post(std::function<void()> task) { tasks_.push_back(std::move(task)); }
    void work();
    bool open(MemoryConnection& connection);
    void gone(MemoryConnection& connection);

    std::unique_ptr<server::Project> project_;
    std::deque<std::function<void()>> tasks_;
    std::map<server::SessionId, MemoryConnection*> lines_;
    server::SessionId lastSession_ = 0;
    std::vector<server::StoredCommit> commits_;
    std::map<TransactionId, Revision> transactions_;
    bool reachable_ = true;
};

}  // namespace usdlive::tests
