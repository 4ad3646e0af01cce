// Collects the layers of each save request, and answers it.
#include "project/files/Saves.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace usdlive::server {

void Saves::request(Session& session, const SaveLayers& asked) {
    Request request{session.id, asked.request, asked.force.value_or(false), {}, {}};
    for (const LayerId& layer : asked.layers) {
        if (layers_->has(layer))
            request.layers.insert(layer);
        else
            request.failed.push_back({layer, std::string(errorName(ErrorCode::LayerNotFound)),
                                      "the project has no such layer"});
    }
    if (asked.layers.empty())
        for (const LayerId& layer : layers_->all())
            if (fileStates_->isDirty(layer)) request.layers.insert(layer);
    if (!sessions_->takeForRequest(session, asked.request, bytesOf(request.layers))) return;
    for (const LayerId& layer : request.layers) layers_->require(layer);
    waiting_.push_back(std::move(request));
    advance();
}

void Saves::advance() {
    std::erase_if(waiting_, [this](Request& request) { return collect(request); });
}

/// Collects the request's layers. Returns true when all are loaded, so that it waits only for their
/// revision.
bool Saves::collect(Request& request) {
    for (auto layer = request.layers.begin(); layer != request.layers.end();) {
        const LayerLoading& loading = *layers_->loading(*layer);
        const auto* failed = std::get_if<LoadFailed>(&loading);
        if (!failed && !std::holds_alternative<Loaded>(loading)) return false;
        if (failed)
            request.failed.push_back(
                {*layer, std::string(errorName(failed->error.code)), failed->error.message});
        layer = failed ? request.layers.erase(layer) : std::next(layer);
    }
    if (const Session* session = sessions_->find(request.session))
        leaveOutLocked(*session, request);
    Pending pending{std::move(request), {}, line_->executed()};
    for (const LayerId& layer : pending.request.layers) {
        const SavedState& saved = fileStates_->saved(layer);
        pending.jobs.push_back({layer, *line_->doc(layer), pending.revision, saved,
                                saved.file && !pending.request.force});
    }
    if (pending.revision <= line_->durable())
        start(pending);
    else
        pending_.push_back(std::move(pending));
    return true;
}

/// Removes layers that the user may not save (LK3) from the request.
void Saves::leaveOutLocked(const Session& session, Request& request) const {
    std::erase_if(request.layers, [&](const LayerId& layer) {
        const auto locked = access_->toSave(session.subject, layer);
        if (locked)
            request.failed.push_back(
                {layer, std::string(errorName(locked->code)), locked->message});
        return locked.has_value();
    });
}

void Saves::start(const Pending& pending) {
    const Session* session = sessions_->greeted(pending.request.session);
    if (!session) return;
    const auto& [id, request, force, layers, failed] = pending.request;
    if (pending.jobs.empty()) {
        recordRefused(session->subject.user, failed);
        return sessions_->send(*session, LayersSaved{request, pending.revision, {}, failed});
    }
    if (!failed.empty()) failed_[{id, request}] = failed;
    ++underWay_;
    files_->saveLayers(id, request, pending.jobs);
}

void Saves::saved(SessionId id, std::uint64_t request, const SaveOutcome& outcome) {
    --underWay_;
    LayersSaved message{request, outcome.revision, {}, outcome.failed};
    const Session* session = sessions_->find(id);
    const UserName user = session ? session->subject.user : UserName();
    for (const auto& [layer, file] : outcome.saved) {
        message.saved.push_back(layer);
        fileStates_->setSaved(layer, {outcome.revision, file});
        activity_->record({"layer saved", user, layer});
    }
    if (!session || !session->isGreeted()) return;
    const auto failed = failed_.extract({id, request});
    if (!failed.empty())
        message.failed.insert(message.failed.end(), failed.mapped().begin(), failed.mapped().end());
    recordRefused(user, message.failed);
    sessions_->send(*session, message);
}

void Saves::recordRefused(const UserName& user,
                          const std::vector<LayersSaved::Failure>& failed) const {
    for (const auto& failure : failed)
        activity_->record({"save refused", user, failure.layer, failure.message});
}

void Saves::progressed(SessionId id, std::uint64_t request, const LayerId& layer, std::size_t done,
                       std::size_t total) {
    const Session* session = sessions_->greeted(id);
    if (session && session->features.contains("progress"))
        sessions_->send(*session, RequestProgress{request, "save", layer, done, total});
}

bool Saves::needs(const LayerId& layer) const {
    return std::ranges::any_of(
        waiting_, [&](const Request& request) { return request.layers.contains(layer); });
}

void Saves::becameDurable(Revision upTo) {
    while (!pending_.empty() && pending_.front().revision <= upTo) {
        const Pending pending = std::move(pending_.front());
        pending_.pop_front();
        start(pending);
    }
}

/// Collects the layers of pending requests again.
void Saves::rolledBack(const Error& /*error*/, const LostCommits& /*lost*/) {
    for (Pending& pending : std::exchange(pending_, {}))
        waiting_.push_back(std::move(pending.request));
    for (const Request& request : waiting_)
        for (const LayerId& layer : request.layers) layers_->require(layer);
    advance();
}

void Saves::left(const Session& session) {
    std::erase_if(failed_, [&](const auto& one) { return one.first.first == session.id; });
}

}  // namespace usdlive::server
