// Requests to save layers.
#pragma once

#include <deque>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/layers/FileStates.h"
#include "project/layers/LayerTable.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Requests to save layers to their files. A request waits until its layers are loaded and all
/// their commits are durable. It waits again if commits are rolled back.
class Saves : public LineListener, public LayerListener, public SessionListener {
public:
    Saves(const HistoryLine& line, LayerTable& layers, FileStates& fileStates,
          SessionTable& sessions, const AccessPolicy& access, const Ports& ports)
        : line_(line),
          layers_(layers),
          fileStates_(fileStates),
          sessions_(sessions),
          access_(access),
          files_(ports.files),
          activity_(ports.activity) {}

    void request(Session& session, const SaveLayers& request);

    /// Returns whether a request waits for the layer to be loaded.
    [[nodiscard]] bool needs(const LayerId& layer) const;
    /// Returns whether files are being written.
    [[nodiscard]] bool isWriting() const { return underWay_ > 0; }

    // Answers of ports::Files.
    void saved(SessionId session, std::uint64_t request, const SaveOutcome& outcome);
    void progressed(SessionId session, std::uint64_t request, const LayerId& layer,
                    std::size_t done, std::size_t total);

    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void ready(const LayerId& /*layer*/, bool /*imported*/) override { advance(); }
    void failed(const LayerId& /*layer*/, const Error& /*error*/) override { advance(); }
    void left(const Session& session) override;

private:
    struct Request {
        SessionId session = 0;
        std::uint64_t request = 0;
        bool force = false;
        std::set<LayerId> layers;
        std::vector<LayersSaved::Failure> failed;
    };
    /// A request that is passed to the port when its revision is durable.
    struct Pending {
        Request request;
        std::vector<SaveJob> jobs;
        Revision revision = 0;
    };
    void advance();
    bool collect(Request& request);
    void leaveOutLocked(const Session& session, Request& request) const;
    void start(const Pending& pending);
    void recordRefused(const UserName& user, const std::vector<LayersSaved::Failure>& failed) const;

    Wire<const HistoryLine> line_;
    Wire<LayerTable> layers_;
    Wire<FileStates> fileStates_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;

    std::vector<Request> waiting_;  ///< waiting for layers to be loaded
    std::deque<Pending> pending_;   ///< sorted by revision
    std::size_t underWay_ = 0;
    /// The layers that requests in progress do not write.
    std::map<std::pair<SessionId, std::uint64_t>, std::vector<LayersSaved::Failure>> failed_;
};

}  // namespace usdlive::server
