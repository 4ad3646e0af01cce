// The content of a layer as a value, without USD.
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

/// Identifies a spec in one LayerDoc and its copies, whatever its path becomes. Never reused in a
/// doc. Local: two machines give the same spec different ids.
using NodeId = std::uint64_t;
inline constexpr NodeId kRootNode = 1;

/// The content of a layer as a tree of specs, without USD.
///
/// A plain value. Copies share structure: a copy costs a pointer, and an edit of a copy copies the
/// nodes on the path to the change. An edit of a doc that shares nothing changes it in place.
/// Different copies may be used by different threads at the same time. The cost of moving a spec
/// grows with its own size.
class LayerDoc {
public:
    class Node;  // src/layer/LayerDocNode.h

    LayerDoc();
    LayerDoc(const LayerDoc&);
    LayerDoc(LayerDoc&&) noexcept;
    LayerDoc& operator=(const LayerDoc&);
    LayerDoc& operator=(LayerDoc&&) noexcept;
    ~LayerDoc();

    /// The result of an edit. Ids are those of this doc.
    struct Applied {
        /// false: the spec exists (M2), the erased part is absent, or nothing differs
        bool changed = false;
        NodeId node = 0;          ///< the spec that was edited (or created)
        NodeId parent = 0;        ///< the (new) parent after a Create, Move or Place
        std::uint64_t order = 0;  ///< the position among the siblings after a Create, Move or Place
        bool renumbered = false;  ///< the parent's whole list got new order numbers
        std::vector<NodeId> erased = {};  ///< the spec and everything below it after a Delete
    };

    /// The origin of an edit. Edits from a commit or a file (History) skip the limits for authors.
    enum class By { History, Author };
    /// Applies one edit whose address is an absolute path of this doc (Address::creation unset). An
    /// error leaves the doc unchanged: InvalidPath (also if a move makes a path below longer than
    /// PA1 allows), SpecNotFound, SpecKindConflict (M2), SpecExists and MoveIntoItself (M5),
    /// InvalidEdit (a kind that is not allowed there, a value that does not fit the part, a field
    /// that lists children), InvalidValue, ForbiddenValue (D1: `timeCodesPerSecond` <= 0 or not
    /// finite). For an Author also SpecKindConflict (ED7).
    Result<Applied> apply(std::string_view path, const EditAction& action, By by = By::History);

    [[nodiscard]] bool has(std::string_view path) const;
    [[nodiscard]] std::optional<SpecKind> kind(std::string_view path) const;
    /// Returns nullptr if the spec or field is absent. The pointer is valid until this doc changes.
    [[nodiscard]] const FieldValue* field(std::string_view path, std::string_view name) const;
    [[nodiscard]] std::vector<std::string> fieldNames(std::string_view path) const;
    [[nodiscard]] std::vector<std::string> children(std::string_view path, ChildList list) const;
    /// Returns the name of the spec that follows in the same list; empty for the last, for the
    /// pseudo-root, and if there is no spec at `path`.
    [[nodiscard]] std::string nextSibling(std::string_view path) const;
    [[nodiscard]] std::size_t specCount() const;  ///< includes the pseudo-root; O(1)

    /// Returns the node ids from the pseudo-root to the deepest existing spec on `path`.
    [[nodiscard]] std::vector<NodeId> idsAlong(std::string_view path) const;

    /// Visits every spec: parents before children, siblings in order. `order` as in Applied.
    struct SpecView {
        NodeId node, parent;
        std::uint64_t order;
        SpecKind kind;
        std::string_view name;  ///< empty for the pseudo-root
        std::string_view path;
        const std::vector<std::pair<std::string, FieldValue>>* fields;  ///< sorted by name
    };
    void visit(const std::function<void(const SpecView&)>& visitor) const;
    /// Visits the spec at `path` and everything below it. Does nothing if it is absent.
    void visit(std::string_view path, const std::function<void(const SpecView&)>& visitor) const;

