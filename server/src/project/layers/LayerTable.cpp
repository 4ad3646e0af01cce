// Loads layers on their first use, and imports those that the store does not have.
#include "project/layers/LayerTable.h"

#include <algorithm>

namespace usdlive::server {

namespace {

// An import is one commit. FlatBuffers are limited to 2 GiB.
constexpr std::size_t kMaxImportBytes = 1 << 30;

}  // namespace

Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc) {
    auto frame = encodeImport(layer, doc, kMaxImportBytes);
    if (!frame)
        return fail(ErrorCode::LayerUnreadable, layer.value + " is too large to be imported");
    LayerImport made{std::move(*frame), {}};
    forEachBlob(doc, [&](const Value& blob) { made.blobs.push_back(blob.hash()); });
    return made;
}

std::vector<LayerId> LayerTable::removeUnused(
    const std::function<bool(const LayerId&)>& isRemoved) {
    std::vector<LayerId> removed;
    for (const auto& [layer, entry] : layers_)
        if (std::holds_alternative<NotLoaded>(entry.loading) && entry.changed == 0 &&
            isRemoved(layer))
            removed.push_back(layer);
    for (const LayerId& layer : removed) {
        layers_.erase(layer);
        listeners_.notify(&LayerListener::removed, layer);
    }
    return removed;
}

void LayerTable::require(const LayerId& layer) {
    LayerLoading& loading = layers_[layer].loading;
    if (!std::holds_alternative<NotLoaded>(loading)) return;
    loading = Loading{};
    history_->loadLayer(layer);
}

void LayerTable::unload(const LayerId& layer) {
    line_->drop(layer);
    layers_[layer].loading = NotLoaded{};
}

std::vector<LayerId> LayerTable::all() const {
    std::vector<LayerId> all;
    for (const auto& [layer, entry] : layers_) all.push_back(layer);
    return all;
}

std::vector<LayerInfo> LayerTable::infos() const {
    std::vector<LayerInfo> infos;
    for (const auto& [layer, entry] : layers_) infos.push_back({layer});
    return infos;
}

const LayerLoading* LayerTable::loading(const LayerId& layer) const {
    const auto found = layers_.find(layer);
    return found == layers_.end() ? nullptr : &found->second.loading;
}

bool LayerTable::isLoaded(const LayerId& layer) const {
    const auto found = layers_.find(layer);
    return found != layers_.end() && std::holds_alternative<Loaded>(found->second.loading);
}

Revision LayerTable::changed(const LayerId& layer) const {
    const auto found = layers_.find(layer);
    return found == layers_.end() ? 0 : found->second.changed;
}

bool LayerTable::isAnyLoading() const {
    return std::ranges::any_of(layers_, [](const auto& one) {
        return std::holds_alternative<Loading>(one.second.loading);
    });
}

// ---- answers of the ports

void LayerTable::notStored(const LayerId& layer) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !std::holds_alternative<Loading>(found->second.loading)) return;
    files_->importLayer(layer);
}

void LayerTable::layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !std::holds_alternative<Loading>(found->second.loading)) return;
    if (!loaded) return fail(layer, loaded.error());
    line_->put(layer, loaded->doc);
    found->second.loading = Loaded{};
    listeners_.notify(&LayerListener::loaded, layer, *loaded);
    const bool imported = loaded->import.has_value();
    if (imported) {
        if (const auto error = store_->whyNotWritable()) {
            line_->drop(layer);
            return fail(layer, *error);
        }
        line_->commitImport({layer, std::move(loaded->import->frame),
                             std::move(loaded->import->blobs), std::move(loaded->saved.file)});
    }
    listeners_.notify(&LayerListener::ready, layer, imported);
}

void LayerTable::fail(const LayerId& layer, const Error& error) {
    layers_[layer].loading = LoadFailed{error};
    listeners_.notify(&LayerListener::failed, layer, error);
    layers_[layer].loading = NotLoaded{};
}

// ---- the line

void LayerTable::ordered(const OrderedCommit& commit) {
    for (const LayerId& layer : commit.layers) layers_[layer].changed = commit.revision;
}

void LayerTable::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    for (const LayerId& layer : lost.changed) {
        Entry& entry = layers_[layer];
        entry.loading = NotLoaded{};
        entry.changed = std::min(entry.changed, line_->durable());
    }
    // A lost import is repeated when the layer is needed again.
    for (const LayerId& layer : lost.changed)
        if (!lost.imported.contains(layer)) require(layer);
}

}  // namespace usdlive::server
