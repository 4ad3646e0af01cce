// Builds the whole content of an SdfLayer.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <string_view>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

class SdfLayerStore;

/// Builds the whole content of a layer apart from it, then puts it in with one change notice, so
/// that a big layer does not block its editor's frames.
///
/// May be built on any one thread. A field that cannot be set does not stop the rest: a field whose
/// blob is missing stays absent until `store.blobArrived`, and a field that this OpenUSD does not
/// support stays absent.
class LayerFill {
public:
    /// Construct it on the thread that owns `layer`. `blobs` is called on the thread that adds.
    LayerFill(const pxr::SdfLayerHandle& layer, BlobSource& blobs);
    ~LayerFill();
    LayerFill(const LayerFill&) = delete;
    LayerFill& operator=(const LayerFill&) = delete;

    /// Adds the next spec in the order of LayerDoc::visit(), starting with the pseudo-root. Error:
    /// InvalidEdit for any other order; drop the object then.
    Result<void> addSpec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                         std::string_view name);
    /// Adds a field to the last spec.
    void addField(std::string_view name, const FieldValue& value);
    /// Adds the whole doc.
    void add(const LayerDoc& doc);
    /// The asset paths in the added fields, as authored (NamedAssets.h).
    struct Named {
        std::set<std::string> arcs;   ///< sublayers, references and payloads
        std::set<std::string> clips;  ///< value clips
    };
    [[nodiscard]] const Named& named() const;

    /// Replaces the content of the layer. Call it once, on the thread that owns the layer. If the
    /// layer has prims, Sdf notifies only of differences. The store's observer is not notified. An
    /// error names the first field that this OpenUSD does not support; all other fields are set.
    /// With Notices::None Sdf notifies of nothing: only for a layer of which it is going to notify
    /// that it was reloaded.
    enum class Notices { OfDifferences, None };
    Result<void> into(SdfLayerStore& store, Notices notices = Notices::OfDifferences);

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Returns an anonymous text layer with the content of `layer`. Sdf sends no notice of the content,
/// which takes a fraction of the time of SdfLayer::TransferContent().
[[nodiscard]] pxr::SdfLayerRefPtr copyOfLayer(const pxr::SdfLayer& layer);

/// Returns the doc as a new anonymous layer of that format ("usda", "usdc"), or as text that was
/// read back successfully. Errors: BlobNotFound; SaveFailed or the field's own error if a part of
/// the doc would be lost.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> makeLayer(const LayerDoc& doc, BlobSource& blobs,
                                                    const std::string& formatId);
[[nodiscard]] Result<std::string> exportText(const LayerDoc& doc, BlobSource& blobs);

}  // namespace usdlive::usd
