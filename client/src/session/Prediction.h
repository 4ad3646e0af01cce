#pragma once

#include <functional>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "Pending.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// In a preview, the sequence number that stands for the preview itself (it has none yet): its
/// edits name specs that it creates by this.
inline constexpr std::uint64_t kThisPreview = ~std::uint64_t(0);

/// The field that it sets or erases; none where it does something else.
[[nodiscard]] const std::string* fieldOf(const EditAction& action);

/// Where a move of the spec at `path` goes, in the terms of its parent's address.
[[nodiscard]] std::string destination(std::string_view path, const MoveSpec& move);

/// What the editor sees where that is not simply the confirmed layers: previews of others and one's
/// own transactions on top of them (M7). Only layers that one of these names have a doc here; of
/// all others the confirmed doc is what is seen, and is not copied.
///
/// Predicted moves and deletes stand in a log of their own above the confirmed one, and predicted
/// creations likewise. So the confirmed side goes on while the prediction stays, as long as its
/// commits have no effect on what was predicted: see effect() and acknowledge().
///
/// Predicted specs get node ids of their own range, the same ones each time the prediction is made
/// anew, so that a comparison of two predictions knows a spec again.
class Prediction {
public:
    /// The confirmed side, which belongs to the session and outlives this.
    struct Confirmed {
        const LayerDocs& layers;
        const NamespaceLog& log;
        const OwnCreations& creations;  ///< of one's own commits
        const Revision& revision;
    };
    explicit Prediction(const Confirmed& confirmed)
        : confirmed_(&confirmed), names_(&confirmed.log), creations_(&confirmed.creations) {}

    /// Begins anew on the confirmed layers, and returns what it was.
    [[nodiscard]] Prediction startAnew() { return std::exchange(*this, Prediction(*confirmed_)); }
    [[nodiscard]] const LayerDocs& docs() const { return docs_; }

    /// A preview of somebody else; `slot` tells it from others.
    void preview(std::uint64_t slot, const PreviewFrame& frame);
    /// One's own transaction, by the code the server runs.
    Prognosis run(const Transaction& transaction);
    /// As run(), and tells where each edit landed (nothing: it was dropped).
    struct Landed {
        Prognosis prognosis;
        std::vector<std::optional<AuthoredEdit>> edits;
        std::optional<Refused> refused;
    };
    Landed land(const Transaction& transaction);

    /// An edit as its author made it, on what is seen now: applies it and says how it is to be
    /// addressed (M3), as of the revision openedAt() its layer. It is edit `creation.edit` of
    /// transaction `creation.sequence`.
    Result<Edit> author(const AuthoredEdit& edit, const Creation& creation, Prognosis& prognosis);

    /// How it would be addressed: as author(), which follows.
    [[nodiscard]] Result<Edit> addressed(const AuthoredEdit& edit) const {
        const LayerDoc* doc = find(edit.layer);
        if (!doc)
            return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
        return addressed(edit, *doc);
    }

    /// nullptr: no such layer.
    [[nodiscard]] const LayerDoc* find(const LayerId& layer) const;
    /// How many fields of one's own it has noted: destroying it takes so long.
    [[nodiscard]] std::size_t fieldsNoted() const;
    /// Has the layer a doc of its own here?
    [[nodiscard]] bool predicts(const LayerId& layer) const { return docs_.contains(layer); }
    /// The confirmed revision that the prediction of the layer was begun on; without one the
    /// present.
    [[nodiscard]] Revision openedAt(const LayerId& layer) const;
    /// The least of these, or `otherwise`.
    [[nodiscard]] Revision oldest(Revision otherwise) const;

    /// What a committed edit of somebody else means for what is predicted of its layer.
    enum class Effect {
        None,     ///< nothing: a pending write of the whole field covers it (M7)
        Applies,  ///< the doc takes it as it is
        Disturbs  ///< the prediction has to be made anew
    };
    /// `isPending`: has that transaction of one's own not been answered?
    [[nodiscard]] Effect effect(const Edit& committed,
                                const std::function<bool(std::uint64_t)>& isPending) const;
    /// A committed edit that applies.
    void apply(const Edit& committed);
    /// One's own first transaction was committed as predicted: its moves, deletes and creations
    /// are confirmed now.
    void acknowledge(std::uint64_t sequence, const Prognosis& prognosis);
    /// Do previews move or delete specs?
    [[nodiscard]] bool previewsChangeNames() const { return previewsChangeNames_; }

private:
    struct Move {
        LayerId layer;
        std::string from, to;
    };
    struct LayerNotes {
        std::unordered_map<NodeId, Creation> created;  // own ones; the rest are of previews
        // By path, NUL, field: the last transaction of one's own that wrote it whole, 0 none.
        std::unordered_map<std::string, std::uint64_t> fields;
        std::vector<std::string> structural;  // created, deleted, moved from and to
    };

    LayerDoc* open(const LayerId& layer);
    Landed execute(const Transaction& transaction, bool own, NodeId firstNode, bool wantEdits);
    void note(const Edit& executed, const LayerDoc::Applied& applied,
              const std::optional<Creation>& creation, Prognosis& prognosis);
    Result<Address> address(const LayerId& layer, const LayerDoc& doc, std::string_view path) const;
    Result<Address> childAddress(const LayerId& layer, const LayerDoc& doc,
                                 std::string_view path) const;
    Result<Edit> addressed(const AuthoredEdit& edit, const LayerDoc& doc) const;

    const Confirmed* confirmed_;
    LayerDocs docs_;
    std::unordered_map<LayerId, Revision> openedAt_;
    NamespaceLog names_;
    OwnCreations creations_;
    std::vector<Move> moves_;
    std::unordered_map<LayerId, LayerNotes> notes_;
    bool previewsChangeNames_ = false;
};

}  // namespace usdlive::client
