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

/// The kinds of spec the model holds; numbers as SdfSpecType. Targets and connections are not specs
/// of the model: they follow from `targetPaths` and `connectionPaths`.
enum class SpecKind : std::uint8_t {
    Attribute = 1,
    Prim = 6,
    PseudoRoot = 7,
    Relationship = 8,
    Variant = 10,
    VariantSet = 11,
};
/// For people: "prim", "variant set".
[[nodiscard]] std::string_view specKindName(SpecKind kind);

/// A spec that an unacknowledged transaction of the same author creates: edit number `edit` (a
/// Create) of transaction number `sequence`.
struct Creation {
    std::uint64_t sequence = 0;
    std::uint32_t edit = 0;
    auto operator<=>(const Creation&) const = default;
};

/// Which spec an edit is for (M3). Without `creation`, `path` is absolute and meant as of the
/// transaction's base revision, before any of the author's pending edits. With it, `path` is what
/// follows the created spec ("" is the spec itself, ".x", "/B.x", "{v=}", "{v=one}B"), since only
/// its author knows where it stands. In a commit addresses are absolute and apply one after the
/// other.
struct Address {
    std::string path;
    std::optional<Creation> creation;
    bool operator==(const Address&) const = default;
};

/// A part of a composite field, that is a register of its own (M1). std::monostate is the whole
/// field.
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
    Value item;  ///< with its payload, when set; matched by itemKey()
    std::optional<Value>
        before;  ///< stands before this item of the same list, else (or if gone) last
    bool operator==(const ListItem&) const = default;
};
struct MapKey {
    Value key;
    bool operator==(const MapKey&) const = default;
};
using FieldPart = std::variant<std::monostate, DictionaryKey, SampleTime, ListItem, MapKey>;

/// ED1 creates a spec as the last of its list. An existing one of the same kind is left as it is
/// (M2).
struct CreateSpec {
    SpecKind kind = SpecKind::Prim;
    bool operator==(const CreateSpec&) const = default;
};
/// ED2 deletes a spec with everything below it.
struct DeleteSpec {
    bool operator==(const DeleteSpec&) const = default;
};
/// ED3 moves a spec with everything below it. A rename keeps its place, a new parent puts it last.
struct MoveSpec {
    Address parent;    ///< the new parent
    std::string name;  ///< the new name
    bool operator==(const MoveSpec&) const = default;
};
/// ED4 moves a spec within its list: before the sibling of that name, else (or if gone) last.
struct PlaceSpec {
    std::string before;
    bool operator==(const PlaceSpec&) const = default;
};
/// ED5 sets a field or a part of it; for a ListItem, puts the item in (moving it when it is there).
/// Setting a part of a field that is absent or holds another form makes it one of the part's form.
struct SetField {
    std::string field;
    FieldPart part;
    FieldValue value;                  ///< for a ListItem unused: the item is its own value
    ValueType form = ValueType::None;  ///< for ListItem and MapKey: the item's / key's type
    bool operator==(const SetField&) const = default;
};
/// ED6 erases a field or a part of it. What is absent already is no error. The last dictionary key
/// erases the field, as in Sdf; so does the last sample or map key, and the last item of a list op
/// that is not explicit.
struct EraseField {
    std::string field;
    FieldPart part;
    bool operator==(const EraseField&) const = default;
};

using EditAction = std::variant<CreateSpec, DeleteSpec, MoveSpec, PlaceSpec, SetField, EraseField>;

/// One change of one register or of the namespace of one layer.
struct Edit {
    LayerId layer;
    Address address;
    EditAction action;
    bool operator==(const Edit&) const = default;
};

/// Names a transaction for ever: a client numbers its own 1, 2, 3 ... (M9).
struct TransactionId {
    ClientId client;
    std::uint64_t sequence = 0;
    auto operator<=>(const TransactionId&) const = default;
};

/// What an author submits: committed together or not at all.
struct Transaction {
    TransactionId id;
    Revision base = 0;          ///< the revision that the addresses are meant as of
    std::uint64_t gesture = 0;  ///< the gesture this ends (M11), 0 for none
    std::vector<Edit> edits;
    bool operator==(const Transaction&) const = default;
};

/// M4: an edit whose spec was gone. `edit` is as it was submitted.
struct DroppedEdit {
    std::uint32_t index = 0;  ///< in Transaction::edits
    ErrorCode reason{};
    Edit edit;
    bool operator==(const DroppedEdit&) const = default;
};

/// A transaction the server has accepted.
struct Commit {
    Revision revision = 0;
    Epoch epoch = 0;
    TransactionId id;
    UserName user;
    std::int64_t timeMs = 0;  ///< server's wall clock, milliseconds since 1970, for people only
    std::uint64_t gesture = 0;
    /// A commit that brought a whole layer in from its file: receivers that have the layer open had
    /// it at this revision in their snapshot; its edits are in the log but not broadcast.
    std::optional<LayerId> imported;
    std::vector<Edit> edits;  ///< as executed: absolute paths, each valid after the ones before
    std::vector<DroppedEdit> dropped;
    Hash previous;  ///< chain hash of the commit before; zero for the first
    /// So many commits before this one it stands for as well, all of them together without what was
    /// written again (CF1); `previous` is then that of the first. Only on the way to who fell
    /// behind, never in the history.
    Revision conflated = 0;
    bool operator==(const Commit&) const = default;
};

/// Calls `visit` for every blob (V9) that the action names.
void forEachBlob(const EditAction& action, const std::function<void(const Value&)>& visit);

}  // namespace usdlive
