// Saving layers to their files.
#pragma once

#include <deque>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "Wiring.h"
#include "access/AccessPolicy.h"
#include "layers/FileStates.h"
#include "layers/LayerTable.h"
#include "sessions/SessionTable.h"

namespace usdlive::server {

/// Requests to save layers. A request waits until its layers are loaded and everything in them is
/// durable. When commits are rolled back it waits again.
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

    /// Does a request wait for the layer to be loaded?
    [[nodiscard]] bool needs(const LayerId& layer) const;
    /// Are files being written?
    [[nodiscard]] bool isWriting() const { return underWay_ > 0; }

    // Answers of the port.
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
    /// Is handed on when its revision is durable.
    struct Pending {
        Request request;
        std::vector<SaveJob> jobs;
        Revision revision = 0;
    };
    void advance();
    bool collect(Request& request);
    void leaveOutLocked(const Session& session, Request& request) const;
    void start(const Pending& pending);

    Wire<const HistoryLine> line_;
    Wire<LayerTable> layers_;
    Wire<FileStates> fileStates_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;

    std::vector<Request> waiting_;  ///< for layers to be loaded
    std::deque<Pending> pending_;   ///< by revision
    std::size_t underWay_ = 0;
    /// The layers that requests under way do not write.
    std::map<std::pair<SessionId, std::uint64_t>, std::vector<LayersSaved::Failure>> failed_;
};

}  // namespace usdlive::server
