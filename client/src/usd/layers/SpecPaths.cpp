// Finds the specs at and below a path of a stage.
#include "usd/layers/SpecPaths.h"

#include <algorithm>

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

bool contains(const std::vector<pxr::TfToken>& names, const pxr::TfToken& name) {
    return std::ranges::find(names, name) != names.end();
}

bool hasPrim(const StageHost& host, const SdfPath& path) {
    if (path == SdfPath::AbsoluteRootPath()) return true;
    const SdfPath parent = path.GetParentPath();
    return hasPrim(host, parent) && contains(host.childNames(parent), path.GetNameToken());
}

void collect(const StageHost& host, const SdfPath& prim, bool hierarchy,
             std::vector<SdfPath>& specs) {
    if (prim != SdfPath::AbsoluteRootPath()) {
        specs.push_back(prim);
        for (const auto& name : host.propertyNames(prim))
            specs.push_back(prim.AppendProperty(name));
    }
    if (!hierarchy) return;
    for (const auto& name : host.childNames(prim))
        collect(host, prim.AppendChild(name), true, specs);
}

bool hasSpec(const StageHost& host, const SdfPath& path) {
    if (!path.IsAbsolutePath() || path.ContainsPrimVariantSelection()) return false;
    if (path.IsAbsoluteRootOrPrimPath()) return hasPrim(host, path);
    const SdfPath prim = path.GetPrimPath();
    return path.IsPrimPropertyPath() && hasPrim(host, prim) &&
           contains(host.propertyNames(prim), path.GetNameToken());
}

}  // namespace

LayerResult<std::vector<SdfPath>> specsOf(const StageHost& host, const SdfPath& path,
                                          bool hierarchy) {
    if (!hasSpec(host, path))
        return fail(LayerErrorType::InvalidParam,
                    "the stage has no prim or property at '" + path.GetString() + "'");
    std::vector<SdfPath> specs;
    if (path.IsPropertyPath())
        specs.push_back(path);
    else
        collect(host, path, hierarchy, specs);
    return specs;
}

}  // namespace usdlive::layers
