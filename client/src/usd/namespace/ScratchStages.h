// Declares ScratchStages, copies of stages on which the edits of a batch are tried.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usd/namespace/ComposedStage.h"
#include "usd/namespace/Planner.h"

namespace usdlive::naming {

/// Copies of stages on which the edits of a batch are tried one after another. It copies the local
/// layers and the layers that lead to them. All other layers are used directly.
class ScratchStages {
public:
    explicit ScratchStages(const Stages& stages);
    ScratchStages(const ScratchStages&) = delete;
    ScratchStages& operator=(const ScratchStages&) = delete;

    [[nodiscard]] const Stages& stages() const { return scratch_; }
    /// Makes the changes of a plan of the original stages in the copies.
    void apply(const Plan& plan) const;
    /// Returns the plan with the copies replaced by the original layers.
    [[nodiscard]] Plan toReal(Plan plan) const;

private:
    struct Copy {
        pxr::SdfLayerRefPtr layer;
        std::map<std::string, std::string> toOriginal, toCopy;  ///< asset paths
    };
    using Composed = std::vector<std::unique_ptr<ComposedStage>>;

    void setArcs(const Plan& plan) const;
    void setRelocates(const Plan& plan) const;
    void chooseLayers(const std::vector<ComposedStage*>& stages);
    void redirect(const std::vector<ComposedStage*>& stages);
    [[nodiscard]] std::string redirected(const pxr::SdfLayerHandle& layer, const std::string& path,
                                         const pxr::VtDictionary& variables) const;
    [[nodiscard]] pxr::SdfLayerHandle copyOf(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] std::unique_ptr<ComposedStage> compose(ComposedStage& stage) const;

    std::map<pxr::SdfLayerHandle, Copy> copies_;
    std::map<pxr::SdfLayerHandle, pxr::SdfLayerHandle> originals_;
    Composed composed_;
    Stages scratch_;
};

}  // namespace usdlive::naming
