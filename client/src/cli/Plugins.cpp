// Finds the plug-ins in a build folder, in an installed package and in a Python package.
#include "cli/Plugins.h"

#include <pxr/base/plug/plugin.h>
#include <pxr/base/plug/registry.h>

#include <filesystem>
#include <string>
#include <vector>

namespace usdlive::cli {

namespace {

namespace fs = std::filesystem;

std::vector<fs::path> possibleFolders() {
    std::error_code ignored;
    const fs::path programs = fs::read_symlink("/proc/self/exe", ignored).parent_path();
    // In a build, and in a Python package.
    std::vector<fs::path> folders{programs.parent_path() / "usd-plugins",
                                  programs.parent_path() / "_plugins"};
    // An installation has them beside OpenUSD, whose plug-ins are in pxr/pluginfo/NAME/resources.
    if (const auto sdf = pxr::PlugRegistry::GetInstance().GetPluginWithName("sdf")) {
        const fs::path resources = sdf->GetResourcePath();
        const fs::path site = (resources / "../../../..").lexically_normal();
        folders.push_back(site / "plugins");
    }
    folders.push_back(programs.parent_path() / "lib/usdlive/plugins");
    return folders;
}

}  // namespace

void registerPlugins() {
    auto& registry = pxr::PlugRegistry::GetInstance();
    std::error_code ignored;
    for (const fs::path& folder : possibleFolders()) {
        if (!fs::is_directory(folder, ignored)) continue;
        std::vector<std::string> found;
        for (const auto& entry : fs::directory_iterator(folder, ignored)) {
            // A plug-in's folder has its name.
            const fs::path info = entry.path() / "plugInfo.json";
            if (fs::exists(info, ignored) &&
                !registry.GetPluginWithName(entry.path().filename().string()))
                found.push_back(info.string());
        }
        registry.RegisterPlugins(found);
        return;
    }
}

}  // namespace usdlive::cli
