// Declares PathIndex, which finds the specs that refer to a path without reading the whole stage
// again.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/pathTable.h>

#include <atomic>
#include <map>
#include <memory>
#include <set>
#include <thread>
#include <vector>

#include "usd/namespace/PathValues.h"

namespace usdlive::naming {

/// Finds the specs of one layer whose fields refer to a path or to paths below it. The layer is
/// read once; later only changed specs are read. The result may contain specs that no longer refer
/// to the path.
class LayerPaths {
public:
    explicit LayerPaths(pxr::SdfLayerHandle layer) : layer_(std::move(layer)) {}

    /// Updates the index. Called for each change of the layer.
    void follow(const pxr::SdfChangeList& changes);
    /// Discards the index. The layer is read again at the next query.
    void forget() { isRead_ = false; }
    /// Reads the layer unless the index is up to date.
    void read();
    /// Adds the specs to `specs`, some more than once.
    void specsWithPathsTo(const pxr::SdfPath& path, pxr::SdfPathVector& specs);

private:
    struct Entry {
        pxr::SdfPath spec;
        std::size_t moved;  // how many of moves_ the path already contains
    };

    void readBelow(const pxr::SdfPath& path);
    void readSpec(const pxr::SdfPath& spec);
    void readChanged(const pxr::SdfPath& path, const pxr::SdfChangeList::Entry& entry);

    const pxr::SdfLayerHandle layer_;
    bool isRead_ = false;
    std::size_t entries_ = 0, entriesOfLayer_ = 0;
    pxr::SdfPathTable<std::vector<Entry>> byTarget_;
    PathMoves moves_;  // renames since the layer was read; entries keep the older paths
};

/// The LayerPaths of all layers that were queried. Use it on one thread; after a change on another
/// thread all layers are read again.
class PathIndex : public pxr::TfWeakBase {
public:
    PathIndex();
    ~PathIndex();
    PathIndex(const PathIndex&) = delete;
    PathIndex& operator=(const PathIndex&) = delete;

    [[nodiscard]] LayerPaths& of(const pxr::SdfLayerHandle& layer);
    /// Discards the indexes of all other layers.
    void keepOnly(const std::set<pxr::SdfLayerHandle>& layers);

private:
    void onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice);

    const std::thread::id thread_ = std::this_thread::get_id();
    std::atomic<bool> stale_ = false;  // set when another thread changed a layer
    std::map<pxr::SdfLayerHandle, LayerPaths> layers_;
    pxr::TfNotice::Key changedKey_;
};

}  // namespace usdlive::naming
