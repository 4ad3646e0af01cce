// The files of a project's folder.
#pragma once

#include <unordered_map>
#include <vector>

#include "app/ProjectStrand.h"
#include "app/SharedStore.h"
#include "app/Workers.h"
#include "files/AssetFiles.h"
#include "files/LayerFiles.h"
#include "project/ports/Files.h"
#include "transport/Log.h"

namespace usdlive::server {

/// The files of a project's folder, read and written by workers. Network thread.
class ServedFiles final : public ports::Files {
public:
    ServedFiles(ProjectStrand& strand, WorkerShares& workers, LayerFiles& files, AssetFiles& assets,
                const BlobStore& blobs, SharedStore& store, Log& log);

    void importLayer(const LayerId& layer) override;
    void readLayer(SessionId session, std::uint64_t request, const LayerId& layer) override;
    void saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) override;
    void setSaved(const LayerId& layer, const SavedState& saved) override;
    void checkFile(const LayerId& layer) override;
    void reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                     LayerDoc present) override;
    void createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) override;
    void storeFile(SessionId session, std::uint64_t request, UploadJob job) override;
    void listSkipped(SessionId session, std::uint64_t request) override;

private:
    // Run by workers.
    Result<LoadedLayer> import(const LayerId& layer);
    SaveOutcome save(SessionId session, std::uint64_t request, const std::vector<SaveJob>& jobs);
    Result<FileStamp> save(const SaveJob& job);

    ProjectStrand& strand_;
    WorkerShares& workers_;
    // Keeps saves in order, because the last save of a layer has to win.
    SerialJobs saver_;
    // The files that `saver_` has written last. A save that was requested before the previous one
    // finished does not know that one's result.
    std::unordered_map<LayerId, SavedState> written_;
    // Uploads take long and wait for each other, so that saves and imports have a worker.
    SerialJobs uploader_;
    LayerFiles& files_;
    AssetFiles& assets_;
    const BlobStore& blobs_;
    SharedStore& store_;
    Log& log_;
};

}  // namespace usdlive::server
