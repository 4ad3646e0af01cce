// Layers in folders: project folders that the editor opens from, and the cache folder of a client.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "usd/LayerPlaces.h"
#include "usd/Placeholders.h"

namespace usdlive::client {

/// The folder that the server serves, or a copy of it, from which the editor opens layers itself.
/// It has the files of its layers: nothing is made or removed in it.
class FolderPlaces : public LayerPlaces {
public:
    /// InvalidArgument: `folder` is not a folder.
    static Result<std::unique_ptr<FolderPlaces>> create(const std::filesystem::path& folder);

    /// Absolute, without links.
    [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

    [[nodiscard]] std::string identifierOf(const LayerId& layer) const override;
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& identifier) const override;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const override;
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

/// The cache folder: it mirrors the project with files without content, so that relative paths
/// between layers resolve.
class CacheFolderPlaces final : public FolderPlaces {
public:
    /// Creates the folder. InvalidArgument when that fails. `worker` makes the files that a frame
    /// has no time for, and outlives this.
    static Result<std::unique_ptr<CacheFolderPlaces>> create(const std::filesystem::path& folder,
                                                             Worker& worker);

    Result<bool> makeFindable(const LayerId& layer) override { return placeholders_.make(layer); }
    void remove(const LayerId& layer) override { placeholders_.remove(layer); }
    void add(std::vector<LayerId> layers, double budgetMs) override;
    [[nodiscard]] bool isComplete() const override { return placeholders_.isComplete(); }
    [[nodiscard]] std::optional<Error> takeError() override { return placeholders_.takeError(); }

private:
    CacheFolderPlaces(std::filesystem::path folder, Worker& worker);

    Worker& worker_;
    Placeholders placeholders_;
};

/// Several places at once. Layers are opened at the first one; those of the others are recognized.
class AllPlaces final : public LayerPlaces {
public:
    explicit AllPlaces(std::unique_ptr<LayerPlaces> first);
    /// Ignores a place that is there already.
    void attach(std::unique_ptr<LayerPlaces> further);

    /// The identifier of `layer` at the place that has the layer `beside`; at the first place where
    /// none has.
    [[nodiscard]] std::string identifierBeside(const pxr::SdfLayerHandle& beside,
                                               const LayerId& layer) const;

    [[nodiscard]] std::string identifierOf(const LayerId& layer) const override;
    [[nodiscard]] std::optional<LayerId> layerAt(const std::string& identifier) const override;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const override;
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
