// Creates the files of new layers.
#include "project/files/NewLayers.h"

#include <utility>

namespace usdlive::server {

std::optional<Error> NewLayers::objection(const Session& session, const LayerId& layer) const {
    if (layers_->has(layer))
        return Error{ErrorCode::LayerExists, "the project has a layer " + layer.value +
                                                 ": open it, or choose another name"};
    if (auto denied = access_->toAction(session.subject, ProjectAction::CreateLayer, layer,
                                        "create " + layer.value))
        return denied;
    return store_->whyNotWritable();
}

void NewLayers::create(const Session& session, const CreateLayer& request) {
    if (const auto error = objection(session, request.layer)) {
        activity_->record(
            {"new layer refused", session.subject.user, request.layer, error->message});
        return sessions_->sendError(session, *error, request.request);
    }
    files_->createLayerFile(session.id, request.request, request.layer);
}

void NewLayers::created(SessionId id, std::uint64_t request, const LayerId& layer,
                        const Result<void>& created) {
    const Session* session = sessions_->greeted(id);
    if (!created) {
        if (session) sessions_->sendError(*session, created.error(), request);
        return;
    }
    // The layer is loaded at once, so that the store has it even if an older listing of the folder
    // does not contain the file.
    fileStates_->addCreated(layer);
    layers_->require(layer);
    if (!session) return;
    activity_->record({"layer created", session->subject.user, layer});
    sessions_->send(*session, LayerCreated{request, layer});
}

void NewLayers::listSkipped(const Session& session, const ListSkipped& request) {
    files_->listSkipped(session.id, request.request);
}

void NewLayers::skippedListed(SessionId id, std::uint64_t request,
                              Result<std::vector<SkippedFile>> skipped) {
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (!skipped) return sessions_->sendError(*session, skipped.error(), request);
    SkippedFiles answer{request, skipped->size(), std::move(*skipped)};
    if (answer.files.size() > kMaxSkippedFiles) answer.files.resize(kMaxSkippedFiles);
    sessions_->send(*session, answer);
}

}  // namespace usdlive::server
