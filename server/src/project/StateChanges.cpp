#include "usdlive/server/project/StateChanges.h"

#include <set>
#include <tuple>
#include <unordered_map>

#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

std::string destination(const Edit& edit, const MoveSpec& move) {
    return specpath::child(move.parent.path, specpath::last(edit.address.path).list, move.name);
}

std::optional<NamespaceChange> namespaceChange(Revision revision, const ExecutedEdit& executed) {
    if (!executed.applied.changed) return std::nullopt;
    const Edit& edit = executed.edit;
    if (std::holds_alternative<DeleteSpec>(edit.action))
        return NamespaceChange{revision, edit.layer, edit.address.path, std::nullopt};
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    if (!move) return std::nullopt;
    return NamespaceChange{revision, edit.layer, edit.address.path, destination(edit, *move)};
}

/// Where a spec that an edit was for stands after the whole transaction.
class FinalPaths {
public:
    FinalPaths(const LayerDocs& layers, const std::vector<ExecutedEdit>& edits) : layers_(layers) {
        for (std::size_t index = 0; index < edits.size(); ++index)
            if (auto change = namespaceChange(0, edits[index]))
                moves_[change->layer].push_back({index, std::move(*change)});
    }

    /// `path` is the node's after edit number `index`. Nothing when it was deleted by a later one.
    std::optional<std::string> find(const LayerId& layer, NodeId node, std::string path,
                                    std::size_t index) {
        const auto moves = moves_.find(layer);
        if (moves == moves_.end() || moves->second.back().first <= index) return path;
        // Carrying the path over later moves costs their number; once that was done too often, all
        // paths of the layer are looked up instead, which costs its size, once.
        if (moves->second.size() > budget_) return lookUp(layer, node);
        budget_ -= moves->second.size();
        return carry(moves->second, std::move(path), index);
    }

private:
    using Moves = std::vector<std::pair<std::size_t, NamespaceChange>>;

    static std::optional<std::string> carry(const Moves& moves, std::string path,
                                            std::size_t index) {
        for (const auto& [at, change] : moves) {
            if (at <= index || !specpath::hasPrefix(path, change.from)) continue;
            if (!change.to) return std::nullopt;
            path = specpath::replacePrefix(path, change.from, *change.to);
        }
        return path;
    }
    std::optional<std::string> lookUp(const LayerId& layer, NodeId node) {
        const auto [entry, added] = paths_.try_emplace(layer);
        auto& paths = entry->second;
        if (added)
            layers_.at(layer).visit([&paths](const LayerDoc::SpecView& spec) {
                paths.emplace(spec.node, std::string(spec.path));
            });
        const auto found = paths.find(node);
        return found == paths.end() ? std::nullopt : std::optional(found->second);
    }

    const LayerDocs& layers_;
    std::unordered_map<LayerId, Moves> moves_;
    std::unordered_map<LayerId, std::unordered_map<NodeId, std::string>> paths_;
    std::size_t budget_ = 10'000;
};

/// Walks the edits in order. What an edit says by itself is written at once; fields of which parts
/// were set and renumbered lists are written once, at the end, as they then are.
class Collector {
public:
    Collector(const LayerDocs& layers, const std::vector<ExecutedEdit>& edits)
        : layers_(layers), edits_(edits), paths_(layers, edits) {}

    std::vector<StateChange> collect() {
        for (; index_ < edits_.size(); ++index_) {
            const ExecutedEdit& executed = edits_[index_];
            if (!executed.applied.changed) continue;
            std::visit([&](const auto& action) { add(executed, action); }, executed.edit.action);
        }
        for (const auto& [layer, node, parent] : renumbered_) putChildren(layer, node, parent);
        for (const auto& [key, path] : fields_) putFinalField(key, path);
        return std::move(changes_);
    }

private:
    using FieldKey = std::tuple<LayerId, NodeId, std::string>;

    std::optional<std::string> finalPath(const ExecutedEdit& executed, std::string path) {
        return paths_.find(executed.edit.layer, executed.applied.node, std::move(path), index_);
    }

