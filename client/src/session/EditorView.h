// The view: the layers as the editor shows them.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "session/Deadline.h"
#include "session/Gesture.h"
#include "session/OpenedLayers.h"
#include "session/OthersPreviews.h"
#include "session/OwnAddresses.h"
#include "session/PendingTransactions.h"
#include "session/Prediction.h"
#include "session/Session.h"
#include "session/SessionEvents.h"
#include "session/UndoStack.h"
#include "usdlive/common/layer/Inverse.h"

namespace usdlive::client {

/// The view: the confirmed layers, then the previews of others, then the own pending transactions
/// and the open gesture (M7). Tells the editor's LayerView about each change of it.
///
/// A commit that does not affect own work is applied to the view directly. Otherwise the prediction
/// is *outdated*: update() computes it again, in several calls if there is much to compute, and
/// tells the editor the difference. Until then the view stays as it is.
///
/// While the layers are joined again in another history, the view is *frozen*: it keeps the content
/// from before, and takes the editor's edits.
class EditorView {
public:
    /// The parts that the view is made of or informs. All belong to the session and outlive the
    /// view.
    struct Parts {
        const Session::Options& options;
        const Prediction::Confirmed& confirmed;
        PendingTransactions& pending;
        std::optional<Gesture>& gesture;
        const OthersPreviews& previews;
        const OpenedLayers& opened;
        OwnAddresses& addresses;
        UndoStack& undo;
        Deadline& deadline;
        SessionHost& host;
        LayerView& editor;
        SessionEvents& events;
    };
    explicit EditorView(const Parts& parts);

    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    /// nullptr: not joined. Valid until the next call that changes the view.
    [[nodiscard]] const LayerDoc* find(const LayerId& layer) const;
    [[nodiscard]] bool isFrozen() const { return frozen_.has_value(); }
    /// Returns true while the prediction does not contain all commits and previews.
    [[nodiscard]] bool isOutdated() const { return outdated_; }
    /// Returns true while update() has to be called again to complete the prediction.
    [[nodiscard]] bool isComputing() const { return next_.has_value(); }
    /// Returns the revision up to which the editor has seen all commits of the layer.
    [[nodiscard]] Revision seenUntil(const LayerId& layer) const;
    /// Returns the oldest revision that predictions need, or `otherwise`.
    [[nodiscard]] Revision oldestNeeded(Revision otherwise) const;

    // ---- edits of the editor, which shows them already

    /// Applies an edit to the view, and returns it with its address. It is the next one of this
    /// transaction. While the view is frozen, it has no address.
    Result<Edit> author(Pending& pending, const AuthoredEdit& edit);
    /// Call after author().
    void authored();
    /// Returns the edit with its present address, without applying it.
    [[nodiscard]] Result<Edit> addressed(const AuthoredEdit& edit, const Creation& number) const;
    /// Applies an edit that takes the place of edit `number`, with the same address (SE15).
    Result<void> writeAgain(const AuthoredEdit& edit, const Creation& number);
    /// Returns what takes the edit back; nothing while the view is frozen, because nobody knows
    /// what others have written meanwhile.
    [[nodiscard]] Inverse inverseOf(const AuthoredEdit& edit) const;

    /// Edits of the editor that the view does not have.
    class Repairs {
    public:
        /// The view has refused this edit.
        void add(const EditorView& view, const AuthoredEdit& edit);
        /// The whole layer has to be shown again.
        void add(const LayerId& layer) { resets_.insert(layer); }
        /// The view has accepted a later edit: what was refused may be at another path now.
        void follow(const AuthoredEdit& accepted);

    private:
        friend class EditorView;
        std::set<LayerId> resets_;
        std::vector<AuthoredEdit> fields_;
    };
    /// Undoes them in the editor's layers. Call it before other changes are shown: the paths are
    /// those that the editor shows now.
    void repair(const Repairs& repairs);

    // ---- the confirmed layers. A commit: commitComes(), then the layers change, then
    // commitShown().

    /// `own`: the transaction that this commit answers, or nullptr.
    void commitComes(const Commit& commit, const Pending* own);
    void commitShown(const Commit& commit, const Pending* own);
    /// Call when a committed transaction is not pending any more.
    void acknowledged(const Pending& own);
    /// The undo follows commits when the view shows them.
    void followUndo();
    /// Compares the prediction with one that is computed at once (Options::checksPrediction).
    /// Throws std::logic_error if they differ.
    void check() const;

    // ---- layers

    /// A layer is opened that is joined already.
    void opened(const LayerId& layer) { resets_.insert(layer); }
    void closed(const LayerId& layer) { resets_.erase(layer); }
    /// `again`: it was joined before, in another history.
    void joined(const LayerId& layer, bool again);
    /// Call after joined() for all that have arrived.
    void allJoined();
    void joinFailed(const LayerId& layer);
    /// The layer is not among the confirmed ones any more.
    void dropped(const LayerId& layer);

    // ---- predictions

    /// The prediction has to be computed again from its beginning.
    void restart();
    void previewsChanged();
    /// Computes it again now, within the deadline.
    void recompute();
    /// Completes it, whatever that takes.
    void complete();
    /// Completes the prediction as far as the deadline allows, and shows layers that have arrived.
    void update();

    // ---- another history

    /// The confirmed layers are not valid any more. Own work is carried over by its paths in the
    /// view (Pending::carried). Call it before they change.
    void freeze();
    /// The layers are joined again. The view has no own work until carried() and showAll().
    void thaw();
    /// Gives a transaction that was carried over its new addresses.
    void carried(Pending& pending);
    void showAll();

private:
    // The prediction that is being computed, some transactions at a time.
    struct Next {
        Prediction prediction;
        std::size_t done = 0;   // number of pending transactions that it contains
        bool outdated = false;  // it has to be computed again afterwards
    };
    // The prediction that stays valid with the commit that is being applied.
    enum class Valid { None, Shown, Next };

    [[nodiscard]] Prediction* valid();
    [[nodiscard]] bool isPending(std::uint64_t sequence) const;
    void readdressGesture();
    void predictPreviews(Prediction& prediction) const;
    void predictGesture(Prediction& prediction);
    void compute();
    void carryOver();
    void showDifference(const LayerDocs& before);
    void show(const LayerId& layer, const std::string& path, const EditAction& action);
    void showResets();
    void discard(Prediction old);

    const Parts parts_;
    Prediction prediction_{parts_.confirmed};
    bool outdated_ = false;
    std::optional<Next> next_;  // only when outdated_
    Valid valid_ = Valid::None;
    std::size_t answered_ = 0;         // own structural edits since the prediction was made
    std::set<LayerId> resets_;         // layers whose whole content the editor gets next
    std::optional<LayerDocs> frozen_;  // the view from before
    /// The editor has created a spec that the prediction already has, from a preview of another.
    bool createdExisting_ = false;
};

}  // namespace usdlive::client
