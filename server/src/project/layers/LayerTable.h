// The layers of a project, and whether they are loaded.
#pragma once

#include <map>
#include <variant>
#include <vector>

#include "project/Wiring.h"
#include "project/layers/LayerListener.h"
#include "project/lines/HistoryLine.h"
#include "project/lines/StoreCondition.h"

namespace usdlive::server {

struct NotLoaded {};
struct Loading {};
struct Loaded {};
/// This state lasts only while the listeners are notified.
struct LoadFailed {
    Error error;
};
using LayerLoading = std::variant<NotLoaded, Loading, Loaded, LoadFailed>;

/// The list of layers. Loads a layer from the store on its first use. If the store does not have
/// it, imports it from its file: its whole content becomes a commit. Loads layers again if commits
/// that changed them were lost.
class LayerTable : public LineListener {
public:
    LayerTable(HistoryLine& line, const StoreCondition& store, ports::History& history,
               ports::Files& files)
        : line_(line), store_(store), history_(history), files_(files) {}

    /// Listeners are notified in the order in which they are added.
    void addListener(LayerListener& listener) { listeners_.add(listener); }

    /// Adds a layer. Returns false if it exists already.
    bool add(const LayerId& layer) { return layers_.try_emplace(layer).second; }
    /// Removes the layers that are not loaded, have no commit since the start, and for which
    /// `isRemoved` returns true. Returns them.
    std::vector<LayerId> removeUnused(const std::function<bool(const LayerId&)>& isRemoved);
    /// Starts to load a layer, unless it is loaded or being loaded.
    void require(const LayerId& layer);
    /// Removes a layer from memory. Precondition: it is loaded, and all its commits are durable.
    void unload(const LayerId& layer);

    [[nodiscard]] bool has(const LayerId& layer) const { return layers_.contains(layer); }
    [[nodiscard]] std::vector<LayerId> all() const;
    /// Returns the list for sessions without the feature `layerList` (SE9).
    [[nodiscard]] std::vector<LayerInfo> infos() const;
    /// Returns nullptr if there is no such layer.
    [[nodiscard]] const LayerLoading* loading(const LayerId& layer) const;
    [[nodiscard]] bool isLoaded(const LayerId& layer) const;
    /// Returns the newest commit since the start that changed the layer, durable or not; 0 if there
    /// is none.
    [[nodiscard]] Revision changed(const LayerId& layer) const;
    [[nodiscard]] bool isAnyLoading() const;

    // Answers of the ports.
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    void notStored(const LayerId& layer);

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;

private:
    struct Entry {
        LayerLoading loading;
        Revision changed = 0;
    };
    void fail(const LayerId& layer, const Error& error);

    Wire<HistoryLine> line_;
    Wire<const StoreCondition> store_;
    Wire<ports::History> history_;
    Wire<ports::Files> files_;
    Listeners<LayerListener> listeners_;
    std::map<LayerId, Entry> layers_;
};

}  // namespace usdlive::server