    void add(const ExecutedEdit& executed, const CreateSpec&) {
        putNode(executed, executed.edit.address.path);
    }
    void add(const ExecutedEdit& executed, const MoveSpec& move) {
        putNode(executed, destination(executed.edit, move));
    }
    void add(const ExecutedEdit& executed, const PlaceSpec&) {
        putNode(executed, executed.edit.address.path);
    }
    void add(const ExecutedEdit& executed, const DeleteSpec&) {
        changes_.push_back(EraseNodes{executed.edit.layer, executed.applied.erased});
    }
    void add(const ExecutedEdit& executed, const SetField& set) {
        const LayerId& layer = executed.edit.layer;
        const NodeId node = executed.applied.node;
        if (std::holds_alternative<std::monostate>(set.part))
            changes_.push_back(
                PutField{layer, node, set.field, set.value, executed.applied.hadSamples});
        else if (const auto* sample = std::get_if<SampleTime>(&set.part))
            changes_.push_back(
                PutSample{layer, node, set.field, sample->time, *set.value.as<Value>()});
        else
            putFieldLater(executed, set.field);
    }
    void add(const ExecutedEdit& executed, const usdlive::EraseField& erase) {
        const LayerId& layer = executed.edit.layer;
        const NodeId node = executed.applied.node;
        const auto* sample = std::get_if<SampleTime>(&erase.part);
        if (std::holds_alternative<std::monostate>(erase.part))
            changes_.push_back(
                server::EraseField{layer, node, erase.field, executed.applied.hadSamples});
        else if (sample && isThere(executed, erase.field))
            changes_.push_back(EraseSample{layer, node, erase.field, sample->time});
        else
            putFieldLater(executed, erase.field);
    }

    void putNode(const ExecutedEdit& executed, const std::string& path) {
        const LayerId& layer = executed.edit.layer;
        const LayerDoc::Applied& applied = executed.applied;
        // Deleted by a later edit: then nothing needs to be known of it.
        if (const auto now = finalPath(executed, path))
            changes_.push_back(PutNode{layer, applied.node, applied.parent, applied.order,
                                       *layers_.at(layer).kind(*now),
                                       std::string(specpath::last(*now).name)});
        if (!applied.renumbered) return;
        if (auto parent = paths_.find(layer, applied.parent, specpath::parent(path), index_))
            renumbered_.emplace(layer, applied.parent, std::move(*parent));
    }
    void putChildren(const LayerId& layer, NodeId parent, const std::string& path) {
        layers_.at(layer).visit(path, [&](const LayerDoc::SpecView& spec) {
            if (spec.parent == parent)
                changes_.push_back(PutNode{layer, spec.node, parent, spec.order, spec.kind,
                                           std::string(spec.name)});
        });
    }

    bool isThere(const ExecutedEdit& executed, const std::string& field) {
        const auto now = finalPath(executed, executed.edit.address.path);
        return now && layers_.at(executed.edit.layer).field(*now, field);
    }
    void putFieldLater(const ExecutedEdit& executed, const std::string& field) {
        if (auto now = finalPath(executed, executed.edit.address.path))
            fields_.insert_or_assign({executed.edit.layer, executed.applied.node, field},
                                     std::move(*now));
    }
    void putFinalField(const FieldKey& key, const std::string& path) {
        const auto& [layer, node, field] = key;
        if (const FieldValue* value = layers_.at(layer).field(path, field))
            changes_.push_back(PutField{layer, node, field, *value});
        else
            changes_.push_back(server::EraseField{layer, node, field});
    }

    const LayerDocs& layers_;
    const std::vector<ExecutedEdit>& edits_;
    FinalPaths paths_;
    std::size_t index_ = 0;
    std::set<std::tuple<LayerId, NodeId, std::string>> renumbered_;  // layer, parent, its path
    std::map<FieldKey, std::string> fields_;                         // with the node's path
    std::vector<StateChange> changes_;
};

}  // namespace

std::vector<StateChange> stateChanges(const LayerDocs& layers,
                                      const std::vector<ExecutedEdit>& edits) {
    return Collector(layers, edits).collect();
}

std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                              const std::vector<ExecutedEdit>& edits) {
    std::vector<NamespaceChange> changes;
    for (const ExecutedEdit& executed : edits)
        if (auto change = namespaceChange(revision, executed))
            changes.push_back(std::move(*change));
    return changes;
}

}  // namespace usdlive::server
