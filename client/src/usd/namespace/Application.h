// Declares Application, which writes the plans of a batch into the layers and records how to undo
// them.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "usd/namespace/PathIndex.h"
#include "usd/namespace/Planner.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::naming {

/// A field with a new value. `before` is its spec's path before all moves, and `path` the path
/// after them.
struct FieldEdit {
    pxr::SdfPath before, path;
    pxr::TfToken field;
    pxr::VtValue oldValue, value;
};

/// Everything that a batch changes.
struct Changes {
    /// The moves of composed objects by one plan, in the layers whose fields refer to them.
    struct Objects {
        std::vector<PathMoves> moves;  ///< for each stage
        std::vector<pxr::SdfLayerHandleVector> localLayers;
        bool hasRelocates = false;
        std::size_t step = 0;      ///< objects of later steps name paths after this one
        std::size_t madeWith = 0;  ///< the last step that moves specs of this plan
    };

    std::vector<Step> steps;
    std::map<pxr::SdfLayerRefPtr, std::vector<FieldEdit>> fields;  ///< written after all steps
    std::vector<Objects> objects;                                  ///< for each plan

    [[nodiscard]] std::vector<pxr::SdfLayerRefPtr> layers() const;
    /// Tells the live layers of the stages which objects a step has moved or deleted (M15).
    void notePlaces(std::size_t step) const;
    /// Tells them that the moves of a step were undone, for the plans for which `isUndone` is true.
    void notePlacesBack(std::size_t step, const std::function<bool(std::size_t)>& isUndone) const;
};

/// All changes of a batch, as they are made in the layers.
class Application {
public:
    /// Collects all changes without making them.
    Application(const std::vector<Plan>& plans, PathIndex& index);

    /// If there are errors, the batch must not be applied.
    [[nodiscard]] const std::vector<std::string>& errors() const { return errors_; }
    [[nodiscard]] pxr::SdfLayerHandleVector layers() const;
    /// Makes all changes: each step within one change block, and the fields within the last one. If
    /// Sdf refuses a change, returns an error and changes nothing.
    [[nodiscard]] Result<NamespaceRecord> apply() const;

private:
    /// The arcs and relocates of the plans, by the paths of their specs before all moves.
    using Planned = std::map<std::pair<pxr::SdfPath, pxr::TfToken>, pxr::VtValue>;
    /// Moves by step.
    using StepMaps = std::vector<PathMap>;

    void collectPlanned(const std::vector<Plan>& plans);
    void collectPathFields(const std::vector<Plan>& plans, PathIndex& index);
    void findPathFields(const pxr::SdfLayerRefPtr& layer, const std::vector<PathMoves>& objects,
                        PathIndex& index);
    void checkPermissions();
    Result<void> makeStep(std::size_t step, NamespaceRecord::Content& content) const;
    void writeFields() const;
    [[nodiscard]] pxr::SdfPath after(const pxr::SdfLayerHandle& layer, pxr::SdfPath path) const;

    Changes changes_;
    std::map<pxr::SdfLayerHandle, StepMaps> specMoves_;
    std::map<pxr::SdfLayerHandle, Planned> planned_;
    std::vector<std::string> errors_;
};

}  // namespace usdlive::naming
