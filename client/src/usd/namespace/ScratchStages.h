#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "ComposedStage.h"
#include "Planner.h"

namespace usdlive::naming {

/// Copies of stages, on which the edits of a batch are tried one after another. Copied are the
/// local layers and those that lead to them; all others are used as they are.
class ScratchStages {
public:
    explicit ScratchStages(const Stages& stages);
    ScratchStages(const ScratchStages&) = delete;
    ScratchStages& operator=(const ScratchStages&) = delete;

    [[nodiscard]] const Stages& stages() const { return scratch_; }
    /// Makes what the plan says in the copies.
    void apply(const Plan& plan) const;
    /// The plan in terms of the layers themselves.
    [[nodiscard]] Plan toReal(Plan plan) const;

private:
    struct Copy {
        pxr::SdfLayerRefPtr layer;
        std::map<std::string, std::string> written;  ///< asset paths of the copy to the layer's own
    };
    using Composed = std::vector<std::unique_ptr<ComposedStage>>;

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
