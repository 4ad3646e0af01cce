// The layers and clips that a live layer names.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <set>
#include <string>
#include <utility>

#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

/// Notes which fields of a layer name other layers or value clips, and collects the asset paths
/// that are new in them. Finding them in a whole layer takes long, because Sdf reads every spec.
class UsedAssets {
public:
    /// The layer has new content, in which these were found.
    void replace(usd::LayerFill::Named named) {
        namesLayers_ = !named.arcs.empty();
        namesClips_ = !named.clips.empty();
        named_.arcs.merge(named.arcs);
        named_.clips.merge(named.clips);
    }
    /// Notes an edit. The layer may have its content only at the end of a block. Returns false if
    /// it names nothing.
    bool note(const std::string& path, const EditAction& action) {
        const auto* set = std::get_if<SetField>(&action);
        return set && note(path, set->field);
    }
    bool note(const std::string& path, const std::string& field) {
        const bool clips = usd::namesClips(field);
        if (!clips && !usd::namesLayers(field)) return false;
        (clips ? namesClips_ : namesLayers_) = true;
        naming_.emplace(path, field);
        return true;
    }

    /// Return false if the layer certainly names none.
    [[nodiscard]] bool namesLayers() const { return namesLayers_; }
    [[nodiscard]] bool namesClips() const { return namesClips_; }
    /// Returns whether take() may return any.
    [[nodiscard]] bool hasNew() const {
        return !naming_.empty() || !named_.arcs.empty() || !named_.clips.empty();
    }
    /// Returns the asset paths that the layer has got since the last call.
    [[nodiscard]] usd::LayerFill::Named take(const pxr::SdfLayerHandle& layer) {
        for (const auto& [path, field] : std::exchange(naming_, {}))
            usd::addNamedAssets(layer->GetField(pxr::SdfPath(path), pxr::TfToken(field)),
                                usd::namesClips(field) ? named_.clips : named_.arcs);
        return std::exchange(named_, {});
    }

private:
    bool namesLayers_ = false;
    bool namesClips_ = false;
    std::set<std::pair<std::string, std::string>> naming_;  // paths and fields to be read
    usd::LayerFill::Named named_;
};

}  // namespace usdlive::client
