// Imports and saves a project's files on workers.
#include "app/ServedFiles.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "app/Faults.h"

namespace usdlive::server {

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A save that takes longer than this reports its progress, with this pause (PG1).
constexpr milliseconds kProgressPause{500};

}  // namespace

ServedFiles::ServedFiles(ProjectStrand& strand, WorkerShares& workers, LayerFiles& files,
                         AssetFiles& assets, const BlobStore& blobs, SharedStore& store, Log& log)
    : strand_(strand),
      workers_(workers),
      saver_(workers.files),
      uploader_(workers.files),
      files_(files),
      assets_(assets),
      blobs_(blobs),
      store_(store),
      log_(log) {}

void ServedFiles::importLayer(const LayerId& layer) {
    strand_.inBackground(
        *workers_.files, 0, 0, [this, layer] { return import(layer); },
        [layer](Project& project, Result<LoadedLayer> imported) {
            project.layerLoaded(layer, std::move(imported));
        });
}

Result<LoadedLayer> ServedFiles::import(const LayerId& layer) {
    faultPoint("import");
    strand_.post([layer](Project& project) { project.layerBeingImported(layer); });
    const auto begin = steady_clock::now();
    auto imported = files_.import(layer);
    if (!imported) {
        log_.write(LogLevel::Warning, "layer cannot be read",
                   {{"layer", layer.value}, {"error", imported.error().message}});
        return tl::unexpected(imported.error());
    }
    auto& [doc, file] = *imported;
    auto commit = makeImport(layer, doc);
    if (!commit) return tl::unexpected(commit.error());
    const auto time = std::chrono::duration_cast<milliseconds>(steady_clock::now() - begin);
    log_.write(LogLevel::Info, "file read",
               {{"layer", layer.value}, {"specs", doc.specCount()}, {"ms", time.count()}});
    return LoadedLayer{std::move(doc), std::move(*commit), {0, file}};
}

void ServedFiles::readLayer(SessionId session, std::uint64_t request, const LayerId& layer) {
    strand_.inBackground(
        *workers_.history, session, Intake::kJobBytes,
        [this, layer] {
            return files_.import(layer).map(
                [](ImportedLayer&& found) { return std::move(found.doc); });
        },
        [session, request](Project& project, Result<LayerDoc> doc) {
            project.historyRead(session, request, std::move(doc));
        });
}

void ServedFiles::saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) {
    strand_.inBackground(
        saver_, session, Intake::kJobBytes,
        [this, session, request, jobs = std::move(jobs)]() -> Result<SaveOutcome> {
            return save(session, request, jobs);
        },
        [session, request](Project& project, Result<SaveOutcome> saved) {
            project.layersSaved(session, request, std::move(*saved));
        });
}

Result<FileStamp> ServedFiles::save(const SaveJob& job) {
    faultPoint("save-before");
    const auto written = written_.find(job.layer);
    const bool isNewer =
        written != written_.end() && written->second.revision >= job.saved.revision;
    const SavedState known = isNewer ? written->second : job.saved;
    std::vector<Hash> expected;
    if (job.onlyIfUnchanged && known.file) expected.push_back(known.file->hash);
    if (job.onlyIfUnchanged && known.pending) expected.push_back(known.pending->hash);
    auto saved = files_.save(job.layer, job.doc, expected, [&](const Hash& hash) {
        SavedState state = known;
        state.pending = SavedState::PendingSave{job.revision, hash};
        return store_.use([&](CommitStore& store) { return store.setSaved(job.layer, state); });
    });
    faultPoint("save-after");
    if (!saved) return saved;
    const SavedState state{job.revision, *saved, {}};
    written_[job.layer] = state;
    return store_.use([&](CommitStore& store) { return store.setSaved(job.layer, state); })
        .map([&] { return *saved; });
}

SaveOutcome ServedFiles::save(SessionId session, std::uint64_t request,
                              const std::vector<SaveJob>& jobs) {
    SaveOutcome outcome;
    auto reported = steady_clock::now();
    for (std::size_t index = 0; index < jobs.size(); ++index) {
        const SaveJob& job = jobs[index];
        if (steady_clock::now() - reported >= kProgressPause) {
            reported = steady_clock::now();
            strand_.post([=, layer = job.layer, total = jobs.size()](Project& project) {
                project.layersBeingSaved(session, request, layer, index, total);
            });
        }
        outcome.revision = std::max(outcome.revision, job.revision);
        auto work = [&] { return save(job); };
        if (const auto saved = resultOf(work)) {
            outcome.saved.emplace_back(job.layer, *saved);
        } else {
            log_.write(LogLevel::Error, "layer not saved",
                       {{"layer", job.layer.value}, {"error", saved.error().message}});
            outcome.failed.push_back(
                {job.layer, std::string(errorName(saved.error().code)), saved.error().message});
        }
    }
    return outcome;
}

void ServedFiles::setSaved(const LayerId& layer, const SavedState& saved) {
    saver_.post([this, layer, saved] {
        const auto set =
            store_.use([&](CommitStore& store) { return store.setSaved(layer, saved); });
        if (!set)
            log_.write(LogLevel::Warning, "the store could not record that a layer is saved",
                       {{"layer", layer.value}, {"error", set.error().message}});
    });
}

void ServedFiles::checkFile(const LayerId& layer) {
    strand_.inBackground(
        saver_, 0, 0, [this, layer] { return files_.stamp(layer); },
        [layer](Project& project, Result<std::optional<FileStamp>> file) {
            project.fileChecked(layer, std::move(file));
        });
}

void ServedFiles::reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                              LayerDoc present) {
    strand_.inBackground(
        saver_, session, Intake::kJobBytes,
        [this, layer, present = std::move(present)]() -> Result<ReloadedLayer> {
            auto imported = files_.import(layer);
            if (!imported) return tl::unexpected(imported.error());
            return makeReload(layer, present, imported->doc, imported->file);
        },
        [session, request, layer](Project& project, Result<ReloadedLayer> reloaded) {
            project.layerReloaded(session, request, layer, std::move(reloaded));
        });
}

void ServedFiles::createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) {
    strand_.inBackground(
        saver_, session, Intake::kJobBytes, [this, layer] { return files_.create(layer); },
        [session, request, layer](Project& project, const Result<void>& created) {
            project.layerCreated(session, request, layer, created);
        });
}

void ServedFiles::storeFile(SessionId session, std::uint64_t request, UploadJob job) {
    const std::string path = job.path;
    strand_.inBackground(
        uploader_, session, Intake::kJobBytes,
        [this, job = std::move(job)]() -> Result<bool> {
            auto stored = assets_.store({job.path, job.hash, job.size, job.overwrite}, blobs_,
                                        [] { faultPoint("upload-before"); });
            if (!stored)
                log_.write(LogLevel::Warning, "file not written",
                           {{"file", job.path}, {"error", stored.error().message}});
            if (stored && *stored) faultPoint("upload-after");
            return stored;
        },
        [session, request, path](Project& project, const Result<bool>& complete) {
            project.fileStored(session, request, path, complete);
        });
}

void ServedFiles::listSkipped(SessionId session, std::uint64_t request) {
    strand_.inBackground(
        *workers_.files, session, Intake::kJobBytes, [this] { return files_.skipped(); },
        [session, request](Project& project, Result<std::vector<SkippedFile>> skipped) {
            project.skippedListed(session, request, std::move(skipped));
        });
}

}  // namespace usdlive::server
