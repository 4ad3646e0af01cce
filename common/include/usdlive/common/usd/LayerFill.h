#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::usd {

class SdfLayerStore;

/// Do fields of that name tell which other layers are composed (sublayers, references, payloads)?
[[nodiscard]] bool namesLayers(std::string_view field);

/// A layer's whole content, made beside the layer, and then put into it at once with one change
/// notice: a big layer need not take its editor's frames.
///
/// Made on one thread at a time, which need not be the layer's. A field that cannot be had does not
/// keep the rest away: one whose blob is not here is absent until `store.blobArrived`, one that
/// this OpenUSD cannot hold stays absent.
class LayerFill {
public:
    /// For this layer, on the thread that owns it. `blobs` is asked on the thread that adds.
    LayerFill(const pxr::SdfLayerHandle& layer, BlobSource& blobs);
    ~LayerFill();
    LayerFill(const LayerFill&) = delete;
    LayerFill& operator=(const LayerFill&) = delete;

    /// The next spec in the order of LayerDoc::visit(), of which the pseudo-root is the first.
    /// InvalidEdit: it is not the next; there is nothing to be done with this fill any more.
    Result<void> addSpec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                         std::string_view name);
    /// Of the last spec.
    void addField(std::string_view name, const FieldValue& value);
    /// All of a doc.
    void add(const LayerDoc& doc);
    /// Whether namesLayers() is true of a field that was added.
    [[nodiscard]] bool namesLayers() const;

    /// On the thread that owns the layer, once. Replaces its content; where it has prims, Sdf tells
    /// only of what differs. The store's observer is not told. An error names the first field that
    /// this OpenUSD cannot hold; all others are in.
    Result<void> into(SdfLayerStore& store);

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The doc as a fresh anonymous layer of that format ("usda", "usdc"), or the layer's text, which
/// has been read back. Errors: BlobNotFound, and SaveFailed (or the field's own error) where
/// something of the doc would be missing.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> makeLayer(const LayerDoc& doc, BlobSource& blobs,
                                                    const std::string& formatId);
[[nodiscard]] Result<std::string> exportText(const LayerDoc& doc, BlobSource& blobs);

}  // namespace usdlive::usd
