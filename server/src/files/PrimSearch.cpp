// Looks for prims in the file of a layer.
#include "files/PrimSearch.h"

#include "files/OpenLayerFile.h"
#include "files/OpenUsdThreads.h"

namespace usdlive::server {

Result<bool> hasPrim(const LayerId& layer, const std::filesystem::path& file,
                     const std::function<bool(std::string_view path)>& condition) {
    Result<bool> found = false;
    withoutThreadsOfOpenUsd([&] {
        found = openLayerFile(layer, file).map([&](const pxr::SdfLayerRefPtr& opened) {
            bool has = false;
            opened->Traverse(pxr::SdfPath::AbsoluteRootPath(), [&](const pxr::SdfPath& path) {
                if (!has && path.IsPrimPath())
                    has = condition(path.StripAllVariantSelections().GetString());
            });
            return has;
        });
    });
    return found;
}

}  // namespace usdlive::server
