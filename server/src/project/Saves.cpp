// Writing layers to their files.
#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxSaves = 1'000;  // not begun yet, of all sessions

}  // namespace

void Project::Impl::saveLayers(Session& session, const SaveLayers& request) {
    if (saves_.size() + readySaves_.size() >= kMaxSaves)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    SaveRequest save{session.id, request.request, request.force.value_or(false), {}, {}};
    for (const LayerId& layer : request.layers) {
        if (layers_.contains(layer))
            save.layers.insert(layer);
        else
            save.failed.push_back({layer, std::string(errorName(ErrorCode::LayerNotFound)),
                                   "the project has no such layer"});
    }
    if (request.layers.empty()) {
        for (const auto& [layer, entry] : layers_)
            if (entry.unsaved || entry.changed > entry.saved.revision || entry.file.missing)
                save.layers.insert(layer);
    }
    for (const LayerId& layer : save.layers)
        if (std::holds_alternative<NotLoaded>(layers_[layer].state)) load(layer);
    saves_.push_back(std::move(save));
    continueSaves();
}

void Project::Impl::continueSaves() {
    std::erase_if(saves_, [this](SaveRequest& save) { return continueSave(save); });
}

/// True when all its layers are there, and it was handed on.
bool Project::Impl::continueSave(SaveRequest& save) {
    for (auto layer = save.layers.begin(); layer != save.layers.end();) {
        const auto& state = layers_[*layer].state;
        const auto* failed = std::get_if<LoadFailed>(&state);
        if (!failed && !std::holds_alternative<Loaded>(state)) return false;
        if (failed)
            save.failed.push_back(
                {*layer, std::string(errorName(failed->error.code)), failed->error.message});
        layer = failed ? save.layers.erase(layer) : std::next(layer);
    }
    if (const Session* session = find(save.session)) leaveLocked(*session, save);
    ReadySave ready{std::move(save), {}, executed_};
    for (const LayerId& layer : ready.save.layers) {
        const SavedState& saved = layers_[layer].saved;
        ready.jobs.push_back(
            {layer, docs_.at(layer), executed_, saved, saved.file && !ready.save.force});
    }
    if (ready.revision <= durable_)
        sendSave(ready);
    else
        readySaves_.push_back(std::move(ready));
    return true;
}

/// LK3
void Project::Impl::leaveLocked(const Session& session, SaveRequest& save) const {
    std::erase_if(save.layers, [&](const LayerId& layer) {
        const auto locked = access_.toLayer(*this, session.subject, layer);
        if (locked)
            save.failed.push_back({layer, std::string(errorName(locked->code)), locked->message});
        return locked.has_value();
    });
}

void Project::Impl::sendSave(const ReadySave& ready) {
    Session* session = find(ready.save.session);
    if (!session || !session->isGreeted()) return;
    const std::uint64_t request = ready.save.request;
    if (ready.jobs.empty())
        return send(*session, LayersSaved{request, ready.revision, {}, ready.save.failed});
    if (!ready.save.failed.empty()) session->failedSaves[request] = ready.save.failed;
    ++savesUnderWay_;
    ports_.files.saveLayers(session->id, request, ready.jobs);
}

void Project::Impl::layersSaved(SessionId id, std::uint64_t request, const SaveOutcome& outcome) {
    --savesUnderWay_;
    LayersSaved message{request, outcome.revision, {}, outcome.failed};
    Session* session = find(id);
    const UserName user = session ? session->subject.user : UserName();
    for (const auto& [layer, file] : outcome.saved) {
        message.saved.push_back(layer);
        fileIs(layer, {outcome.revision, file});
        ports_.activity.happened({"layer saved", user, layer});
    }
    if (!session || !session->isGreeted()) return;
    const auto failed = session->failedSaves.extract(request);
    if (!failed.empty())
        message.failed.insert(message.failed.end(), failed.mapped().begin(), failed.mapped().end());
    for (const auto& failure : message.failed)
        ports_.activity.happened({"save refused", user, failure.layer, failure.message});
    send(*session, message);
}

void Project::Impl::layersBeingSaved(SessionId id, std::uint64_t request, const LayerId& layer,
                                     std::size_t done, std::size_t total) {
    Session* session = find(id);
    if (session && session->isGreeted() && session->features.contains("progress"))
        send(*session, RequestProgress{request, "save", layer, done, total});
}

}  // namespace usdlive::server
