// Queues events for the editor and dispatches them.
#include "link/EditorEvents.h"

#include "basics/Raised.h"

namespace usdlive::client {

void EditorEvents::report(Error error) {
    ErrorMessage message;
    message.code = errorName(error.code);
    message.message = std::move(error.message);
    push(event::ServerError{std::move(message)});
}

void EditorEvents::dispatch() {
    if (dispatching_) return;
    const Raised dispatching(dispatching_);
    while (!events_.empty()) {
        const Event one = std::move(events_.front());
        events_.pop_front();
        // A copy: the handler may set another one.
        if (const auto handler = handler_) handler(one);
    }
}

}  // namespace usdlive::client
