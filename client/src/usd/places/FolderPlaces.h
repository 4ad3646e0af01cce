// LayerPlaces in folders: project folders from which the editor opens layers, and the cache folder
// of a client.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "usd/places/LayerPlaces.h"
#include "usd/places/Placeholders.h"

namespace usdlive::client {

/// A folder from which the editor opens layers itself: the one that the server serves, or a copy of
/// it. It has the files of its layers, so no files are created or removed in it.
class FolderPlaces : public LayerPlaces {
public:
    /// Error: InvalidArgument (`folder` is not a folder).
    static Result<std::unique_ptr<FolderPlaces>> create(const std::filesystem::path& folder);

    /// Returns the absolute path, without links.
    [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

    [[nodiscard]] std::string identifierOf(const LayerId& layer) const override;
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& identifier) const override;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const override;
    [[nodiscard]] bool isPlaceholder(const pxr::SdfLayerHandle&) const override { return false; }
    Result<bool> makeFindable(const LayerId&) override { return false; }
    void remove(const LayerId&) override {}
    void add(std::vector<LayerId>, double) override {}
    [[nodiscard]] bool isComplete() const override { return true; }
    [[nodiscard]] std::optional<Error> takeError() override { return std::nullopt; }

protected:
    explicit FolderPlaces(std::filesystem::path folder) : folder_(std::move(folder)) {}

private:
    const std::filesystem::path folder_;
};

/// The cache folder. It mirrors the project by files without content, so that relative paths
/// between layers resolve. The identifiers of layers are the paths of these files, or addresses
/// that the resolver plug-in finds them by.
class CacheFolderPlaces final : public FolderPlaces {
public:
    /// Creates the folder. `worker` creates the files that do not fit into a frame, and outlives
    /// this object. Error: InvalidArgument (the folder cannot be created).
    static Result<std::unique_ptr<CacheFolderPlaces>> create(const std::filesystem::path& folder,
                                                             Worker& worker);

    /// Makes identifiers addresses. `base` is the address of the project, with a slash at its end.
    void useAddresses(std::string base) { base_ = std::move(base); }

    [[nodiscard]] std::string identifierOf(const LayerId& layer) const override;
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& identifier) const override;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const override;
    [[nodiscard]] bool isPlaceholder(const pxr::SdfLayerHandle& layer) const override {
        return layerOf(layer).has_value();
    }
    Result<bool> makeFindable(const LayerId& layer) override { return placeholders_.make(layer); }
    void remove(const LayerId& layer) override { placeholders_.remove(layer); }
    void add(std::vector<LayerId> layers, double budgetMs) override;
    [[nodiscard]] bool isComplete() const override { return placeholders_.isComplete(); }
    [[nodiscard]] std::optional<Error> takeError() override { return placeholders_.takeError(); }

private:
    CacheFolderPlaces(std::filesystem::path folder, Worker& worker);

    Worker& worker_;
    Placeholders placeholders_;
    std::string base_;  // empty: identifiers are paths
};

/// Several places together. Layers are opened at the first one; layers of the others are
/// recognized.
class AllPlaces final : public LayerPlaces {
public:
    explicit AllPlaces(std::unique_ptr<LayerPlaces> first);
    /// Adds a place, unless it exists already.
    void attach(std::unique_ptr<LayerPlaces> further);

    /// Returns the identifier of `layer` at the place that has the layer `beside`, or at the first
    /// place if none has it.
    [[nodiscard]] std::string identifierBeside(const pxr::SdfLayerHandle& beside,
                                               const LayerId& layer) const;

    [[nodiscard]] std::string identifierOf(const LayerId& layer) const override;
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& identifier) const override;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const override;
    [[nodiscard]] bool isPlaceholder(const pxr::SdfLayerHandle& layer) const override;
    Result<bool> makeFindable(const LayerId& layer) override;
    void remove(const LayerId& layer) override;
    void add(std::vector<LayerId> layers, double budgetMs) override;
    [[nodiscard]] bool isComplete() const override;
    [[nodiscard]] std::optional<Error> takeError() override;

private:
    [[nodiscard]] LayerPlaces& first() const { return *places_.front(); }

    std::vector<std::unique_ptr<LayerPlaces>> places_;
};

}  // namespace usdlive::client
