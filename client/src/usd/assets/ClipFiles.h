// The layers of the project that are read as files, because value clips name them.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usd/places/LayerPlaces.h"
#include "usd/places/PlainFiles.h"

namespace usdlive::client {

/// The layers that value clips name. OpenUSD opens such a layer when a value needs it, uses what it
/// has then, and does not compose it. So they are not made live and filled later, but are files of
/// the project, which have their content when they are opened (PlainFiles::readAsFile()).
///
/// A layer is none of them while it is live, if an arc names it as well, or if it was opened before
/// clips named it. It is filled as other layers are, and its clips are composed again then.
///
/// Does nothing while PlainFiles is not started. Used by the thread that owns the layers.
class ClipFiles {
public:
    /// `mayBeFile` returns whether a layer is in the project and not live. The arguments outlive
    /// this object.
    ClipFiles(const LayerPlaces& places, PlainFiles& files,
              std::function<bool(const LayerId&)> mayBeFile);

    /// Returns whether the layer is read as a file.
    [[nodiscard]] bool contains(const LayerId& id) const { return files_.contains(id); }
    /// Returns whether clips name the layer.
    [[nodiscard]] bool areClips(const LayerId& id) const;

    /// Call it with the asset paths and templates of clips in a live layer, before Sdf notifies of
    /// them. `project` has the layers of the project.
    void addClips(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets,
                  const std::set<LayerId>& project);
    /// Call it with the asset paths of arcs in a live layer, before those of its clips.
    void addArcs(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets);
    /// Call it before a layer is opened live, and when the editor has closed it.
    void opens(const LayerId& id);
    void closed(const LayerId& id);
    /// Call it when the layers of the project have changed. `added` were not in it before.
    void projectChanged(const std::vector<LayerId>& added);

private:
    [[nodiscard]] std::optional<LayerId> named(const pxr::SdfLayerHandle& layer,
                                               const std::string& asset) const;
    [[nodiscard]] bool hasArc(const LayerId& id) const;
    void add(const LayerId& id);
    void mark(const LayerId& id);
    void addMatching(const LayerId& pattern, const std::set<LayerId>& project);

    const LayerPlaces& places_;
    PlainFiles& projectFiles_;
    const std::function<bool(const LayerId&)> mayBeFile_;
    std::set<LayerId> named_;      // by clips; the project may not have them
    std::set<LayerId> templates_;  // in `clips` metadata
    std::set<LayerId> files_;
    // The asset paths of arcs and the layers that have them, by the names of the files.
    std::map<std::string, std::set<std::pair<pxr::SdfLayerHandle, std::string>>, std::less<>> arcs_;
};

}  // namespace usdlive::client
