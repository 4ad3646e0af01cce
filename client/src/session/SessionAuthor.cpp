// Edits of the editor: transactions and gestures.
#include <algorithm>

#include "session/SessionImpl.h"

namespace usdlive::client {

namespace {

// Applies an edit to the paths of edits that failed: deletes and moves change them.
void applyTo(std::vector<AuthoredEdit>& failed, const AuthoredEdit& edit) {
    const auto below = [&](const AuthoredEdit& other) {
        return other.layer == edit.layer && specpath::hasPrefix(other.path, edit.path);
    };
    if (std::holds_alternative<DeleteSpec>(edit.action)) std::erase_if(failed, below);
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    if (!move) return;
    const std::string to = destination(edit.path, *move);
    for (AuthoredEdit& other : failed)
        if (below(other)) other.path = specpath::replacePrefix(other.path, edit.path, to);
}

}  // namespace

void Session::Impl::author(std::vector<AuthoredEdit> edits) {
    if (edits.empty() || writeAgain(edits)) return;
    if (auto error = gesture_ ? std::nullopt : tooManyUnsent()) {
        Repairs repairs;
        for (const AuthoredEdit& edit : edits) repairs.resets.insert(edit.layer);
        events_.push(event::Lost{{.sequence = 0,
                                  .gesture = 0,
                                  .reason = *std::move(error),
                                  .refused = true,
                                  .edits = std::move(edits)}});
        return repair(repairs);
    }

    LostWork lost;
    Repairs repairs;
    undo_.begin({});
    if (gesture_) {
        lost.sequence = gesture_->pending.transaction.id.sequence;
        lost.gesture = gesture_->pending.transaction.gesture;
        authorInto(gesture_->pending, std::move(edits), lost, repairs);
        repair(repairs);
        if (gesture_->pending.expectation.refused && !frozen_) {  // because of a preview
            restartPrediction();
            rebuild();
        }
    } else {
        Pending pending = newPending();
        lost.sequence = pending.transaction.id.sequence;
        authorInto(pending, std::move(edits), lost, repairs);
        if (!pending.authored.empty()) pending_.add(std::move(pending));
        repair(repairs);
    }
    undo_.end();
    // The executor decides about the fields of such a spec (M13).
    if (std::exchange(createdExisting_, false) && !frozen_) {
        restartPrediction();
        rebuild();
    }
    checkPrediction();
    if (!lost.edits.empty()) events_.push(event::Lost{std::move(lost)});
}

std::optional<Error> Session::Impl::tooManyUnsent() const {
    const std::size_t most = options_.maxUnsentTransactions;
    if (pending_.unsent() < most) return std::nullopt;
    return Error{ErrorCode::NotConnected,
                 "no more than " + std::to_string(most) +
                     " transactions are kept until they can be sent. Connect again before you go "
                     "on"};
}

// SE15: new values replace those of an unsent transaction that sets the same registers. So a client
// that is offline, or slower than its edits, sends only the last of many values.
bool Session::Impl::writeAgain(std::vector<AuthoredEdit>& edits) {
    if (gesture_ || frozen_ || dirty_) return false;
    Pending* pending = pending_.writtenAgainBy(edits);
    if (!pending || !pending->expectation.complete) return false;
    if (pending->transaction.label != labelOf(undo_.label())) return false;
    addresses_.rebase(*pending);
    Transaction& transaction = pending->transaction;
    const auto number = [&](std::size_t index) {
        return Creation{transaction.id.sequence, std::uint32_t(index)};
    };
    // A path may be that of another spec now.
    std::vector<std::vector<Address>> names;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        auto addressed = prediction_.addressed(edits[index]);
        if (!addressed) return false;
        addresses_.renew(*addressed, prediction_.openedAt(addressed->layer), number(index));
        if (addressed->address != transaction.edits[index].address) return false;
        names.push_back(std::move(addressed->names));
    }
    LostWork lost;
    lost.sequence = transaction.id.sequence;
    Repairs repairs;
    undo_.begin({});
    for (std::size_t index = 0; index < edits.size(); ++index) {
        Expectation unchanged;
        Inverse inverse = inverseOf(*pending, edits[index]);
        const auto addressed = prediction_.author(edits[index], number(index), unchanged);
        if (!addressed) {
            if (lost.edits.empty()) lost.reason = addressed.error();
            noteRepair(edits[index], repairs);
            lost.edits.push_back(std::move(edits[index]));
            continue;
        }
        noteForUndo(transaction.id.sequence, index, edits[index], std::move(inverse));
        transaction.edits[index].action = edits[index].action;
        transaction.edits[index].names = std::move(names[index]);
        pending->authored[index] = std::move(edits[index]);
        ++writtenAgain_;
    }
    undo_.end();
    pending->blobs.clear();
    for (const AuthoredEdit& edit : pending->authored) collectBlobs(edit.action, pending->blobs);
    reportPending(*pending);
    checkPrediction();
    if (!lost.edits.empty()) {
        events_.push(event::Lost{std::move(lost)});
        repair(repairs);
    }
    return true;
}

