// Edits of layers, transactions and commits.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/layer/FieldValue.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

/// The kinds of spec of the model, numbered as SdfSpecType. Targets and connections are not specs
/// of the model: they follow from `targetPaths` and `connectionPaths`.
enum class SpecKind : std::uint8_t {
    Attribute = 1,
    Prim = 6,
    PseudoRoot = 7,
    Relationship = 8,
    Variant = 10,
    VariantSet = 11,
};
/// Returns the name for messages: "prim", "variant set".
[[nodiscard]] std::string_view specKindName(SpecKind kind);

/// A spec created by a transaction of the same author that is not acknowledged yet: edit number
/// `edit` (a Create) of transaction number `sequence`.
struct Creation {
    std::uint64_t sequence = 0;
    std::uint32_t edit = 0;
    auto operator<=>(const Creation&) const = default;
};

/// The spec that an edit changes (M3). Without `creation`, `path` is absolute and refers to the
/// transaction's base revision, before any pending edit of the author. With `creation`, `path` is
/// relative to the created spec ("" is the spec itself, ".x", "/B.x", "{v=}", "{v=one}B"), because
/// only its author knows its current path. In a commit, addresses are absolute and apply in order.
struct Address {
    std::string path;
    std::optional<Creation> creation;
    bool operator==(const Address&) const = default;
};

/// A part of a composite field; each part is a register (M1). std::monostate is the whole field.
struct DictionaryKey {
    std::vector<std::string> path;  ///< at least one key
    bool operator==(const DictionaryKey&) const = default;
};
struct SampleTime {
    double time = 0;
    bool operator==(const SampleTime&) const = default;
};
struct ListItem {
    ListName list = ListName::Explicit;
    Value item;  ///< with its payload, when it is set; matched by itemKey()
    /// The item is placed before this one of the same list, or at the end if there is none.
    std::optional<Value> before;
    bool operator==(const ListItem&) const = default;
};
struct MapKey {
    Value key;
    bool operator==(const MapKey&) const = default;
};
using FieldPart = std::variant<std::monostate, DictionaryKey, SampleTime, ListItem, MapKey>;

/// ED1: creates a spec at the end of its list. An existing spec of the same kind is kept as it is
/// (M2).
struct CreateSpec {
    SpecKind kind = SpecKind::Prim;
    bool operator==(const CreateSpec&) const = default;
};
/// ED2: deletes a spec and everything below it. With `place`, the author has deleted the object of
/// a stage at this place: no spec has to be there, and addresses and values of others that name the
/// place mean the deleted object (M15).
struct DeleteSpec {
    bool place = false;
    bool operator==(const DeleteSpec&) const = default;
};
/// ED3: moves a spec and everything below it. A rename keeps its place in the list; under a new
/// parent it becomes the last. With `place`, the author has moved the object of a stage at this
/// place: no spec has to be there, nor at the new parent.
struct MoveSpec {
    Address parent;      ///< the new parent
    std::string name;    ///< the new name
    bool place = false;  ///< M15
    bool operator==(const MoveSpec&) const = default;
};
/// ED4: moves a spec within its list: before the sibling `before`, or to the end if there is none.
struct PlaceSpec {
    std::string before;
    bool operator==(const PlaceSpec&) const = default;
};
/// ED5: sets a field or a part of it. For a ListItem, inserts the item, or moves an existing one. A
/// field that is absent or has another form is first replaced by an empty one of the part's form.
struct SetField {
    std::string field;
    FieldPart part;
    FieldValue value;                  ///< unused for a ListItem: the item is its own value
    ValueType form = ValueType::None;  ///< for ListItem and MapKey: the type of the item or key
    bool operator==(const SetField&) const = default;
};
/// ED6: erases a field or a part of it. Erasing an absent part is no error. As in Sdf, the field
/// goes with its last dictionary key, sample or map key, and with the last item of a list op that
/// is not explicit.
struct EraseField {
    std::string field;
    FieldPart part;
    bool operator==(const EraseField&) const = default;
};

using EditAction = std::variant<CreateSpec, DeleteSpec, MoveSpec, PlaceSpec, SetField, EraseField>;

