// Builds the content of a layer by a worker.
#include "usd/live/BackgroundFill.h"

#include <algorithm>
#include <atomic>

#include "usdlive/common/core/Overloaded.h"

namespace usdlive::client {

namespace {

// Returns false if the part does not follow the parts that were added before.
bool addPart(usd::LayerFill& fill, const SnapshotPart& part) {
    const Overloaded add{
        [&](const SnapshotPart::Spec& spec) {
            return bool(fill.addSpec(spec.node, spec.parent, spec.order, spec.kind, spec.name));
        },
        [&](const SnapshotPart::Field& field) {
            fill.addField(field.name, field.value);
            return true;
        }};
    return std::ranges::all_of(part.records,
                               [&](const auto& record) { return std::visit(add, record); });
}

}  // namespace

// Used by the worker while it builds, afterwards by the owner.
struct BackgroundFill::Job {
    Job(const pxr::SdfLayerHandle& layer, BlobSource& blobs) : fill(layer, blobs) {}

    usd::LayerFill fill;
    bool failed = false;

    std::atomic<int> underWay = 0;
    std::atomic<bool> dropped = false;
};

BackgroundFill::BackgroundFill(const pxr::SdfLayerHandle& layer, BlobSource& blobs, Worker& worker)
    : worker_(worker), job_(std::make_shared<Job>(layer, blobs)) {}

BackgroundFill::~BackgroundFill() { job_->dropped = true; }

template <class Task>
void BackgroundFill::post(Task task) {
    ++job_->underWay;
    worker_.post([job = job_, task = std::move(task)] {
        if (!job->dropped && !job->failed) task(*job);
        --job->underWay;
    });
}

void BackgroundFill::add(const LayerDoc& doc) {
    if (doc.specCount() <= kMadeAtOnce) return job_->fill.add(doc);
    post([doc](Job& job) { job.fill.add(doc); });
}

void BackgroundFill::add(std::shared_ptr<const SnapshotPart> part) {
    post([part = std::move(part)](Job& job) { job.failed = !addPart(job.fill, *part); });
}

bool BackgroundFill::isDone() const { return job_->underWay == 0; }
bool BackgroundFill::hasFailed() const { return job_->failed; }
const usd::LayerFill::Named& BackgroundFill::named() const { return job_->fill.named(); }
Result<void> BackgroundFill::into(usd::SdfLayerStore& store) { return job_->fill.into(store); }

}  // namespace usdlive::client
