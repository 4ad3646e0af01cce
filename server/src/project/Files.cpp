// The files of layers: which there are, and whether they hold what the server knows of (FI1, FI2).
#include <algorithm>
#include <utility>

#include "ProjectImpl.h"

namespace usdlive::server {

void Project::Impl::setFiles(const std::vector<LayerFile>& files) {
    std::set<LayerId> listed;
    for (const LayerFile& file : files) listed.insert(file.layer);
    bool changed = std::erase_if(layers_, [&](const auto& entry) {
                       return std::holds_alternative<NotLoaded>(entry.second.state) &&
                              entry.second.changed == 0 && entry.second.saved.revision == 0 &&
                              !listed.contains(entry.first);
                   }) > 0;
    for (const LayerFile& file : files) {
        const auto [found, added] = layers_.try_emplace(file.layer);
        changed |= added;
        if (found->second.file.present == file) continue;
        found->second.file.present = file;
        checkFile(file.layer, found->second);
    }
    // One that was loaded stays without its file: the store has it.
    for (auto& [layer, entry] : layers_) {
        if (listed.contains(layer) || !entry.file.present.trace) continue;
        entry.file.present.trace.reset();
        checkFile(layer, entry);
    }
    if (changed) tellLayers();
}

/// SE9
void Project::Impl::tellLayers() {
    const auto frame = std::make_shared<const Bytes>(
        encodeFrame(ControlFrame{encodeControl(ProjectLayers{layerInfos()})}));
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted()) ports_.outbox.send(id, frame);
}

/// FI6
void Project::Impl::createLayer(Session& session, const CreateLayer& request) {
    if (layers_.contains(request.layer))
        return sendError(session,
                         {ErrorCode::LayerExists, "the project has a layer " + request.layer.value +
                                                      ": open it, or choose another name"},
                         request.request);
    if (storeClosed_)
        return sendError(session, {ErrorCode::StorageFailed, "the store has failed"},
                         request.request);
    if (!hasSpace_)
        return sendError(session, {ErrorCode::StorageFull, "the disk of the server is full"},
                         request.request);
    ports_.files.createLayerFile(session.id, request.request, request.layer);
}

void Project::Impl::layerCreated(SessionId id, std::uint64_t request, const LayerId& layer,
                                 const Result<void>& created) {
    Session* session = find(id);
    const bool here = session && session->isGreeted();
    if (!created) {
        if (here) sendError(*session, created.error(), request);
        return;
    }
    // Loaded at once, so that it is in the store, whatever the folder looked like a moment ago.
    if (layers_.try_emplace(layer).second) tellLayers();
    if (std::holds_alternative<NotLoaded>(layers_[layer].state)) load(layer);
    if (!here) return;
    ports_.activity.happened({"layer created", session->subject.user, layer});
    send(*session, LayerCreated{request, layer});
}

void Project::Impl::skippedListed(SessionId id, std::uint64_t request,
                                  Result<std::vector<SkippedFile>> skipped) {
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (!skipped) return sendError(*session, skipped.error(), request);
    SkippedFiles answer{request, skipped->size(), std::move(*skipped)};
    if (answer.files.size() > kMaxSkippedFiles) answer.files.resize(kMaxSkippedFiles);
    send(*session, answer);
}

/// Asks for what the file holds when it looks other than it did.
void Project::Impl::checkFile(const LayerId& layer, LayerEntry& entry) {
    EntryFile& file = entry.file;
    suspects_.insert(layer);
    if (!entry.saved.file) return;
    const auto& trace = file.present.trace;
    if (!trace) {
        file.missing = true;
        file.outdated = false;
    } else if (*trace != entry.saved.file->trace && trace != file.looked) {
        file.looked = trace;
        ports_.files.checkFile(layer);
    }
}

void Project::Impl::fileChecked(const LayerId& layer,
                                const Result<std::optional<FileStamp>>& checked) {
    const auto found = layers_.find(layer);
    if (found == layers_.end()) return;
    LayerEntry& entry = found->second;
    EntryFile& file = entry.file;
    if (!entry.saved.file) return;
    suspects_.insert(layer);
    if (!checked) {
        file.looked.reset();  // the next look at the folder asks again
        return;
    }
    file.missing = !*checked;
    file.outdated = false;
    if (!*checked) return;
    const FileStamp& stamp = **checked;
    file.present.trace = file.looked = stamp.trace;
    if (const auto& coming = entry.saved.coming; coming && stamp.hash == coming->hash) {
        const SavedState saved{coming->revision, stamp};
        fileWas(layer, saved);
        ports_.files.setSaved(layer, saved);
    } else if (stamp.hash == entry.saved.file->hash) {
        entry.saved.file->trace = stamp.trace;
    } else {
        file.outdated = true;
    }
}

/// As the store says: the file holds, as far as is known, what the layer was at that revision.
void Project::Impl::fileWas(const LayerId& layer, const SavedState& saved) {
    const auto found = layers_.find(layer);
    if (found == layers_.end()) return;
    LayerEntry& entry = found->second;
    suspects_.insert(layer);
    if (saved.revision < entry.saved.revision) return;
    const auto before = std::exchange(entry.saved, saved).file;
    if (before && before == saved.file) return;  // what was found out since still holds
    entry.file.outdated = entry.file.missing = false;
    entry.file.looked.reset();
    checkFile(layer, entry);
}

/// It was just written or read. The folder is looked at again before it may look otherwise.
void Project::Impl::fileIs(const LayerId& layer, const SavedState& saved) {
    const auto found = layers_.find(layer);
    if (found == layers_.end()) return;
    found->second.unsaved = false;
    if (saved.file) found->second.file.present.trace = saved.file->trace;
    fileWas(layer, saved);
}

}  // namespace usdlive::server
