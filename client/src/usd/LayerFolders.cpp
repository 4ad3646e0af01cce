#include "usdlive/client/usd/LayerFolders.h"

#include <algorithm>
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

}  // namespace usdlive::client
