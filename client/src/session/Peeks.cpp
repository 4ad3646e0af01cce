// Reads layers without joining them.
#include "session/Peeks.h"

#include <algorithm>

namespace usdlive::client {

void Peeks::ask(const LayerId& layer, Revision revision, Done done) {
    const OpenLayer open{requests_.nextNumber(), layer, revision};
    if (const auto refused = requests_.whyNot(open.request, open.kType))
        return done(tl::unexpected(toError(*refused)), 0);
    peeks_.push_back({layer, revision, {open.request, {}, {}}, std::move(done)});
    requests_.add(open, [this, open](const auto& outcome) {
        const auto peek = std::ranges::find(peeks_, open.request,
                                            [](const Peek& one) { return one.snapshot.request; });
        if (outcome || peek == peeks_.end()) return;
        const auto failed = std::move(peek->done);
        peeks_.erase(peek);
        failed(tl::unexpected(toError(outcome.error())), 0);
    });
    channel_.send(open);
}

void Peeks::received(const LayerOpened& message) {
    for (Peek& peek : peeks_)
        if (peek.snapshot.request == message.request) peek.snapshot.opened = message;
}

void Peeks::received(ReceivedSnapshot& received) {
    for (Peek& peek : peeks_) {
        if (peek.snapshot.request != received.request) continue;
        peek.snapshot.content = std::move(received.whole);
        events_.push(event::Progress{event::Progress::Task::Fetch, peek.layer, received.specs,
                                     peek.snapshot.specs(), received.request});
    }
}

void Peeks::complete() {
    for (std::size_t index = 0; index < peeks_.size();) {
        Incoming& snapshot = peeks_[index].snapshot;
        if (!snapshot.isComplete()) {
            ++index;
            continue;
        }
        Peek peek = std::move(peeks_[index]);
        peeks_.erase(peeks_.begin() + std::ptrdiff_t(index));
        requests_.forget(peek.snapshot.request);
        if (peek.revision == 0 && channel_.isOnline() && !opened_.contains(peek.layer))
            channel_.send(CloseLayer{peek.layer});
        peek.done(std::move(*peek.snapshot.content), peek.snapshot.opened->revision);
    }
}

}  // namespace usdlive::client