/// One change of one register of a layer, or of its namespace.
struct Edit {
    LayerId layer;
    Address address;
    EditAction action;
    /// M15: what the paths in the values of `action` name, in the order of forEachPath(). Empty:
    /// they are paths at the base revision, as addresses. An empty address is a path that names
    /// nothing else. Never in a commit.
    std::vector<Address> names = {};
    bool operator==(const Edit&) const = default;
};

/// Identifies a transaction for ever: each client numbers its own 1, 2, 3 ... (M9).
struct TransactionId {
    ClientId client;
    std::uint64_t sequence = 0;
    auto operator<=>(const TransactionId&) const = default;
};

/// The edits that an author submits, to be committed together or not at all.
/// The most bytes of Transaction::label.
inline constexpr std::size_t kMaxLabelBytes = 1'000;
/// Returns a text as a label can be: at most kMaxLabelBytes of whole characters, and spaces in
/// place of control characters.
[[nodiscard]] std::string labelOf(std::string_view text);

struct Transaction {
    TransactionId id;
    Revision base = 0;          ///< the revision that the addresses refer to
    std::uint64_t gesture = 0;  ///< the gesture that this transaction ends (M11); 0: none
    std::vector<Edit> edits;
    /// M16: the newest revision that the author had seen; 0: `base`.
    Revision seen = 0;
    std::string label =
        {};  ///< the text of its author for users, "Move chairs" (M18); may be empty
    bool operator==(const Transaction&) const = default;
};

/// Returns the newest revision that the author had seen (M16).
[[nodiscard]] Revision newestSeen(const Transaction& transaction);
/// Returns whether the action moves or deletes the object of a stage at a place (M15).
[[nodiscard]] bool concernsPlace(const EditAction& action);
/// Returns the path to which a move takes the spec at `path`. The new parent is named by its path.
[[nodiscard]] std::string destination(std::string_view path, const MoveSpec& move);
/// Returns a move of the object at a place that leaves it where it is: one without effect (M15).
[[nodiscard]] MoveSpec stayingAt(std::string_view path);
/// Returns whether an executed edit moved or deleted a spec or an object.
[[nodiscard]] bool changesNamespace(const Edit& executed);

/// M4: an edit whose spec was deleted before. `edit` is as submitted.
struct DroppedEdit {
    std::uint32_t index = 0;  ///< in Transaction::edits
    ErrorCode reason{};
    Edit edit;
    bool operator==(const DroppedEdit&) const = default;
};

/// Gives executed edits, in order, their indexes in the transaction: dropped edits are not among
/// them. Edits that the executor has added follow after the last index.
class SubmittedIndexes {
public:
    /// `dropped` is in the order of the indexes, and outlives this object.
    explicit SubmittedIndexes(const std::vector<DroppedEdit>& dropped) : dropped_(&dropped) {}
    /// Returns the index of the next executed edit.
    std::uint32_t next();

private:
    const std::vector<DroppedEdit>* dropped_;
    std::size_t passed_ = 0;  // dropped edits before `index_`
    std::uint32_t index_ = 0;
};

/// A transaction that the server has accepted.
struct Commit {
    Revision revision = 0;
    Epoch epoch = 0;
    TransactionId id;
    UserName user;
    std::int64_t timeMs = 0;  ///< server's wall clock, milliseconds since 1970; for display only
    std::uint64_t gesture = 0;
    /// Set in a commit that imports a whole layer from its file. Receivers that have the layer open
    /// got its content at this revision in their snapshot. The edits are in the log but not
    /// broadcast.
    std::optional<LayerId> imported;
    std::vector<Edit> edits;  ///< executed edits: absolute paths, each valid after the edits before
    std::vector<DroppedEdit> dropped;
    Hash previous;  ///< chain hash of the commit before; zero for the first commit
    /// The number of earlier commits that this one includes, without the registers that were
    /// written again (CF1); `previous` is then that of the first of them. Set only in messages to
    /// sessions that have fallen behind, never in the history.
    Revision conflated = 0;
    /// M17: in a commit that deletes specs, the first earlier commit that its author had not seen;
    /// 0: the author had seen all of them.
    Revision firstUnseen = 0;
    std::string label = {};  ///< that of its transaction (M18)
    bool operator==(const Commit&) const = default;
};

/// Calls `visit` for every blob (V9) that the action refers to.
void forEachBlob(const EditAction& action, const std::function<void(const Value&)>& visit);

}  // namespace usdlive
