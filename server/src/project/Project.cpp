#include "usdlive/server/project/Project.h"

#include "ProjectImpl.h"
#include "usdlive/common/core/Overloaded.h"

namespace usdlive::server {

Project::Impl::Impl(Options options, Ports ports, StoreState store,
                    const std::vector<LayerFile>& files)
    : options_(std::move(options)),
      ports_(ports),
      epoch_(store.head.epoch),
      hasSpace_(store.hasSpace),
      access_(options_.administrators, options_.lockTakeoverMs, wallClockMs()),
      history_(firstNamespaceRevision(options_, store.head), store.head.revision,
               store.namespaceChanges),
      firstRevision_(store.head.revision),
      executed_(store.head.revision),
      executedHash_(store.head.hash),
      durable_(store.head.revision),
      durableHash_(store.head.hash),
      recent_(options_.recentCommitBytes),
      base_(store.base),
      oldest_(base_.revision),
      forgottenUpTo_(store.forgottenUpTo) {
    setFiles(files);
    for (const LayerId& layer : store.unsaved)
        if (const auto found = layers_.find(layer); found != layers_.end())
            found->second.unsaved = true;
}

Result<StoreState> readState(const CommitStore& store, const Project::Options& options) {
    StoreState state;
    state.head = store.head();
    state.base = store.base();
    state.forgottenUpTo = store.forgottenUpTo();
    state.hasSpace = store.hasSpace();
    auto changes = store.namespaceChanges(Project::firstNamespaceRevision(options, state.head));
    if (!changes) return tl::unexpected(changes.error());
    auto unsaved = store.unsavedLayers();
    if (!unsaved) return tl::unexpected(unsaved.error());
    state.namespaceChanges = std::move(*changes);
    state.unsaved = std::move(*unsaved);
    return state;
}

const LayerDoc* Project::Impl::layer(const LayerId& layer) const {
    const auto found = docs_.find(layer);
    return found == docs_.end() ? nullptr : &found->second;
}

SharedBytes encodeNews(const News& news) {
    const auto isEmpty = Overloaded{
        [](const LayerStates& states) { return states.layers.empty(); },
        [](const Presences& people) { return people.shown.empty() && people.gone.empty(); }};
    if (std::visit(isEmpty, news)) return nullptr;
    const auto json = std::visit([](const auto& message) { return encodeControl(message); }, news);
    return std::make_shared<const Bytes>(encodeFrame(ControlFrame{json}));
}

Project::Project(Options options, Ports ports, StoreState store,
                 const std::vector<LayerFile>& files)
    : impl_(std::make_unique<Impl>(std::move(options), ports, std::move(store), files)) {}
Project::~Project() = default;

void Project::connected(SessionId session) { impl_->connected(session); }
void Project::received(SessionId session, ByteView message) {
    impl_->received(session, message);
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::disconnected(SessionId session) {
    impl_->disconnected(session);
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::drained(SessionId session) { impl_->drained(session); }
void Project::appended(Revision upTo) {
    impl_->appended(upTo);
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::appendFailed(Error error, CommitStore::Head head) {
    impl_->appendFailed(error, head);
    impl_->tellStates();
}
void Project::storeClosed() { impl_->storeClosed(); }
void Project::layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded) {
    impl_->layerLoaded(layer, std::move(loaded));
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::layerNotStored(const LayerId& layer) { impl_->layerNotStored(layer); }
void Project::snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes) {
    impl_->snapshotKept(layer, bytes);
}
void Project::commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits) {
    impl_->commitsRead(session, std::move(commits));
}
void Project::historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc) {
    impl_->historyRead(session, request, std::move(doc));
}
void Project::historyNotStored(SessionId session, std::uint64_t request) {
    impl_->historyNotStored(session, request);
}
void Project::clientRead(const ClientId& client, const Result<ClientRecord>& record) {
    impl_->clientRead(client, record);
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored) {
    impl_->blobsFound(asked, stored);
    impl_->tellStates();
    impl_->unloadIdle();
}
void Project::blobWritten(SessionId session, const Hash& hash, Result<bool> whole) {
    impl_->blobWritten(session, hash, whole);
}
void Project::layersSaved(SessionId session, std::uint64_t request, SaveOutcome outcome) {
    impl_->layersSaved(session, request, outcome);
    impl_->tellStates();
}
void Project::layersBeingSaved(SessionId session, std::uint64_t request, const LayerId& layer,
                               std::size_t done, std::size_t total) {
    impl_->layersBeingSaved(session, request, layer, done, total);
}
void Project::layerBeingImported(const LayerId& layer) { impl_->layerBeingImported(layer); }
void Project::layerCreated(SessionId session, std::uint64_t request, const LayerId& layer,
                           const Result<void>& created) {
    impl_->layerCreated(session, request, layer, created);
    impl_->tellStates();
}
void Project::skippedListed(SessionId session, std::uint64_t request,
                            Result<std::vector<SkippedFile>> skipped) {
    impl_->skippedListed(session, request, std::move(skipped));
}
void Project::fileChecked(const LayerId& layer, Result<std::optional<FileStamp>> file) {
    impl_->fileChecked(layer, file);
    impl_->tellStates();
}
void Project::layerReloaded(SessionId session, std::uint64_t request, const LayerId& layer,
                            Result<ReloadedLayer> reloaded) {
    impl_->layerReloaded(session, request, layer, std::move(reloaded));
    impl_->tellStates();
}
void Project::checkpointAdded(SessionId session, std::uint64_t request,
                              const Result<Checkpoint>& added) {
    impl_->checkpointAdded(session, request, added);
}
void Project::checkpointsRead(SessionId session, std::uint64_t request,
                              Result<std::vector<Checkpoint>> checkpoints) {
    impl_->checkpointsRead(session, request, std::move(checkpoints));
}
void Project::boundHistory() { impl_->boundHistory(); }
void Project::baseFound(Result<BaseLimit> limit) { impl_->baseFound(std::move(limit)); }
void Project::baseIs(const CommitStore::Base& base) { impl_->baseIs(base); }
void Project::clientsForgotten(Revision upTo) { impl_->clientsForgotten(upTo); }
void Project::setSpace(bool hasSpace) { impl_->setSpace(hasSpace); }
void Project::compacted(const Result<CompactOutcome>& outcome) { impl_->compacted(outcome); }
void Project::storageMeasured(SessionId session, std::uint64_t request, Result<Storage> storage) {
    impl_->storageMeasured(session, request, std::move(storage));
}
void Project::setFiles(const std::vector<LayerFile>& files) {
    impl_->setFiles(files);
    impl_->tellStates();
}
void Project::unloadIdle() { impl_->unloadIdle(); }
void Project::sweep(std::int64_t nowMs) { impl_->sweep(nowMs); }
bool Project::hasPresence() const { return impl_->hasPresence(); }
std::set<ClientId> Project::activeClients() const { return impl_->activeClients(); }

std::vector<Hash> Project::unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                       std::int64_t nowMs) {
    return impl_->unusedBlobs(unnamed, upTo, nowMs);
}
Revision Project::durableRevision() const { return impl_->durableRevision(); }
const ProjectCounters& Project::counters() const { return impl_->counters(); }
std::size_t Project::sessionCount() const { return impl_->sessionCount(); }
const LayerDoc* Project::layer(const LayerId& layer) const { return impl_->layer(layer); }

}  // namespace usdlive::server
