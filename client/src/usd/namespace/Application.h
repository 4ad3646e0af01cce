// Declares Application, which writes the plans of a batch into the layers and records how to undo
// them.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "PathIndex.h"
#include "Planner.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::naming {

/// All changes of a batch, in the order of its edits, as they are made in the layers.
class Application {
public:
    /// A field with a new value. `before` is its spec's path before all moves, and `path` the path
    /// after them.
    struct FieldEdit {
        pxr::SdfPath before, path;
        pxr::TfToken field;
        pxr::VtValue oldValue, value;
    };
    struct LayerEdits {
        PathMoves moves;
        std::vector<FieldEdit> fields;
    };
    using Layers = std::map<pxr::SdfLayerRefPtr, LayerEdits>;

    /// Collects all changes without making them.
    Application(const std::vector<Plan>& plans, PathIndex& index);

    /// If there are errors, the batch must not be applied.
    [[nodiscard]] const std::vector<std::string>& errors() const { return errors_; }
    [[nodiscard]] pxr::SdfLayerHandleVector layers() const;
    /// Makes all changes within one change block. If Sdf refuses a change, returns an error and
    /// changes nothing.
    [[nodiscard]] Result<NamespaceRecord> apply() const;

private:
    /// The arcs and relocates of the plans, by the paths of their specs before all moves.
    using Planned = std::map<std::pair<pxr::SdfPath, pxr::TfToken>, pxr::VtValue>;

    void collectPlan(const std::vector<Plan>& plans);
    void collectPathFields(const std::vector<Plan>& plans, PathIndex& index);
    /// `objects` are moved at once, for each edit.
    void findPathFields(const pxr::SdfLayerRefPtr& layer, const std::vector<PathMoves>& objects,
                        PathIndex& index);
    void checkPermissions();

    Layers layers_;
    std::map<pxr::SdfLayerHandle, Planned> planned_;
    std::vector<std::string> errors_;
};

}  // namespace usdlive::naming
