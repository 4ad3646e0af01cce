#pragma once

#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

/// The kind of such a spec in the protocol; nothing: it has none (mappers, expressions, targets).
[[nodiscard]] std::optional<SpecKind> specKind(pxr::SdfSpecType type);

/// What an editor wrote into a layer, in the order it was written. Called from within Sdf, before
/// the change stands in the layer, on whatever thread writes; must not touch the layer.
class LayerWriteObserver {
public:
    virtual ~LayerWriteObserver() = default;
    virtual void specCreated(const pxr::SdfPath& path, pxr::SdfSpecType type) = 0;
    virtual void specDeleted(const pxr::SdfPath& path) = 0;
    virtual void specMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) = 0;
    /// `parent`'s list of children `field` was written or grew.
    virtual void childrenChanged(const pxr::SdfPath& parent, const pxr::TfToken& field,
                                 bool appended) = 0;
    virtual void fieldChanged(const pxr::SdfPath& path, const pxr::TfToken& field) = 0;
    virtual void dictionaryKeyChanged(const pxr::SdfPath& path, const pxr::TfToken& field,
                                      const pxr::TfToken& keyPath) = 0;
    virtual void timeSampleChanged(const pxr::SdfPath& path, double time) = 0;
    /// An array is written, as a field or as the sample of a time; fieldChanged() or
    /// timeSampleChanged() follows.
    virtual void arrayWritten(const pxr::SdfPath& /*path*/, const pxr::TfToken& /*field*/,
                              std::optional<double> /*time*/, const pxr::VtValue& /*array*/) {}
};

/// A real SdfLayer as a store of edits: applies the edits of others to it, and tells an observer
/// what the editor itself writes. It does so as the layer's state delegate, of which a layer has
/// one.
///
/// Lives as long as the layer is live; belongs to the thread that owns the layer. Applying edits
/// sends Sdf's usual notices (wrap several in one SdfChangeBlock) and never reaches the observer.
class SdfLayerStore {
public:
    /// Installs itself on the layer. `observer` may be nullptr (a server, a test). An existing
    /// foreign delegate is replaced; restored at destruction.
    SdfLayerStore(pxr::SdfLayerHandle layer, BlobSource& blobs, LayerWriteObserver* observer);
    ~SdfLayerStore();
    SdfLayerStore(const SdfLayerStore&) = delete;
    SdfLayerStore& operator=(const SdfLayerStore&) = delete;

    [[nodiscard]] const pxr::SdfLayerHandle& layer() const;

    /// Applies one edit (absolute path). A field whose blob is not here yet is left as it is and
    /// remembered; see blobArrived(). Errors as LayerDoc::apply, and InvalidPath / UnsupportedValue
    /// for what this OpenUSD cannot hold; then nothing was changed.
    Result<void> apply(std::string_view path, const EditAction& action);

    /// Sets the fields that waited for this blob and still want it: `current` tells what the model
    /// holds at (path, field) now.
    void blobArrived(const Hash& hash,
                     const std::function<const FieldValue*(const std::string& path,
                                                           const std::string& field)>& current);
    [[nodiscard]] bool waitsForBlobs() const;
    [[nodiscard]] bool waitsFor(const Hash& hash) const;

    /// The content of one field as it stands in the layer; nothing when absent. `subLayers` comes
    /// with its offsets (`subLayerOffsets` is never asked for or told).
    [[nodiscard]] Result<std::optional<FieldValue>> read(const pxr::SdfPath& path,
                                                         const pxr::TfToken& field,
                                                         BlobSink& blobs) const;

private:
    class Applier;
    class Delegate;
    friend class LayerFill;
    pxr::TfRefPtr<Delegate> delegate_;
};

/// Fields of Sdf that are not fields of the model: the lists of children, `subLayerOffsets`
/// (part of `subLayers`).
[[nodiscard]] bool isStructural(const pxr::TfToken& field);

/// A whole layer into a LayerDoc. Errors name path and field; specs that are no specs of the model
/// (mappers, expressions) with content are UnsupportedValue.
[[nodiscard]] Result<LayerDoc> readLayer(const pxr::SdfLayerHandle& layer, BlobSink& blobs);
/// Whether readLayer() would give `doc`. Makes no second copy of the content, and one of no array
/// of numbers.
[[nodiscard]] bool holds(const pxr::SdfLayerHandle& layer, const LayerDoc& doc);

}  // namespace usdlive::usd
