// Selects the part of a stage that is composed, by the paths of prims.
#include "usdlive/client/usd/stage/PopulationMask.h"

#include "usd/stage/DepthGuard.h"

namespace usdlive::stage {

using pxr::SdfPath;

PopulationMask::PopulationMask(const pxr::SdfPathVector& paths) : paths_(std::in_place) {
    pxr::SdfPathVector fewest;
    for (const auto& path : paths)
        if (canBePrim(path)) fewest.push_back(path);
    SdfPath::RemoveDescendentPaths(&fewest);
    paths_->insert(fewest.begin(), fewest.end());
}

pxr::SdfPathVector PopulationMask::paths() const {
    if (!paths_) return {SdfPath::AbsoluteRootPath()};
    return {paths_->begin(), paths_->end()};
}

bool PopulationMask::includesSubtree(const SdfPath& prim) const {
    if (!paths_) return true;
    for (SdfPath at = prim; !at.IsEmpty(); at = at.GetParentPath())
        if (paths_->contains(at)) return true;
    return false;
}

bool PopulationMask::includes(const SdfPath& prim) const {
    if (includesSubtree(prim)) return true;
    const auto below = paths_->lower_bound(prim);
    return below != paths_->end() && below->HasPrefix(prim);
}

bool PopulationMask::includedChildren(const SdfPath& prim, pxr::TfTokenVector* names) const {
    if (includesSubtree(prim)) return true;
    const std::size_t depth = prim.GetPathElementCount();
    for (auto at = paths_->lower_bound(prim); at != paths_->end() && at->HasPrefix(prim); ++at) {
        SdfPath child = *at;
        while (child.GetPathElementCount() > depth + 1) child = child.GetParentPath();
        if (names->empty() || names->back() != child.GetNameToken())
            names->push_back(child.GetNameToken());
    }
    return !names->empty();
}

PopulationMask PopulationMask::below(const SdfPath& prim) const {
    if (includesSubtree(prim)) return {};
    PopulationMask mask{pxr::SdfPathVector{}};
    for (auto at = paths_->lower_bound(prim); at != paths_->end() && at->HasPrefix(prim); ++at)
        mask.paths_->insert(at->ReplacePrefix(prim, SdfPath::AbsoluteRootPath()));
    return mask;
}

}  // namespace usdlive::stage
