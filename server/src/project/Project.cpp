// Implements Project: passes each call to the part that handles it.
#include "project/Project.h"

#include <span>

#include "project/ProjectImpl.h"
#include "project/sessions/UpdateFrames.h"

namespace usdlive::server {

Result<StoreState> readState(const CommitStore& store, const Project::Options& options) {
    StoreState state;
    state.head = store.head();
    state.base = store.base();
    state.forgottenUpTo = store.forgottenUpTo();
    state.hasSpace = store.hasSpace();
    state.identity = store.identity();
    auto changes = store.namespaceChanges(Project::firstNamespaceRevision(options, state.head));
    if (!changes) return tl::unexpected(changes.error());
    auto unsaved = store.unsavedLayers();
    if (!unsaved) return tl::unexpected(unsaved.error());
    if (state.head.revision > state.base.revision) {
        const auto time = timeOf(store, state.head.revision);
        if (!time) return tl::unexpected(time.error());
        state.headTimeMs = *time;
    }
    state.namespaceChanges = std::move(*changes);
    state.unsaved = std::move(*unsaved);
    return state;
}

SharedBytes encodeStateUpdate(const StateUpdate& update) {
    Bytes frames;
    if (const auto* states = std::get_if<LayerStates>(&update)) {
        appendUpdates(frames, std::span(states->layers),
                      [](auto some) { return LayerStates{{some.begin(), some.end()}}; });
    } else {
        const auto& people = std::get<Presences>(update);
        appendUpdates(frames, std::span(people.shown),
                      [](auto some) { return Presences{{some.begin(), some.end()}, {}}; });
        appendUpdates(frames, std::span(people.gone),
                      [](auto some) { return Presences{{}, {some.begin(), some.end()}}; });
    }
    return frames.empty() ? nullptr : std::make_shared<const Bytes>(std::move(frames));
}

Project::Project(Options options, Ports ports, StoreState store,
                 const std::vector<LayerFile>& files)
    : impl_(std::make_unique<Impl>(std::move(options), ports, std::move(store), files)) {}
Project::~Project() = default;

void Project::connected(SessionId session, std::optional<SignedIn> user,
                        const std::string& address) {
    impl_->connected(session, std::move(user), address);
}
void Project::rolesChanged(const std::function<Role(const SignedIn&)>& roleOf) {
    impl_->rolesChanged(roleOf);
    impl_->finishCall();
}
bool Project::endSignIns(std::int64_t now) {
    const bool willEnd = impl_->endSignIns(now);
    impl_->finishCall();
    return willEnd;
}
void Project::setRules(std::shared_ptr<const AccessRules> rules) {
    impl_->setRules(std::move(rules));
}
void Project::received(SessionId session, ByteView message) {
    impl_->received(session, message);
    impl_->finishCall();
}
void Project::disconnected(SessionId session) {
    impl_->disconnected(session);
    impl_->finishCall();
}
void Project::drained(SessionId session) { impl_->catchup_.drained(session); }
void Project::appended(Revision upTo) {
    impl_->line_.appended(upTo);
    impl_->finishCall();
}
void Project::appendFailed(Error error, CommitStore::Head head) {
    impl_->appendFailed(error, head);
    impl_->states_.announce();
}
void Project::storeClosed() { impl_->store_.closed = true; }
void Project::layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded) {
    impl_->layers_.layerLoaded(layer, std::move(loaded));
    impl_->finishCall();
}
void Project::layerNotStored(const LayerId& layer) { impl_->layers_.notStored(layer); }
void Project::snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes) {
    impl_->snapshots_.kept(layer, bytes);
}
void Project::commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits) {
    impl_->commitsRead(session, std::move(commits));
}
void Project::historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc) {
    impl_->openings_.historyRead(session, request, std::move(doc));
}
void Project::historyNotStored(SessionId session, std::uint64_t request) {
    impl_->openings_.historyNotStored(session, request);
}
void Project::clientRead(const ClientId& client, const Result<ClientRecord>& record) {
    impl_->clientRead(client, record);
    impl_->finishCall();
}
void Project::blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored) {
    impl_->blobsFound(asked, stored);
    impl_->finishCall();
}
void Project::blobWritten(SessionId session, const Hash& hash, Result<bool> whole) {
    impl_->values_.written(session, hash, whole);
}
void Project::layersSaved(SessionId session, std::uint64_t request, SaveOutcome outcome) {
    impl_->saves_.saved(session, request, outcome);
    impl_->states_.announce();
}
void Project::layersBeingSaved(SessionId session, std::uint64_t request, const LayerId& layer,
                               std::size_t done, std::size_t total) {
    impl_->saves_.progressed(session, request, layer, done, total);
}
void Project::layerBeingImported(const LayerId& layer) { impl_->openings_.beingImported(layer); }
void Project::layerCreated(SessionId session, std::uint64_t request, const LayerId& layer,
                           const Result<void>& created) {
    impl_->newLayers_.created(session, request, layer, created);
    impl_->states_.announce();
}
void Project::fileStored(SessionId session, std::uint64_t request, const std::string& path,
                         const Result<bool>& complete) {
    impl_->newFiles_.stored(session, request, path, complete);
}
void Project::skippedListed(SessionId session, std::uint64_t request,
                            Result<std::vector<SkippedFile>> skipped) {
    impl_->newLayers_.skippedListed(session, request, std::move(skipped));
}
void Project::fileChecked(const LayerId& layer, Result<std::optional<FileStamp>> file) {
    impl_->fileStates_.checked(layer, file);
    if (impl_->options_.reloadsFiles && impl_->fileStates_.isOutdated(layer))
        impl_->reloads_.reloadByItself(layer);
    impl_->finishCall();
}
void Project::layerReloaded(SessionId session, std::uint64_t request, const LayerId& layer,
                            Result<ReloadedLayer> reloaded) {
    impl_->reloads_.fileRead(session, request, layer, std::move(reloaded));
    impl_->states_.announce();
}
void Project::checkpointAdded(SessionId session, std::uint64_t request,
                              const Result<Checkpoint>& added) {
    impl_->checkpoints_.added(session, request, added);
}
void Project::checkpointsRead(SessionId session, std::uint64_t request,
                              Result<std::vector<Checkpoint>> checkpoints) {
    impl_->checkpoints_.listed(session, request, std::move(checkpoints));
}
void Project::boundHistory() { impl_->compaction_.boundHistory(); }
void Project::baseFound(Result<BaseLimit> limit) { impl_->compaction_.baseFound(std::move(limit)); }
void Project::baseChanged(const CommitStore::Base& base) { impl_->start_.moveTo(base); }
void Project::clientsForgotten(Revision upTo) { impl_->authors_.clientsForgotten(upTo); }
void Project::setSpace(bool hasSpace) { impl_->store_.hasSpace = hasSpace; }
void Project::compacted(const Result<CompactOutcome>& outcome) {
    impl_->compaction_.compacted(outcome);
}
void Project::storageMeasured(SessionId session, std::uint64_t request, Result<Storage> storage) {
    impl_->compaction_.measured(session, request, std::move(storage));
}
void Project::setFiles(const std::vector<LayerFile>& files) {
    impl_->fileStates_.show(files);
    impl_->states_.announce();
}
void Project::unloadIdle() { impl_->idleLayers_.unload(); }
void Project::sweep(std::int64_t nowMs) { impl_->presences_.sweep(nowMs); }
bool Project::hasPresence() const { return !impl_->presences_.empty(); }
std::set<ClientId> Project::activeClients() const { return impl_->authors_.active(); }

std::vector<Hash> Project::unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                       std::int64_t nowMs) {
    return impl_->unusedBlobs(unnamed, upTo, nowMs);
}
Revision Project::durableRevision() const { return impl_->line_.durable(); }
const ProjectCounters& Project::counters() const { return impl_->counters_; }
std::size_t Project::sessionCount() const { return impl_->sessions_.clients(); }
std::set<UserName> Project::users() const { return impl_->sessions_.users(); }
const Subject* Project::subjectOf(SessionId session) const {
    const Session* found = impl_->sessions_.find(session);
    return found && found->isGreeted() ? &found->subject : nullptr;
}
const LayerDoc* Project::layer(const LayerId& layer) const { return impl_->line_.doc(layer); }

}  // namespace usdlive::server
