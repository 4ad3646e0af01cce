// Reads commits from the store, one read at a time for each session.
#pragma once

#include <algorithm>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "project/Wiring.h"
#include "project/ports/History.h"
#include "project/sessions/Session.h"

namespace usdlive::server {

/// The purpose of a read.
enum class ReadPurpose { ResumeCheck, Stream, Creations };
struct CommitRead {
    ReadPurpose purpose{};
    Revision from = 0, to = 0;
    std::uint64_t sequence = 0;  ///< only for Creations
};

/// Queues the reads of each session, and returns the purpose of each answer of the store.
class CommitReads : public SessionListener {
public:
    explicit CommitReads(ports::History& history) : history_(history) {}

    void request(SessionId session, const CommitRead& read) {
        auto& reads = reads_[session];
        reads.push_back(read);
        if (reads.size() == 1) history_->readCommits(session, read.from, read.to);
    }

    struct Answer {
        CommitRead read;
        Result<std::vector<StoredCommit>> commits;  ///< the first one is read.from
    };
    /// Receives an answer of ports::History. Returns nothing if the session has ended.
    [[nodiscard]] std::optional<Answer> answered(SessionId session,
                                                 Result<std::vector<StoredCommit>> commits) {
        const auto found = reads_.find(session);
        if (found == reads_.end()) return std::nullopt;
        auto& reads = found->second;
        const CommitRead read = reads.front();
        reads.pop_front();
        if (reads.empty())
            reads_.erase(found);
        else
            history_->readCommits(session, reads.front().from, reads.front().to);
        if (commits && (commits->empty() || commits->front().revision != read.from))
            commits = fail(ErrorCode::StorageCorrupt,
                           "revision " + std::to_string(read.from) + " is not in the store");
        return Answer{read, std::move(commits)};
    }

    [[nodiscard]] bool isReading(SessionId session, ReadPurpose purpose) const {
        const auto found = reads_.find(session);
        return found != reads_.end() &&
               std::ranges::any_of(found->second, [purpose](const CommitRead& read) {
                   return read.purpose == purpose;
               });
    }
    /// Returns the oldest revision that a read requests, minus one; `newest` if there are no reads.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const {
        for (const auto& [session, reads] : reads_)
            for (const CommitRead& read : reads) newest = std::min(newest, read.from - 1);
        return newest;
    }

    void left(const Session& session) override { reads_.erase(session.id); }

private:
    Wire<ports::History> history_;
    /// Never empty; the first read is in progress.
    std::map<SessionId, std::deque<CommitRead>> reads_;
};

}  // namespace usdlive::server
