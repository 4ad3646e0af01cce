// Builds the content of a layer by a worker.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>

#include "basics/Worker.h"
#include "session/MessageReader.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::client {

/// Builds the content of a layer by a worker, so that the editor is not blocked. Belongs to the
/// thread that owns the layer.
class BackgroundFill {
public:
    /// `blobs` is called by the worker and outlives it.
    BackgroundFill(const pxr::SdfLayerHandle& layer, BlobSource& blobs, Worker& worker);
    /// Cancels the remaining work.
    ~BackgroundFill();
    BackgroundFill(const BackgroundFill&) = delete;
    BackgroundFill& operator=(const BackgroundFill&) = delete;

    /// Adds either a whole doc or the parts of a snapshot in order. A doc of at most kMadeAtOnce
    /// specs takes a few milliseconds and is built at once.
    static constexpr std::size_t kMadeAtOnce = 2'000;
    void add(const LayerDoc& doc);
    void add(std::shared_ptr<const SnapshotPart> part);

    /// Returns whether everything that was added is built.
    [[nodiscard]] bool isDone() const;
    /// Returns whether a part did not fit the parts before it. Precondition: isDone().
    [[nodiscard]] bool hasFailed() const;
    /// Returns LayerFill::named(). Precondition: isDone().
    [[nodiscard]] const usd::LayerFill::Named& named() const;
    /// Calls LayerFill::into(). Call it once. Precondition: isDone() and not hasFailed().
    Result<void> into(usd::SdfLayerStore& store);

private:
    struct Job;
    template <class Task>
    void post(Task task);

    Worker& worker_;
    std::shared_ptr<Job> job_;
};

}  // namespace usdlive::client
