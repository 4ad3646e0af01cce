// The predicted side of a session: own transactions and previews on the confirmed layers (M7).
#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "session/Pending.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// The sequence number of a preview, which has no other one yet. Its edits name the specs that it
/// creates with this number.
inline constexpr std::uint64_t kThisPreview = ~std::uint64_t(0);

/// The field that an action sets or erases; nullptr for other actions.
[[nodiscard]] const std::string* fieldOf(const EditAction& action);

/// The view where it differs from the confirmed layers: previews of others and own transactions on
/// top of them (M7). Only layers that one of these edits have a doc here. The view of all others is
/// the confirmed doc, which is not copied.
///
/// Predicted moves and deletes are in a namespace log of their own on top of the confirmed one, and
/// predicted creations likewise. So the confirmed side can change while the prediction stays, as
/// long as the commits have no effect on what was predicted: see effect() and acknowledge().
///
/// Predicted specs have node ids of a range of their own. They are the same each time the
/// prediction is computed again, so that a comparison of two predictions recognizes a spec.
class Prediction {
public:
    /// The confirmed side. It belongs to the session and outlives the prediction.
    struct Confirmed {
        const LayerDocs& layers;
        const NamespaceLog& log;
        const OwnCreations& creations;  ///< creations of own commits
        const Revision& revision;
        const ClientId& self;
    };
    explicit Prediction(const Confirmed& confirmed)
        : confirmed_(&confirmed), names_(&confirmed.log), creations_(&confirmed.creations) {}

    /// Becomes empty again, and returns what it was.
    [[nodiscard]] Prediction startAnew() { return std::exchange(*this, Prediction(*confirmed_)); }
    [[nodiscard]] const LayerDocs& docs() const { return docs_; }

    /// Executes a preview of another client. `slot` identifies it.
    void preview(std::uint64_t slot, const PreviewFrame& frame);
    /// Executes an own transaction, with the code that the server runs.
    Expectation run(const Transaction& transaction);
    /// Like run(), and also returns each edit with its path in the view and the author's own value,
    /// which is not merged with that of a colleague (nothing: it was dropped).
    struct Landed {
        Expectation expectation;
        std::vector<std::optional<AuthoredEdit>> edits;
        std::optional<Refused> refused;
    };
    Landed land(const Transaction& transaction);

    /// Applies an edit of the editor to the view, and returns it with its address (M3) at the
    /// revision openedAt() of its layer. It is edit `creation.edit` of transaction
    /// `creation.sequence`.
    Result<Edit> author(const AuthoredEdit& edit, const Creation& creation,
                        Expectation& expectation);

    /// Returns the edit as author() would, without applying it.
    [[nodiscard]] Result<Edit> addressed(const AuthoredEdit& edit) const {
        const LayerDoc* doc = find(edit.layer);
        if (!doc)
            return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
        return addressed(edit, *doc);
    }

    /// nullptr: no such layer.
    [[nodiscard]] const LayerDoc* find(const LayerId& layer) const;
    /// Returns the path in the view of a spec that had this path in the confirmed layers before
    /// entry `mark` of their NamespaceLog, or had it in the view; nothing if it was deleted since.
    [[nodiscard]] std::optional<std::string> pathInView(const LayerId& layer, std::string path,
                                                        std::uint64_t mark) const {
        return names_.translateFrom(layer, std::move(path), mark);
    }
    /// Number of own fields that it has noted: a measure of the time that destroying it takes.
    [[nodiscard]] std::size_t fieldsNoted() const;
    /// Returns whether the layer has a doc here.
    [[nodiscard]] bool predicts(const LayerId& layer) const { return docs_.contains(layer); }
    /// The confirmed revision at which the prediction of the layer began; without a prediction the
    /// current one.
    [[nodiscard]] Revision openedAt(const LayerId& layer) const;
    /// The oldest of these, or `otherwise`.
    [[nodiscard]] Revision oldest(Revision otherwise) const;

