// Declares the content of a NamespaceRecord: the changes of a batch, and the specs that it deleted.
#pragma once

#include <map>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "usd/namespace/Application.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

namespace usdlive {

/// The changes that a batch made, step by step.
class NamespaceRecord::Content {
public:
    explicit Content(naming::Changes changes);

    using LayerMoves = std::map<pxr::SdfLayerRefPtr, naming::PathMoves>;
    /// Records what the layers contain before a step. Returns its moves.
    [[nodiscard]] const LayerMoves& begin(std::size_t step);
    /// Called when the moves of the step are made, after its change block.
    void end(std::size_t step);

    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;
    /// Undoes everything, and forgets it. Throws Misuse on another thread than that of the editor.
    std::vector<content::Kept> undo(const content::Record::IsShared& isShared);

private:
    using Kept = std::vector<content::Kept>;
    using LayerPath = std::pair<pxr::SdfLayerRefPtr, pxr::SdfPath>;
    /// The changes of one step, with paths as they were before it.
    struct Done {
        LayerMoves moves;
        std::map<pxr::SdfLayerRefPtr, pxr::SdfLayerRefPtr> deleted;  ///< layers with the specs
        std::map<LayerPath, pxr::TfTokenVector> order;  ///< the children of prims that lost one
        std::vector<LayerPath> madeOvers, cleanedUp;
    };

    void keepParents(Done& done, const pxr::SdfLayerRefPtr& layer, const naming::PathMove& move);
    void undoStep(std::size_t step, Kept& kept);
    void undoMoves(std::size_t step, Kept& kept);
    void undoFields(const content::Record::IsShared& isShared, Kept& kept);
    void undoField(const pxr::SdfLayerRefPtr& layer, const naming::FieldEdit& edit, bool force,
                   Kept& kept);
    [[nodiscard]] pxr::SdfPath pathNow(const pxr::SdfLayerRefPtr& layer, pxr::SdfPath path) const;
    [[nodiscard]] pxr::VtValue valueBefore(const pxr::SdfLayerRefPtr& layer,
                                           const naming::FieldEdit& edit,
                                           const pxr::SdfPath& owner) const;

    const std::thread::id thread_ = std::this_thread::get_id();
    naming::Changes changes_;
    std::vector<Done> done_;  // for each step that was begun
    // The plans that are not undone, and the moves of specs that remain, for each step.
    std::set<std::size_t> stays_;
    std::vector<std::map<pxr::SdfLayerRefPtr, naming::PathMap>> staying_;
};

}  // namespace usdlive
