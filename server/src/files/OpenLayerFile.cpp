// Opens the file of a layer.
#include "files/OpenLayerFile.h"

#include "usdlive/common/usd/TextDepth.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::server {

Result<pxr::SdfLayerRefPtr> openLayerFile(const LayerId& layer, const std::filesystem::path& path) {
    const usd::TfComplaints complaints;
    if (const auto why = usd::whyTooDeep(pxr::ArResolvedPath(path.string())); !why.empty())
        return layerUnreadable(layer, why);
    auto opened = pxr::SdfLayer::OpenAsAnonymous(path.string());
    if (!opened) return layerUnreadable(layer, complaints.text("OpenUSD gives no reason"));
    return opened;
}

}  // namespace usdlive::server
