#include "usdlive/client/usd/LayerFolders.h"

#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <system_error>

#include "usdlive/common/core/LayerPath.h"

namespace usdlive::client {

namespace fs = std::filesystem;

Result<LayerFolders> LayerFolders::create(const fs::path& cacheFolder) {
    std::error_code error;
    fs::create_directories(cacheFolder, error);
    const fs::path canonical = error ? fs::path() : fs::canonical(cacheFolder, error);
    if (error)
        return fail(ErrorCode::InvalidArgument,
                    "cannot use " + cacheFolder.string() + " as cache folder: " + error.message());
    LayerFolders folders;
    folders.folders_.push_back(canonical);
    return folders;
}

void LayerFolders::add(const fs::path& folder) {
    std::error_code error;
    auto canonical = fs::canonical(folder, error);
    if (!error && std::find(folders_.begin(), folders_.end(), canonical) == folders_.end())
        folders_.push_back(std::move(canonical));
}

std::optional<LayerId> LayerFolders::layerAt(const std::string& path) const {
    if (path.empty() || path.front() != '/') return std::nullopt;
    for (const auto& folder : folders_) {
        const std::string prefix = folder.string() + "/";
        if (!path.starts_with(prefix)) continue;
        const auto id = parseLayerId(std::string_view(path).substr(prefix.size()));
        if (id) return *id;
    }
    return std::nullopt;
}

fs::path LayerFolders::placeOf(const LayerId& layer) const { return cacheFolder() / layer.value; }

Result<bool> LayerFolders::makePlaceholder(const LayerId& layer) {
    const fs::path place = placeOf(layer);
    std::error_code error;
    if (fs::exists(place, error)) return false;
    const auto content = emptyFile(place.extension().string());
    if (!content) return tl::unexpected(content.error());
    fs::create_directories(place.parent_path(), error);
    std::ofstream file(place, std::ios::binary);
    if (!(file << *content).flush())
        return fail(ErrorCode::InvalidArgument, "cannot write " + place.string());
    return true;
}

void LayerFolders::removePlaceholder(const LayerId& layer) {
    std::error_code ignored;
    fs::remove(placeOf(layer), ignored);
}

Result<std::string> LayerFolders::emptyFile(const std::string& extension) {
    if (extension != ".usdc") return std::string("#usda 1.0\n");
    if (emptyCrate_.empty()) {
        const fs::path path = cacheFolder() / ".usdlive-empty.usdc";
        const auto layer = pxr::SdfLayer::CreateAnonymous(".usdc");
        if (!layer || !layer->Export(path.string()))
            return fail(ErrorCode::InvalidArgument, "cannot write " + path.string());
        std::ostringstream content;
        content << std::ifstream(path, std::ios::binary).rdbuf();
        emptyCrate_ = content.str();
        std::error_code ignored;
        fs::remove(path, ignored);
    }
    return emptyCrate_;
}

}  // namespace usdlive::client
