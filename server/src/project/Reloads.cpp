// Taking files that were changed behind the server as commits (FI3).
#include <algorithm>
#include <unordered_map>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxReloads = 100;  // not answered yet, of all sessions
// What is edited while its file is read is read again, so often; then the comparison is made here,
// between two edits.
constexpr int kAttempts = 3;

/// The same content, with the node ids of `present` for all that stands there too.
LayerDoc matched(const LayerDoc& present, const LayerDoc& content) {
    struct Spec {
        NodeId node;
        SpecKind kind;
    };
    std::unordered_map<std::string, Spec> known;
    present.visit([&](const LayerDoc::SpecView& spec) {
        known.emplace(spec.path, Spec{spec.node, spec.kind});
    });
    LayerDoc::Builder builder;
    std::unordered_map<NodeId, NodeId> ids{{0, 0}};
    NodeId next = present.nextId();
    content.visit([&](const LayerDoc::SpecView& spec) {
        const auto same = known.find(std::string(spec.path));
        const bool isKnown = same != known.end() && same->second.kind == spec.kind;
        const NodeId node = isKnown ? same->second.node : next++;
        ids.emplace(spec.node, node);
        (void)builder.addSpec(node, ids.at(spec.parent), spec.order, spec.kind, spec.name);
        for (const auto& [name, value] : *spec.fields) (void)builder.addField(node, name, value);
    });
    return builder.finish();
}

std::vector<Edit> editsBetween(const LayerId& layer, const LayerDoc& present,
                               const LayerDoc& content) {
    std::vector<Edit> edits;
    for (auto& [path, action] : difference(present, content))
        edits.push_back({layer, {std::move(path), {}}, std::move(action)});
    return edits;
}

}  // namespace

ReloadedLayer makeReload(const LayerId& layer, const LayerDoc& present, const LayerDoc& content,
                         const FileStamp& file) {
    ReloadedLayer reloaded{{}, matched(present, content), file};
    reloaded.edits = editsBetween(layer, present, reloaded.doc);
    return reloaded;
}

void Project::Impl::reloadLayers(Session& session, const ReloadLayers& request) {
    if (reloads_.size() + readyReloads_.size() >= kMaxReloads)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    ReloadRequest reload;
    reload.session = session.id;
    reload.request = reload.outcome.request = request.request;
    for (const LayerId& layer : request.layers) {
        if (layers_.contains(layer))
            reload.waiting.insert(layer);
        else
            reload.outcome.failed.push_back({layer,
                                             std::string(errorName(ErrorCode::LayerNotFound)),
                                             "the project has no such layer"});
    }
    if (request.layers.empty())
        for (const auto& [layer, entry] : layers_)
            if (entry.file.outdated) reload.waiting.insert(layer);
    for (const LayerId& layer : reload.waiting)
        if (std::holds_alternative<NotLoaded>(layers_[layer].state)) load(layer);
    reloads_.push_back(std::move(reload));
    continueReloads();
}

void Project::Impl::continueReloads() {
    std::erase_if(reloads_, [this](ReloadRequest& reload) {
        if (!find(reload.session)) return true;
        continueReload(reload);
        if (!reload.waiting.empty() || !reload.reading.empty()) return false;
        reload.outcome.revision = executed_;
        if (executed_ <= durable_)
            sendReloaded(reload);
        else
            readyReloads_.push_back(std::move(reload));
        return true;
    });
}

/// Has the files of the layers read that are loaded.
void Project::Impl::continueReload(ReloadRequest& reload) {
    const auto failed = [&](const LayerId& layer, const Error& error) {
        reload.outcome.failed.push_back({layer, std::string(errorName(error.code)), error.message});
    };
    const Session& session = *find(reload.session);
    std::erase_if(reload.waiting, [&](const LayerId& layer) {
        const auto& state = layers_[layer].state;
        if (const auto* problem = std::get_if<LoadFailed>(&state)) {
            failed(layer, problem->error);
            return true;
        }
        if (!std::holds_alternative<Loaded>(state)) return false;
        if (const auto locked = access_.toLayer(*this, session.subject, layer))
            failed(layer, *locked);
        else
            read(reload, layer, 1);
        return true;
    });
}

