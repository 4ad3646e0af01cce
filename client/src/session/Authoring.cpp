// Edits of the editor, gestures and undo.
#include "session/Authoring.h"

#include <algorithm>
#include <string>
#include <utility>

namespace usdlive::client {

namespace {

constexpr std::int64_t kReportGestureEveryMs = 400;

}  // namespace

void Authoring::author(std::vector<AuthoredEdit> edits) {
    if (edits.empty() || writeAgain(edits)) return;
    if (auto error = parts_.gesture ? std::nullopt : tooManyUnsent()) {
        EditorView::Repairs repairs;
        for (const AuthoredEdit& edit : edits) repairs.add(edit.layer);
        parts_.events.push(event::Lost{{.sequence = 0,
                                        .gesture = 0,
                                        .reason = *std::move(error),
                                        .refused = true,
                                        .edits = std::move(edits)}});
        return parts_.view.repair(repairs);
    }

    LostWork lost;
    EditorView::Repairs repairs;
    parts_.undo.begin({});
    if (parts_.gesture) {
        lost.sequence = parts_.gesture->pending.transaction.id.sequence;
        lost.gesture = parts_.gesture->pending.transaction.gesture;
        authorInto(parts_.gesture->pending, std::move(edits), lost, repairs);
        parts_.view.repair(repairs);
        const bool refused = parts_.gesture->pending.expectation.refused;  // because of a preview
        if (refused && !parts_.view.isFrozen()) parts_.view.recompute();
    } else {
        Pending pending = newPending();
        lost.sequence = pending.transaction.id.sequence;
        authorInto(pending, std::move(edits), lost, repairs);
        if (!pending.authored.empty()) parts_.pending.add(std::move(pending));
        parts_.view.repair(repairs);
    }
    parts_.undo.end();
    parts_.view.authored();
    if (!lost.edits.empty()) parts_.events.push(event::Lost{std::move(lost)});
}

std::optional<Error> Authoring::tooManyUnsent() const {
    const std::size_t most = parts_.options.maxUnsentTransactions;
    if (parts_.pending.unsent() < most) return std::nullopt;
    return Error{ErrorCode::NotConnected,
                 "no more than " + std::to_string(most) +
                     " transactions are kept until they can be sent. Connect again before you go "
                     "on"};
}

// SE15: new values replace those of an unsent transaction that sets the same registers. So a client
// that is offline, or slower than its edits, sends only the last of many values.
bool Authoring::writeAgain(std::vector<AuthoredEdit>& edits) {
    if (parts_.gesture || parts_.view.isFrozen() || parts_.view.isOutdated()) return false;
    Pending* pending = parts_.pending.writtenAgainBy(edits);
    if (!pending || !pending->expectation.complete) return false;
    if (pending->transaction.label != labelOf(parts_.undo.label())) return false;
    parts_.addresses.rebase(*pending);
    Transaction& transaction = pending->transaction;
    const auto number = [&](std::size_t index) {
        return Creation{transaction.id.sequence, std::uint32_t(index)};
    };
    // A path may be that of another spec now.
    std::vector<std::vector<Address>> names;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        auto addressed = parts_.view.addressed(edits[index], number(index));
        if (!addressed) return false;
        if (addressed->address != transaction.edits[index].address) return false;
        names.push_back(std::move(addressed->names));
    }
    LostWork lost;
    lost.sequence = transaction.id.sequence;
    EditorView::Repairs repairs;
    parts_.undo.begin({});
    for (std::size_t index = 0; index < edits.size(); ++index) {
        Inverse inverse = inverseOf(*pending, edits[index]);
        const auto written = parts_.view.writeAgain(edits[index], number(index));
        if (!written) {
            if (lost.edits.empty()) lost.reason = written.error();
            repairs.add(parts_.view, edits[index]);
            lost.edits.push_back(std::move(edits[index]));
            continue;
        }
        noteForUndo(transaction.id.sequence, index, edits[index], std::move(inverse));
        transaction.edits[index].action = edits[index].action;
        transaction.edits[index].names = std::move(names[index]);
        pending->authored[index] = std::move(edits[index]);
        ++writtenAgain_;
    }
    parts_.undo.end();
    pending->blobs.clear();
    for (const AuthoredEdit& edit : pending->authored) collectBlobs(edit.action, pending->blobs);
    parts_.pending.onChange(*pending);
    parts_.view.check();
    if (!lost.edits.empty()) {
        parts_.events.push(event::Lost{std::move(lost)});
        parts_.view.repair(repairs);
    }
    return true;
}

Pending Authoring::newPending() {
    Pending pending;
    pending.transaction.id = {parts_.options.client, parts_.pending.nextSequence()};
    pending.transaction.base = parts_.point.revision();
    pending.transaction.label = labelOf(parts_.undo.label());
    return pending;
}

void Authoring::authorInto(Pending& pending, std::vector<AuthoredEdit> edits, LostWork& lost,
                           EditorView::Repairs& repairs) {
    for (AuthoredEdit& edit : edits) {
        Inverse inverse = inverseOf(pending, edit);
        Result<Edit> addressed = parts_.view.author(pending, edit);
        // Nothing is lost if nothing is at this place.
        if (!addressed && concernsPlace(edit.action)) continue;
        if (!addressed) {
            if (lost.edits.empty()) lost.reason = addressed.error();
            repairs.add(parts_.view, edit);
            lost.edits.push_back(std::move(edit));
            continue;
        }
        repairs.follow(edit);
        accept(pending, *std::move(addressed), std::move(edit), std::move(inverse));
    }
}

