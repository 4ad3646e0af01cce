#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>

#include "session/MessageReader.h"
#include "usd/Worker.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::client {

/// The content of a layer, made by a worker while the editor goes on. Belongs to the thread that
/// owns the layer.
class BackgroundFill {
public:
    /// `blobs` is asked by the worker, and lives as long as that.
    BackgroundFill(const pxr::SdfLayerHandle& layer, usd::BlobSource& blobs, Worker& worker);
    /// What is not done is not done any more.
    ~BackgroundFill();
    BackgroundFill(const BackgroundFill&) = delete;
    BackgroundFill& operator=(const BackgroundFill&) = delete;

    /// Either a doc, or the parts of a snapshot in their order. A doc of at most kMadeAtOnce specs
    /// takes a few milliseconds: it is made here and now.
    static constexpr std::size_t kMadeAtOnce = 2'000;
    void add(const LayerDoc& doc);
    void add(std::shared_ptr<const SnapshotPart> part);

    /// All that was added is made.
    [[nodiscard]] bool isDone() const;
    /// A part does not go with those before it. Precondition: isDone().
    [[nodiscard]] bool hasFailed() const;
    /// As LayerFill::namesLayers(). Precondition: isDone().
    [[nodiscard]] bool namesLayers() const;
    /// As LayerFill::into(). Precondition: isDone() and not hasFailed(). Once.
    Result<void> into(usd::SdfLayerStore& store);

private:
    struct Job;
    template <class Task>
    void post(Task task);

    Worker& worker_;
    std::shared_ptr<Job> job_;
};

}  // namespace usdlive::client
