// The layers of a project, and which are loaded.
#pragma once

#include <map>
#include <variant>
#include <vector>

#include "Wiring.h"
#include "layers/LayerListener.h"
#include "lines/HistoryLine.h"
#include "lines/StoreCondition.h"

namespace usdlive::server {

struct NotLoaded {};
struct Loading {};
struct Loaded {};
/// Only while its listeners are notified.
struct LoadFailed {
    Error error;
};
using LayerLoading = std::variant<NotLoaded, Loading, Loaded, LoadFailed>;

/// Which layers there are. Loads a layer from the store on its first use; one that the store does
/// not have is imported from its file, and its whole content becomes a commit. Loads again what a
/// lost commit had changed.
class LayerTable : public LineListener {
public:
    LayerTable(HistoryLine& line, const StoreCondition& store, ports::History& history,
               ports::Files& files)
        : line_(line), store_(store), history_(history), files_(files) {}

    /// Notified in the order in which they are added.
    void addListener(LayerListener& listener) { listeners_.add(listener); }

    /// False: it is there already.
    bool add(const LayerId& layer) { return layers_.try_emplace(layer).second; }
    /// Removes the layers that are not in use, have no commit since the start, and that `isRemoved`
    /// says are removed. True if there were some.
    bool removeUnused(const std::function<bool(const LayerId&)>& isRemoved);
    /// Begins to load a layer, unless it is or is being loaded.
    void require(const LayerId& layer);
    /// Precondition: it is loaded, and everything in it is durable.
    void unload(const LayerId& layer);

    [[nodiscard]] bool has(const LayerId& layer) const { return layers_.contains(layer); }
    [[nodiscard]] std::vector<LayerId> all() const;
    /// The list that `welcome` and `projectLayers` (SE9) contain.
    [[nodiscard]] std::vector<LayerInfo> infos() const;
    /// nullptr: there is no such layer.
    [[nodiscard]] const LayerLoading* loading(const LayerId& layer) const;
    [[nodiscard]] bool isLoaded(const LayerId& layer) const;
    /// The newest commit since the start that changed it, durable or not; 0 none.
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
