// Declares Kinds, the kinds of models that OpenUSD and its plug-ins define.
#pragma once

#include <pxr/base/tf/token.h>

#include <map>

namespace usdlive::stage {

class Kinds {
public:
    /// Reads "Kinds" from the metadata of all plug-ins that PlugRegistry knows.
    Kinds();

    [[nodiscard]] bool isA(pxr::TfToken kind, const pxr::TfToken& base) const;
    [[nodiscard]] bool isModel(const pxr::TfToken& kind) const { return isA(kind, model_); }
    [[nodiscard]] bool isGroup(const pxr::TfToken& kind) const { return isA(kind, group_); }
    [[nodiscard]] bool isComponent(const pxr::TfToken& kind) const { return isA(kind, component_); }

private:
    const pxr::TfToken model_{"model"}, group_{"group"}, component_{"component"};
    std::map<pxr::TfToken, pxr::TfToken> baseOf_;
};

}  // namespace usdlive::stage
