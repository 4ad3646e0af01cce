// Reads layers in the background while an editor's frame must not wait for a provider.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "EdfData.h"

namespace usdlive::edf {

/// The content of a layer, or the reason why there is none.
struct ReadResult {
    EdfDataRefPtr data;
    std::string reason;
};

/// The reads of all layers of the process. Outside of a tick, a read is a plain call. While a live
/// client is in its tick, a read runs on a thread, and a later tick loads the layer again when the
/// content is here (docs/decisions/0019-a-tick-composes-what-is-here.md). Any thread.
class LateReads {
public:
    using Read = std::function<ReadResult()>;

    static LateReads& ofProcess();

    /// Between these calls, read() does not wait, whichever thread calls it: composition uses
    /// threads of its own. The calls nest.
    void beginTick();
    void endTick();
    /// Loads the layers again whose content has arrived since a tick of this thread needed it; one
    /// after the other, so that many of them take several ticks. Call it within a tick and outside
    /// of change blocks.
    void reloadArrived();

    /// Returns the content of the layer. Returns nothing if this is within a tick and the content
    /// is not here after a moment; reloadArrived() reads the layer again then. `read` must own what
    /// it uses. It is not called if a read for the same identifier is under way, unless that layer
    /// is loaded again within a tick, because a file that it depends on may have changed since.
    std::optional<ReadResult> read(const pxr::SdfLayerHandle& layer, const std::string& provider,
                                   Read read);
    /// Within a tick, starts `read` as read() does, and returns true. Otherwise returns false.
    bool postpone(const pxr::SdfLayerHandle& layer, const std::string& provider, Read read);

    /// Call it when the layer could not be read: ticks try again, from time to time, and load the
    /// layer again when a read succeeds.
    void failed(const pxr::SdfLayerHandle& layer, const std::string& provider, Read read);
    /// Call it when the layer was read.
    void succeeded(const pxr::SdfLayerHandle& layer);

private:
    using Clock = std::chrono::steady_clock;
    struct Tick {
        int depth = 0;
        std::optional<Clock::time_point> waitsUntil;  // set by its first read
    };
    struct Pending {
        pxr::SdfLayerHandle layer;
        std::thread::id owner;  // the thread whose tick needed it
        Read read;              // empty once it has begun
        std::optional<ReadResult> result;
        bool isBeingReloaded = false;  // by reloadArrived()
    };
    struct Failed {
        pxr::SdfLayerHandle layer;
        std::string provider;
        Read read;
        Clock::duration pause;
        Clock::time_point due;  // for the next try; max(): one is under way
    };
    using PendingPtr = std::shared_ptr<Pending>;
    struct Queue {
        std::deque<PendingPtr> waiting;
        int threads = 0;
    };

    /// Returns the read of the layer that is under way, or starts one. Requires a tick.
    PendingPtr withinTick(const pxr::SdfLayerHandle& layer, const std::string& provider, Read read);
    /// Returns the next read that has ended, for reloadArrived(). Null if there is none.
    std::pair<PendingPtr, pxr::SdfLayerHandle> nextArrived();
    void forget(const PendingPtr& pending);
    void tryAgain();
    /// Returns whether this was another failed read of a layer; it has nothing to load.
    bool failedAgain(const std::string& identifier, const Pending& pending);
    void start(const std::string& provider, const PendingPtr& pending);
    void work(const std::string& provider);
    void end(const PendingPtr& pending, ReadResult result);
    [[nodiscard]] Clock::time_point waitsUntil(std::thread::id owner);

    std::mutex mutex_;  // guards all members below
    std::condition_variable ended_;
    std::map<std::thread::id, Tick> ticks_;
    std::map<std::string, PendingPtr> pending_;  // by the identifier of the layer
    std::map<std::string, Failed> failed_;       // by the identifier of the layer
    std::map<std::string, Queue> queues_;        // by the id of the provider
};

}  // namespace usdlive::edf
