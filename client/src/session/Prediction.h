#pragma once

#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
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

/// What the editor sees where that is not simply the confirmed layers: previews of others and one's
/// own transactions on top of them (M7). Only layers that one of these names have a doc here; of
/// all others the confirmed doc is what is seen, and is not copied.
///
/// Predicted moves and deletes stand in the log behind the confirmed ones, until cutNames().
///
/// Predicted specs get node ids of their own range, the same ones each time the prediction is made
/// anew, so that a comparison of two predictions knows a spec again.
class Prediction {
public:
    /// Both belong to the session and outlive this.
    Prediction(const LayerDocs& confirmed, NamespaceLog& log) : confirmed_(confirmed), log_(log) {}

    /// Begins anew on the confirmed layers. Takes what was predicted out of the log.
    void start(const OwnCreations& creations, Revision confirmed);
    /// The docs as they were, for a comparison; start() follows.
    [[nodiscard]] LayerDocs takeDocs() { return std::move(docs_); }
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
    /// addressed (M3). It is edit `creation.edit` of transaction `creation.sequence`.
    Result<Edit> author(const AuthoredEdit& edit, const Creation& creation, Prognosis& prognosis);

    /// nullptr: no such layer.
    [[nodiscard]] const LayerDoc* find(const LayerId& layer) const;
    /// Has the layer a doc of its own here?
    [[nodiscard]] bool predicts(const LayerId& layer) const { return docs_.contains(layer); }
    /// Does a committed edit leave the rest of the prediction of its layer as it is?
    [[nodiscard]] bool independent(const Edit& committed) const;
    /// A committed edit that is independent.
    void applyIndependent(const Edit& committed);

    /// Are there predicted moves or deletes?
    [[nodiscard]] bool hasNames() const { return log_.mark() != confirmedNames_; }
    /// Takes them out of the log. start() has to follow before anything else is predicted.
    void cutNames() { log_.truncate(confirmedNames_); }
    /// Where in the log the confirmed ones end.
    [[nodiscard]] std::uint64_t confirmedNames() const { return confirmedNames_; }
    /// Names have been committed while there were none predicted.
    void confirmNames() { confirmedNames_ = log_.mark(); }

    /// A state to go back to.
    struct Saved;
    [[nodiscard]] Saved save() const;
    void restore(Saved saved);

private:
    struct Move {
        LayerId layer;
        std::string from, to;
    };
    struct LayerNotes {
        std::unordered_map<NodeId, Creation> created;  // own ones; the rest are of previews
        std::unordered_set<std::string> fields;        // path, NUL, field
        std::vector<std::string> structural;           // created, deleted, moved from and to
    };

    LayerDoc* open(const LayerId& layer);
    Landed execute(const Transaction& transaction, bool own, NodeId firstNode, bool wantEdits);
    void note(const Edit& executed, const LayerDoc::Applied& applied,
              const std::optional<Creation>& creation, Prognosis& prognosis);
    Result<Address> address(const LayerId& layer, const LayerDoc& doc, std::string_view path) const;
    Result<Address> childAddress(const LayerId& layer, const LayerDoc& doc,
                                 std::string_view path) const;
    Result<Edit> addressed(const AuthoredEdit& edit, const LayerDoc& doc) const;

    const LayerDocs& confirmed_;
    NamespaceLog& log_;
    LayerDocs docs_;
    OwnCreations creations_;
    std::vector<Move> moves_;
    std::unordered_map<LayerId, LayerNotes> notes_;
    std::uint64_t confirmedNames_ = 0;
    Revision revision_ = 0;  // that a commit of it all would have

public:
    struct Saved {
        LayerDocs docs;
        OwnCreations creations;
        std::unordered_map<LayerId, LayerNotes> notes;
        std::size_t moves = 0;
        std::uint64_t names = 0;
    };
};

}  // namespace usdlive::client
