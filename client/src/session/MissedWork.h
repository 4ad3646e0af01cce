// Own work whose commits this client has not received.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "session/Requests.h"

namespace usdlive::client {

/// Own work that is committed although its commit was not received, because the history was
/// replaced meanwhile. It is read from the log of the past, some at a time, and reported as
/// committed or lost.
class MissedWork {
public:
    MissedWork(const Channel& channel, Requests& requests, SessionEvents& events)
        : channel_(channel), requests_(requests), events_(events) {}

    /// `pending` was committed as `revision`.
    void add(Revision revision, Pending pending);
    /// The session is online: reads what is left.
    void welcomed();
    [[nodiscard]] std::size_t size() const { return works_.size(); }
    template <class Visit>
    void forEach(const Visit& visit) const {
        for (const Work& work : works_) visit(work.pending);
    }

private:
    struct Work {
        Revision revision = 0;
        Pending pending;
        bool asked = false;  // its commit was requested on this connection
    };

    void read();
    void read(const Work& work);
    [[nodiscard]] std::vector<Work>::iterator find(std::uint64_t sequence);

    const Channel& channel_;
    Requests& requests_;
    SessionEvents& events_;
    std::vector<Work> works_;  // in the order in which they were found
};

}  // namespace usdlive::client
