// Makes transactions of the edits of the editor, and takes own work back.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "session/EditorView.h"
#include "session/HistoryPoint.h"
#include "session/OwnPreviews.h"

namespace usdlive::client {

/// Makes own transactions of the edits of the editor, or parts of the open gesture (M11), and takes
/// own work back.
class Authoring {
public:
    /// The parts that it works with. All belong to the session and outlive this object.
    struct Parts {
        const Session::Options& options;
        const HistoryPoint& point;
        std::optional<Gesture>& gesture;
        PendingTransactions& pending;
        OwnAddresses& addresses;
        UndoStack& undo;
        EditorView& view;
        OwnPreviews& previews;
        SessionHost& host;
        LayerView& editor;
        SessionEvents& events;
    };
    explicit Authoring(const Parts& parts) : parts_(parts) {}

    /// See Session::author().
    void author(std::vector<AuthoredEdit> edits);
    void beginGesture();
    void endGesture();
    /// Reports an open gesture to the host from time to time, so that the journal keeps it.
    void reportGesture(std::int64_t nowMs);
    /// See Session::undo().
    Result<UndoResult> takeBack(UndoStack::Direction direction);
    /// See Session::writtenAgain().
    [[nodiscard]] std::uint64_t writtenAgain() const { return writtenAgain_; }

private:
    [[nodiscard]] bool writeAgain(std::vector<AuthoredEdit>& edits);
    Pending newPending();
    void authorInto(Pending& pending, std::vector<AuthoredEdit> edits, LostWork& lost,
                    EditorView::Repairs& repairs);
    void accept(Pending& pending, Edit addressed, AuthoredEdit edit, Inverse inverse);
    [[nodiscard]] std::optional<Error> tooManyUnsent() const;
    [[nodiscard]] Inverse inverseOf(const Pending& pending, const AuthoredEdit& edit) const;
    void noteForUndo(std::uint64_t sequence, std::size_t index, const AuthoredEdit& edit,
                     Inverse inverse);
    void noteSeen(Transaction& transaction, const LayerId& layer) const;

    const Parts parts_;
    std::uint64_t writtenAgain_ = 0;
    std::int64_t reportedMs_ = 0;
};

}  // namespace usdlive::client
