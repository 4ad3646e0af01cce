// Finds data providers among the plug-ins, and loads their libraries.
#include "ProviderRegistry.h"

#include <pxr/base/js/value.h>
#include <pxr/base/plug/registry.h>
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/base/tf/getenv.h>

#include <algorithm>
#include <optional>
#include <set>
#include <vector>

#include "Problems.h"

namespace usdlive::edf {

using std::chrono::milliseconds;

namespace {

constexpr double kDefaultLimitSeconds = 60, kMaxLimitSeconds = 3600;
constexpr const char* kBase = "IEdfDataProvider";

// `timeLimitSeconds` of the plugInfo.json; USDLIVE_EDF_TIME_LIMIT replaces it for all providers.
milliseconds limitOf(const pxr::JsObject& info) {
    double seconds = kDefaultLimitSeconds;
    if (const auto found = info.find("timeLimitSeconds"); found != info.end()) {
        if (found->second.IsReal()) seconds = found->second.GetReal();
        if (found->second.IsInt()) seconds = found->second.GetInt();
    }
    seconds = pxr::TfGetenvDouble("USDLIVE_EDF_TIME_LIMIT", seconds);
    if (!(seconds > 0)) seconds = kDefaultLimitSeconds;
    return milliseconds(static_cast<std::int64_t>(std::min(seconds, kMaxLimitSeconds) * 1000));
}

std::optional<std::string> idOf(const pxr::JsObject& info) {
    const auto found = info.find("dataProviderId");
    if (found == info.end() || !found->second.IsString() || found->second.GetString().empty())
        return std::nullopt;
    return found->second.GetString();
}

}  // namespace

ProviderAnswer ProviderRegistry::find(const std::string& id) {
    std::unique_lock lock(mutex_);
    const Known* entry = known(id);
    if (!entry) {
        std::string ids;
        for (const auto& [other, plugin] : known_) ids += (ids.empty() ? "" : ", ") + other;
        ProviderAnswer none;
        none.error =
            "no plug-in has the provider '" + id + "'; known are: " + (ids.empty() ? "none" : ids);
        return none;
    }
    const Known found = *entry;
    lock.unlock();  // loading a library can need the lock of Python, whose owner may wait for this
                    // one
    ProviderAnswer answer;
    answer.plugin = found.plugin->GetName();
    answer.limit = found.limit;
    pxr::TfErrorMark mark;
    if (!found.plugin->Load()) {
        answer.error = "its library could not be loaded: " + takeProblems(mark);
        return answer;
    }
    answer.factory = found.type.GetFactory<EdfDataProviderFactoryBase>();
    if (!answer.factory)
        answer.error = "its library does not define the type " + found.type.GetTypeName() +
                       ", or was built for another version of DataProvider.h";
    return answer;
}

// Plug-ins that were registered after the last look are found too.
const ProviderRegistry::Known* ProviderRegistry::known(const std::string& id) {
    auto found = known_.find(id);
    if (found == known_.end()) {
        look();
        found = known_.find(id);
    }
    return found == known_.end() ? nullptr : &found->second;
}

void ProviderRegistry::look() {
    auto& plugins = pxr::PlugRegistry::GetInstance();
    std::set<pxr::TfType> types;
    pxr::PlugRegistry::GetAllDerivedTypes(pxr::TfType::Declare(kBase), &types);
    std::vector<pxr::TfType> sorted(types.begin(), types.end());
    std::ranges::sort(sorted, {}, [](const pxr::TfType& type) { return type.GetTypeName(); });
    for (const auto& type : sorted) {
        const auto plugin = plugins.GetPluginForType(type);
        if (!plugin) continue;
        const auto info = plugin->GetMetadataForType(type);
        const auto id = idOf(info);
        if (!id) {
            if (unusable_.insert(type.GetTypeName()).second)
                TF_WARN(
                    "edf: the plugInfo.json of %s has no text dataProviderId for %s, which cannot "
                    "be used",
                    plugin->GetName().c_str(), type.GetTypeName().c_str());
            continue;
        }
        const auto [place, isNew] = known_.try_emplace(*id, Known{type, plugin, limitOf(info)});
        if (!isNew && place->second.type != type && unusable_.insert(type.GetTypeName()).second)
            TF_WARN("edf: the plug-ins %s and %s both have the provider '%s'; the first is used",
                    place->second.plugin->GetName().c_str(), plugin->GetName().c_str(),
                    id->c_str());
    }
}

}  // namespace usdlive::edf
