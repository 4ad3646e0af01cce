// Reads the files of layers, and commits the differences.
#include "project/files/Reloads.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

namespace {

// If a layer is edited while its file is being compared, it is compared again, up to this number of
// times. Then it is compared on the strand, between two edits.
constexpr int kAttempts = 3;

}  // namespace

void Reloads::Request::addFailure(const LayerId& layer, const Error& error) {
    outcome.failed.push_back({layer, std::string(errorName(error.code)), error.message});
}

void Reloads::request(Session& session, const ReloadLayers& asked) {
    Request request;
    request.session = session.id;
    request.request = request.outcome.request = asked.request;
    for (const LayerId& layer : asked.layers) {
        if (layers_->has(layer))
            request.waiting.insert(layer);
        else
            request.addFailure(layer, {ErrorCode::LayerNotFound, "the project has no such layer"});
    }
    if (asked.layers.empty())
        for (const LayerId& layer : layers_->all())
            if (fileStates_->isOutdated(layer)) request.waiting.insert(layer);
    if (!sessions_->takeForRequest(session, asked.request, bytesOf(request.waiting))) return;
    for (const LayerId& layer : request.waiting) layers_->require(layer);
    requests_.push_back(std::move(request));
    advance();
}

void Reloads::reloadByItself(const LayerId& layer) {
    if (!layers_->has(layer) || fileStates_->isDirty(layer) || needs(layer)) return;
    Request request;
    request.request = ++ownRequests_;
    request.waiting.insert(layer);
    layers_->require(layer);
    requests_.push_back(std::move(request));
    advance();
}

const Subject* Reloads::subjectOf(const Request& request) const {
    static const Subject kNobody;
    if (request.session == 0) return &kNobody;
    const Session* session = sessions_->greeted(request.session);  // AC4: not one that is closing
    return session ? &session->subject : nullptr;
}

void Reloads::advance() {
    std::erase_if(requests_, [this](Request& request) {
        if (!subjectOf(request)) return true;
        readLoaded(request);
        if (!request.waiting.empty() || !request.reading.empty()) return false;
        request.outcome.revision = line_->executed();
        if (line_->executed() <= line_->durable())
            answer(request);
        else
            pending_.push_back(std::move(request));
        return true;
    });
}

/// Requests the files of the loaded layers.
void Reloads::readLoaded(Request& request) {
    const Subject& subject = *subjectOf(request);
    std::erase_if(request.waiting, [&](const LayerId& layer) {
        const LayerLoading& loading = *layers_->loading(layer);
        if (const auto* problem = std::get_if<LoadFailed>(&loading)) {
            request.addFailure(layer, problem->error);
            return true;
        }
        if (!std::holds_alternative<Loaded>(loading)) return false;
        if (const auto locked = access_->toReload(subject, layer))
            request.addFailure(layer, *locked);
        else
            read(request, layer, 1);
        return true;
    });
}

void Reloads::read(Request& request, const LayerId& layer, int attempt) {
    request.reading[layer] = {line_->executed(), attempt};
    files_->reloadLayer(request.session, request.request, layer, *line_->doc(layer));
}

void Reloads::fileRead(SessionId id, std::uint64_t number, const LayerId& layer,
                       Result<ReloadedLayer> reloaded) {
    const auto request = std::ranges::find_if(requests_, [&](const Request& one) {
        return one.session == id && one.request == number && one.reading.contains(layer);
    });
    const Subject* subject = request == requests_.end() ? nullptr : subjectOf(*request);
    if (!subject) return advance();
    const Reading reading = request->reading.extract(layer).mapped();
    if (!layers_->isLoaded(layer)) {  // its commits were rolled back during the read
        request->waiting.insert(layer);
        layers_->require(layer);
        return advance();
    }
    const bool wasEdited = layers_->changed(layer) > reading.base;
    Result<void> taken;
    if (!reloaded) {
        taken = tl::unexpected(reloaded.error());
    } else if (id == 0 && fileStates_->isDirty(layer)) {
        taken = fail(ErrorCode::LayerOutdated, layer.value + " was edited meanwhile");
    } else if (wasEdited && reading.attempt < kAttempts) {
        return read(*request, layer, reading.attempt + 1);
    } else {
        if (wasEdited)
            reloaded->edits = makeReload(layer, *line_->doc(layer), reloaded->doc, {}).edits;
        if (reloaded->edits.empty())
            request->unchanged.emplace_back(layer, SavedState{line_->executed(), reloaded->file});
        else
            taken = take(*subject, layer, std::move(*reloaded));
    }
    if (taken)
        request->outcome.reloaded.push_back(layer);
    else
        request->addFailure(layer, taken.error());
    advance();
}

