// Declares planEdit(), which plans the changes of one edit in all layers, or returns the reasons to
// refuse it.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/types.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "usd/namespace/ComposedStage.h"
#include "usd/namespace/PathValues.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

namespace usdlive::naming {

/// A field of arcs with its new value. The path is the path of the spec before it moves.
struct ArcEdit {
    pxr::SdfPath path;
    pxr::TfToken field;
    pxr::VtValue value;
};

struct LayerPlan {
    std::vector<ArcEdit> arcs;
    PathMoves moves;
    std::optional<pxr::SdfRelocates> relocates;
};

/// The changes of one edit. They are made in this order: arcs, moves, relocates, then other fields
/// that refer to moved objects.
struct Plan {
    std::map<pxr::SdfLayerHandle, LayerPlan> layers;
    /// For each stage (the edited one, then its dependents), the composed objects that move.
    std::vector<PathMoves> objects;
    /// For each stage, other objects that Pcp reports as deleted. Specs of other arcs can keep
    /// them. Deletions adds those that are deleted to `objects`.
    std::vector<pxr::SdfPathVector> reportedDeleted;
    std::vector<pxr::SdfLayerHandleVector> localLayers;
    bool hasRelocates = false;  // true if relocates also move the opinions over arcs
    std::vector<std::string> errors, warnings;

    /// Returns true if the edit may have effects at other places than touched().
    [[nodiscard]] bool concernsMore() const;
    /// Returns all moves of specs and objects, and the specs whose arcs change, as deleted ones.
    [[nodiscard]] std::vector<PathMoves> touched() const;
};

/// The moves of one edit in one step (MoveSteps).
struct StepEdit {
    std::size_t plan = 0;  ///< its index
    std::map<pxr::SdfLayerHandle, PathMoves> moves;
};
using Step = std::vector<StepEdit>;
/// Returns the steps of the plans, at least one.
[[nodiscard]] std::vector<Step> inSteps(const std::vector<Plan>& plans);

struct Stages {
    ComposedStage* edited = nullptr;
    std::vector<ComposedStage*> dependents;
    const EditedStage* host = nullptr;
    pxr::SdfLayerHandle editTarget;  // null for the root layer
    bool targetMapsPaths = false;
};

[[nodiscard]] Plan planEdit(const Stages& stages, const NamespaceEditor::Edit& edit,
                            const NamespaceEditOptions& options);

}  // namespace usdlive::naming
