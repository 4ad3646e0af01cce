// Answers to transactions that are sent after certain commits (SE5).
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "project/ports/Outbox.h"  // SessionId
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

struct Answer {
    Revision after = 0;  ///< the answer is sent after the commits up to this one
    SharedBytes frame;
    bool repeats = false;  ///< reports that `after` has committed the transaction already
    bool closes = false;   ///< the session is closed after it
};

/// A submitted transaction whose commit was rolled back.
struct LostSubmission {
    Revision revision = 0;  ///< revision of the lost commit
    std::uint64_t sequence = 0;
    SessionId session = 0;  ///< the session that submitted it
};

/// The unsent answers to one session's transactions, in order.
class Answers {
public:
    void add(Answer answer) { waiting_.push_back(std::move(answer)); }
    /// Removes and returns the next answer, if it may be sent after the commits up to `position`.
    [[nodiscard]] std::optional<Answer> next(Revision position);
    /// Inserts refusals of the lost transactions in the order of their revisions, and replaces the
    /// answers that reported them as committed. A session that did not submit a lost transaction
    /// gets no refusal for it: if it submits it later, it is executed. Returns the numbers of the
    /// refused transactions.
    std::vector<std::uint64_t> rollBack(SessionId session, const std::vector<LostSubmission>& lost,
                                        Revision durable, const Error& error);
    void clear() { waiting_.clear(); }

private:
    std::deque<Answer> waiting_;
};

}  // namespace usdlive::server
