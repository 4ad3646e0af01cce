// Maps layers to files in project folders and in the cache folder of a client.
#include "usd/places/FolderPlaces.h"

#include <pxr/usd/ar/resolver.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "usd/places/PlainFiles.h"  // encodedInAddress
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

std::optional<LayerId> layerIn(const fs::path& folder, const std::string& path) {
    if (path.empty() || path.front() != '/') return std::nullopt;
    const std::string file = pxr::SdfLayer::SplitIdentifier(path).first;
    const std::string normal = fs::path(file).lexically_normal().string();
    const std::string prefix = folder.string() + "/";
    if (!normal.starts_with(prefix)) return std::nullopt;
    const auto id = parseLayerId(std::string_view(normal).substr(prefix.size()));
    return id ? std::optional(*id) : std::nullopt;
}

}  // namespace

Result<std::unique_ptr<FolderPlaces>> FolderPlaces::create(const fs::path& folder) {
    std::error_code error;
    fs::path canonical = fs::canonical(folder, error);
    if (error || !fs::is_directory(canonical))
        return fail(ErrorCode::InvalidArgument, folder.string() + " is not a folder");
    return std::unique_ptr<FolderPlaces>(new FolderPlaces(std::move(canonical)));
}

std::string FolderPlaces::identifierOf(const LayerId& layer) const {
    return (folder_ / layer.value).string();
}

std::optional<LayerId> FolderPlaces::layerAt(const std::string& identifier) const {
    return layerIn(folder_, identifier);
}

std::optional<LayerId> FolderPlaces::layerOf(const pxr::SdfLayerHandle& layer) const {
    return layerIn(folder_, layer->GetRealPath());
}

Result<std::unique_ptr<CacheFolderPlaces>> CacheFolderPlaces::create(const fs::path& folder,
                                                                     Worker& worker) {
    std::error_code error;
    fs::create_directories(folder, error);
    fs::path canonical = error ? fs::path() : fs::canonical(folder, error);
    if (error)
        return fail(ErrorCode::InvalidArgument,
                    "cannot use " + folder.string() + " as cache folder: " + error.message());
    return std::unique_ptr<CacheFolderPlaces>(new CacheFolderPlaces(std::move(canonical), worker));
}

CacheFolderPlaces::CacheFolderPlaces(fs::path folder, Worker& worker)
    : FolderPlaces(std::move(folder)), worker_(worker), placeholders_(this->folder()) {}

std::string CacheFolderPlaces::identifierOf(const LayerId& layer) const {
    if (base_.empty()) return FolderPlaces::identifierOf(layer);
    return pxr::ArGetResolver().CreateIdentifier(base_ + encodedInAddress(layer.value));
}

std::optional<LayerId> CacheFolderPlaces::layerAt(const std::string& identifier) const {
    if (base_.empty()) return FolderPlaces::layerAt(identifier);
    if (!identifier.starts_with(base_)) return std::nullopt;
    const std::string file = pxr::SdfLayer::SplitIdentifier(identifier).first;
    const auto path = percentDecoded(std::string_view(file).substr(base_.size()));
    if (!path) return std::nullopt;
    const auto id = parseLayerId(*path);
    return id ? std::optional(*id) : std::nullopt;
}

std::optional<LayerId> CacheFolderPlaces::layerOf(const pxr::SdfLayerHandle& layer) const {
    return base_.empty() ? FolderPlaces::layerOf(layer) : layerAt(layer->GetIdentifier());
}

void CacheFolderPlaces::add(std::vector<LayerId> layers, double budgetMs) {
    placeholders_.add(std::move(layers), budgetMs, worker_);
}

AllPlaces::AllPlaces(std::unique_ptr<LayerPlaces> first) { places_.push_back(std::move(first)); }

void AllPlaces::attach(std::unique_ptr<LayerPlaces> further) {
    // Two places are the same if they give a layer the same identifier.
    const LayerId any{"layer.usda"};
    const auto identifier = further->identifierOf(any);
    const bool known = std::ranges::any_of(
        places_, [&](const auto& place) { return place->identifierOf(any) == identifier; });
    if (!known) places_.push_back(std::move(further));
}

std::string AllPlaces::identifierBeside(const pxr::SdfLayerHandle& beside,
                                        const LayerId& layer) const {
    for (const auto& place : places_)
        if (place->layerOf(beside)) return place->identifierOf(layer);
    return identifierOf(layer);
}

std::string AllPlaces::identifierOf(const LayerId& layer) const {
    return first().identifierOf(layer);
}

std::optional<LayerId> AllPlaces::layerAt(const std::string& identifier) const {
    for (const auto& place : places_)
        if (auto id = place->layerAt(identifier)) return id;
    return std::nullopt;
}

std::optional<LayerId> AllPlaces::layerOf(const pxr::SdfLayerHandle& layer) const {
    for (const auto& place : places_)
        if (auto id = place->layerOf(layer)) return id;
    return std::nullopt;
}

bool AllPlaces::isPlaceholder(const pxr::SdfLayerHandle& layer) const {
    return std::ranges::any_of(places_,
                               [&](const auto& place) { return place->isPlaceholder(layer); });
}

Result<bool> AllPlaces::makeFindable(const LayerId& layer) { return first().makeFindable(layer); }

void AllPlaces::remove(const LayerId& layer) { first().remove(layer); }

void AllPlaces::add(std::vector<LayerId> layers, double budgetMs) {
    first().add(std::move(layers), budgetMs);
}

bool AllPlaces::isComplete() const { return first().isComplete(); }

std::optional<Error> AllPlaces::takeError() { return first().takeError(); }

}  // namespace usdlive::client