void Project::Impl::read(ReloadRequest& reload, const LayerId& layer, int attempt) {
    reload.reading[layer] = {executed_, attempt};
    ports_.files.reloadLayer(reload.session, reload.request, layer, docs_.at(layer));
}

void Project::Impl::layerReloaded(SessionId id, std::uint64_t request, const LayerId& layer,
                                  Result<ReloadedLayer> reloaded) {
    const auto reload = std::ranges::find_if(reloads_, [&](const ReloadRequest& one) {
        return one.session == id && one.request == request && one.reading.contains(layer);
    });
    const Session* session = find(id);
    if (reload == reloads_.end() || !session) return continueReloads();
    const ReloadRequest::Reading reading = reload->reading.extract(layer).mapped();
    LayerEntry& entry = layers_[layer];
    Result<void> taken;
    if (!std::holds_alternative<Loaded>(entry.state)) {  // it was taken back meanwhile
        reload->waiting.insert(layer);
        if (std::holds_alternative<NotLoaded>(entry.state)) load(layer);
        return continueReloads();
    }
    if (!reloaded) {
        taken = tl::unexpected(reloaded.error());
    } else if (entry.changed > reading.base && reading.attempt < kAttempts) {
        return read(*reload, layer, reading.attempt + 1);
    } else {
        if (entry.changed > reading.base)
            reloaded->edits = makeReload(layer, docs_.at(layer), reloaded->doc, {}).edits;
        if (reloaded->edits.empty())
            reload->unchanged.emplace_back(layer, SavedState{executed_, reloaded->file});
        else
            taken = takeFile(*session, layer, std::move(*reloaded));
    }
    if (taken)
        reload->outcome.reloaded.push_back(layer);
    else
        reload->outcome.failed.push_back(
            {layer, std::string(errorName(taken.error().code)), taken.error().message});
    continueReloads();
}

/// A commit in the name of who asked for it, but not one of its client's transactions.
Result<void> Project::Impl::takeFile(const Session& session, const LayerId& layer,
                                     ReloadedLayer reloaded) {
    if (const auto locked = access_.toLayer(*this, session.subject, layer))
        return tl::unexpected(*locked);
    if (storeClosed_) return fail(ErrorCode::StorageFailed, "the store has failed");
    if (!hasSpace_) return fail(ErrorCode::StorageFull, "the disk of the server is full");
    const LayerDocs before{{layer, docs_.at(layer)}};
    const std::uint64_t mark = history_.log().mark();
    auto executed = executeInOrder(docs_, history_.log(), std::move(reloaded.edits), executed_ + 1);
    if (!executed) return tl::unexpected(executed.error());
    const auto undone = [&](Error error) {
        docs_[layer] = before.at(layer);
        history_.truncate(mark);
        return tl::unexpected(std::move(error));
    };
    if (const auto locked = access_.toEdits(*this, session.subject, executed->edits, before))
        return undone(locked->second);
    auto commit = makeCommit(session.subject.user, {}, 0, std::move(*executed), mark);
    if (!commit)
        return undone({ErrorCode::TransactionTooLarge,
                       layer.value + " differs from its file by more than one commit can hold"});
    auto& [made, record] = *commit;
    record.saved = made.reloaded =
        CommitRecord::Saved{layer, {made.revision, std::move(reloaded.file)}};
    append(std::move(made), std::move(record));
    return {};
}

void Project::Impl::sendReloaded(const ReloadRequest& reload) {
    for (const auto& [layer, saved] : reload.unchanged) {
        fileIs(layer, saved);
        ports_.files.setSaved(layer, saved);
    }
    Session* session = find(reload.session);
    if (!session || !session->isGreeted()) return;
    for (const LayerId& layer : reload.outcome.reloaded)
        ports_.activity.happened({"layer reloaded", session->subject.user, layer});
    for (const auto& failure : reload.outcome.failed)
        ports_.activity.happened(
            {"reload refused", session->subject.user, failure.layer, failure.message});
    send(*session, reload.outcome);
}

}  // namespace usdlive::server
