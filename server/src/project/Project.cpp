#include "usdlive/server/project/Project.h"

#include "ProjectImpl.h"

namespace usdlive::server {

Project::Impl::Impl(Options options, ProjectHost& host, CommitStore::Head head,
                    std::vector<LayerId> layers, std::vector<NamespaceChange> changes)
    : options_(std::move(options)),
      host_(host),
      epoch_(head.epoch),
      history_(firstNamespaceRevision(options_, head), head.revision, changes),
      executed_(head.revision),
      executedHash_(head.hash),
      durable_(head.revision),
      durableHash_(head.hash),
      recent_(options_.recentCommitBytes) {
    setLayers(layers);
}

const LayerDoc* Project::Impl::layer(const LayerId& layer) const {
    const auto found = docs_.find(layer);
    return found == docs_.end() ? nullptr : &found->second;
}

Project::Project(Options options, ProjectHost& host, CommitStore::Head head,
                 std::vector<LayerId> layers, std::vector<NamespaceChange> namespaceChanges)
    : impl_(std::make_unique<Impl>(std::move(options), host, head, std::move(layers),
                                   std::move(namespaceChanges))) {}
Project::~Project() = default;

void Project::connected(SessionId session) { impl_->connected(session); }
void Project::received(SessionId session, ByteView message) { impl_->received(session, message); }
void Project::disconnected(SessionId session) { impl_->disconnected(session); }
void Project::drained(SessionId session) { impl_->drained(session); }
void Project::appended(Revision upTo) { impl_->appended(upTo); }
void Project::appendFailed(Error error, CommitStore::Head head) {
    impl_->appendFailed(error, head);
}
void Project::layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded) {
    impl_->layerLoaded(layer, std::move(loaded));
}
void Project::commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits) {
    impl_->commitsRead(session, std::move(commits));
}
void Project::historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc) {
    impl_->historyRead(session, request, std::move(doc));
}
void Project::blobWritten(SessionId session, const Hash& hash, Result<bool> whole) {
    impl_->blobWritten(session, hash, whole);
}
void Project::layersSaved(SessionId session, std::uint64_t request, LayersSaved outcome) {
    impl_->layersSaved(session, request, std::move(outcome));
}
void Project::setLayers(std::vector<LayerId> layers) { impl_->setLayers(layers); }
Revision Project::durableRevision() const { return impl_->durableRevision(); }
const ProjectCounters& Project::counters() const { return impl_->counters(); }
std::size_t Project::sessionCount() const { return impl_->sessionCount(); }
const LayerDoc* Project::layer(const LayerId& layer) const { return impl_->layer(layer); }

}  // namespace usdlive::server