Pending Session::Impl::newPending() {
    Pending pending;
    pending.transaction.id = {options_.client, pending_.nextSequence()};
    pending.transaction.base = revision_;
    pending.transaction.label = labelOf(undo_.label());
    return pending;
}

void Session::Impl::authorInto(Pending& pending, std::vector<AuthoredEdit> edits, LostWork& lost,
                               Repairs& repairs) {
    for (AuthoredEdit& edit : edits) {
        Inverse inverse = inverseOf(pending, edit);
        Result<Edit> addressed = predictEdit(pending, edit);
        // Nothing is lost if nothing is at this place.
        if (!addressed && concernsPlace(edit.action)) continue;
        if (!addressed) {
            if (lost.edits.empty()) lost.reason = addressed.error();
            noteRepair(edit, repairs);
            lost.edits.push_back(std::move(edit));
            continue;
        }
        applyTo(repairs.fields, edit);
        accept(pending, *std::move(addressed), std::move(edit), std::move(inverse));
    }
}

// Adds an edit to the transaction, which the view shows now.
void Session::Impl::accept(Pending& pending, Edit addressed, AuthoredEdit edit, Inverse inverse) {
    if (concernsPlace(edit.action) || std::holds_alternative<DeleteSpec>(edit.action))
        noteSeen(pending.transaction, edit.layer);
    if (!gesture_) collectBlobs(edit.action, pending.blobs);
    if (frozen_) pending.carried.push_back(edit);
    std::size_t index = pending.transaction.edits.size();
    if (gesture_ && !frozen_) {
        const std::size_t added = gesture_->add(std::move(addressed), std::move(edit));
        if (added != index) pending.expectation.touched.pop_back();
        index = added;
    } else {
        pending.transaction.edits.push_back(std::move(addressed));
        pending.authored.push_back(std::move(edit));
    }
    noteForUndo(pending.transaction.id.sequence, index, pending.authored[index],
                std::move(inverse));
}

// Edits that the editor makes while its layers are joined again cannot be undone: nobody knows what
// others have written meanwhile.
Inverse Session::Impl::inverseOf(const Pending& pending, const AuthoredEdit& edit) const {
    if (undo_.goesWithCreated(pending.transaction.id.sequence, edit)) return {};
    const LayerDoc* doc = frozen_ ? nullptr : view(edit.layer);
    return doc ? inverseBefore(*doc, edit.path, edit.action) : Inverse();
}

void Session::Impl::noteForUndo(std::uint64_t sequence, std::size_t index, const AuthoredEdit& edit,
                                Inverse inverse) {
    if (const LayerDoc* doc = frozen_ ? nullptr : view(edit.layer))
        undo_.add(sequence, std::uint32_t(index), edit, std::move(inverse), *doc, revision_);
}

// M16, M17: the author of an edit of a place, or of a delete, had seen the view. While it is being
// computed again, it lacks some commits.
void Session::Impl::noteSeen(Transaction& transaction, const LayerId& layer) const {
    if (frozen_) return;
    const Revision seen = dirty_ || rebuild_ ? prediction_.openedAt(layer) : revision_;
    transaction.seen = transaction.seen == 0 ? seen : std::min(transaction.seen, seen);
}

// Applies an edit to the view, and returns it with its address.
Result<Edit> Session::Impl::predictEdit(Pending& pending, const AuthoredEdit& edit) {
    if (!isJoined(edit.layer))
        return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
    if (frozen_) {  // addressed at the thaw
        const auto applied = frozen_->views.at(edit.layer).apply(edit.path, edit.action);
        if (!applied) return tl::unexpected(applied.error());
        return Edit{edit.layer, {}, edit.action};
    }
    const Creation number{pending.transaction.id.sequence,
                          std::uint32_t(pending.transaction.edits.size())};
    const LayerDoc* doc = prediction_.find(edit.layer);
    const bool exists =
        std::holds_alternative<CreateSpec>(edit.action) && doc && doc->has(edit.path);
    auto addressed = prediction_.author(edit, number, pending.expectation);
    if (addressed && exists) createdExisting_ = true;
    if (addressed) addresses_.renew(*addressed, prediction_.openedAt(edit.layer), number);
    return addressed;
}

