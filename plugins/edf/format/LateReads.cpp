// Reads layers in the background while an editor's frame must not wait for a provider.
#include "LateReads.h"

#include <algorithm>

#include "GuardedCall.h"

namespace usdlive::edf {

namespace {

// How long all reads of one tick wait together, and the time for composing what has arrived. A
// provider that only computes answers within this time, and its payload does not blink when
// somebody drags a parameter.
constexpr std::chrono::milliseconds kMoment{8};
// Reads of one provider at the same time. Further ones wait for a thread.
constexpr int kMaxThreads = 4;
// After this time a layer that could not be read is tried again, then after twice the time each.
constexpr std::chrono::seconds kFirstPause{2}, kLongestPause{60};

}  // namespace

// Never destroyed: its threads may run while the process exits.
LateReads& LateReads::ofProcess() {
    static LateReads& reads = *new LateReads;
    return reads;
}

void LateReads::beginTick() {
    const std::lock_guard lock(mutex_);
    ++ticks_[std::this_thread::get_id()].depth;
}

void LateReads::endTick() {
    const std::lock_guard lock(mutex_);
    const auto tick = ticks_.find(std::this_thread::get_id());
    if (tick != ticks_.end() && --tick->second.depth == 0) ticks_.erase(tick);
}

void LateReads::reloadArrived() {
    const auto end = Clock::now() + kMoment;
    tryAgain();
    do {
        const auto [arrived, layer] = nextArrived();
        if (!arrived) return;
        pxr::SdfLayer::ReloadLayers({layer}, /* force = */ true);
        // Sdf does not read muted layers.
        const std::lock_guard lock(mutex_);
        forget(arrived);
    } while (Clock::now() < end);
}

std::pair<LateReads::PendingPtr, pxr::SdfLayerHandle> LateReads::nextArrived() {
    const std::lock_guard lock(mutex_);
    std::erase_if(pending_, [this](const auto& one) {
        // Nobody uses the layer any more, or there is no news.
        return one.second->result && (!one.second->layer || failedAgain(one.first, *one.second));
    });
    const auto self = std::this_thread::get_id();
    const auto found = std::ranges::find_if(
        pending_, [&](const auto& one) { return one.second->result && one.second->owner == self; });
    if (found == pending_.end()) return {};
    found->second->isBeingReloaded = true;
    return {found->second, found->second->layer};
}

void LateReads::tryAgain() {
    const std::lock_guard lock(mutex_);
    std::erase_if(failed_, [](const auto& one) { return !one.second.layer; });
    const auto now = Clock::now();
    for (auto& [identifier, one] : failed_) {
        if (now < one.due || pending_.contains(identifier)) continue;
        one.due = Clock::time_point::max();
        withinTick(one.layer, one.provider, one.read);
    }
}

bool LateReads::failedAgain(const std::string& identifier, const Pending& pending) {
    const auto found = failed_.find(identifier);
    if (found == failed_.end() || pending.result->reason.empty()) return false;
    Failed& one = found->second;
    if (one.due != Clock::time_point::max()) return false;
    one.pause = std::min<Clock::duration>(2 * one.pause, kLongestPause);
    one.due = Clock::now() + one.pause;
    return true;
}

void LateReads::failed(const pxr::SdfLayerHandle& layer, const std::string& provider, Read read) {
    const std::lock_guard lock(mutex_);
    failed_.insert_or_assign(
        layer->GetIdentifier(),
        Failed{layer, provider, std::move(read), kFirstPause, Clock::now() + kFirstPause});
}

void LateReads::succeeded(const pxr::SdfLayerHandle& layer) {
    const std::lock_guard lock(mutex_);
    failed_.erase(layer->GetIdentifier());
}

void LateReads::forget(const PendingPtr& pending) {
    std::erase_if(pending_, [&](const auto& one) { return one.second == pending; });
}

std::optional<ReadResult> LateReads::read(const pxr::SdfLayerHandle& layer,
                                          const std::string& provider, Read read) {
    const std::string identifier = layer->GetIdentifier();
    std::unique_lock lock(mutex_);
    PendingPtr pending;
    if (!ticks_.empty()) {
        if (const auto found = pending_.find(identifier); found != pending_.end()) {
            const Pending& old = *found->second;
            const bool hasBegun = !old.read, isSame = old.layer && old.layer == layer;
            if (hasBegun && isSame && !old.isBeingReloaded) pending_.erase(found);
        }
        pending = withinTick(layer, provider, std::move(read));
    } else if (const auto found = pending_.find(identifier); found != pending_.end()) {
        pending = found->second;
        pending->layer = layer;
    }
    if (!pending || (ticks_.empty() && pending->read)) {
        if (pending) pending->read = nullptr;  // no thread has begun with it: this one reads
        pending_.erase(identifier);
        lock.unlock();
        return read();
    }
    const auto isHere = [&] { return pending->result.has_value(); };
    if (ticks_.empty())
        ended_.wait(lock, isHere);
    else if (!ended_.wait_until(lock, waitsUntil(pending->owner), isHere))
        return std::nullopt;
    forget(pending);
    return pending->result;
}

bool LateReads::postpone(const pxr::SdfLayerHandle& layer, const std::string& provider, Read read) {
    const std::lock_guard lock(mutex_);
    if (ticks_.empty()) return false;
    withinTick(layer, provider, std::move(read));
    return true;
}

LateReads::PendingPtr LateReads::withinTick(const pxr::SdfLayerHandle& layer,
                                            const std::string& provider, Read read) {
    const auto self = std::this_thread::get_id();
    auto& pending = pending_[layer->GetIdentifier()];
    const bool isNew = !pending;
    if (isNew) pending = std::make_shared<Pending>();
    const PendingPtr found = pending;  // start() may change the map
    found->layer = layer;
    found->owner = ticks_.contains(self) ? self : ticks_.begin()->first;
    if (isNew) {
        found->read = std::move(read);
        start(provider, found);
    }
    return found;
}

// All reads of a tick share one moment, however many there are.
LateReads::Clock::time_point LateReads::waitsUntil(std::thread::id owner) {
    auto& until = ticks_[owner].waitsUntil;
    if (!until) until = Clock::now() + kMoment;
    return *until;
}

void LateReads::start(const std::string& provider, const PendingPtr& pending) {
    Queue& queue = queues_[provider];
    queue.waiting.push_back(pending);
    if (queue.threads == kMaxThreads) return;
    ++queue.threads;
    const auto problem = startDetached([this, provider] { work(provider); });
    if (problem.empty() || --queue.threads > 0) return;
    for (const auto& one : std::exchange(queue.waiting, {})) end(one, {nullptr, problem});
}

void LateReads::work(const std::string& provider) {
    std::unique_lock lock(mutex_);
    Queue& queue = queues_[provider];
    while (!queue.waiting.empty()) {
        const PendingPtr pending = queue.waiting.front();
        queue.waiting.pop_front();
        Read read = std::exchange(pending->read, nullptr);
        if (!read) continue;
        if (!pending->layer) {  // its arguments have changed again meanwhile
            forget(pending);
            continue;
        }
        lock.unlock();
        ReadResult result = read();
        // Composition needs the deferred parts as well.
        if (result.data) result.data->readAll();
        read = nullptr;
        lock.lock();
        end(pending, std::move(result));
    }
    --queue.threads;
}

void LateReads::end(const PendingPtr& pending, ReadResult result) {
    pending->read = nullptr;
    pending->result = std::move(result);
    ended_.notify_all();
}

}  // namespace usdlive::edf
