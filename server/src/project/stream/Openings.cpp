// Answers requests to open layers.
#include "project/stream/Openings.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

void Openings::open(Session& session, const OpenLayer& open) {
    const LayerId& layer = open.layer;
    if (!layers_->has(layer))
        return sessions_->sendError(
            session, {ErrorCode::LayerNotFound, "the project has no layer " + layer.value},
            open.request);
    if (open.revision != 0) return openPast(session, open);
    if (const auto error = sessions_->whyNotOpen(session, layer))
        return sessions_->sendError(session, *error, open.request);
    sessions_->open(session, layer);
    const Request request{session.id, open.request};
    if (layers_->isLoaded(layer)) return openLoaded(request, layer);
    waiting_[layer].push_back(request);
    layers_->require(layer);
}

void Openings::openLoaded(const Request& request, const LayerId& layer) {
    Snapshot snapshot{request, layer, *line_->doc(layer), line_->executed()};
    if (snapshot.revision <= line_->durable())
        send(snapshot);
    else
        pending_.push_back(std::move(snapshot));
}

void Openings::send(const Snapshot& snapshot) {
    const auto& [request, layer, doc, revision] = snapshot;
    const Session* session = sessions_->greeted(request.session);
    if (!session) return;
    catchup_->sendsLayerAsOf(session->id, revision);
    sessions_->send(*session, LayerOpened{request.request, layer, revision, doc.specCount()});
    outbox_->sendSnapshot(session->id, request.request, doc);
}

// ---- layers that are being loaded

void Openings::beingImported(const LayerId& layer) {
    const auto found = waiting_.find(layer);
    if (found == waiting_.end()) return;
    for (const Request& request : found->second) {
        const Session* session = sessions_->greeted(request.session);
        if (session && session->features.contains("progress"))
            sessions_->send(*session, RequestProgress{request.request, "import", layer, 0, 0});
    }
}

void Openings::ready(const LayerId& layer, bool imported) {
    const auto waiting = waiting_.extract(layer);
    if (waiting.empty()) return;
    const std::vector<Request>& requests = waiting.mapped();
    if (imported && !requests.empty())
        if (const Session* session = sessions_->find(requests.front().session))
            activity_->record({"layer imported", session->subject.user, layer});
    for (const Request& request : requests) openLoaded(request, layer);
}

void Openings::failed(const LayerId& layer, const Error& error) {
    const auto waiting = waiting_.extract(layer);
    if (waiting.empty()) return;
    for (const Request& request : waiting.mapped()) {
        Session* session = sessions_->greeted(request.session);
        if (!session) continue;
        sessions_->closeLayer(*session, layer);
        sessions_->sendError(*session, error, request.request);
    }
}

// ---- the line

void Openings::becameDurable(Revision upTo) {
    while (!pending_.empty() && pending_.front().revision <= upTo) {
        const Snapshot snapshot = std::move(pending_.front());
        pending_.pop_front();
        send(snapshot);
    }
}

/// Layers that lost commits are loaded again. Only a lost import makes requests fail.
void Openings::rolledBack(const Error& error, const LostCommits& lost) {
    for (Snapshot& snapshot : std::exchange(pending_, {})) {
        snapshot.revision = std::min(snapshot.revision, line_->durable());
        if (!lost.changed.contains(snapshot.layer))
            pending_.push_back(std::move(snapshot));
        else if (!lost.imported.contains(snapshot.layer))
            waiting_[snapshot.layer].push_back(snapshot.request);
        else if (const Session* session = sessions_->greeted(snapshot.request.session))
            sessions_->sendError(*session, error, snapshot.request.request);
    }
}

// ---- layers of the past

void Openings::openPast(Session& session, const OpenLayer& open) {
    if (open.revision > line_->durable())
        return sessions_->sendError(session,
                                    {ErrorCode::FutureRevision,
                                     "the newest revision is " + std::to_string(line_->durable())},
                                    open.request);
    if (const auto error = start_->whyNotReadable(open.revision))
        return sessions_->sendError(session, *error, open.request);
    if (!pastReads_[session.id].emplace(open.request, open).second)
        return sessions_->close(session,
                                {ErrorCode::MalformedControl,
                                 "two requests with the number " + std::to_string(open.request)});
    history_->readHistory(session.id, open.request, open.layer, open.revision);
}

void Openings::historyRead(SessionId id, std::uint64_t request, Result<LayerDoc> doc) {
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    const auto read = pastReads_[id].extract(request);
    if (read.empty()) return;
    const OpenLayer& open = read.mapped();
    if (!doc) return sessions_->sendError(*session, doc.error(), request);
    send({{id, request}, open.layer, std::move(*doc), open.revision});
}

void Openings::historyNotStored(SessionId id, std::uint64_t request) {
    const auto reads = pastReads_.find(id);
    if (reads == pastReads_.end()) return;
    const auto found = reads->second.find(request);
    if (found != reads->second.end()) files_->readLayer(id, request, found->second.layer);
}

Revision Openings::oldestNeeded(Revision newest) const {
    for (const auto& [session, reads] : pastReads_)
        for (const auto& [request, open] : reads) newest = std::min(newest, open.revision);
    return newest;
}

void Openings::left(const Session& session) { pastReads_.erase(session.id); }

}  // namespace usdlive::server
