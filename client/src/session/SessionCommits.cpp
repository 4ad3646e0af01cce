#include <algorithm>

#include "SessionImpl.h"

namespace usdlive::client {

namespace {

// Previews may be meant as of a revision that is this far behind.
constexpr Revision kPreviewsBehind = 1'000;
constexpr Revision kPrunedAtOnce = 64;

// So often a transaction is mended and sent again before its author is told.
constexpr int kMaxAttempts = 5;

bool changesNames(const Edit& edit) {
    return std::holds_alternative<MoveSpec>(edit.action) ||
           std::holds_alternative<DeleteSpec>(edit.action);
}

bool asPredicted(const Pending& own, const Commit& commit) {
    const auto& fieldsAt = own.prognosis.fieldsAt;
    return commit.dropped.empty() && fieldsAt.size() == commit.edits.size() &&
           std::equal(
               fieldsAt.begin(), fieldsAt.end(), commit.edits.begin(),
               [](const std::string& path, const Edit& edit) { return path == edit.address.path; });
}

}  // namespace

void Session::Impl::apply(const Commit& commit) {
    revision_ = commit.revision;
    const bool mine = commit.id.client == options_.client;
    const Pending* own = mine ? pending_.find(commit.id.sequence) : nullptr;

    const std::pair gesture{commit.id.client, commit.gesture};
    if (commit.gesture != 0 && previews_.erase(gesture) > 0) {
        dirty_ = true;
        events_.push_back(event::PreviewChanged{gesture.first, gesture.second, true});
    }
    if (!dirty_ && !frozen_ && disturbs(commit, own)) dirty_ = true;
    // What is predicted stands in the log behind what is confirmed, so it has to make room.
    if (dirty_) prediction_.cutNames();
    const bool last = !prediction_.hasNames();
    const auto applied = applyCommit(confirmed_, log_, commit);
    if (last) prediction_.confirmNames();
    for (auto& [layer, opened] : layers_)
        if (opened.joining) keepForLater(*opened.joining, layer, commit);
    if (!applied) {
        report({applied.error().code,
                "this copy has diverged and is fetched again: " + applied.error().message});
        freeze();
        for (auto& [layer, opened] : layers_)
            if (opened.joining) ask(opened.joining->snapshot, layer, 0);
        return;
    }
    if (!frozen_) applyToEditor(commit, own != nullptr);
    if (mine) acknowledge(commit);
    if (gesture_ && !dirty_ && !frozen_) gesture_->pending.transaction.base = revision_;
    prune();
}

void Session::Impl::keepForLater(Joining& joining, const LayerId& layer, const Commit& commit) {
    for (const Edit& edit : commit.edits)
        if (edit.layer == layer) joining.later.emplace_back(commit.revision, edit);
}

// Has the prediction to be made anew?
bool Session::Impl::disturbs(const Commit& commit, const Pending* own) const {
    if (own &&
        (!asPredicted(*own, commit) || !previews_.empty() || !pending_.isFirst(commit.id.sequence)))
        return true;
    const bool names = prediction_.hasNames() || gesture_;
    if (!names && prediction_.docs().empty()) return false;
    return std::any_of(commit.edits.begin(), commit.edits.end(), [&](const Edit& edit) {
        if (!confirmed_.contains(edit.layer)) return false;
        if (names && changesNames(edit)) return true;
        return !own && !prediction_.independent(edit);
    });
}

// Layers without predictions show the confirmed doc, and take every commit as it is. Of those with
// predictions only an undisturbed one does; the others follow when they have been predicted anew.
void Session::Impl::applyToEditor(const Commit& commit, bool own) {
    const LayerId* layer = nullptr;  // of the edit before: mostly they are of one layer
    bool known = false, predicted = false, shown = false;
    for (const Edit& edit : commit.edits) {
        if (!layer || *layer != edit.layer) {
            layer = &edit.layer;
            known = confirmed_.contains(*layer);
            predicted = prediction_.predicts(*layer);
            shown = isJoined(*layer) && !resets_.contains(*layer);
        }
        if (!known) continue;
        if (predicted) {
            if (dirty_ || own) continue;
            prediction_.applyIndependent(edit);
        }
        if (shown) editor_.apply(edit.layer, edit.address.path, edit.action);
    }
}

void Session::Impl::acknowledge(const Commit& commit) {
    const auto pending = pending_.take(commit.id.sequence);
    if (!pending) return;
    for (const Value& blob : pending->blobs) uploads_.stored(blob.hash());
    recordCreations(creations_, log_, pending->transaction, commit);
    if (!commit.dropped.empty()) reportDropped(*pending, commit);
    if (!pending_.empty()) return;
    if (!gesture_) creations_ = {};
    dirty_ = true;  // the views become the confirmed docs again
}

void Session::Impl::reportDropped(const Pending& pending, const Commit& commit) {
    LostWork work{.sequence = commit.id.sequence,
                  .gesture = commit.gesture,
                  .reason = {commit.dropped.front().reason,
                             std::string(errorText(commit.dropped.front().reason))},
                  .refused = false,
                  .edits = {}};
    for (const DroppedEdit& dropped : commit.dropped)
        if (dropped.index < pending.authored.size())
            work.edits.push_back(pending.authored[dropped.index]);
    events_.push_back(event::Lost{std::move(work)});
}

void Session::Impl::lose(Pending pending, Error reason) {
    host_.answered(pending.transaction.id.sequence);
    withdrawPreview(pending.transaction.gesture);
    events_.push_back(event::Lost{{.sequence = pending.transaction.id.sequence,
                                   .gesture = pending.transaction.gesture,
                                   .reason = std::move(reason),
                                   .refused = true,
                                   .edits = std::move(pending.authored)}});
    dirty_ = true;
}

// A transaction that was refused for what the author can mend unasked: the server has forgotten the
// moves since its base, or a big value that it named. Its number is spent, so it gets another.
bool Session::Impl::resubmit(std::uint64_t sequence) {
    Pending* pending = pending_.find(sequence);
    if (!pending || ++pending->attempts > kMaxAttempts) return false;
    for (const Value& blob : pending->blobs) uploads_.forget(blob.hash());
    const std::uint64_t number = pending_.nextSequence();
    pending->transaction.id.sequence = number;
    pending->sent = false;
    pending->reseal = true;
    // What was sent already names the old number in vain, and is dropped.
    const auto renameIn = [&](Pending& other) {
        if (other.sent) return;
        forEachAddress(other.transaction.edits, [&](Address& address) {
            if (address.creation && address.creation->sequence == sequence)
                address.creation->sequence = number;
        });
    };
    for (Pending& other : pending_) renameIn(other);
    if (gesture_) renameIn(gesture_->pending);
    dirty_ = true;
    return true;
}

void Session::Impl::caughtUp() {
    if (!std::exchange(resealWhenCaughtUp_, false) || frozen_) return;
    pending_.markUnsent(true);
    dirty_ = true;
}

void Session::Impl::prune() {
    const Revision kept = revision_ > kPreviewsBehind ? revision_ - kPreviewsBehind : 0;
    if (kept < log_.oldest() + kPrunedAtOnce) return;
    Revision oldest = pending_.oldestBase(kept);
    if (gesture_) oldest = std::min(oldest, gesture_->pending.transaction.base);
    if (oldest > log_.oldest()) log_.prune(oldest);
}

// ---- joining

void Session::Impl::completeJoins() {
    bool joined = false;
    for (auto& [layer, opened] : layers_) {
        if (!opened.joining || !completeJoin(layer, *opened.joining)) continue;
        if (!opened.joining->again || !frozen_) resets_.insert(layer);
        opened.joining.reset();
        joined = true;
    }
    if (joined) presentAgain();
}

bool Session::Impl::completeJoin(const LayerId& layer, Joining& joining) {
    Incoming& snapshot = joining.snapshot;
    if (!snapshot.content || !snapshot.opened || snapshot.opened->revision > revision_)
        return false;
    LayerDoc doc = *std::exchange(snapshot.content, std::nullopt);
    // A frozen layer is reset at the thaw, all at once.
    if (layers_.at(layer).wanted && !frozen_) editor_.arrived(layer, doc);
    for (const auto& [revision, edit] : joining.later) {
        if (revision <= snapshot.opened->revision) continue;
        if (doc.apply(edit.address.path, edit.action)) continue;
        joining.later.clear();
        ask(snapshot, layer, 0);  // something was wrong with it; asked for again
        return false;
    }
    confirmed_.insert_or_assign(layer, std::move(doc));
    return true;
}

void Session::Impl::completePeeks() {
    for (std::size_t index = 0; index < peeks_.size();) {
        Incoming& snapshot = peeks_[index].snapshot;
        if (!snapshot.content || !snapshot.opened) {
            ++index;
            continue;
        }
        Peek peek = std::move(peeks_[index]);
        peeks_.erase(peeks_.begin() + std::ptrdiff_t(index));
        if (peek.revision == 0 && online_ && !layers_.contains(peek.layer))
            sendControl(CloseLayer{peek.layer});
        peek.done(std::move(*peek.snapshot.content), peek.snapshot.opened->revision);
    }
}

}  // namespace usdlive::client
