#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "usdlive/common/core/Ref.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// Identifies a spec inside one LayerDoc and its copies, whatever its path becomes. Never reused in
/// a doc. Local: two machines give the same spec different ids.
using NodeId = std::uint64_t;
inline constexpr NodeId kRootNode = 1;

/// The content of a layer, without USD: a tree of specs.
///
/// A plain value. Copies share structure, so a copy costs a pointer, and an edit of a copy copies
/// the nodes on the way to what it changes; an edit of a doc that shares nothing changes it in
/// place. Different copies may be used from different threads at once. Moving a spec costs its own
/// size.
class LayerDoc {
public:
    class Node;  // src/layer/LayerDocNode.h

    LayerDoc();
    LayerDoc(const LayerDoc&);
    LayerDoc(LayerDoc&&) noexcept;
    LayerDoc& operator=(const LayerDoc&);
    LayerDoc& operator=(LayerDoc&&) noexcept;
    ~LayerDoc();

    /// What an edit did. Ids are this doc's.
    struct Applied {
        bool changed = false;  ///< false: M2 merge, erasing what is absent, all as it was already
        NodeId node = 0;       ///< the spec the edit was for (the created one)
        NodeId parent = 0;     ///< of a Create, Move or Place: the (new) parent
        std::uint64_t order = 0;  ///< of a Create, Move or Place: sorts it among its siblings
        bool renumbered = false;  ///< the parent's whole list got new order numbers
        std::vector<NodeId> erased = {};  ///< of a Delete: the spec and all below it
    };

    /// Whose an edit is: what a commit or a file holds applies as it is.
    enum class By { History, Author };
    /// Applies one edit whose address is an absolute path of this doc (Address::creation unset).
    /// Errors leave the doc as it was: InvalidPath (also when a move would make a path below longer
    /// than PA1 allows), SpecNotFound, SpecKindConflict (M2), SpecExists and MoveIntoItself (M5),
    /// InvalidEdit (a kind that cannot stand there, a value that does not fit the part, a field
    /// that lists children), InvalidValue, ForbiddenValue (D1: `timeCodesPerSecond` <= 0 or not
    /// finite). By an author also SpecKindConflict (ED7).
    Result<Applied> apply(std::string_view path, const EditAction& action, By by = By::History);

    [[nodiscard]] bool has(std::string_view path) const;
    [[nodiscard]] std::optional<SpecKind> kind(std::string_view path) const;
    /// nullptr when the spec or field is absent. Valid until this doc is changed.
    [[nodiscard]] const FieldValue* field(std::string_view path, std::string_view name) const;
    [[nodiscard]] std::vector<std::string> fieldNames(std::string_view path) const;
    [[nodiscard]] std::vector<std::string> children(std::string_view path, ChildList list) const;
    [[nodiscard]] std::size_t specCount() const;  ///< with the pseudo-root; O(1)

    /// The node ids from the pseudo-root down to the deepest spec on the way to `path` that exists.
    [[nodiscard]] std::vector<NodeId> idsAlong(std::string_view path) const;

    /// Visits every spec, parents before children, siblings in order. `order` as in Applied.
    struct SpecView {
        NodeId node, parent;
        std::uint64_t order;
        SpecKind kind;
        std::string_view name;  ///< empty for the pseudo-root
        std::string_view path;
        const std::vector<std::pair<std::string, FieldValue>>* fields;  ///< sorted by name
    };
    void visit(const std::function<void(const SpecView&)>& visitor) const;
    /// The same, below and with the spec at `path`; nothing when it is absent.
    void visit(std::string_view path, const std::function<void(const SpecView&)>& visitor) const;

    /// The same, one spec at a time and resumable.
    class Walk {
    public:
        explicit Walk(LayerDoc doc);
        Walk(Walk&&) noexcept;
        ~Walk();
        /// nullptr after the last. Its path is valid until the next call, the rest as long as the
        /// walk.
        const SpecView* next();

    private:
        struct State;
        std::unique_ptr<State> state_;
    };

    /// Same specs, same order, same fields. Shared structure is not looked into.
    friend bool operator==(const LayerDoc& left, const LayerDoc& right);

    /// One line a spec and field, in order: what two replicas are compared by when USD is not
    /// there.
    [[nodiscard]] std::string dump() const;

    /// Rebuilding from a store or snapshot: specs in any order, each parent before its children;
    /// siblings are sorted by `order` at finish(). Errors: SpecNotFound (no such parent),
    /// SpecExists, InvalidEdit. Node ids are kept.
    class Builder {
    public:
        Builder();
        ~Builder();
        Result<void> addSpec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                             std::string_view name);
        Result<void> addField(NodeId node, std::string_view name, FieldValue value);
        LayerDoc finish();

    private:
        struct State;
        std::unique_ptr<State> state_;
    };

    /// New specs get ids from here on (or from nextId(), if that is higher); used to keep the ids
    /// of a client's predictions apart. Two copies that both create specs give them the same ids:
    /// before their difference() is taken, ids created in one of them must not mean another spec in
    /// the other.
    void reserveIds(NodeId firstFree);
    /// The id the next spec created will have.
    [[nodiscard]] NodeId nextId() const { return nextId_; }

private:
    friend class LayerDocDiff;
    class Editor;

    Ref<Node> root_;  // null only in a doc that was moved from: assign or destroy it
    NodeId nextId_ = kRootNode + 1;
    std::size_t specCount_ = 1;
    // Bounds of what any path of this doc has, never too low, so that most moves need not be
    // measured.
    std::uint32_t maxPathBytes_ = 1;
    std::uint32_t maxPathElements_ = 0;
};

/// Calls `visit` for every blob (V9) that the layer names, as often as it does.
void forEachBlob(const LayerDoc& doc, const std::function<void(const Value&)>& visit);

/// The edits that turn `from` into `to`, in an order in which they apply; paths absolute. Looks
/// only where structure is not shared. A spec that stands elsewhere with the same id is moved, not
/// deleted and created. Composite fields are told part by part where only parts differ.
[[nodiscard]] std::vector<std::pair<std::string, EditAction>> difference(const LayerDoc& from,
                                                                         const LayerDoc& to);

/// The parts by which two contents of one field differ: the smallest list of Set/Erase actions
/// that, applied in order, turn `from` into `to` exactly (or one whole SetField where parts cannot
/// say it, e.g. duplicates in a list, another order of map entries, another form). nullptr is
/// "absent".
[[nodiscard]] std::vector<EditAction> fieldDifference(std::string_view field,
                                                      const FieldValue* from, const FieldValue* to);

/// The same as an author sends it (M1): part by part also where the whole would be shorter, so that
/// others who write other parts at the same time keep theirs. Whole are only a value, a composite
/// that parts cannot say, and one that changes in more than 1,000 parts and would be shorter.
[[nodiscard]] std::vector<EditAction> authoredParts(std::string_view field, const FieldValue* from,
                                                    const FieldValue* to);

/// `present` with the parts of `added`, which win; `added` where they are not of one form.
[[nodiscard]] FieldValue unitedParts(std::string_view field, const FieldValue& present,
                                     const FieldValue& added);

}  // namespace usdlive
