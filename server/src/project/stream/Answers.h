// Answers to an author's transactions that have to wait for commits (SE5).
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/server/project/ports/Outbox.h"  // SessionId

namespace usdlive::server {

struct Answer {
    Revision after = 0;  ///< is sent when the session has the commits up to this one
    SharedBytes frame;
    bool repeats = false;  ///< says that a transaction is committed already, by `after`
    bool closes = false;   ///< the session ends with it
};

/// A submitted transaction whose commit was rolled back.
struct LostSubmission {
    Revision revision = 0;  ///< of the commit
    std::uint64_t sequence = 0;
    SessionId session = 0;  ///< that submitted it
};

/// The answers to one session's transactions, in order.
class Answers {
public:
    void add(Answer answer) { waiting_.push_back(std::move(answer)); }
    /// Takes the next answer out if the session, with the commits up to `position`, may be sent it.
    [[nodiscard]] std::optional<Answer> next(Revision position);
    /// The refusals of what was lost take their place among the answers that waited for it. A
    /// session that has not submitted it, nor again, gets none: when it submits it, that is
    /// executed like any other.
    void rollBack(SessionId session, const std::vector<LostSubmission>& lost, Revision durable,
                  const Error& error);
    void clear() { waiting_.clear(); }

private:
    std::deque<Answer> waiting_;
};

}  // namespace usdlive::server
