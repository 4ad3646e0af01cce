// What one edit changes in all layers, or why it cannot be done. Changes nothing.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/types.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "ComposedStage.h"
#include "PathValues.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

namespace usdlive::naming {

/// A field of arcs, with its new value. The path is that of the spec before it moves.
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

/// The order is: arcs, moves, relocates, then the other fields that lead to what has moved.
struct Plan {
    std::map<pxr::SdfLayerHandle, LayerPlan> layers;
    /// Of each stage (the edited one, then its dependents), the composed objects that move.
    std::vector<PathMoves> objects;
    std::vector<pxr::SdfLayerHandleVector> localLayers;
    bool hasRelocates = false;  // relocates move what comes over arcs as well
    std::vector<std::string> errors, warnings;
};

struct Stages {
    ComposedStage* edited = nullptr;
    std::vector<ComposedStage*> dependents;
    const EditedStage* host = nullptr;
    pxr::SdfLayerHandle editTarget;  // null: the root layer
    bool targetMapsPaths = false;
};

[[nodiscard]] Plan planEdit(const Stages& stages, const NamespaceEditor::Edit& edit,
                            const NamespaceEditOptions& options);

}  // namespace usdlive::naming
