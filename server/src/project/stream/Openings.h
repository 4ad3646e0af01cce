// Requests to open layers at the newest or an older revision.
#pragma once

#include <deque>
#include <map>
#include <utility>
#include <vector>

#include "project/Wiring.h"
#include "project/layers/LayerTable.h"
#include "project/lines/HistoryStart.h"
#include "project/sessions/SessionTable.h"
#include "project/stream/Catchup.h"

namespace usdlive::server {

/// Sends snapshots of layers to sessions. A snapshot of the newest state contains all executed
/// commits, and is sent when they are durable.
class Openings : public LineListener, public LayerListener, public SessionListener {
public:
    Openings(const HistoryLine& line, const HistoryStart& start, LayerTable& layers,
             SessionTable& sessions, Catchup& catchup, const Ports& ports)
        : line_(line),
          start_(start),
          layers_(layers),
          sessions_(sessions),
          catchup_(catchup),
          outbox_(ports.outbox),
          history_(ports.history),
          files_(ports.files),
          activity_(ports.activity) {}

    void open(Session& session, const OpenLayer& request);
    /// Returns the oldest revision at which a layer is being read; `newest` if none is.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const;

    // Answers of the ports.
    void historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc);
    void historyNotStored(SessionId session, std::uint64_t request);
    void beingImported(const LayerId& layer);

    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void ready(const LayerId& layer, bool imported) override;
    void failed(const LayerId& layer, const Error& error) override;
    void left(const Session& session) override;

private:
    struct Request {
        SessionId session = 0;
        std::uint64_t request = 0;
    };
    /// A copy of a layer that is sent when all its commits are durable.
    struct Snapshot {
        Request request;
        LayerId layer;
        LayerDoc doc;
        Revision revision = 0;
    };
    void openPast(Session& session, const OpenLayer& request);
    void openLoaded(const Request& request, const LayerId& layer);
    void send(const Snapshot& snapshot);

    Wire<const HistoryLine> line_;
    Wire<const HistoryStart> start_;
    Wire<LayerTable> layers_;
    Wire<SessionTable> sessions_;
    Wire<Catchup> catchup_;
    Wire<ports::Outbox> outbox_;
    Wire<ports::History> history_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;

    /// Requests that wait for the layer to be loaded.
    std::map<LayerId, std::vector<Request>> waiting_;
    std::deque<Snapshot> pending_;  ///< sorted by revision
    /// By number of the request.
    std::map<SessionId, std::map<std::uint64_t, OpenLayer>> pastReads_;
};

}  // namespace usdlive::server
