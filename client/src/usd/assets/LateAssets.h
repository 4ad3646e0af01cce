// Lets stages compose files and layers that were not there when a layer named them.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "basics/Worker.h"
#include "usd/live/LiveSet.h"
#include "usd/places/LayerPlaces.h"
#include "usd/places/PlainFiles.h"

namespace usdlive::client {

/// OpenUSD composes a reference, payload, sublayer or value clip that it could not open only when
/// the field changes. For files and layers that have come since, this class finds the fields of
/// live layers that name them, and lets Sdf notify of these fields. A worker searches the layers.
/// Used by the thread that owns them.
class LateAssets {
public:
    /// All arguments outlive this object.
    LateAssets(LiveSet& live, LayerPlaces& places, const PlainFiles& files, Worker& worker);
    ~LateAssets();
    LateAssets(const LateAssets&) = delete;
    LateAssets& operator=(const LateAssets&) = delete;

    /// Call it when the project has new layers.
    void add(const std::vector<LayerId>& layers);
    /// Call it when files can be opened that could not be opened before. Those that OpenUSD does
    /// not open as layers are ignored.
    void add(const std::vector<std::string>& files);
    /// Part of a tick, within its change block and after the editor's writes are sealed: notifies
    /// of what a search has found, and starts the next search.
    void compose();
    /// Does the same for value clips, after the change block: OpenUSD keeps what it knows of a set
    /// of clips that is the same before and after one round of changes.
    void composeClips();

private:
    /// The files and layers to search for. Both have paths in the project.
    struct Wanted {
        std::set<std::string> files, layers;
        [[nodiscard]] bool isEmpty() const { return files.empty() && layers.empty(); }
    };
    struct Named;
    struct Search;
    [[nodiscard]] bool isWanted(const LiveLayer& live, const Named& named) const;
    [[nodiscard]] bool isWanted(const LiveLayer& live, const std::string& asset) const;
    void start();
    template <class Take>
    void takeFound(Take take);

    LiveSet& live_;
    LayerPlaces& places_;
    const PlainFiles& files_;
    Worker& worker_;
    Wanted next_;
    std::shared_ptr<Search> search_;  // shared with the worker; nullptr: none runs
};

}  // namespace usdlive::client
