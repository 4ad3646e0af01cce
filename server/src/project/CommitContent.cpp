#include "usdlive/server/project/CommitContent.h"

#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

tl::unexpected<Error> damaged(Revision revision, const std::string& why) {
    return fail(ErrorCode::StorageCorrupt,
                "commit " + std::to_string(revision) + " cannot be applied again: " + why);
}

}  // namespace

std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                              const std::vector<ExecutedEdit>& edits) {
    std::vector<NamespaceChange> changes;
    for (const auto& [edit, applied] : edits) {
        const std::string& path = edit.address.path;
        if (!applied.changed) continue;
        if (std::holds_alternative<DeleteSpec>(edit.action))
            changes.push_back({revision, edit.layer, path, std::nullopt});
        else if (const auto* move = std::get_if<MoveSpec>(&edit.action))
            changes.push_back(
                {revision, edit.layer, path,
                 specpath::child(move->parent.path, specpath::last(path).list, move->name)});
    }
    return changes;
}

tl::unexpected<Error> historyReplaced(Revision revision, Revision base) {
    return fail(ErrorCode::HistoryReplaced,
                "revision " + std::to_string(revision) +
                    " cannot be read any more: the commits up to " + std::to_string(base) +
                    " were replaced by what the layers held then, to save space. The oldest "
                    "revision to be read is " +
                    std::to_string(base));
}

Result<Commit> decodeCommit(const StoredCommit& stored) {
    auto frame = decodeFrame(withoutLength(*stored.frame));
    if (!frame) return damaged(stored.revision, frame.error().message);
    auto* commit = std::get_if<CommitFrame>(&*frame);
    if (!commit) return damaged(stored.revision, "it is none");
    return std::move(commit->commit);
}

Result<void> replay(LayerDoc& doc, const LayerId& layer, const Commit& commit) {
    for (const Edit& edit : commit.edits) {
        if (edit.layer != layer) continue;
        if (const auto applied = doc.apply(edit.address.path, edit.action); !applied)
            return damaged(commit.revision, applied.error().message);
    }
    return {};
}

}  // namespace usdlive::server