    /// Visits every spec, one at a time; can be paused and resumed.
    class Walk {
    public:
        explicit Walk(LayerDoc doc);
        Walk(Walk&&) noexcept;
        ~Walk();
        /// Returns nullptr after the last spec. Its path is valid until the next call, the rest as
        /// long as the walk.
        const SpecView* next();

    private:
        struct State;
        std::unique_ptr<State> state_;
    };

    /// Compares specs, order and fields. Skips structure that both share.
    friend bool operator==(const LayerDoc& left, const LayerDoc& right);

    /// Returns one line per spec and field, in order. Used to compare two replicas without USD.
    [[nodiscard]] std::string dump() const;

    /// Rebuilds a doc from a store or a snapshot. Specs may come in any order, but each parent
    /// before its children; finish() sorts siblings by `order`. Errors: SpecNotFound (the parent is
    /// missing), SpecExists, InvalidEdit. Node ids are kept.
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

    /// Sets the lowest id for new specs (nextId() if that is higher). Used to separate the ids of a
    /// client's predictions from those of the server's commits. Two copies that both create specs
    /// use the same ids. Before difference() compares them, make sure that an id created in one of
    /// them does not name another spec in the other.
    void reserveIds(NodeId firstFree);
    /// Returns the id of the next spec to be created.
    [[nodiscard]] NodeId nextId() const { return nextId_; }

private:
    friend class LayerDocDiff;
    friend class SpecTree;
    class Editor;

    Ref<Node> root_;  // null only in a moved-from doc, which may be assigned or destroyed
    NodeId nextId_ = kRootNode + 1;
    std::size_t specCount_ = 1;
    // Upper bounds for the paths of this doc, so that most moves need no measurement.
    std::uint32_t maxPathBytes_ = 1;
    std::uint32_t maxPathElements_ = 0;
};

/// A spec of a doc and everything below it, as they were when this object was made. Shares
/// structure with the doc. A value.
class SpecTree {
public:
    SpecTree() = default;
    /// Precondition: the doc has a spec at `path`.
    SpecTree(const LayerDoc& doc, std::string path);

    [[nodiscard]] const std::string& path() const { return path_; }
    /// Visits as LayerDoc::visit() does, with the paths of then.
    void visit(const std::function<void(const LayerDoc::SpecView&)>& visitor) const;

private:
    LayerDoc top_;  // its root is the spec
    std::string path_;
};

/// Calls `visit` for every reference of the layer to a blob (V9).
void forEachBlob(const LayerDoc& doc, const std::function<void(const Value&)>& visit);

/// Returns the edits that turn `from` into `to`, in an order in which they apply. Paths are
/// absolute. Looks only where structure is not shared. A spec with the same id at another path is
/// moved instead of deleted and created. Composite fields are compared part by part.
[[nodiscard]] std::vector<std::pair<std::string, EditAction>> difference(const LayerDoc& from,
                                                                         const LayerDoc& to);

/// Returns the smallest list of Set and Erase actions that turn `from` into `to` when applied in
/// order. It is one whole SetField if parts cannot express the change, for example duplicates in a
/// list, another order of map entries, or another form. nullptr is an absent field.
[[nodiscard]] std::vector<EditAction> fieldDifference(std::string_view field,
                                                      const FieldValue* from, const FieldValue* to);

/// Returns the same for an author's edits (M1): part by part even if the whole is shorter, so that
/// concurrent edits of other parts are kept. Writes the whole field only for a plain value, for a
/// composite that parts cannot express, and for more than 1,000 changed parts if the whole is
/// shorter.
[[nodiscard]] std::vector<EditAction> authoredParts(std::string_view field, const FieldValue* from,
                                                    const FieldValue* to);

/// Returns `present` merged with the parts of `added`, which win. Returns `added` if the forms
/// differ.
[[nodiscard]] FieldValue unitedParts(std::string_view field, const FieldValue& present,
                                     const FieldValue& added);

}  // namespace usdlive
