// An SdfLayer that is live.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usd/live/ApartEdits.h"
#include "usd/live/BackgroundFill.h"
#include "usd/live/Capture.h"
#include "usd/live/EditPermission.h"
#include "usd/live/UsedAssets.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::client {

/// An SdfLayer that is live or becoming live.
///
/// At first it has no content and the editor may not edit it (Sdf reports its own clear error).
/// reset() starts to build the content by a worker, and fill() puts it in. From then on the editor
/// may write, and its writes are captured. This object keeps the layer in memory.
class LiveLayer final : public pxr::TfWeakBase {
public:
    struct Dependencies {
        BlobSource& source;
        BlobSource& workerSource;  ///< the same for any thread; missing values are not requested
        BlobSink& sink;
        Worker& worker;
        /// Returns the session's view of the layer.
        std::function<const LayerDoc*()> view;
        /// Called when the layer cannot show some content, so that it differs from the project.
        std::function<void(Error)> report;
        /// Called by any thread when isIdle() becomes false.
        std::function<void()> wake;
        /// Called with the asset paths of value clips that the editor writes, before Sdf notifies
        /// of them.
        Capture::Named clipsWritten;
        /// Called with the asset paths of layers that the editor names anew, before Sdf notifies of
        /// them.
        Capture::Named layersNamed = [](const auto&) {};
    };

    LiveLayer(LayerId id, pxr::SdfLayerRefPtr layer, Dependencies dependencies);
    /// The layer keeps its content and the permission that the editor has set.
    ~LiveLayer();

    [[nodiscard]] const LayerId& id() const { return id_; }
    [[nodiscard]] const pxr::SdfLayerRefPtr& layer() const { return layer_; }
    /// Returns whether the layer has all its content and the editor may write.
    [[nodiscard]] bool isFilled() const { return store_ && !fill_; }
    /// Returns the session's view of the layer if isFilled(), otherwise nullptr.
    [[nodiscard]] const LayerDoc* content() const {
        return isFilled() ? dependencies_.view() : nullptr;
    }

    /// Call it when another user has locked or unlocked the layer (LK1), or the user's role has
    /// changed (AC3). While edits are forbidden, `permissionToEdit` is false and Sdf refuses edits
    /// of the editor. Afterwards the editor's own setting applies again.
    void setForbidden(bool forbidden) { permission_.setForbidden(forbidden); }
    /// Returns whether a tick has nothing to do for this layer until `wake` is called.
    [[nodiscard]] bool isIdle() const;

    /// Receives a part of a snapshot (LayerView), so that the worker can start building the content
    /// before reset().
    void arriving(std::shared_ptr<const SnapshotPart> part);
    void arrived(const LayerDoc& snapshot);
    /// Replaces all content. Edits of apply() wait until it is built.
    void reset(const LayerDoc& doc);
    /// Edits of `expressionVariables` and `subLayers` wait for applyApart(). The others are
    /// complete at the end of the block.
    void apply(const std::string& path, const EditAction& action, usd::SdfLayerStore::Block& block);
    /// Returns whether edits wait for applyApart().
    [[nodiscard]] bool hasApart() const { return !apart_.isEmpty(); }
    /// Applies the next of these edits. Call it in a change block of its own for each time.
    void applyApart();
    [[nodiscard]] bool isFilling() const { return fill_ != nullptr; }
    /// Returns whether content is being built for a layer that had content before.
    [[nodiscard]] bool isRefilling() const { return store_ && fill_; }
    /// Puts the content in if it is built. Never waits.
    void fill();

    [[nodiscard]] bool hasWrites() const;
    /// Calls Capture::seal(). Precondition: the client has no open change block.
    [[nodiscard]] Capture::Sealed seal();
    /// Calls Capture::appendBigArrays().
    void appendBigArrays(std::vector<pxr::VtValue>& arrays) const {
        if (isFilled()) capture_.appendBigArrays(arrays);
    }

    /// Lets Sdf notify of the field as if this item had been removed and added again. The content
    /// stays as it is. Precondition: not hasWrites().
    void notify(const std::string& path, const std::string& field, const ListItem& item);
    /// Takes a field out of the layer until restore() or the end of this object, which is no edit.
    /// Precondition: not hasWrites().
    void takeOut(const std::string& path, const std::string& field);
    void restore();

    void blobArrived(const Hash& hash);
    [[nodiscard]] bool waitsForBlobs() const { return store_ && store_->waitsForBlobs(); }
    [[nodiscard]] bool waitsFor(const Hash& hash) const { return store_ && store_->waitsFor(hash); }

    /// The layers and clips that this layer names.
    [[nodiscard]] const UsedAssets& uses() const { return uses_; }
    /// Returns the asset paths that this layer has got since the last call. Precondition: there is
    /// no open block of apply().
    [[nodiscard]] usd::LayerFill::Named takeNamed() { return uses_.take(layer_); }
    /// Returns whether the layers that this layer uses may have changed since the last
    /// takeUsesChanged().
    [[nodiscard]] bool usesChanged() const { return usesChanged_; }
    [[nodiscard]] bool takeUsesChanged() { return std::exchange(usesChanged_, false); }
    /// Returns whether the editor has saved the layer to its file since the last call.
    [[nodiscard]] bool takeSaved() { return std::exchange(saved_, false); }

private:
    struct Waiting {
        std::string path;
        EditAction action;
    };

    void startOver();
    void reloaded();
    void noteUses();
    void noteNames(const std::string& path, const EditAction& action);
    [[nodiscard]] Capture::Sealed sealMuted();
    [[nodiscard]] std::unique_ptr<BackgroundFill> newFill();
    using Block = usd::SdfLayerStore::Block;
    void applyNow(const std::string& path, const EditAction& action, Block& block);
    void write(const std::string& path, const EditAction& action, Block& block);
    void onReplaced(const pxr::SdfNotice::LayerDidReplaceContent& notice);
    void onMuteness(const pxr::SdfNotice::LayerMutenessChanged& notice);
    void onSaved(const pxr::SdfNotice::LayerDidSaveLayerToFile& notice);
    void onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice);

    const LayerId id_;
    const pxr::SdfLayerRefPtr layer_;
    const Dependencies dependencies_;
    Capture capture_;
    std::unique_ptr<usd::SdfLayerStore> store_;  // set when the layer gets its first content
    std::unique_ptr<BackgroundFill> arriving_;
    std::optional<LayerDoc> snapshot_;  // the doc of arriving_, when it is complete
    std::unique_ptr<BackgroundFill> fill_;
    std::vector<Waiting> waiting_;  // edits that wait for fill_
    ApartEdits apart_;              // wait for applyApart()
    EditPermission permission_;     // closed until the layer has all content
    // The client has replaced the content. Sdf notifies of it later, at the end of the change
    // block.
    bool expectsReplacement_ = false;
    bool startOver_ = false;           // the layer was reloaded or muted: the change is not an edit
    bool written_ = false;             // notices have arrived for writes since the last seal()
    bool reloadedWritten_ = false;     // it was reloaded then; not reported yet
    bool writtenBeforeMuted_ = false;  // written before the mute, and not sealed yet
    std::vector<std::pair<std::string, std::string>> takenOut_;  // paths and fields
    UsedAssets uses_;
    bool usesChanged_ = false;
    bool saved_ = false;
    pxr::TfNotice::Key replacedKey_;
    pxr::TfNotice::Key mutenessKey_;
    pxr::TfNotice::Key savedKey_;
    pxr::TfNotice::Key changedKey_;
};

}  // namespace usdlive::client
