// Applies edits to an SdfLayer, observes its editor, and reads whole layers.
#pragma once

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

/// Returns the protocol's kind of such a spec, or nothing for mappers, expressions and targets.
[[nodiscard]] std::optional<SpecKind> specKind(pxr::SdfSpecType type);

/// Receives an editor's writes to a layer, in order. Called from within Sdf, before the layer has
/// changed, on the thread that writes. Must not access the layer.
class LayerWriteObserver {
public:
    virtual ~LayerWriteObserver() = default;
    virtual void specCreated(const pxr::SdfPath& path, pxr::SdfSpecType type) = 0;
    virtual void specDeleted(const pxr::SdfPath& path) = 0;
    virtual void specMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) = 0;
    /// A list of children of `parent` was written, or extended if `appended`.
    virtual void childrenChanged(const pxr::SdfPath& parent, const pxr::TfToken& field,
                                 bool appended) = 0;
    virtual void fieldChanged(const pxr::SdfPath& path, const pxr::TfToken& field) = 0;
    virtual void dictionaryKeyChanged(const pxr::SdfPath& path, const pxr::TfToken& field,
                                      const pxr::TfToken& keyPath) = 0;
    virtual void timeSampleChanged(const pxr::SdfPath& path, double time) = 0;
    /// An array is written as a field, or as a sample if `time` is set. fieldChanged() or
    /// timeSampleChanged() follows.
    virtual void arrayWritten(const pxr::SdfPath& /*path*/, const pxr::TfToken& /*field*/,
                              std::optional<double> /*time*/, const pxr::VtValue& /*array*/) {}
    /// Called by SdfLayerStore::placeMoved(). `to` is empty if the object was deleted.
    virtual void placeMoved(const pxr::SdfPath& /*from*/, const pxr::SdfPath& /*to*/) {}
    /// A field that names value clips is written, or a key of it with this value. fieldChanged() or
    /// dictionaryKeyChanged() follows.
    virtual void clipsWritten(const pxr::VtValue& /*value*/) {}
    /// A field gets asset paths of layers that it did not name (namesLayers()). fieldChanged()
    /// follows.
    virtual void layersNamed(const std::set<std::string>& /*assets*/) {}
};

/// Applies edits to an SdfLayer and notifies an observer of the editor's own writes. Works as the
/// layer's state delegate, and a layer has only one.
///
/// Keep it while the layer is live. Use it on the thread that owns the layer. Applied edits send
/// the usual notices of Sdf (use one SdfChangeBlock around several) and never reach the observer.
class SdfLayerStore {
    class Delegate;

public:
    /// A change block for many edits of any layers, which takes linear time. Changes of a list of
    /// children, and of the parts of a field, wait until it ends, before Sdf sends its notices.
    class Block {
    public:
        Block();
        ~Block();
        Block(const Block&) = delete;
        Block& operator=(const Block&) = delete;

    private:
        friend class SdfLayerStore;
        const pxr::SdfChangeBlock block_;
        std::vector<pxr::TfRefPtr<Delegate>> delegates_;  // with edits that may wait
    };

    /// Installs itself on the layer. `observer` may be nullptr (a server, a test). Replaces an
    /// existing delegate; the destructor restores it.
    SdfLayerStore(pxr::SdfLayerHandle layer, BlobSource& blobs, LayerWriteObserver* observer);
    ~SdfLayerStore();
    SdfLayerStore(const SdfLayerStore&) = delete;
    SdfLayerStore& operator=(const SdfLayerStore&) = delete;

    [[nodiscard]] const pxr::SdfLayerHandle& layer() const;

    /// Tells the observer of a layer that the editor has moved the object of a stage at this place,
    /// or deleted it if `to` is empty (M15). Call it in the change block and after the changes of
    /// the layer itself. Does nothing for a layer without a store.
    static void placeMoved(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& from,
                           const pxr::SdfPath& to);

    /// Applies one edit with an absolute path. If the blob of a field is missing, the field stays
    /// as it is until blobArrived(). Errors are those of LayerDoc::apply(), and InvalidPath or
    /// UnsupportedValue for content that this OpenUSD does not support. An error changes nothing.
    Result<void> apply(std::string_view path, const EditAction& action);
    Result<void> apply(std::string_view path, const EditAction& action, Block& block);

    /// Sets the fields that waited for this blob and still need it. `current` returns the field's
    /// present content in the model.
    void blobArrived(const Hash& hash,
                     const std::function<const FieldValue*(const std::string& path,
                                                           const std::string& field)>& current);
    [[nodiscard]] bool waitsForBlobs() const;
    [[nodiscard]] bool waitsFor(const Hash& hash) const;

    /// Returns the content of one field of the layer, or nothing if it is absent. `subLayers`
    /// includes its offsets; `subLayerOffsets` is never used as a field.
    [[nodiscard]] Result<std::optional<FieldValue>> read(const pxr::SdfPath& path,
                                                         const pxr::TfToken& field,
                                                         BlobSink& blobs) const;

private:
    class Applier;
    friend class LayerFill;
    pxr::TfRefPtr<Delegate> delegate_;
};

/// Returns true for fields of Sdf that are no fields of the model: lists of children, and
/// `subLayerOffsets` (part of `subLayers`).
[[nodiscard]] bool isStructural(const pxr::TfToken& field);

/// Reads a whole layer into a LayerDoc. Errors name the path and the field. Specs with content that
/// the model does not have (mappers, expressions) give UnsupportedValue.
[[nodiscard]] Result<LayerDoc> readLayer(const pxr::SdfLayerHandle& layer, BlobSink& blobs);
/// Returns true if readLayer() would return `doc`, without a second copy of the content.
[[nodiscard]] bool holds(const pxr::SdfLayerHandle& layer, const LayerDoc& doc);

}  // namespace usdlive::usd