// Adds an edit to the transaction, which the view shows now.
void Authoring::accept(Pending& pending, Edit addressed, AuthoredEdit edit, Inverse inverse) {
    if (concernsPlace(edit.action) || std::holds_alternative<DeleteSpec>(edit.action))
        noteSeen(pending.transaction, edit.layer);
    if (!parts_.gesture) collectBlobs(edit.action, pending.blobs);
    if (parts_.view.isFrozen()) pending.carried.push_back(edit);
    std::size_t index = pending.transaction.edits.size();
    if (parts_.gesture && !parts_.view.isFrozen()) {
        const std::size_t added = parts_.gesture->add(std::move(addressed), std::move(edit));
        if (added != index) pending.expectation.touched.pop_back();
        index = added;
    } else {
        pending.transaction.edits.push_back(std::move(addressed));
        pending.authored.push_back(std::move(edit));
    }
    noteForUndo(pending.transaction.id.sequence, index, pending.authored[index],
                std::move(inverse));
}

Inverse Authoring::inverseOf(const Pending& pending, const AuthoredEdit& edit) const {
    const bool goes = parts_.undo.goesWithCreated(pending.transaction.id.sequence, edit);
    return goes ? Inverse() : parts_.view.inverseOf(edit);
}

void Authoring::noteForUndo(std::uint64_t sequence, std::size_t index, const AuthoredEdit& edit,
                            Inverse inverse) {
    if (const LayerDoc* doc = parts_.view.isFrozen() ? nullptr : parts_.view.find(edit.layer))
        parts_.undo.add(sequence, std::uint32_t(index), edit, std::move(inverse), *doc,
                        parts_.point.revision());
}

// M16, M17: the author of an edit of a place, or of a delete, had seen the view.
void Authoring::noteSeen(Transaction& transaction, const LayerId& layer) const {
    if (parts_.view.isFrozen()) return;
    const Revision seen = parts_.view.seenUntil(layer);
    transaction.seen = transaction.seen == 0 ? seen : std::min(transaction.seen, seen);
}

void Authoring::beginGesture() {
    if (parts_.gesture) return;
    parts_.undo.begin({});
    parts_.gesture.emplace().pending = newPending();
    parts_.gesture->pending.transaction.gesture = parts_.gesture->pending.transaction.id.sequence;
}

void Authoring::endGesture() {
    if (!parts_.gesture) return;
    Gesture ended = std::move(*parts_.gesture);
    parts_.gesture.reset();
    ended.pending.transaction.label = labelOf(parts_.undo.label());
    parts_.undo.end();
    // Only its last values have to be stored.
    for (const Edit& edit : ended.pending.transaction.edits)
        collectBlobs(edit.action, ended.pending.blobs);
    if (!ended.pending.authored.empty()) {
        parts_.pending.add(std::move(ended.pending));
        return;
    }
    parts_.host.answered(ended.pending.transaction.id.sequence);
    if (ended.isKnown())
        parts_.previews.withdraw(ended.pending.transaction.gesture, parts_.point.revision());
}

void Authoring::reportGesture(std::int64_t nowMs) {
    if (!parts_.gesture || !parts_.gesture->unreported) return;
    if (nowMs - reportedMs_ < kReportGestureEveryMs) return;
    reportedMs_ = nowMs;
    parts_.gesture->unreported = false;
    parts_.pending.onChange(parts_.gesture->pending);
}

// ---- undo

// The edits are own ones, which the editor does not show yet.
Result<UndoResult> Authoring::takeBack(UndoStack::Direction direction) {
    if (parts_.gesture || parts_.undo.isOpen())
        return fail(ErrorCode::InvalidArgument,
                    std::string("a ") + (parts_.gesture ? "gesture" : "group of edits") +
                        " is open: end it before you undo or redo");
    if (auto error = tooManyUnsent()) return tl::unexpected(*std::move(error));
    parts_.view.complete();  // the inverse is that against the present
    parts_.view.followUndo();
    if (!parts_.undo.hasStep(direction)) return UndoResult{};
    Pending pending = newPending();
    const auto author = [&](AuthoredEdit edit) -> Result<void> {
        Inverse inverse = inverseOf(pending, edit);
        Result<Edit> addressed = parts_.view.author(pending, edit);
        if (!addressed && concernsPlace(edit.action)) return {};
        if (!addressed) return tl::unexpected(std::move(addressed.error()));
        parts_.editor.apply(edit.layer, edit.path, edit.action);
        accept(pending, *std::move(addressed), std::move(edit), std::move(inverse));
        return {};
    };
    const auto docOf = [this](const LayerId& layer) { return parts_.view.find(layer); };
    UndoResult result = parts_.undo.takeBack(direction, docOf, author);
    pending.transaction.label =
        labelOf((direction == UndoStack::Direction::Undo ? "Undo: " : "Redo: ") + result.label);
    if (!pending.authored.empty()) parts_.pending.add(std::move(pending));
    parts_.view.authored();
    return result;
}

}  // namespace usdlive::client
