// Executes requests to open layers, tick by tick.
#include "usd/editor/OpenRequests.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

namespace {

// The time until the progress of a request is first reported, and between later reports (as in
// PG1).
constexpr std::int64_t kProgressEveryMs = 500;

}  // namespace

std::uint64_t OpenRequests::add(const LayerId& layer, LoadSet load, Reports reports) {
    Request request{{layer}, load, reports};
    request.reportAtMs = steadyMs() + kProgressEveryMs;
    requests_.emplace(++last_, std::move(request));
    unstarted_.push_back(last_);
    return last_;
}

std::uint64_t OpenRequests::addJoined(const std::vector<LayerId>& layers, LoadSet load) {
    Request request{{}, load, Reports::Outcome};
    for (const LayerId& layer : layers) see(request, layer);
    requests_.emplace(++last_, std::move(request));
    return last_;
}

bool OpenRequests::start(double budgetMs) {
    const Stopwatch watch;
    while (!unstarted_.empty()) {
        const auto found = requests_.find(unstarted_.front());
        unstarted_.pop_front();
        if (found == requests_.end()) continue;  // the layer was closed meanwhile
        const LayerId layer = found->second.asked.front();
        if (const auto opened = layers_.open(layer); !opened)
            end(found, opened);
        else
            see(found->second, layer);
        if (watch.ms() >= budgetMs) break;
    }
    return !unstarted_.empty();
}

bool OpenRequests::advance(double budgetMs) {
    const Stopwatch watch;
    const auto now = steadyMs();
    bool more = false;
    for (auto one = requests_.begin(); one != requests_.end();) {
        Request& request = one->second;
        if (request.seen.empty() || request.outcome) {
            ++one;
            continue;
        }
        if (!advance(request, watch, budgetMs)) {
            more = true;
            break;
        }
        if (isComplete(request)) {
            one = end(one, {});
            continue;
        }
        reportProgress(one->first, request, now);
        ++one;
    }
    return more;
}

void OpenRequests::see(Request& request, const LayerId& layer) {
    if (!request.seen.insert(layer).second) return;
    request.unfilled.insert(layer);
    request.unchecked.insert(layer);
    ++steps_;
}

bool OpenRequests::advance(Request& request, const Stopwatch& watch, double budgetMs) {
    // Also checks used layers that are filled already.
    for (bool found = true; found;) {
        found = false;
        for (auto one = request.unfilled.begin(); one != request.unfilled.end();) {
            LiveLayer* live = layers_.find(*one);
            if (live && !live->isFilled()) {
                ++one;
                continue;
            }
            one = request.unfilled.erase(one);
            ++steps_;
            if (!live) continue;
            for (const LayerId& used : layers_.openUsed(*live, request.load)) {
                found = found || !request.seen.contains(used);
                see(request, used);
            }
            if (watch.ms() >= budgetMs) return false;
        }
    }
    return true;
}

bool OpenRequests::isComplete(Request& request) const {
    if (!request.unfilled.empty()) return false;
    while (!request.unchecked.empty()) {
        const LiveLayer* live = layers_.find(*request.unchecked.begin());
        if (live && values_.isAwaitedBy(*live)) return false;
        request.unchecked.erase(request.unchecked.begin());
    }
    return true;
}

void OpenRequests::reportProgress(std::uint64_t number, Request& request, std::int64_t nowMs) {
    if (request.reports != Reports::Event || nowMs < request.reportAtMs) return;
    request.reportAtMs = nowMs + kProgressEveryMs;
    event::Progress progress;
    progress.task = event::Progress::Task::Open;
    progress.layer = request.asked.front();
    progress.done = request.seen.size() - request.unfilled.size();
    progress.total = request.seen.size();
    progress.request = number;
    events_.push(std::move(progress));
}

bool OpenRequests::has(const LayerId& layer) const {
    return std::ranges::any_of(requests_, [&](const auto& one) {
        return std::ranges::find(one.second.asked, layer) != one.second.asked.end();
    });
}

void OpenRequests::failed(const LayerId& layer, const Error& reason) { without(layer, reason); }

void OpenRequests::closed(const LayerId& layer) {
    without(layer,
            {ErrorCode::LayerNotOpen, layer.value + " was closed while it was being opened"});
}

void OpenRequests::without(const LayerId& layer, const Error& reason) {
    for (auto one = requests_.begin(); one != requests_.end();) {
        Request& request = one->second;
        const bool isAsked = std::ranges::find(request.asked, layer) != request.asked.end();
        if (isAsked && !request.outcome) {
            one = end(one, tl::unexpected(reason));
            continue;
        }
        request.unfilled.erase(layer);
        request.unchecked.erase(layer);
        ++one;
    }
}

std::optional<Result<void>> OpenRequests::takeOutcome(std::uint64_t request) {
    const auto found = requests_.find(request);
    if (found == requests_.end() || !found->second.outcome) return std::nullopt;
    auto outcome = std::move(found->second.outcome);
    requests_.erase(found);
    return outcome;
}

OpenRequests::Requests::iterator OpenRequests::end(Requests::iterator request,
                                                   Result<void> outcome) {
    ++steps_;
    const LayerId layer = request->second.asked.empty() ? LayerId() : request->second.asked.front();
    if (request->second.reports == Reports::Outcome) {
        request->second.outcome = std::move(outcome);
        return std::next(request);
    }
    if (outcome)
        events_.push(event::LayerOpened{request->first, layer});
    else
        events_.push(event::LayerOpenFailed{request->first, layer, outcome.error()});
    return requests_.erase(request);
}

}  // namespace usdlive::client
