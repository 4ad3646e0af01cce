// Decodes stored commits and executes them again.
#include "project/CommitContent.h"

#include <algorithm>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

namespace {

tl::unexpected<Error> damaged(Revision revision, const std::string& why) {
    return fail(ErrorCode::StorageCorrupt,
                "commit " + std::to_string(revision) + " cannot be applied again: " + why);
}

/// Returns the size of the frame at `offset`, including its length prefix.
std::size_t partSize(const Bytes& frame, std::size_t offset) {
    ByteReader in(ByteView(frame).subspan(offset));
    return std::min<std::size_t>(kFrameLengthBytes + in.u32(), frame.size() - offset);
}

Result<Commit> joinParts(const StoredCommit& stored, const std::vector<ByteView>& frames) {
    CommitParts parts;
    for (const ByteView bytes : frames) {
        auto frame = decodeFrame(bytes);
        if (!frame) return damaged(stored.revision, frame.error().message);
        auto* part = std::get_if<CommitFrame>(&*frame);
        if (!part) return damaged(stored.revision, "it is not a commit");
        auto joined = parts.add(std::move(*part), bytes);
        if (!joined) return damaged(stored.revision, joined.error().message);
        if (*joined && bytes.data() == frames.back().data()) return std::move((*joined)->commit);
        if (*joined) break;
    }
    return damaged(stored.revision, "some of its parts are missing, or there are too many");
}

}  // namespace

bool isInParts(const Bytes& frame) { return partSize(frame, 0) < frame.size(); }

Bytes nextPart(const Bytes& frame, std::size_t& offset) {
    const std::size_t size = partSize(frame, offset);
    const auto begin = frame.begin() + std::ptrdiff_t(offset);
    offset += size;
    return {begin, begin + std::ptrdiff_t(size)};
}

std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                              const std::vector<ExecutedEdit>& edits) {
    std::vector<NamespaceChange> changes;
    for (const auto& [edit, applied] : edits) {
        if (!changesNamespace(edit)) continue;
        const std::string& path = edit.address.path;
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        changes.push_back({revision, edit.layer, path,
                           move ? std::optional(destination(path, *move)) : std::nullopt,
                           concernsPlace(edit.action)});
    }
    return changes;
}

tl::unexpected<Error> historyReplaced(Revision revision, Revision base) {
    return fail(ErrorCode::HistoryReplaced,
                "revision " + std::to_string(revision) +
                    " cannot be read any more: the commits up to " + std::to_string(base) +
                    " were replaced by a base to save space. The oldest revision that "
                    "can be read is " +
                    std::to_string(base));
}

Result<Commit> decodeCommit(const StoredCommit& stored) {
    if (isInParts(*stored.frame)) {
        const auto frames = splitMessage(*stored.frame, ~std::uint32_t(0));
        if (!frames) return damaged(stored.revision, frames.error().message);
        return joinParts(stored, *frames);
    }
    auto frame = decodeFrame(withoutLength(*stored.frame));
    if (!frame) return damaged(stored.revision, frame.error().message);
    auto* commit = std::get_if<CommitFrame>(&*frame);
    if (!commit) return damaged(stored.revision, "it is not a commit");
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
