#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Where layers of the project stand for this process: the cache folder, which mirrors the project
/// with Placeholders, so that relative paths resolve, and folders the editor has opened layers from
/// itself.
class LayerFolders {
public:
    /// Makes the cache folder. InvalidArgument when it cannot be made.
    static Result<LayerFolders> create(const std::filesystem::path& cacheFolder);

    [[nodiscard]] const std::filesystem::path& cacheFolder() const { return folders_.front(); }
    void add(const std::filesystem::path& folder);

    /// The layer whose file this is, by its name alone; nothing outside of the folders.
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& path) const;
    /// Where the layer stands in the cache folder.
    [[nodiscard]] std::filesystem::path placeOf(const LayerId& layer) const;

private:
    std::vector<std::filesystem::path> folders_;  // absolute, without links; the cache folder first
};

}  // namespace usdlive::client
