// The events of a session that its host has not taken yet.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "session/Pending.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::client {

/// The events of a session, in order, until Session::takeEvents().
class SessionEvents {
public:
    void push(Event event) { events_.push_back(std::move(event)); }
    /// Reports an error that answers no request. `about` says what it concerns.
    void report(Error error, ErrorMessage about = {}) {
        about.code = errorName(error.code);
        about.message = std::move(error.message);
        push(event::ServerError{std::move(about)});
    }
    /// Reports the edits of an own transaction that its commit lacks (M12).
    void reportDropped(const Pending& pending, const Commit& commit) {
        LostWork work{.sequence = commit.id.sequence,
                      .gesture = commit.gesture,
                      .reason = {commit.dropped.front().reason,
                                 std::string(errorText(commit.dropped.front().reason))},
                      .refused = false,
                      .edits = {}};
        for (const DroppedEdit& dropped : commit.dropped)
            if (dropped.index < pending.authored.size())
                work.edits.push_back(pending.authored[dropped.index]);
        push(event::Lost{std::move(work)});
    }
    [[nodiscard]] std::vector<Event> take() { return std::exchange(events_, {}); }

private:
    std::vector<Event> events_;
};

}  // namespace usdlive::client