    /// The effect of another client's committed edit on the prediction of its layer.
    enum class Effect {
        None,        ///< none: a pending write of the whole field hides it (M7)
        Applies,     ///< it can be applied to the predicted doc
        Invalidates  ///< the prediction has to be computed again
    };
    /// `isPending` returns whether an own transaction is unanswered.
    [[nodiscard]] Effect effect(const Edit& committed,
                                const std::function<bool(std::uint64_t)>& isPending) const;
    /// Applies such a committed edit.
    void apply(const Edit& committed);
    /// Called when the first own transaction was committed as predicted: its moves, deletes and
    /// creations are confirmed now.
    void acknowledge(std::uint64_t sequence, const Expectation& expectation);
    /// Returns whether previews move or delete specs.
    [[nodiscard]] bool previewsChangeNames() const { return previewsChangeNames_; }

private:
    // The moves of a layer, and the edits of places (M15), in order.
    class Moves {
    public:
        // Adds a move or a delete of a spec.
        void add(std::string from, std::optional<std::string> to);
        // Adds the creation of a spec by an own edit.
        void create(const std::string& path, const Creation& edit);
        // Adds an edit of a place, after that of the spec.
        void vacate(std::string from, std::optional<std::string> to,
                    const std::optional<Creation>& edit, bool movesSpec);
        // Returns the path that the spec at `path` had before all moves.
        [[nodiscard]] std::string undone(std::string path) const;
        // Returns whether an address leads to the place that it has to name.
        using Leads = std::function<bool(const Address&)>;
        // Returns what names the place `path`: its path before all moves, or its path below what an
        // own edit has created or vacated; nothing if that is an edit of a preview. Several things
        // may have come to a place: takes the last of them of which `leads` returns true.
        [[nodiscard]] std::optional<Address> place(std::string path, const Leads& leads) const;
        // Returns what names the object at `path` in a value; nothing if it is unknown, because an
        // own edit has moved or deleted only the spec that was there.
        [[nodiscard]] std::optional<Address> object(std::string path) const;
        // Returns whether an edit of no place has moved or deleted a spec here, or moved one to
        // here.
        [[nodiscard]] bool movesOnlySpec(const std::string& path) const;
        [[nodiscard]] bool empty() const { return moves_.empty(); }

    private:
        struct Move {
            std::string from;
            std::optional<std::string> to;
            std::optional<Creation> edit;  // an own edit of a place
        };
        // Moves by their paths, with their numbers.
        using ByPath = std::set<std::pair<std::string, std::size_t>>;
        struct Index {
            ByPath from, to;
        };
        struct Created {
            std::string path;
            std::size_t time;  // it was created before the move with this number
            Creation edit;
        };
        [[nodiscard]] static std::optional<std::size_t> lastOf(const ByPath& paths,
                                                               std::string path, std::size_t end);
        [[nodiscard]] static std::optional<std::size_t> lastAt(const ByPath& paths,
                                                               const std::string& path);
        // Those that concern a place or an object, before move number `end`.
        struct Last {
            std::optional<std::size_t> moved, left;  // to and from there
            const Created* created;                  // nullptr if a move is later
        };
        [[nodiscard]] static std::optional<Address> leftBy(const Move& move,
                                                           const std::string& path);
        [[nodiscard]] Last last(const std::string& path, std::size_t end, bool isPlace) const;
        [[nodiscard]] std::optional<Address> placeBefore(std::string path, std::size_t end,
                                                         const Leads& leads,
                                                         std::size_t& left) const;
        [[nodiscard]] const Created* lastCreated(std::string path, std::size_t end) const;

        std::vector<Move> moves_;
        std::vector<Created> created_;
        // created_ by path and time, filled in when it is needed: nearly always there is no move.
        mutable std::map<std::pair<std::string, std::size_t>, std::size_t> createdByPath_;
        mutable std::size_t indexed_ = 0;
        Index specs_, places_;
        ByPath carried_;  // by the new path: those that moved a spec
    };
    struct LayerNotes {
        std::unordered_map<NodeId, Creation> created;  // own ones; others are of previews
        // By path, NUL, field: the last own transaction that wrote the whole field; 0: none.
        std::unordered_map<std::string, std::uint64_t> fields;
        std::vector<std::string> structural;  // created, deleted, moved from and to
        Moves moves;
        bool editsPlaces = false;  // also if nothing has moved (M16)
    };

    LayerDoc* open(const LayerId& layer);
    static std::optional<Creation> numberOfPlace(const Executed& executed, std::size_t again,
                                                 std::uint64_t sequence);
    Landed execute(const Transaction& transaction, bool own, NodeId firstNode, bool wantEdits);
    void note(const Edit& executed, const LayerDoc::Applied& applied,
              const std::optional<Creation>& creation, Expectation& expectation);
    Result<Address> address(const LayerId& layer, const LayerDoc& doc, std::string_view path) const;
    // An address has to lead to a place, or to the new parent of an object.
    enum class Names { Place, Parent };
    Result<Address> placeAddress(const LayerId& layer, const LayerDoc& doc, std::string_view path,
                                 Names names = Names::Place) const;
    Result<Address> newAddress(const LayerId& layer, const LayerDoc& doc,
                               std::string_view path) const;
    Result<Address> addressBelow(const LayerId& layer, const LayerDoc& doc,
                                 std::string_view path) const;
    [[nodiscard]] bool leadsTo(const LayerId& layer, const Address& address,
                               const std::string& path, Names names) const;
    Result<Address> parentOfPlace(const LayerId& layer, const LayerDoc& doc,
                                  const std::string& path) const;
    [[nodiscard]] std::vector<Address> namesOf(const AuthoredEdit& edit) const;
    Result<Edit> addressed(const AuthoredEdit& edit, const LayerDoc& doc) const;

    const Confirmed* confirmed_;
    LayerDocs docs_;
    std::unordered_map<LayerId, Revision> openedAt_;
    NamespaceLog names_;
    OwnCreations creations_;
    std::unordered_map<LayerId, LayerNotes> notes_;
    bool previewsChangeNames_ = false;
};

}  // namespace usdlive::client
