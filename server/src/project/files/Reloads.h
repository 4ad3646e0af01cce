// Reloads of files that were changed outside the server (FI3).
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

/// Requests to reload layers from their files. Each file is read and compared by a worker; the
/// difference becomes a commit in the name of the requesting user. A request is answered when its
/// commits are durable. If commits are rolled back, their layers are read again. Nobody requests
/// reloadByItself(), which commits in the name of nobody and only what nobody has changed.
class Reloads : public LineListener, public LayerListener {
public:
    Reloads(HistoryLine& line, const StoreCondition& store, LayerTable& layers,
            FileStates& fileStates, SessionTable& sessions, const AccessPolicy& access,
            const Ports& ports)
        : line_(line),
          store_(store),
          layers_(layers),
          fileStates_(fileStates),
          sessions_(sessions),
          access_(access),
          files_(ports.files),
          activity_(ports.activity) {}

    void request(Session& session, const ReloadLayers& request);
    /// Reloads a layer whose file was changed, unless there are unsaved edits of it (FI8).
    void reloadByItself(const LayerId& layer);

    /// Returns whether a request waits for the layer or reads its file.
    [[nodiscard]] bool needs(const LayerId& layer) const;
    /// Returns whether there are requests whose files are not all read.
    [[nodiscard]] bool isReading() const { return !requests_.empty(); }

    /// Answer of ports::Files.
    void fileRead(SessionId session, std::uint64_t request, const LayerId& layer,
                  Result<ReloadedLayer> reloaded);

    void durable(const OrderedCommit& commit) override;
    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void ready(const LayerId& /*layer*/, bool /*imported*/) override { advance(); }
    void failed(const LayerId& /*layer*/, const Error& /*error*/) override { advance(); }

private:
    struct Reading {
        Revision base = 0;  ///< revision of the layer with which the file is compared
        int attempt = 0;
    };
    struct Request {
        SessionId session = 0;  ///< 0: nobody's
        std::uint64_t request = 0;
        std::set<LayerId> waiting;  ///< layers that are being loaded
        std::map<LayerId, Reading> reading;
        /// Layers that are equal to their files at the revision.
        std::vector<std::pair<LayerId, SavedState>> unchanged;
        LayersReloaded outcome;

        void addFailure(const LayerId& layer, const Error& error);
    };
    /// A commit that makes a layer equal to its file.
    struct Taken {
        LayerId layer;
        SavedState saved;
    };
    void advance();
    void readLoaded(Request& request);
    void read(Request& request, const LayerId& layer, int attempt);
    /// Returns whose request it is; nullptr if its session has ended or is being closed.
    [[nodiscard]] const Subject* subjectOf(const Request& request) const;
    Result<void> take(const Subject& subject, const LayerId& layer, ReloadedLayer reloaded);
    void answer(const Request& request);

    Wire<HistoryLine> line_;
    Wire<const StoreCondition> store_;
    Wire<LayerTable> layers_;
    Wire<FileStates> fileStates_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Files> files_;
    Wire<ports::Activity> activity_;

    std::uint64_t ownRequests_ = 0;
    std::vector<Request> requests_;
    std::deque<Request> pending_;  ///< all files are read; sorted by revision
    std::deque<Taken> taken_;      ///< not durable yet; sorted by revision
};

}  // namespace usdlive::server
