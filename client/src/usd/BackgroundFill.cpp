#include "usdlive/client/usd/BackgroundFill.h"

#include <atomic>

#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::client {

namespace {

class FillFromRecords final : public SnapshotRecords {
public:
    explicit FillFromRecords(usd::LayerFill& fill) : fill_(fill) {}

    Result<void> spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                      std::string_view name) override {
        return fill_.addSpec(node, parent, order, kind, name);
    }
    Result<void> field(std::string_view name, FieldValue value) override {
        fill_.addField(name, value);
        return {};
    }

private:
    usd::LayerFill& fill_;
};

}  // namespace

// The worker's as long as something is under way, then the owner's.
struct BackgroundFill::Job {
    Job(const pxr::SdfLayerHandle& layer, usd::BlobSource& blobs) : fill(layer, blobs) {}

    usd::LayerFill fill;
    FillFromRecords records{fill};
    SnapshotReader reader{records};
    bool failed = false;

    std::atomic<int> underWay = 0;
    std::atomic<bool> dropped = false;
};

BackgroundFill::BackgroundFill(const pxr::SdfLayerHandle& layer, usd::BlobSource& blobs,
                               Worker& worker)
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

void BackgroundFill::add(std::shared_ptr<const SnapshotFrame> chunk) {
    post([chunk = std::move(chunk)](Job& job) { job.failed = !job.reader.add(*chunk); });
}

bool BackgroundFill::isDone() const { return job_->underWay == 0; }
bool BackgroundFill::hasFailed() const { return job_->failed; }
bool BackgroundFill::namesLayers() const { return job_->fill.namesLayers(); }
Result<void> BackgroundFill::into(usd::SdfLayerStore& store) { return job_->fill.into(store); }

}  // namespace usdlive::client
