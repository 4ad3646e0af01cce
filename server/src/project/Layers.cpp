// Layers: loaded on first use, imported if the store has none, opened by sessions.
#include "ProjectImpl.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

// An import is one commit; FlatBuffers end at 2 GiB.
constexpr std::size_t kMaxImportBytes = 1 << 30;

constexpr std::size_t kMaxHistoryReads = 16;  // of one session at once: each replays a layer
constexpr std::size_t kMaxOpens = 10'000;     // that wait for one layer

}  // namespace

Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc) {
    auto frame = encodeImport(layer, doc, kMaxImportBytes);
    if (!frame)
        return fail(ErrorCode::LayerUnreadable, layer.value + " is too large to be imported");
    LayerImport made{std::move(*frame), {}};
    forEachBlob(doc, [&](const Value& blob) { made.blobs.push_back(blob.hash()); });
    return made;
}

std::vector<LayerInfo> Project::Impl::layerInfos() const {
    std::vector<LayerInfo> infos;
    for (const auto& [layer, entry] : layers_) infos.push_back({layer});
    return infos;
}

void Project::Impl::openLayer(Session& session, const OpenLayer& open) {
    const auto found = layers_.find(open.layer);
    if (found == layers_.end())
        return sendError(session,
                         {ErrorCode::LayerNotFound, "the project has no layer " + open.layer.value},
                         open.request);
    if (open.revision != 0) return openHistory(session, open);
    if (session.open.insert(open.layer).second) suspects_.insert(open.layer);
    const WaitingOpen waiting{session.id, open.request};
    if (std::holds_alternative<Loaded>(found->second.state)) return openLoaded(waiting, open.layer);
    if (found->second.opens.size() >= kMaxOpens)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    found->second.opens.push_back(waiting);
    if (std::holds_alternative<NotLoaded>(found->second.state)) load(open.layer);
}

void Project::Impl::openHistory(Session& session, const OpenLayer& open) {
    if (open.revision > durable_)
        return sendError(
            session,
            {ErrorCode::FutureRevision, "the newest revision is " + std::to_string(durable_)},
            open.request);
    if (open.revision < oldest_)
        return sendError(session, historyReplaced(open.revision, oldest_).value(), open.request);
    if (session.historyReads.size() >= kMaxHistoryReads ||
        !session.historyReads.emplace(open.request, open).second)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    ports_.history.readHistory(session.id, open.request, open.layer, open.revision);
}

void Project::Impl::historyRead(SessionId id, std::uint64_t request, Result<LayerDoc> doc) {
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    const auto found = session->historyReads.find(request);
    if (found == session->historyReads.end()) return;
    const OpenLayer open = found->second;
    session->historyReads.erase(found);
    if (!doc) return sendError(*session, doc.error(), request);
    sendOpened({{id, request}, open.layer, std::move(*doc), open.revision});
}

void Project::Impl::historyNotStored(SessionId id, std::uint64_t request) {
    const Session* session = find(id);
    if (!session) return;
    const auto found = session->historyReads.find(request);
    if (found != session->historyReads.end())
        ports_.files.readLayer(id, request, found->second.layer);
}

/// A snapshot is of what was executed, and sent once that is durable.
void Project::Impl::openLoaded(const WaitingOpen& open, const LayerId& layer) {
    ReadyOpen ready{open, layer, docs_.at(layer), executed_};
    if (ready.revision <= durable_)
        sendOpened(ready);
    else
        readyOpens_.push_back(std::move(ready));
}

void Project::Impl::sendOpened(const ReadyOpen& ready) {
    const auto& [open, layer, doc, revision] = ready;
    Session* session = find(open.session);
    if (!session || !session->isGreeted()) return;
    if (revision > session->position) session->opened.insert(revision);
    send(*session, LayerOpened{open.request, layer, revision, doc.specCount()});
    ports_.outbox.sendSnapshot(open.session, open.request, doc);
}

void Project::Impl::load(const LayerId& layer) {
    layers_[layer].state = Loading{};
    ports_.history.loadLayer(layer);
}

