// Finds and keeps edits that an editor made in a layer before the layer was live.
#include "usd/live/EarlyWork.h"

#include "usd/live/LayerClaims.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::client {

namespace {

void keepAsFile(const LayerId& id, const pxr::SdfLayerRefPtr& layer, const Error& reason,
                LostWorkReports& lost) {
    LostWork work;
    work.refused = true;
    const auto file = lost.fileFor(id);
    const bool kept = layer->Export(file.string());
    work.reason = {reason.code,
                   id.value +
                       " was edited before it was live and cannot be read: " + reason.message +
                       (kept ? ". Its content is in " + file.string()
                             : ". Its content could not be written to " + file.string())};
    lost.add(std::move(work));
}

}  // namespace

Result<std::vector<std::pair<std::string, EditAction>>> earlyWork(const pxr::SdfLayerRefPtr& layer,
                                                                  BlobCache& blobs) {
    if (!layer->IsDirty()) return {};
    const auto written = usd::readLayer(layer, blobs);
    if (!written) return tl::unexpected(written.error());
    return difference(LayerClaims::ofProcess().left(layer).value_or(LayerDoc()), *written);
}

void keepEarlyWork(const LayerId& id, const pxr::SdfLayerRefPtr& layer, BlobCache& blobs,
                   LostWorkReports& lost) {
    auto written = earlyWork(layer, blobs);
    if (!written) return keepAsFile(id, layer, written.error(), lost);
    if (written->empty()) return;
    LostWork work;
    work.refused = true;
    work.reason = {
        ErrorCode::LayerNotOpen,
        id.value +
            " was edited before it was live; the content of the project has replaced these edits"};
    for (auto& [path, action] : *written) work.edits.push_back({id, path, std::move(action)});
    lost.add(std::move(work));
}

}  // namespace usdlive::client
