// Builds a sparse layer from lost edits.
#include "usd/live/LostWorkLayer.h"

#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/ValueCodec.h"
#include "work/SparseLayer.h"

namespace usdlive::client {

Result<pxr::SdfLayerRefPtr> lostWorkLayer(const LostWork& work, const LayerId& layer,
                                          const LayerDoc* known, BlobSource& blobs) {
    const auto nameOfType = [&blobs](const Value& value) {
        const auto decoded = usd::decodeLeaf(value, blobs);
        const auto type =
            decoded ? pxr::SdfSchema::GetInstance().FindType(*decoded) : pxr::SdfValueTypeName();
        return type ? type.GetAsToken().GetString() : std::string();
    };
    return usd::makeLayer(sparseLayer(work, layer, known, nameOfType), blobs, "usda");
}

}  // namespace usdlive::client