void Project::Impl::layerNotStored(const LayerId& layer) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !std::holds_alternative<Loading>(found->second.state)) return;
    ports_.files.importLayer(layer);
}

void Project::Impl::layerBeingImported(const LayerId& layer) {
    const auto found = layers_.find(layer);
    if (found == layers_.end()) return;
    for (const WaitingOpen& open : found->second.opens) {
        Session* session = find(open.session);
        if (session && session->isGreeted() && session->features.contains("progress"))
            send(*session, RequestProgress{open.request, "import", layer, 0, 0});
    }
}

void Project::Impl::layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !std::holds_alternative<Loading>(found->second.state)) return;
    if (!loaded) return loadFailed(layer, loaded.error());
    docs_.insert_or_assign(layer, loaded->doc);
    found->second.state = Loaded{};
    found->second.replayCost = loaded->replayed.cost;
    found->second.snapshotBytes = loaded->replayed.snapshotBytes;
    fileWas(layer, loaded->saved);
    found->second.lock = lockOf(docs_.at(layer));
    noteMutes(layer);
    access_.noteSpecLocks(layer, docs_);
    if (loaded->import) {
        if (const auto imported = import(layer, std::move(*loaded->import)); !imported) {
            docs_.erase(layer);
            return loadFailed(layer, imported.error());
        }
    }
    takeSnapshot(layer);
    keepSnapshots();
    const auto opens = std::exchange(found->second.opens, {});
    if (!opens.empty() && loaded->import)
        if (const Session* session = find(opens.front().session))
            ports_.activity.happened({"layer imported", session->subject.user, layer});
    for (const WaitingOpen& open : opens) openLoaded(open, layer);
    noteIdle(layer);
    workAll();
    continueSaves();
    continueReloads();
}

/// Whoever waits for it is told; whoever asks next makes another attempt.
void Project::Impl::loadFailed(const LayerId& layer, const Error& error) {
    LayerEntry& entry = layers_[layer];
    entry.state = LoadFailed{error};
    const auto opens = std::exchange(entry.opens, {});
    for (const WaitingOpen& open : opens)
        if (Session* session = find(open.session); session && session->isGreeted()) {
            closeLayer(*session, layer);
            sendError(*session, error, open.request);
        }
    workAll();
    continueSaves();
    continueReloads();
    entry.state = NotLoaded{};
}

void Project::Impl::workAll() {
    for (auto& [id, session] : sessions_) work(session);
}

/// The layer came from its file: its whole content becomes a commit, so that the history holds all
/// there is. Others are told by a stub (CH2).
Result<void> Project::Impl::import(const LayerId& layer, LayerImport import) {
    if (storeClosed_) return fail(ErrorCode::StorageFailed, "the store has failed");
    if (!hasSpace_) return fail(ErrorCode::StorageFull, "the disk of the server is full");

    InFlightCommit made;
    CommitRecord record;
    record.revision = made.revision = executed_ + 1;
    made.imported = layer;
    record.saved = CommitRecord::Saved{layer, {made.revision, layers_[layer].saved.file}};
    record.layers = made.layers = {layer};
    made.edits = import.frame.edits;
    made.blobs = std::move(import.blobs);
    made.mark = history_.log().mark();

    CommitFrame stub;
    stub.commit = {made.revision, epoch_, {}, {},           ports_.clock.wallClockMs(), 0,
                   layer,         {},     {}, executedHash_};
    stampCommit(import.frame.bytes, stub.commit);
    record.hash = made.hash = chainHash(executedHash_, withoutLength(import.frame.bytes));
    record.frame = std::make_shared<const Bytes>(std::move(import.frame.bytes));
    stub.hashAfter = made.hash;
    made.broadcast = std::make_shared<const Bytes>(encodeFrame(stub));
    const Revision revision = made.revision;
    append(std::move(made), std::move(record));
    layers_[layer].saved.revision = revision;
    return {};
}

}  // namespace usdlive::server
