// The queue of events for the editor.
#pragma once

#include <deque>
#include <functional>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Queues events and calls the editor's handler for them, in order.
class EditorEvents {
public:
    using Handler = std::function<void(const Event&)>;

    void setHandler(Handler handler) { handler_ = std::move(handler); }
    void push(Event event) { events_.push_back(std::move(event)); }
    /// Queues an error that answers no request.
    void report(Error error);
    /// Calls the handler for all queued events. The handler may call any function of the client. A
    /// call from within the handler does nothing: the outer call dispatches the following events.
    void dispatch();
    [[nodiscard]] bool isDispatching() const { return dispatching_; }

private:
    std::deque<Event> events_;
    Handler handler_;
    bool dispatching_ = false;
};

}  // namespace usdlive::client
