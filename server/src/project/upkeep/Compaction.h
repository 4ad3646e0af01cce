// Replaces old commits by a base (CH4).
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/clients/Greeting.h"
#include "project/lines/HistoryLine.h"
#include "project/lines/HistoryStart.h"
#include "project/sessions/SessionTable.h"
#include "project/stream/Catchup.h"
#include "project/stream/CommitReads.h"
#include "project/stream/Openings.h"

namespace usdlive::server {

/// Replaces the oldest commits, on request or because of --history-days, as far as no checkpoint
/// and no session needs them. Executes one request at a time. Also reports the disk space of the
/// store.
class Compaction {
public:
    struct Parts {
        const HistoryLine& line;
        HistoryStart& start;
        SessionTable& sessions;
        const AccessPolicy& access;
        // The parts that read the history:
        const Greeting& greeting;
        const CommitReads& reads;
        const Catchup& catchup;
        const Openings& openings;
        TimeOfDay& time;
    };
    Compaction(std::optional<std::uint64_t> historyDays, const Parts& parts, const Ports& ports);

    void request(Session& session, const CompactHistory& request);
    /// Replaces the commits that are older than --history-days.
    void boundHistory();
    void measure(const Session& session, const RequestStorage& request);

    // Answers of ports::History.
    void baseFound(Result<BaseLimit> limit);
    void compacted(const Result<CompactOutcome>& outcome);
    void measured(SessionId session, std::uint64_t request, Result<Storage> storage);

private:
    struct Request {
        std::optional<SessionId> session;  ///< nothing: requested by boundHistory()
        std::uint64_t request = 0;
        std::int64_t beforeMs = 0;
        // Set when the base is found:
        Revision from = 0;    ///< the previous base
        std::string keptFor;  ///< the reason why newer commits are kept
    };
    void add(const std::optional<SessionId>& session, std::uint64_t request, std::uint64_t days);
    void findNextBase();
    void finish(const Result<CompactOutcome>& outcome);
    [[nodiscard]] Revision oldestNeeded() const;

    std::optional<std::uint64_t> historyDays_;
    Wire<const HistoryLine> line_;
    Wire<HistoryStart> start_;
    Wire<SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<const Greeting> greeting_;
    Wire<const CommitReads> reads_;
    Wire<const Catchup> catchup_;
    Wire<const Openings> openings_;
    Wire<ports::History> history_;
    Wire<ports::Activity> activity_;
    Wire<TimeOfDay> time_;
    std::deque<Request> requests_;  ///< the first one is in progress
};

}  // namespace usdlive::server