/// Commits the difference in the name of the requesting user. The commit is not a transaction of
/// the client.
Result<void> Reloads::take(const Subject& subject, const LayerId& layer, ReloadedLayer reloaded) {
    if (const auto locked = access_->toReload(subject, layer)) return tl::unexpected(*locked);
    if (const auto error = store_->whyNotWritable()) return tl::unexpected(*error);
    HistoryLine::OwnEdits edits{std::move(reloaded.edits), subject.user};
    edits.label = "Reload of " + layer.value;
    edits.check = [&](const Executed& executed, const LayerDocs& before) -> std::optional<Refused> {
        auto locked = access_->toEdits(subject, executed.edits, before);
        return locked ? std::optional(Refused{std::move(locked->second)}) : std::nullopt;
    };
    edits.file.emplace(layer, reloaded.file);
    const auto revision = line_->commitInOrder(std::move(edits));
    if (!revision && revision.error().code == ErrorCode::TransactionTooLarge)
        return fail(ErrorCode::TransactionTooLarge,
                    layer.value + " differs from its file by " + revision.error().message);
    if (!revision) return tl::unexpected(revision.error());
    taken_.push_back({layer, {*revision, std::move(reloaded.file)}});
    return {};
}

void Reloads::answer(const Request& request) {
    for (const auto& [layer, saved] : request.unchanged) {
        fileStates_->setSaved(layer, saved);
        files_->setSaved(layer, saved);
    }
    const Session* session = sessions_->greeted(request.session);
    if (!session && request.session != 0) return;
    const UserName user = subjectOf(request)->user;
    for (const LayerId& layer : request.outcome.reloaded)
        activity_->record({"layer reloaded", user, layer});
    for (const auto& failure : request.outcome.failed)
        activity_->record({"reload refused", user, failure.layer, failure.message});
    if (session) sessions_->send(*session, request.outcome);
}

bool Reloads::needs(const LayerId& layer) const {
    return std::ranges::any_of(requests_, [&](const Request& request) {
        return request.waiting.contains(layer) || request.reading.contains(layer);
    });
}

// ---- the line

void Reloads::durable(const OrderedCommit& commit) {
    if (taken_.empty() || taken_.front().saved.revision != commit.revision) return;
    const Taken taken = std::move(taken_.front());
    taken_.pop_front();
    fileStates_->setSaved(taken.layer, taken.saved);
}

void Reloads::becameDurable(Revision upTo) {
    while (!pending_.empty() && pending_.front().outcome.revision <= upTo) {
        const Request request = std::move(pending_.front());
        pending_.pop_front();
        answer(request);
    }
}

void Reloads::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    taken_.clear();
    for (Request& request : std::exchange(pending_, {})) requests_.push_back(std::move(request));
    for (Request& request : requests_) {
        std::erase_if(request.unchanged,
                      [&](const auto& one) { return lost.changed.contains(one.first); });
        std::erase_if(request.outcome.reloaded, [&](const LayerId& layer) {
            return lost.changed.contains(layer) && request.waiting.insert(layer).second;
        });
        for (const LayerId& layer : request.waiting) layers_->require(layer);
    }
    advance();
}

}  // namespace usdlive::server
