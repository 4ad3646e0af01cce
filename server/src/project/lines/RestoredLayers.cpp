// Begins a line of history at an earlier revision.
#include "project/RestoredLayers.h"

#include <map>
#include <optional>
#include <utility>

#include "project/CommitContent.h"
#include "project/lines/HistoryLine.h"

namespace usdlive::server {

namespace {

/// Keeps the commit, for a store that appends it at once.
class OneCommit final : public ports::CommitLog {
public:
    void append(CommitRecord commit) override { made = std::move(commit); }

    std::optional<CommitRecord> made;
};

class GivenTime final : public ports::Clock {
public:
    explicit GivenTime(std::int64_t timeMs) : timeMs_(timeMs) {}
    [[nodiscard]] std::int64_t wallClockMs() override { return timeMs_; }
    [[nodiscard]] std::int64_t steadyMs() override { return 0; }

private:
    const std::int64_t timeMs_;
};

Result<LayerDocs> layersAt(const CommitStore& store, Revision revision) {
    LayerDocs docs;
    const auto layers = store.layers();
    if (!layers) return tl::unexpected(layers.error());
    for (const LayerId& layer : *layers) {
        auto doc = store.layerAt(layer, revision);
        if (!doc) return tl::unexpected(doc.error());
        if (*doc) docs.emplace(layer, *std::move(*doc));
    }
    return docs;
}

/// Applies the commits after `revision`, so that specs keep their ids. Returns the time of the
/// last.
Result<std::int64_t> goOn(const CommitStore& store, Revision revision, LayerDocs& docs) {
    std::int64_t timeMs = 0;
    NamespaceLog ignored;
    Result<void> applied;
    const auto read =
        store.read(revision + 1, store.head().revision, [&](const StoredCommit& stored) {
            const auto commit = decodeCommit(stored);
            if (!commit) {
                applied = tl::unexpected(commit.error());
                return false;
            }
            timeMs = commit->timeMs;
            ignored.prune(commit->revision);
            // The layer is there as it was imported.
            if (!commit->imported) applied = applyCommit(docs, ignored, *commit);
            return bool(applied);
        });
    if (!read) return tl::unexpected(read.error());
    if (!applied) return tl::unexpected(applied.error());
    return timeMs;
}

}  // namespace

Result<Revision> restoreLayers(CommitStore& store, Revision revision, const Restoring& by) {
    const CommitStore::Head head = store.head();
    if (revision > head.revision)
        return fail(ErrorCode::InvalidArgument, "there is no revision " + std::to_string(revision) +
                                                    ": the project is at revision " +
                                                    std::to_string(head.revision));
    if (revision == head.revision) return revision;
    if (const Revision base = store.base().revision; revision < base)
        return historyReplaced(revision, base);
    const auto then = layersAt(store, revision);
    if (!then) return tl::unexpected(then.error());
    LayerDocs now = *then;
    const auto timeMs = goOn(store, revision, now);
    if (!timeMs) return tl::unexpected(timeMs.error());
    HistoryLine::OwnEdits edits;
    edits.user = by.user;
    edits.label = by.label;
    for (const auto& [layer, content] : std::map(then->begin(), then->end()))
        for (auto& [path, action] : difference(now.at(layer), content))
            edits.edits.push_back({layer, {path, {}}, std::move(action), {}});
    if (edits.edits.empty()) return head.revision;
    OneCommit log;
    GivenTime clock(by.timeMs);
    TimeOfDay time(clock);
    HistoryLine line({}, {head, head.revision, {}, std::move(now), *timeMs}, log, time);
    if (auto committed = line.commitInOrder(std::move(edits)); !committed) return committed;
    if (auto appended = store.append({&*log.made, 1}); !appended)
        return tl::unexpected(appended.error());
    return log.made->revision;
}

}  // namespace usdlive::server
