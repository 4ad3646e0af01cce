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

// Number of own structural edits that are committed before the prediction is computed again, which
// drops its notes about them.
constexpr std::size_t kAnsweredKept = 4'096;

// Returns whether each edit was committed at the predicted path and unchanged. The executor may
// change it (M13, ED9).
bool asPredicted(const Pending& own, const Commit& commit) {
    if (!own.expectation.complete || !commit.dropped.empty()) return false;
    const auto& submitted = own.transaction.edits;
    if (commit.edits.size() != submitted.size()) return false;
    auto touched = own.expectation.touched.begin();
    const auto end = own.expectation.touched.end();
    for (std::size_t index = 0; index < submitted.size(); ++index) {
        const Edit& edit = commit.edits[index];
        if (touched == end || touched->path != edit.address.path) return false;
        if (fieldOf(edit.action) && edit.action != submitted[index].action) return false;
        ++touched;
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && touched != end && touched->path == destination(edit.address.path, *move))
            ++touched;
    }
    return touched == end;
}

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
    revision_ = commit.revision;
    const bool mine = commit.id.client == options_.client;
    const Pending* own = mine ? pending_.find(commit.id.sequence) : nullptr;

    if (commit.gesture != 0) previews_.committed(commit.id.client, commit.gesture);
    if (!mine && commit.firstUnseen != 0) committed_.follow(log_, commit.firstUnseen);
    Prediction* current = frozen_ ? nullptr : follow(commit, own);
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
    if (!frozen_) applyToEditor(commit, own != nullptr, current);
    if (mine)
        acknowledge(commit, current);
    else if (auto lost = committed_.takenBy(log_, commit))
        events_.push(event::Lost{*std::move(lost)});
    prune();
}

bool Session::Impl::isPending(std::uint64_t sequence) const {
    return pending_.contains(sequence) ||
           (gesture_ && gesture_->pending.transaction.id.sequence == sequence);
}

// Returns the prediction that is valid after this commit: the current one, or else the one that is
// being computed; nullptr if it has to be computed again. A computation is stopped only if its
// result would be wrong. Otherwise another one follows it, so that a stream of commits cannot keep
// it from ever being shown.
Prediction* Session::Impl::follow(const Commit& commit, const Pending* own) {
    if (dirty_ && !rebuild_) return nullptr;
    Prediction& current = rebuild_ ? rebuild_->next : prediction_;
    bool holds = true, canGoOn = rebuild_.has_value();
    if (own) {
        const bool next = pending_.isFirst(commit.id.sequence) && (!rebuild_ || rebuild_->done > 0);
        canGoOn = canGoOn && next && !current.previewsChangeNames() && asPredicted(*own, commit);
        holds = next && previews_.isEmpty() && asPredicted(*own, commit);
    } else {
        for (const Edit& edit : commit.edits) {
            if (!confirmed_.contains(edit.layer)) continue;
            const auto pending = [this](std::uint64_t number) { return isPending(number); };
            if (current.effect(edit, pending) != Prediction::Effect::Invalidates) continue;
            holds = false;
            canGoOn = canGoOn && !changesNamespace(edit);
        }
    }
    if (holds) return &current;
    if (!canGoOn) {
        restartPrediction();
        return nullptr;
    }
    rebuild_->outdated = true;
    return &current;
}

// Applies a commit to the editor. Layers without predictions show the confirmed doc, so every
// commit applies. Layers with predictions show it when the prediction is valid or has been computed
// again.
void Session::Impl::applyToEditor(const Commit& commit, bool own, Prediction* current) {
    using Effect = Prediction::Effect;
    const LayerId* layer = nullptr;  // layer of the edit before: most commits edit one layer
    bool known = false, predicted = false, shown = false;
    const auto pending = [this](std::uint64_t number) { return isPending(number); };
    for (const Edit& edit : commit.edits) {
        if (!layer || *layer != edit.layer) {
            layer = &edit.layer;
            known = confirmed_.contains(*layer);
            predicted = prediction_.predicts(*layer);
            shown = isJoined(*layer) && !resets_.contains(*layer);
        }
        if (!known) continue;
        const bool applies = current && !own && current->effect(edit, pending) == Effect::Applies;
        if (applies) current->apply(edit);
        if (predicted && (dirty_ || !applies)) continue;
        if (shown) show(edit.layer, edit.address.path, edit.action);
    }
}

void Session::Impl::acknowledge(const Commit& commit, Prediction* current) {
    auto pending = pending_.take(commit.id.sequence);
    if (!pending) return;
    submissions_.answered();
    if (current) current->acknowledge(commit.id.sequence, pending->expectation);
    if (rebuild_) --rebuild_->done;
    for (const Value& blob : pending->blobs) uploads_.stored(blob.hash());
    recordCreations(creations_, log_, pending->transaction, commit);
    if (!commit.dropped.empty()) events_.reportDropped(*pending, commit);
    const auto& edits = pending->transaction.edits;
    answered_ += std::size_t(std::count_if(edits.begin(), edits.end(), [](const Edit& edit) {
        return fieldOf(edit.action) == nullptr;
    }));
    committed_.add(log_, commit, *std::move(pending));
    if (!pending_.empty()) {
        // Drops the notes about their specs from time to time.
        if (!dirty_ && answered_ > std::max(kAnsweredKept, 2 * pending_.size()))
            restartPrediction();
        return;
    }
    if (dirty_ || frozen_ || gesture_ || !previews_.isEmpty()) {
        restartPrediction();
    } else {  // the views are the confirmed docs again
        checkPrediction();
        discard(prediction_.startAnew());
        answered_ = 0;
    }
    if (!gesture_) creations_ = {};
}

void Session::Impl::lose(Pending pending, Error reason) {
    host_.answered(pending.transaction.id.sequence);
    undo_.lost(pending.transaction.id.sequence);
    ownPreviews_.withdraw(pending.transaction.gesture, revision_);
    events_.push(event::Lost{{.sequence = pending.transaction.id.sequence,
                              .gesture = pending.transaction.gesture,
                              .reason = std::move(reason),
                              .refused = true,
                              .edits = std::move(pending.authored)}});
    restartPrediction();
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
    restartPrediction();
    return true;
}

void Session::Impl::prune() {
    const Revision kept = revision_ > kPreviewsBehind ? revision_ - kPreviewsBehind : 0;
    if (kept < log_.oldest() + kPrunedAtOnce) return;
    Revision oldest = prediction_.oldest(pending_.oldestNeeded(kept));
    if (rebuild_) oldest = rebuild_->next.oldest(oldest);
    if (gesture_) oldest = std::min(oldest, neededSince(gesture_->pending.transaction));
    oldest = undo_.oldestNeeded(oldest);
    if (oldest <= log_.oldest()) return;
    committed_.follow(log_);
    log_.prune(oldest);
}

// ---- joining

void Session::Impl::completeJoins() {
    // A frozen layer is reset at the thaw, all at once.
    const auto arrived = [this](const LayerId& layer, const LayerDoc& content) {
        if (!frozen_) editor_.arrived(layer, content);
    };
    const auto joined = [this](const LayerId& layer, LayerDoc content, bool again) {
        confirmed_.insert_or_assign(layer, std::move(content));
        if (!again || !frozen_) resets_.insert(layer);
    };
    if (!opened_.complete(revision_, arrived, joined)) return;
    if (rebuild_) restartPrediction();
    previews_.presentAgain();
}

}  // namespace usdlive::client
