// The confirmed side: commits, acknowledgements, layers that are joined.
#include <algorithm>

#include "session/SessionImpl.h"

namespace usdlive::client {

namespace {

// Previews may have a base that is so many revisions behind.
constexpr Revision kPreviewsBehind = 1'000;
constexpr Revision kPrunedAtOnce = 64;

// How often a refused transaction is corrected and sent again before it is lost.
constexpr int kMaxAttempts = 5;

}  // namespace

// Makes the inverses of the edits of an own commit while it is applied.
class Session::Impl::OwnCommit final : public AppliedEdits {
public:
    explicit OwnCommit(const Commit& commit) : first_(commit.edits.data()) {
        numbers_.reserve(commit.edits.size());
        executed_.reserve(commit.edits.size());
        SubmittedIndexes indexes(commit.dropped);
        for (std::size_t edit = 0; edit < commit.edits.size(); ++edit)
            numbers_.push_back(indexes.next());
    }
    void before(const LayerDoc& doc, const Edit& edit) override {
        const auto number = numbers_[std::size_t(&edit - first_)];
        executed_.push_back({number, &edit, inverseBefore(doc, edit.address.path, edit.action), 0});
    }
    void after(const LayerDoc& doc, const Edit& edit) override {
        completeInverse(executed_.back().inverse, doc, edit.address.path);
    }
    [[nodiscard]] std::vector<UndoStack::Executed> take(const NamespaceLog& log,
                                                        const Commit& commit) {
        auto one = executed_.begin();
        forEachExecuted(log, commit, [&](const Edit& edit, std::uint32_t, std::uint64_t mark) {
            if (one != executed_.end() && one->edit == &edit) (one++)->mark = mark;
        });
        return std::move(executed_);
    }

private:
    const Edit* first_;
    std::vector<std::uint32_t> numbers_;
    std::vector<UndoStack::Executed> executed_;
};

void Session::Impl::apply(const Commit& commit) {
    const bool mine = commit.id.client == options_.client;
    const Pending* own = mine ? pending_.find(commit.id.sequence) : nullptr;

    if (commit.gesture != 0) previews_.committed(commit.id.client, commit.gesture);
    if (!mine && commit.firstUnseen != 0) committed_.follow(log_, commit.firstUnseen);
    view_.commitComes(commit, own);
    std::optional<OwnCommit> noted;
    if (own && undo_.tracks(commit.id.sequence)) noted.emplace(commit);
    const auto applied = applyCommit(confirmed_, log_, commit, noted ? &*noted : nullptr);
    opened_.received(commit);
    if (!applied) {
        events_.report({applied.error().code,
                        "this copy has diverged and is fetched again: " + applied.error().message});
        freeze();
        opened_.joinAll();
        return;
    }
    if (!mine) undo_.othersCommitted(log_, commit);
    if (noted) undo_.committed(commit.id.sequence, commit.revision, noted->take(log_, commit));
    if (!mine)
        editor_.othersCommitted(commit);
    else if (own)
        editor_.ownCommitted(commit, own->transaction.base);
    view_.commitShown(commit, own);
    if (mine)
        acknowledge(commit);
    else if (auto lost = committed_.takenBy(log_, commit))
        events_.push(event::Lost{*std::move(lost)});
    prune();
}

void Session::Impl::acknowledge(const Commit& commit) {
    auto pending = pending_.take(commit.id.sequence);
    if (!pending) return;
    submissions_.answered();
    for (const Value& blob : pending->blobs) uploads_.stored(blob.hash());
    recordCreations(creations_, log_, pending->transaction, commit);
    if (!commit.dropped.empty()) events_.reportDropped(*pending, commit);
    view_.acknowledged(*pending);
    committed_.add(log_, commit, *std::move(pending));
    if (pending_.empty() && !gesture_) creations_ = {};
}

void Session::Impl::lose(Pending pending, Error reason) {
    host_.answered(pending.transaction.id.sequence);
    undo_.lost(pending.transaction.id.sequence);
    ownPreviews_.withdraw(pending.transaction.gesture, point_.revision());
    events_.push(event::Lost{{.sequence = pending.transaction.id.sequence,
                              .gesture = pending.transaction.gesture,
                              .reason = std::move(reason),
                              .refused = true,
                              .edits = std::move(pending.authored)}});
    view_.restart();
}

// Sends a refused transaction again if the session can correct it: the server has forgotten the
// moves since its base, or a big value that it named. The transaction keeps its number: a new one,
// far above those that wait, would make the server forget these (M9).
bool Session::Impl::resubmit(std::uint64_t sequence) {
    Pending* pending = pending_.find(sequence);
    if (!pending || ++pending->attempts > kMaxAttempts) return false;
    for (const Value& blob : pending->blobs) uploads_.forget(blob.hash());
    pending_.markUnsent(*pending);
    pending->everSent = false;  // the server does not have it
    view_.restart();
    return true;
}

void Session::Impl::prune() {
    const Revision now = point_.revision();
    const Revision kept = now > kPreviewsBehind ? now - kPreviewsBehind : 0;
    if (kept < log_.oldest() + kPrunedAtOnce) return;
    const Revision oldest = undo_.oldestNeeded(view_.oldestNeeded(pending_.oldestNeeded(kept)));
    if (oldest <= log_.oldest()) return;
    committed_.follow(log_);
    log_.prune(oldest);
}

// ---- joining

void Session::Impl::completeJoins() {
    // A frozen layer is reset at the thaw, all at once.
    const auto arrived = [this](const LayerId& layer, const LayerDoc& content) {
        if (!view_.isFrozen()) editor_.arrived(layer, content);
    };
    const auto joined = [this](const LayerId& layer, LayerDoc content, bool again) {
        confirmed_.insert_or_assign(layer, std::move(content));
        view_.joined(layer, again);
    };
    if (!opened_.complete(point_.revision(), arrived, joined)) return;
    view_.allJoined();
    previews_.presentAgain();
}

}  // namespace usdlive::client
