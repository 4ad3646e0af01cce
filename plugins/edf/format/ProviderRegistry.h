// Finds the data providers among the plug-ins of the process.
#pragma once

#include <pxr/base/plug/plugin.h>
#include <pxr/base/tf/type.h>

#include <chrono>
#include <map>
#include <mutex>
#include <set>
#include <string>

#include "usdlive/edf/DataProvider.h"

namespace usdlive::edf {

/// A provider that can be used, or the reason why not.
struct ProviderAnswer {
    const EdfDataProviderFactoryBase* factory = nullptr;  ///< lives as long as the process
    std::string plugin;                                   ///< the name of its plug-in
    std::chrono::milliseconds limit{};                    ///< how long one call may take
    std::string error;                                    ///< empty if there is a factory
};

/// Finds the types that plugInfo.json files derive from `IEdfDataProvider`, by their
/// `dataProviderId`, as Sdf finds file formats by extension. The library of a plug-in is loaded
/// when its provider is first asked for. Any thread.
class ProviderRegistry {
public:
    [[nodiscard]] ProviderAnswer find(const std::string& id);

private:
    struct Known {
        pxr::TfType type;
        pxr::PlugPluginPtr plugin;
        std::chrono::milliseconds limit{};
    };
    [[nodiscard]] const Known* known(const std::string& id);
    void look();

    std::mutex mutex_;  // guards what follows
    std::map<std::string, Known> known_;
    std::set<std::string> unusable_;  // types that were warned about
};

}  // namespace usdlive::edf
