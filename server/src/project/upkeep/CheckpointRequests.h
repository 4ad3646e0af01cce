// Requests for checkpoints: named revisions (CP1, CP2).
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <string>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/lines/HistoryLine.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Creates checkpoints of the newest executed revision, when that is durable, and lists them.
class CheckpointRequests : public LineListener {
public:
    CheckpointRequests(const HistoryLine& line, SessionTable& sessions, const AccessPolicy& access,
                       TimeOfDay& time, const Ports& ports)
        : line_(line),
          sessions_(sessions),
          access_(access),
          time_(time),
          clock_(ports.clock),
          history_(ports.history),
          activity_(ports.activity) {}

    void create(Session& session, const CreateCheckpoint& request);
    void list(const Session& session, const ListCheckpoints& request);

    // Answers of ports::History.
    void added(SessionId session, std::uint64_t request, const Result<Checkpoint>& added);
    void listed(SessionId session, std::uint64_t request, Result<std::vector<Checkpoint>> read);

    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;

private:
    struct Pending {
        SessionId session = 0;
        std::uint64_t request = 0;
        Checkpoint checkpoint;
    };
    /// The checkpoints that the sessions of a user may still make (SE22).
    struct Allowance {
        std::int64_t left = 0;
        std::int64_t grownMs = 0;  ///< steady time
    };
    [[nodiscard]] bool takeAllowance(const std::string& share);
    [[nodiscard]] std::optional<Error> objection(const Session& session,
                                                 const std::string& name) const;

    Wire<const HistoryLine> line_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<TimeOfDay> time_;
    Wire<ports::Clock> clock_;
    Wire<ports::History> history_;
    Wire<ports::Activity> activity_;
    std::deque<Pending> pending_;  ///< sorted by revision
    std::map<std::string, Allowance> allowances_;
};

}  // namespace usdlive::server
