#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "usd/BackgroundFill.h"
#include "usd/Capture.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::client {

/// One SdfLayer that is live, or on its way there.
///
/// It begins without content and closed to the editor (Sdf answers edits with its own clear error).
/// reset() gives it content, which a worker makes and fill() then brings in; from then on the
/// editor may write, and what it writes is captured. The layer is kept in memory as long as this
/// lives.
class LiveLayer final : public pxr::TfWeakBase {
public:
    struct Surroundings {
        usd::BlobSource& source;
        usd::BlobSource& workerSource;  ///< the same for any thread; what is not there stays so
        usd::BlobSink& sink;
        Worker& worker;
        /// What the session shows of the layer.
        std::function<const LayerDoc*()> view;
        /// The layer cannot show what it should; it differs from the project there.
        std::function<void(Error)> report;
        /// Any thread: isIdle() has become false.
        std::function<void()> wake;
    };

    LiveLayer(LayerId id, pxr::SdfLayerRefPtr layer, Surroundings surroundings);
    /// The layer keeps its content and its editor's permission.
    ~LiveLayer();

    [[nodiscard]] const LayerId& id() const { return id_; }
    [[nodiscard]] const pxr::SdfLayerRefPtr& layer() const { return layer_; }
    /// All content is in and the editor may write.
    [[nodiscard]] bool isFilled() const { return store_ && !fill_; }

    /// Somebody else's lock holds the layer (LK1): Sdf answers edits of the editor with its own
    /// error, `permissionToEdit` is false. What the editor had set holds again afterwards.
    void setLockedByOther(bool locked);
    /// There is nothing for a tick to do, until `wake` is called.
    [[nodiscard]] bool isIdle() const;

    /// As LayerView: content that a reset() will be about. The worker begins with it.
    void arriving(std::shared_ptr<const SnapshotPart> part);
    void arrived(const LayerDoc& snapshot);
    /// All content anew. What comes to apply() meanwhile waits for it.
    void reset(const LayerDoc& doc);
    void apply(const std::string& path, const EditAction& action);
    [[nodiscard]] bool isFilling() const { return fill_ != nullptr; }
    /// Content is being made for a layer that had some before.
    [[nodiscard]] bool isRefilling() const { return store_ && fill_; }
    /// Brings the content in once it is made; never waits.
    void fill();

    [[nodiscard]] bool hasWrites() const;
    /// Precondition: not within a change block of ours.
    [[nodiscard]] Capture::Sealed seal();
    /// As Capture::appendBigArrays().
    void appendBigArrays(std::vector<pxr::VtValue>& arrays) const {
        if (isFilled()) capture_.appendBigArrays(arrays);
    }

    void blobArrived(const Hash& hash);
    [[nodiscard]] bool waitsFor(const Hash& hash) const { return store_ && store_->waitsFor(hash); }

    /// False: the layer names no others, for sure. Sdf looks at every spec to tell which.
    [[nodiscard]] bool namesLayers() const { return namesLayers_; }
    /// Composition changed what the layer uses, since the last takeUsesChanged().
    [[nodiscard]] bool usesChanged() const { return usesChanged_; }
    [[nodiscard]] bool takeUsesChanged() { return std::exchange(usesChanged_, false); }
    /// The editor itself has written the layer to its file, since the last call.
    [[nodiscard]] bool takeSaved() { return std::exchange(saved_, false); }

private:
    struct Waiting {
        std::string path;
        EditAction action;
    };

    void setPermission(bool closed, bool lockedByOther);
    void startOver();
    void noteUses();
    void noteNames(const EditAction& action);
    [[nodiscard]] Capture::Sealed sealMuted();
    [[nodiscard]] std::unique_ptr<BackgroundFill> newFill();
    void applyNow(const std::string& path, const EditAction& action);
    void onReplaced(const pxr::SdfNotice::LayerDidReplaceContent& notice);
    void onMuteness(const pxr::SdfNotice::LayerMutenessChanged& notice);
    void onSaved(const pxr::SdfNotice::LayerDidSaveLayerToFile& notice);

    const LayerId id_;
    const pxr::SdfLayerRefPtr layer_;
    const Surroundings surroundings_;
    Capture capture_;
    std::unique_ptr<usd::SdfLayerStore> store_;  // from the first content on
    std::unique_ptr<BackgroundFill> arriving_;
    std::optional<LayerDoc> snapshot_;  // what arriving_ makes, once all has arrived
    std::unique_ptr<BackgroundFill> fill_;
    std::vector<Waiting> waiting_;  // as long as fill_ works
    // The editor may write unless one of the next two is true; then what it may is what it had set.
    bool closed_ = false;  // until all content is in
    bool lockedByOther_ = false;
    bool permitted_ = true;  // what the editor had set before
    // Sdf tells of a replaced content at the end of a change block, so that ours has to be known
    // again.
    bool expectsReplacement_ = false;
    bool startOver_ =
        false;  // the layer was reloaded or muted: its content is not the editor's work
    bool writtenBeforeMuted_ = false;  // and not sealed yet
    bool usesChanged_ = false;
    bool namesLayers_ = false;
    bool saved_ = false;
    pxr::TfNotice::Key replacedKey_;
    pxr::TfNotice::Key mutenessKey_;
    pxr::TfNotice::Key savedKey_;
};

}  // namespace usdlive::client