void Session::Impl::noteRepair(const AuthoredEdit& edit, Repairs& repairs) const {
    const LayerDoc* doc = view(edit.layer);
    if (!doc) return;
    if (fieldOf(edit.action) && doc->has(edit.path))
        repairs.fields.push_back(edit);
    else
        repairs.resets.insert(edit.layer);
}

// Undoes edits in the editor's layers that the view does not have. Called before other changes are
// shown: the paths are those that the editor shows now.
void Session::Impl::repair(const Repairs& repairs) {
    for (const LayerId& layer : repairs.resets)
        if (const LayerDoc* doc = view(layer)) editor_.reset(layer, *doc);
    for (const AuthoredEdit& edit : repairs.fields) {
        const LayerDoc* doc = view(edit.layer);
        if (!doc || repairs.resets.contains(edit.layer) || !doc->has(edit.path)) continue;
        const std::string& name = *fieldOf(edit.action);
        if (const FieldValue* value = doc->field(edit.path, name))
            editor_.apply(edit.layer, edit.path, SetField{name, {}, *value});
        else
            editor_.apply(edit.layer, edit.path, EraseField{name, {}});
    }
}

void Session::Impl::beginGesture() {
    if (gesture_) return;
    undo_.begin({});
    gesture_.emplace().pending = newPending();
    gesture_->pending.transaction.gesture = gesture_->pending.transaction.id.sequence;
}

void Session::Impl::endGesture() {
    if (!gesture_) return;
    Gesture ended = std::move(*gesture_);
    gesture_.reset();
    ended.pending.transaction.label = labelOf(undo_.label());
    undo_.end();
    // Only its last values have to be stored.
    for (const Edit& edit : ended.pending.transaction.edits)
        collectBlobs(edit.action, ended.pending.blobs);
    if (!ended.pending.authored.empty()) {
        pending_.add(std::move(ended.pending));
        return;
    }
    host_.answered(ended.pending.transaction.id.sequence);
    if (ended.isKnown()) ownPreviews_.withdraw(ended.pending.transaction.gesture, revision_);
}

// ---- undo

// Completes the view, whatever that takes: the inverse is that against the present.
void Session::Impl::finishRebuild() {
    constexpr double kNoBound = 1e12;
    deadline_.set(kNoBound);
    while (dirty_ && !frozen_) rebuild();
}

// The edits are own ones, which the editor does not show yet.
Result<UndoResult> Session::Impl::takeBack(UndoStack::Direction direction) {
    if (gesture_ || undo_.isOpen())
        return fail(ErrorCode::InvalidArgument, std::string("a ") +
                                                    (gesture_ ? "gesture" : "group of edits") +
                                                    " is open: end it before you undo or redo");
    if (auto error = tooManyUnsent()) return tl::unexpected(*std::move(error));
    finishRebuild();
    followUndo();
    if (!undo_.hasStep(direction)) return UndoResult{};
    Pending pending = newPending();
    const auto author = [&](AuthoredEdit edit) -> Result<void> {
        Inverse inverse = inverseOf(pending, edit);
        Result<Edit> addressed = predictEdit(pending, edit);
        if (!addressed && concernsPlace(edit.action)) return {};
        if (!addressed) return tl::unexpected(std::move(addressed.error()));
        editor_.apply(edit.layer, edit.path, edit.action);
        accept(pending, *std::move(addressed), std::move(edit), std::move(inverse));
        return {};
    };
    const auto docOf = [this](const LayerId& layer) { return view(layer); };
    UndoResult result = undo_.takeBack(direction, docOf, author);
    pending.transaction.label =
        labelOf((direction == UndoStack::Direction::Undo ? "Undo: " : "Redo: ") + result.label);
    if (!pending.authored.empty()) pending_.add(std::move(pending));
    if (std::exchange(createdExisting_, false)) {
        restartPrediction();
        rebuild();
    }
    checkPrediction();
    return result;
}

}  // namespace usdlive::client
