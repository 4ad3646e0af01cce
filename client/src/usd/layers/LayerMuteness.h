// The muteness of a stage's layers, in Kit's two scopes.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

struct LayersContext;

/// Keeps which layers the stage mutes, and the flags of both scopes. Those of the local scope are
/// in memory; those of the global scope are in the root layer's map, which all editors share. The
/// stage has the flags of the present scope. Changes that others make on the stage become flags of
/// that scope.
class LayerMuteness {
public:
    /// `isLocal` returns whether a layer is in the local layer stack. Called by follow() and
    /// setScope() only.
    using IsLocal = std::function<bool(const std::string&)>;

    LayerMuteness(LayersContext& context, IsLocal isLocal);

    void setScope(bool global);
    [[nodiscard]] bool isScopeGlobal() const { return globalScope_; }
    [[nodiscard]] bool isMutedLocally(const std::string& id) const { return local_.contains(id); }
    [[nodiscard]] bool isMutedGlobally(const std::string& id) const { return global_.contains(id); }
    /// Returns the state of the stage at the last check.
    [[nodiscard]] bool isMuted(const std::string& id) const { return stage_.contains(id); }
    /// Changes when isMuted() changes for a layer.
    [[nodiscard]] std::uint64_t revision() const { return revision_; }

    /// Writes the flag. In global scope the stage follows.
    LayerResult<void> setGlobally(const std::string& id, bool muted);

    /// Adopts changes on the stage. Writes nothing, so it is safe inside a notice of the stage.
    void stageChanged();
    /// Reads the flags of the global scope again. Writes nothing; the stage follows with follow().
    void flagsChanged();
    /// Lets the stage follow the flags, and writes the flags that follow from changes on the stage.
    void follow();

private:
    void learnFlags();
    void apply(const std::set<std::string>& wanted);
    void writeFlags();
    void notify(std::vector<std::string> changed);

    LayersContext& context_;
    const IsLocal isLocal_;
    bool globalScope_ = false;
    std::set<std::string> local_, global_, stage_;
    std::map<std::string, bool> unwritten_;  // flags to write in the next frame
    bool applying_ = false;                  // we are changing the stage
    bool stageDue_ = false;                  // the stage has to adopt the global flags
    std::uint64_t revision_ = 1;
};

}  // namespace usdlive::layers
