// Reads the kinds of models from the metadata of plug-ins.
#include "usd/stage/Kinds.h"

#include <pxr/base/js/value.h>
#include <pxr/base/plug/plugin.h>
#include <pxr/base/plug/registry.h>

namespace usdlive::stage {

using pxr::TfToken;

Kinds::Kinds() {
    for (const auto& plugin : pxr::PlugRegistry::GetInstance().GetAllPlugins()) {
        const auto metadata = plugin->GetMetadata();
        const auto kinds = metadata.find("Kinds");
        if (kinds == metadata.end() || !kinds->second.IsObject()) continue;
        for (const auto& [name, facts] : kinds->second.GetJsObject()) {
            TfToken base;
            if (facts.IsObject()) {
                const auto& object = facts.GetJsObject();
                const auto found = object.find("baseKind");
                if (found != object.end() && found->second.IsString())
                    base = TfToken(found->second.GetString());
            }
            baseOf_.try_emplace(TfToken(name), base);
        }
    }
    // The kinds of OpenUSD always exist. A plug-in cannot change what they derive from.
    baseOf_[model_] = TfToken();
    baseOf_[group_] = model_;
    baseOf_[component_] = model_;
    baseOf_[TfToken("assembly")] = group_;
    baseOf_[TfToken("subcomponent")] = TfToken();
}

bool Kinds::isA(TfToken kind, const TfToken& base) const {
    // The number of steps is limited, because kinds of plug-ins may derive from each other in a
    // cycle.
    for (std::size_t steps = 0; steps <= baseOf_.size() && !kind.IsEmpty(); ++steps) {
        const auto found = baseOf_.find(kind);
        if (found == baseOf_.end()) return false;
        if (kind == base) return true;
        kind = found->second;
    }
    return false;
}

}  // namespace usdlive::stage
