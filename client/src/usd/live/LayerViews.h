// Layers that OpenUSD opens once more for file format arguments.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <optional>

#include "usd/live/ApartEdits.h"
#include "usd/live/LiveSet.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::client {

/// OpenUSD opens a file once more for each set of file format arguments
/// ("look.usda:SDF_FORMAT_ARGS:who=a"). Such a layer, a view, shows what the live layer of the file
/// has. It is not live itself and refuses edits, so that a file has one layer that edits reach.
/// Used by the thread that owns the layers.
class LayerViews {
public:
    /// All arguments outlive this object.
    LayerViews(const LiveSet& live, BlobSource& blobs) : live_(live), blobs_(blobs) {}

    /// Adds a view of the live layer `id`, unless it is known.
    void add(const LayerId& id, const pxr::SdfLayerRefPtr& view);
    /// Part of a tick, within its change block: applies to the views what has changed in their live
    /// layers. Keeps a view at least as long as its layer is live. Edits of `expressionVariables`
    /// and `subLayers` wait for applyApart().
    void follow();
    /// Applies the next of these edits. Call it in a change block of its own for each time, until
    /// it returns false: there are none.
    bool applyApart();

private:
    struct View {
        LayerId id;
        pxr::SdfLayerRefPtr layer;
        std::unique_ptr<usd::SdfLayerStore> store;
        std::optional<LayerDoc> shown;  // nothing before the first content
        ApartEdits apart;               // wait for applyApart()
    };
    void follow(View& view) const;

    const LiveSet& live_;
    BlobSource& blobs_;
    std::map<const void*, View> views_;  // by the unique identifier of the layer
};

}  // namespace usdlive::client
