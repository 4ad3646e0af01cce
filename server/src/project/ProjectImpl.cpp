// Creates a project from its parts and connects them.
#include "project/ProjectImpl.h"

#include <utility>

namespace usdlive::server {

namespace {

HistoryLine::Limits lineLimits(const Project::Options& options) {
    return {{options.wholeCommitBytes, options.maxFrameBytes, options.partBytes,
             options.maxTransactionBytes},
            options.namespaceLogRevisions};
}

TransactionLimits transactionLimits(const Project::Options& options) {
    return {options.maxEditsPerTransaction, options.maxTransactionBytes};
}

}  // namespace

Project::Impl::Impl(Options options, Ports ports, StoreState store,
                    const std::vector<LayerFile>& files)
    : options_(std::move(options)),
      identity_(std::move(store.identity)),
      activity_(ports.activity),
      store_{store.hasSpace},
      start_(store.base),
      time_(ports.clock),
      line_(lineLimits(options_),
            {store.head,
             firstNamespaceRevision(options_, store.head),
             std::move(store.namespaceChanges),
             {},
             store.headTimeMs},
            ports.history, time_),
      sessions_(ports.outbox, options_.texts,
                {{options_.sessionRequestBytes, options_.userRequestBytes, options_.requestBytes},
                 options_.maxUserLayers}),
      presences_(sessions_, ports.outbox),
      layers_(line_, store_, ports.history, ports.files),
      layerLists_(layers_, sessions_, ports.outbox),
      fileStates_(layers_, layerLists_, suspects_, ports.files),
      states_(line_, layers_, fileStates_, sessions_, suspects_, ports),
      snapshots_({options_.leastReplay, options_.snapshotIntervalMs}, line_, ports.history,
                 ports.clock),
      facts_(line_, states_, sessions_, ports.clock),
      access_(facts_, options_.administrators, options_.lockTakeoverMs),
      reads_(ports.history),
      catchup_({options_.recentCommitBytes, options_.maxBehind}, line_, start_, sessions_, reads_,
               previews_, ports.outbox, counters_),
      gestures_(previews_, line_, sessions_, catchup_, access_, ports.outbox, counters_),
      values_({options_.maxBlobBytes, options_.keepUnusedBlobsMs}, sessions_, store_, previews_,
              ports.blobs, ports.outbox),
      openings_(line_, start_, layers_, sessions_, catchup_, ports),
      authors_(sessions_, store_, ports.history, store.forgottenUpTo),
      prerequisites_(line_, start_, layers_, values_, reads_),
      submissions_(transactionLimits(options_),
                   {line_, store_, sessions_, authors_, prerequisites_, catchup_, gestures_,
                    access_, ports.activity},
                   counters_),
      greeting_(options_, {identity_, line_, start_, store_, sessions_, authors_, layers_,
                           layerLists_, states_, presences_, reads_, catchup_, gestures_, access_,
                           ports.outbox, ports.activity, *this}),
      saves_(line_, layers_, fileStates_, sessions_, access_, ports),
      reloads_(line_, store_, layers_, fileStates_, sessions_, access_, ports),
      newLayers_(store_, layers_, fileStates_, sessions_, access_, ports),
      newFiles_(options_.maxBlobBytes, store_, sessions_, access_, ports),
      checkpoints_(line_, sessions_, access_, time_, ports),
      compaction_(
          options_.historyDays,
          {line_, start_, sessions_, access_, greeting_, reads_, catchup_, openings_, time_},
          ports),
      idleLayers_({options_.idleLayerMs, options_.idleLayerBytes},
                  {line_, layers_, fileStates_, snapshots_, sessions_, access_, submissions_,
                   saves_, reloads_},
                  ports.clock, counters_) {
    connectListeners();
    fileStates_.show(files);
    fileStates_.setUnsaved(store.unsaved);
}

/// Listeners are notified in the order in which they are added here. Two things depend on it: a
/// part is notified after the parts whose state it reads, and a session is sent a commit before the
/// messages that result from it.
void Project::Impl::connectListeners() {
    LineListener* const line[]{&gestures_,   &values_, &submissions_, &layers_,     &access_,
                               &fileStates_, &states_, &snapshots_,   &catchup_,    &authors_,
                               &openings_,   &saves_,  &reloads_,     &checkpoints_};
    for (LineListener* listener : line) line_.addListener(*listener);
    LayerListener* const layers[]{&fileStates_, &states_,      &access_, &snapshots_, &openings_,
                                  &idleLayers_, &submissions_, &saves_,  &reloads_};
    for (LayerListener* listener : layers) layers_.addListener(*listener);
    SessionListener* const sessions[]{&submissions_, &states_,   &access_,  &idleLayers_,
                                      &presences_,   &catchup_,  &reads_,   &values_,
                                      &openings_,    &gestures_, &authors_, &saves_};
    for (SessionListener* listener : sessions) sessions_.addListener(*listener);
}

void Project::Impl::finishCall() {
    states_.announce();
    idleLayers_.unload();
}

// ---- answers that several parts handle

void Project::Impl::appendFailed(const Error& error, const CommitStore::Head& head) {
    store_.closed = false;
    line_.appendFailed(error, head);
    submissions_.workAll();
}

/// Resuming sessions and waiting transactions need the record of the client's commits (M9).
void Project::Impl::clientRead(const ClientId& client, const Result<ClientRecord>& record) {
    if (!authors_.answered(client, record)) return;
    for (auto& [id, session] : sessions_.all()) {
        if (session.client != client || session.isClosing()) continue;
        const bool isResuming = std::holds_alternative<CheckingResume>(session.phase);
        // Without the record, a transaction may be committed twice. The session is closed; the
        // client reconnects, and the record is requested again. A session that submits nothing
        // stays open.
        if (!record && !store_.closed && (isResuming || submissions_.isWaiting(id)))
            sessions_.close(session, record.error());
        else if (isResuming)
            greeting_.checkResume(session);
        else
            submissions_.work(id);
    }
    authors_.forgetIfUnused(client);
}

void Project::Impl::commitsRead(SessionId id, Result<std::vector<StoredCommit>> commits) {
    auto answer = reads_.answered(id, std::move(commits));
    if (!answer) return;
    switch (answer->read.purpose) {
        case ReadPurpose::ResumeCheck:
            return greeting_.resumeRead(id, answer->commits);
        case ReadPurpose::Stream:
            return catchup_.commitsRead(id, std::move(answer->commits));
        case ReadPurpose::Creations:
            return submissions_.creationsRead(id, answer->read.sequence, answer->commits);
    }
}

void Project::Impl::blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored) {
    values_.found(asked, stored);
    submissions_.workAll();
}

std::vector<Hash> Project::Impl::unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                             std::int64_t nowMs) {
    // Nothing is dropped if the project does not know all commits after `upTo`: it was created
    // later, or the store has failed.
    if (upTo < line_.first() || store_.closed) return {};
    // Files that are being read contain big values that no commit names yet. Files that are being
    // written may contain values that no commit names any more.
    if (saves_.isWriting() || reloads_.isReading() || layers_.isAnyLoading()) return {};
    std::unordered_set<Hash> named;
    submissions_.addNamed(named);
    return values_.takeUnused({unnamed, upTo, nowMs, named});
}

}  // namespace usdlive::server
