// Compares the files in the project's folder with the content that was written or read last.
#include "project/layers/FileStates.h"

#include <utility>

namespace usdlive::server {

void FileStates::show(const std::vector<LayerFile>& files) {
    std::set<LayerId> listed;
    for (const LayerFile& file : files) listed.insert(file.layer);
    const std::vector<LayerId> removed = layers_->removeUnused([&](const LayerId& layer) {
        return !listed.contains(layer) && entry(layer).saved.revision == 0;
    });
    std::vector<LayerId> added;
    for (const LayerFile& file : files) {
        if (layers_->add(file.layer)) added.push_back(file.layer);
        Entry& entry = entries_[file.layer];
        if (entry.present == file) continue;
        entry.present = file;
        checkIfChanged(file.layer, entry);
    }
    // A loaded layer stays in the list without its file, because the store has it.
    for (auto& [layer, entry] : entries_) {
        if (listed.contains(layer) || !entry.present.trace) continue;
        entry.present.trace.reset();
        checkIfChanged(layer, entry);
    }
    lists_->changed(added, removed);
}

void FileStates::setUnsaved(const std::vector<LayerId>& layers) {
    for (const LayerId& layer : layers)
        if (layers_->has(layer)) entries_[layer].unsaved = true;
}

void FileStates::addCreated(const LayerId& layer) {
    if (layers_->add(layer)) lists_->changed({layer}, {});
}

const FileStates::Entry& FileStates::entry(const LayerId& layer) const {
    static const Entry kNone;
    const auto found = entries_.find(layer);
    return found == entries_.end() ? kNone : found->second;
}

bool FileStates::isDirty(const LayerId& layer) const {
    const Entry& known = entry(layer);
    return known.unsaved || known.missing || layers_->changed(layer) > known.saved.revision;
}

bool FileStates::isOutdated(const LayerId& layer) const { return entry(layer).outdated; }

const SavedState& FileStates::saved(const LayerId& layer) const { return entry(layer).saved; }

const LayerFile& FileStates::present(const LayerId& layer) const { return entry(layer).present; }

/// Requests a check of the file's content if its metadata have changed.
void FileStates::checkIfChanged(const LayerId& layer, Entry& entry) {
    suspects_->insert(layer);
    if (!entry.saved.file) return;
    const auto& trace = entry.present.trace;
    if (!trace) {
        entry.missing = true;
        entry.outdated = false;
    } else if (*trace != entry.saved.file->trace && trace != entry.looked) {
        entry.looked = trace;
        files_->checkFile(layer);
    }
}

void FileStates::checked(const LayerId& layer, const Result<std::optional<FileStamp>>& checked) {
    const auto found = entries_.find(layer);
    if (found == entries_.end() || !found->second.saved.file) return;
    Entry& entry = found->second;
    suspects_->insert(layer);
    if (!checked) {
        entry.looked.reset();  // the next scan of the folder requests it again
        return;
    }
    entry.missing = !*checked;
    entry.outdated = false;
    if (!*checked) return;
    const FileStamp& stamp = **checked;
    entry.present.trace = entry.looked = stamp.trace;
    if (const auto& pending = entry.saved.pending; pending && stamp.hash == pending->hash) {
        const SavedState saved{pending->revision, stamp};
        noteFile(layer, saved);
        files_->setSaved(layer, saved);
    } else if (stamp.hash == entry.saved.file->hash) {
        entry.saved.file->trace = stamp.trace;
    } else {
        entry.outdated = true;
    }
}

/// Notes that the file has the content of the layer at the saved revision.
void FileStates::noteFile(const LayerId& layer, const SavedState& saved) {
    if (!layers_->has(layer)) return;
    Entry& entry = entries_[layer];
    suspects_->insert(layer);
    if (saved.revision < entry.saved.revision) return;
    const auto before = std::exchange(entry.saved, saved).file;
    if (before && before == saved.file) return;  // the results of later checks are still valid
    entry.outdated = entry.missing = false;
    entry.looked.reset();
    checkIfChanged(layer, entry);
}

void FileStates::setSaved(const LayerId& layer, const SavedState& saved) {
    if (!layers_->has(layer)) return;
    Entry& entry = entries_[layer];
    entry.unsaved = false;
    if (saved.file) entry.present.trace = saved.file->trace;
    noteFile(layer, saved);
}

void FileStates::loaded(const LayerId& layer, const LoadedLayer& loaded) {
    noteFile(layer, loaded.saved);
}

/// An imported layer is equal to its file.
void FileStates::ordered(const OrderedCommit& commit) {
    if (commit.imported) entries_[*commit.imported].saved.revision = commit.revision;
}

void FileStates::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    for (const LayerId& layer : lost.imported) entries_[layer].saved = {};
}

}  // namespace usdlive::server
