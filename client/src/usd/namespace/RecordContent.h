// Declares the content of a NamespaceRecord: the changes of a batch, and the specs that it deleted.
#pragma once

#include <map>
#include <set>
#include <utility>
#include <vector>

#include "Application.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

namespace usdlive {

/// The changes that a batch made in each layer. Created before the batch is applied.
class NamespaceRecord::Content {
public:
    explicit Content(naming::Application::Layers layers);
    /// Called after the batch was applied.
    void finish();

    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;
    std::vector<content::Kept> undo(const content::Record::IsShared& isShared) const;

private:
    using LayerEdits = naming::Application::LayerEdits;

    void keepDeleted(const pxr::SdfLayerRefPtr& layer, const pxr::SdfPath& path);
    void removeSurvivors(const pxr::SdfLayerRefPtr& layer, const naming::PathMoves& moves);
    void restoreDeleted(bool early, std::set<std::size_t>& restored,
                        std::vector<content::Kept>& kept) const;
    void keepOrder(const pxr::SdfLayerRefPtr& layer, const pxr::SdfPath& parent);
    void undoFields(const pxr::SdfLayerHandle& layer, const LayerEdits& edits, bool force,
                    std::vector<content::Kept>& kept) const;
    void undoMoves(const pxr::SdfLayerHandle& layer, const LayerEdits& edits,
                   std::vector<content::Kept>& kept) const;
    void arrangeChildren(const pxr::SdfLayerHandle& layer) const;

    naming::Application::Layers layers_;
    /// A deleted spec, copied into a layer of its own.
    struct Deleted {
        pxr::SdfLayerRefPtr layer;
        pxr::SdfPath path;
        pxr::SdfLayerRefPtr copy;
    };
    std::vector<Deleted> deleted_;
    // Prims that something moved away from, with the previous order of their children.
    std::map<pxr::SdfLayerRefPtr, std::map<pxr::SdfPath, pxr::TfTokenVector>> order_;
    std::vector<std::pair<pxr::SdfLayerRefPtr, pxr::SdfPath>> madeOvers_;
    std::vector<std::pair<pxr::SdfLayerRefPtr, pxr::SdfPath>> cleanedUp_;  // emptied overs
};

}  // namespace usdlive
