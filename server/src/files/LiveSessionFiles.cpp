// The files of a project as a live session sees them: it reads them, and writes none.
#include <mutex>
#include <set>
#include <utility>

#include "files/LayerFiles.h"
#include "files/OpenLayerFiles.h"

namespace usdlive::server {

namespace {

class LiveSessionFiles final : public LayerFiles {
public:
    LiveSessionFiles(std::unique_ptr<LayerFiles> files, std::string liveSession)
        : files_(std::move(files)), liveSession_(std::move(liveSession)) {}

    [[nodiscard]] const std::filesystem::path& folder() const override { return files_->folder(); }
    [[nodiscard]] Result<std::vector<LayerFile>> list() const override { return files_->list(); }
    [[nodiscard]] Result<std::vector<SkippedFile>> skipped() const override {
        return files_->skipped();
    }

    Result<void> create(const LayerId& layer) override {
        if (const auto path = files_->resolve(layer); !path) return tl::unexpected(path.error());
        const auto file = files_->stamp(layer);
        if (!file) return tl::unexpected(file.error());
        const std::lock_guard lock(mutex_);
        if (*file || !created_.insert(layer).second)
            return fail(ErrorCode::LayerExists, "the project has a layer " + layer.value +
                                                    ": open it, or choose another name");
        return {};
    }

    [[nodiscard]] Result<std::filesystem::path> resolve(const LayerId& layer) const override {
        return files_->resolve(layer);
    }

    Result<ImportedLayer> import(const LayerId& layer) override {
        {
            const std::lock_guard lock(mutex_);
            if (created_.contains(layer)) return ImportedLayer{};
        }
        return files_->import(layer);
    }

    [[nodiscard]] Result<std::optional<FileStamp>> stamp(const LayerId& layer) const override {
        return files_->stamp(layer);
    }

    [[nodiscard]] Result<FileStamp> save(const LayerId& layer, const LayerDoc& /*doc*/,
                                         const std::vector<Hash>& /*expected*/,
                                         const Ready& /*ready*/) override {
        return fail(ErrorCode::SaveFailed,
                    layer.value + " has no file in the live session " + liveSession_ +
                        ". Merge the session (usdlive session merge), then save the project");
    }

    Result<Bytes> render(const LayerId& layer, const LayerDoc& doc) override {
        return files_->render(layer, doc);
    }

private:
    const std::unique_ptr<LayerFiles> files_;
    const std::string liveSession_;
    std::mutex mutex_;
    std::set<LayerId> created_;  // the store has each of them as soon as somebody uses it
};

}  // namespace

Result<std::unique_ptr<LayerFiles>> createLiveSessionFiles(const std::filesystem::path& folder,
                                                           const std::string& liveSession,
                                                           BlobStore& blobs) {
    auto files = openLayerFiles(folder, blobs);
    if (!files) return files;
    return std::make_unique<LiveSessionFiles>(std::move(*files), liveSession);
}

}  // namespace usdlive::server
