// Declares DepthGuard, which finds input that is too deep for OpenUSD before OpenUSD reads it.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive::stage {

/// The most elements of the path of a composed prim, and of the target of a composition arc. Pcp
/// calls itself for each element of a target, and a thread of TBB has a stack of 4 MiB.
inline constexpr std::size_t kDeepestPath = 512;

/// Returns true if a path has more than kDeepestPath elements. The path may have any length:
/// SdfPath counts elements in 16 bits, so that its own count and its order are wrong above 65,535.
[[nodiscard]] bool isTooDeep(const pxr::SdfPath& path);

/// Returns true if a stage can have a prim at the path.
[[nodiscard]] inline bool canBePrim(const pxr::SdfPath& path) {
    return path.IsAbsolutePath() && path.IsAbsoluteRootOrPrimPath() && !isTooDeep(path);
}

/// Opens a layer. Fails with LayerUnreadable if it cannot be opened, or if it is a text with
/// brackets or paths that are too deep for OpenUSD, which would end the process.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayer(const std::string& identifier);

/// Checks the layers of a stage for composition arcs to paths that are too deep, and for texts that
/// are nested too deeply. Pcp and the text parser of Sdf call themselves for each level, and end
/// the process when the stack is full. The guard names the root prims and the layers that must be
/// left out; the rest can be composed.
///
/// It opens the layers that sublayers, references and selected variants name, and those of payloads
/// on request, in parallel, as Pcp would open them afterwards. Layers with arguments are checked
/// only if they are open. Not checked in advance are layers that are named by expressions, or in
/// variants that only another layer selects (decision 16). The bound holds for each arc: thousands
/// of arcs that are chained can still fill the stack.
class DepthGuard {
public:
    struct Problem {
        std::string type;   // "ArcTooDeep" or "TextTooDeep"
        pxr::SdfPath prim;  // a root prim of the stage, or the root for layers that are left out
        std::string message;
    };
    /// The layers that were opened. The owner keeps them until the stage is composed.
    using Opened = std::vector<pxr::SdfLayerRefPtr>;

    /// Open: opens layers to check them. FindOnly: checks only layers that are open already.
    enum class Layers { Open, FindOnly };

    DepthGuard(pxr::SdfLayerHandle root, pxr::SdfLayerHandle session, Layers layers);

    /// Checks all layers that can be reached, except those in `unused`. Returns true if
    /// primsLeftOut() or layersLeftOut() changed.
    bool checkAll(const std::set<std::string>& unused, bool payloads, Opened& opened);
    /// Checks the changed specs. A layer that the guard does not know is checked if `isUsed`
    /// returns true for it. Call it before the composition follows the changes.
    bool check(const pxr::SdfLayerChangeListVec& changes,
               const std::function<bool(const pxr::SdfLayerHandle&)>& isUsed, Opened& opened);

    /// Checks the layers of payloads that are loaded next: those of these specs, and of payloads in
    /// them.
    bool checkPayloads(const std::vector<std::pair<pxr::SdfLayerHandle, pxr::SdfPath>>& specs,
                       Opened& opened);

    /// Returns the names of root prims that must not be composed.
    [[nodiscard]] const std::set<pxr::TfToken>& primsLeftOut() const { return leftOut_; }
    [[nodiscard]] bool leavesOut(const pxr::SdfPath& prim) const;
    /// Returns the identifiers of layers that must be muted.
    [[nodiscard]] const std::vector<std::string>& layersLeftOut() const { return muted_; }
    [[nodiscard]] const std::vector<Problem>& problems() const { return problems_; }

private:
    struct Arc;
    struct Wanted;
    struct Scan;
    template <class Visit>
    static void forEachArc(const pxr::SdfLayer& layer, const pxr::SdfPath& subtree, Visit&& visit);
    [[nodiscard]] static Scan scan(const pxr::SdfLayer& layer, const pxr::SdfPath& subtree,
                                   bool payloads);
    void take(const pxr::SdfLayerHandle& layer, bool local, Scan scan, std::vector<Wanted>& wave);
    void follow(std::vector<Wanted> wave, Opened& opened);
    bool decide();
    void leaveOut();
    [[nodiscard]] bool leadsOut(const pxr::SdfLayerHandle& layer, const Arc& arc,
                                bool classesLeadOut) const;

    const pxr::SdfLayerHandle root_, session_;
    const Layers layers_;
    std::set<std::string> unused_;
    bool payloads_ = false;
    std::map<pxr::SdfLayerHandle, bool> checked_;  // true for local layers
    // Layers with arcs that are too deep. They stay open, so that a correction is noticed.
    struct Deep {
        pxr::SdfLayerRefPtr layer;
        std::map<pxr::SdfPath, std::string> messages;  // by the path of the spec
    };
    std::map<pxr::SdfLayerHandle, Deep> deep_;
    std::map<std::string, std::string> texts_;  // messages by identifier of the layer
    std::set<pxr::TfToken> leftOut_;
    std::vector<std::string> muted_;
    std::vector<Problem> problems_;
};

}  // namespace usdlive::stage
