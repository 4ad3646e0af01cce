// The tree of specs of a layer: lookup, edits with their checks (ED1-ED6), and rebuilding.
#include "usdlive/common/layer/LayerDoc.h"

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <unordered_map>

#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/LayerDocNode.h"

namespace usdlive {

namespace {

using Elements = std::span<const PathElement>;
using Node = LayerDoc::Node;

// PA1. Checked for every spec, so that each can be addressed and no tree is too deep for recursion.
constexpr std::size_t kMaxPathBytes = 16 * 1024;
constexpr std::size_t kMaxPathElements = 1024;

constexpr std::size_t slotOf(ChildList list) {
    switch (list) {
        case ChildList::Properties:
            return 1;
        case ChildList::VariantSets:
            return 2;
        default:
            return 0;
    }
}

tl::unexpected<Error> noSpec(std::string_view path) {
    return fail(ErrorCode::SpecNotFound, "there is no spec at " + inQuotes(path));
}

const ChildEntry* childOf(const Node& parent, const PathElement& element) {
    if (!hasList(parent.kind, element.list)) return nullptr;
    return parent.children(element.list).find(element.name);
}

const Node* walk(const Node& root, Elements elements) {
    const Node* node = &root;
    for (const PathElement& element : elements) {
        const ChildEntry* entry = childOf(*node, element);
        if (!entry) return nullptr;
        node = entry->node.get();
    }
    return node;
}

// Returns the difference in length between a child's path and its parent's.
std::size_t stepBytes(SpecKind parent, ChildList list, std::string_view name) {
    switch (list) {
        case ChildList::Prims:
            return name.size() + (parent == SpecKind::Prim ? 1 : 0);
        case ChildList::Properties:
            return name.size() + 1;
        case ChildList::VariantSets:
            return name.size() + 3;
        case ChildList::Variants:
            return name.size();
    }
    return 0;
}

// The distance from a node to the longest path and to the deepest spec below it.
struct Extent {
    std::size_t bytes = 0;
    std::size_t elements = 0;
};

// Stops with an incomplete result after `budget` nodes.
Extent measure(const Node& node, std::size_t& budget) {
    Extent extent;
    if (budget == 0) return extent;
    --budget;
    for (const ChildList list : kChildLists) {
        if (!hasList(node.kind, list)) continue;
        node.children(list).forEach([&](const ChildEntry& entry) {
            if (budget == 0) return;
            const Extent below = measure(*entry.node, budget);
            extent.bytes =
                std::max(extent.bytes, below.bytes + stepBytes(node.kind, list, entry.name));
            extent.elements = std::max(extent.elements, below.elements + 1);
        });
    }
    return extent;
}

void collectIds(const Node& node, std::vector<NodeId>& ids) {
    ids.push_back(node.id);
    for (const ChildList list : kChildLists)
        if (hasList(node.kind, list))
            node.children(list).forEach(
                [&](const ChildEntry& entry) { collectIds(*entry.node, ids); });
}

bool equal(const Node& left, const Node& right) {
    if (&left == &right) return true;
    if (left.kind != right.kind || left.fields != right.fields) return false;
    for (const ChildList list : kChildLists) {
        if (!hasList(left.kind, list)) continue;
        const auto& leftChildren = left.children(list);
        const auto& rightChildren = right.children(list);
        if (leftChildren.sharesAll(rightChildren)) continue;
        if (leftChildren.size() != rightChildren.size()) return false;
        const auto rights = rightChildren.entries();
        std::size_t at = 0;
        bool same = true;
        leftChildren.forEach([&](const ChildEntry& entry) {
            const ChildEntry& other = *rights[at++];
            same = same && entry.name == other.name && equal(*entry.node, *other.node);
        });
        if (!same) return false;
    }
    return true;
}

// Visits a subtree and keeps the current path in one string.
class Walker {
public:
    using View = LayerDoc::SpecView;

    Walker(const Node& top, std::string_view path, NodeId parent, std::uint64_t order,
           std::string_view name)
        : top_(top), path_(path), view_{top.id, parent, order, top.kind, name, {}, &top.fields} {}

    const View* next() {
        if (levels_.empty()) {
            if (std::exchange(begun_, true)) return nullptr;
            return enter(top_);
        }
        while (!levels_.empty()) {
            Level& level = levels_.back();
            path_.resize(level.pathBytes);
            path_.back() = level.lastByte;  // a variant's name is inside the braces of its set
            if (const ChildEntry* entry = level.nextChild()) {
                specpath::extend(path_, kChildLists[level.list], entry->name);
                const Node& child = *entry->node;
                view_ = {child.id, level.node->id, entry->order, child.kind, entry->name,
                         {},       &child.fields};
                return enter(child);
            }
            levels_.pop_back();
        }
        return nullptr;
    }

private:
    struct Level {
        const Node* node;
        std::size_t pathBytes;
        char lastByte;
        std::size_t list = 0;
        ChildSequence::Cursor cursor = {};

        const ChildEntry* nextChild() {
            for (; list < kChildLists.size(); ++list, cursor = {})
                if (hasList(node->kind, kChildLists[list]))
                    if (const auto* entry = node->children(kChildLists[list]).next(cursor))
                        return entry;
            return nullptr;
        }
    };

    const View* enter(const Node& node) {
        levels_.push_back({&node, path_.size(), path_.back()});
        view_.path = path_;
        return &view_;
    }

    const Node& top_;
    std::string path_;
    View view_;
    std::vector<Level> levels_;
    bool begun_ = false;
};

void visitAll(Walker walker, const std::function<void(const LayerDoc::SpecView&)>& visitor) {
    while (const auto* view = walker.next()) visitor(*view);
}

void appendHex(std::string& out, ByteView bytes) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    for (const std::uint8_t byte : bytes) {
        out += kDigits[byte >> 4];
        out += kDigits[byte & 15];
    }
}

const Ref<Node>& emptyRoot() {
    static const Ref<Node> root(new Node(kRootNode, SpecKind::PseudoRoot));
    return root;
}

}  // namespace

// --- Node -------------------------------------------------------------------------------------

LayerDoc::Node::Node(const Node& other)
    : Shared(other),
      kind(other.kind),
      id(other.id),
      fields(other.fields),
      children_(other.children_ ? std::make_unique<Children>(*other.children_) : nullptr) {}

const ChildSequence& LayerDoc::Node::children(ChildList list) const {
    static const ChildSequence kNone;
    return children_ ? (*children_)[slotOf(list)] : kNone;
}

ChildSequence& LayerDoc::Node::editableChildren(ChildList list) {
    if (!children_) children_ = std::make_unique<Children>();
    return (*children_)[slotOf(list)];
}

const FieldValue* LayerDoc::Node::field(std::string_view name) const {
    const auto at = fieldPosition(fields, name);
    return at != fields.end() && at->first == name ? &at->second : nullptr;
}

bool hasList(SpecKind parent, ChildList list) {
    switch (parent) {
        case SpecKind::PseudoRoot:
            return list == ChildList::Prims;
        case SpecKind::Prim:
        case SpecKind::Variant:
            return list != ChildList::Variants;
        case SpecKind::VariantSet:
            return list == ChildList::Variants;
        default:
            return false;
    }
}

bool belongsIn(SpecKind child, ChildList list) {
    switch (child) {
        case SpecKind::Prim:
            return list == ChildList::Prims;
        case SpecKind::Attribute:
        case SpecKind::Relationship:
            return list == ChildList::Properties;
        case SpecKind::VariantSet:
            return list == ChildList::VariantSets;
        case SpecKind::Variant:
            return list == ChildList::Variants;
        default:
            return false;
    }
}

Fields::iterator fieldPosition(Fields& fields, std::string_view name) {
    return std::lower_bound(fields.begin(), fields.end(), name,
                            [](const auto& field, std::string_view n) { return field.first < n; });
}

Fields::const_iterator fieldPosition(const Fields& fields, std::string_view name) {
    return std::lower_bound(fields.begin(), fields.end(), name,
                            [](const auto& field, std::string_view n) { return field.first < n; });
}

namespace {

FieldValue& insertField(Fields& fields, std::string_view name) {
    if (fields.size() == fields.capacity())  // most specs have few fields: no doubling at first
        fields.reserve(fields.size() + 1 + (fields.size() < 4 ? 0 : fields.size() / 2));
    return fields.emplace(fieldPosition(fields, name), name, FieldValue{})->second;
}

}  // namespace

// --- Editor -----------------------------------------------------------------------------------

// Applies one edit to one spec.
class LayerDoc::Editor {
public:
    Editor(LayerDoc& doc, std::string_view path, Elements elements, By by)
        : doc_(doc), path_(path), elements_(elements), by_(by) {}

    Result<Applied> operator()(const CreateSpec& create) {
        if (elements_.empty() || !belongsIn(create.kind, elements_.back().list))
            return misplaced(create.kind);
        const Node* parent = walk(*doc_.root_, above());
        if (!parent) return noSpec(specpath::parent(path_));
        if (!hasList(parent->kind, elements_.back().list)) return misplaced(create.kind);
        if (const ChildEntry* entry = childOf(*parent, elements_.back()))
            return merge(*parent, *entry, create.kind);

        Applied applied{true, doc_.nextId_++, parent->id, 0, false, {}};
        const auto placed = editableList(elements_).append(
            std::string(elements_.back().name), Ref<Node>(new Node(applied.node, create.kind)));
        applied.order = placed.order;
        applied.renumbered = placed.renumbered;
        ++doc_.specCount_;
        raiseBounds(path_.size(), elements_.size());
        return applied;
    }

    Result<Applied> operator()(const DeleteSpec& erase) {
        if (elements_.empty()) return rootStays();
        const ChildEntry* entry = find();
        if (!entry && erase.place) return Applied{};
        if (!entry) return noSpec(path_);
        Applied applied{true, entry->node->id, 0, 0, false, {}};
        collectIds(*entry->node, applied.erased);
        editableList(elements_).remove(entry->order);
        doc_.specCount_ -= applied.erased.size();
        return applied;
    }

    Result<Applied> operator()(const MoveSpec& move) {
        if (elements_.empty()) return rootStays();
        const ChildEntry* entry = find();
        if (!entry && move.place) return Applied{};
        if (!entry) return noSpec(path_);
        if (move.parent.creation)
            return fail(ErrorCode::InvalidEdit, "a move must name the new parent by its path");
        const ChildList list = elements_.back().list;
        const auto parent = specpath::parse(move.parent.path);
        if (!parent) return tl::unexpected(parent.error());
        if (!hasParentPlace(move.parent.path, list)) return misplaced(entry->node->kind);
        if (!specpath::isName(list, move.name))
            return fail(ErrorCode::InvalidPath,
                        inQuotes(move.name) + " is not a valid name for this kind of spec");
        const std::string target = specpath::child(move.parent.path, list, move.name);
        const auto targetElements = specpath::parse(target);
        if (!targetElements) return tl::unexpected(targetElements.error());
        auto moved = moveTo(*entry, target, *targetElements);
        if (!moved && move.place) return Applied{false, entry->node->id};
        return moved;
    }

    Result<Applied> operator()(const PlaceSpec& place) {
        if (elements_.empty()) return rootStays();
        const Node* parent = walk(*doc_.root_, above());
        const ChildEntry* entry = parent ? childOf(*parent, elements_.back()) : nullptr;
        if (!entry) return noSpec(path_);
        const ChildSequence& siblings = parent->children(elements_.back().list);
        const ChildEntry* before = siblings.find(place.before);
        Applied applied{false, entry->node->id, parent->id, entry->order, false, {}};
        if (before == entry || siblings.next(entry->order) == before) return applied;

        const auto target = before ? std::optional(before->order) : std::nullopt;
        const auto placed = editableList(elements_).place(entry->order, target);
        applied.changed = true;
        applied.order = placed.order;
        applied.renumbered = placed.renumbered;
        return applied;
    }

    Result<Applied> operator()(const SetField& set) {
        if (auto checked = checkSet(elements_.empty(), set); !checked)
            return tl::unexpected(checked.error());
        if (by_ == By::Author)
            if (auto checked = checkAuthored(set); !checked) return tl::unexpected(checked.error());
        const Node* node = walkNoting();
        if (!node) return noSpec(path_);
        if (by_ == By::Author && !canHave(node->kind, set)) return noSuchField(node->kind, set);
        Applied applied{false, node->id};
        if (holdsAlready(node->field(set.field), set)) return applied;

        Fields& fields = editableNode(elements_).fields;
        const auto at = fieldPosition(fields, set.field);
        const bool present = at != fields.end() && at->first == set.field;
        setPart(present ? at->second : insertField(fields, set.field), set);
        applied.changed = true;
        return applied;
    }

    Result<Applied> operator()(const EraseField& erase) {
        if (auto checked = checkErase(erase); !checked) return tl::unexpected(checked.error());
        const Node* node = walkNoting();
        if (!node) return noSpec(path_);
        Applied applied{false, node->id};
        const FieldValue* field = node->field(erase.field);
        if (!field || !holdsPart(*field, erase.part)) return applied;

        Fields& fields = editableNode(elements_).fields;
        const auto at = fieldPosition(fields, erase.field);
        if (!erasePart(at->second, erase.part)) fields.erase(at);
        applied.changed = true;
        return applied;
    }

private:
    [[nodiscard]] Elements above() const { return elements_.first(elements_.size() - 1); }

    [[nodiscard]] const ChildEntry* find() const {
        const Node* parent = walk(*doc_.root_, above());
        return parent ? childOf(*parent, elements_.back()) : nullptr;
    }

    // Walks the whole path and notes the order numbers, so that editableNode() need not search the
    // names again.
    const Node* walkNoting() {
        const Node* node = doc_.root_.get();
        for (const PathElement& element : elements_) {
            const ChildEntry* entry = childOf(*node, element);
            if (!entry) return nullptr;
            if (noted_ < orders_.size()) orders_[noted_++] = entry->order;
            node = entry->node.get();
        }
        return node;
    }

    // Returns the node at an existing path for changes. Nothing on the path is shared afterwards.
    Node& editableNode(Elements elements) {
        Node* node = &doc_.root_.editable();
        for (std::size_t i = 0; i < elements.size(); ++i) {
            ChildSequence& children = node->editableChildren(elements[i].list);
            node = &children.editableNode(i < noted_ ? orders_[i]
                                                     : children.find(elements[i].name)->order);
        }
        return *node;
    }

    // Returns the list that contains the spec. Precondition: the parent exists.
    ChildSequence& editableList(Elements elements) {
        return editableNode(elements.first(elements.size() - 1))
            .editableChildren(elements.back().list);
    }

    Result<Applied> merge(const Node& parent, const ChildEntry& entry, SpecKind kind) const {
        if (entry.node->kind == kind) return Applied{false, entry.node->id, parent.id, entry.order};
        return fail(ErrorCode::SpecKindConflict, std::string("there is a spec of kind ") +
                                                     std::string(specKindName(entry.node->kind)) +
                                                     " and not " + std::string(specKindName(kind)) +
                                                     " at " + inQuotes(path_));
    }

    // Returns true if the path grammar allows a child of that list below `parent`.
    static bool hasParentPlace(std::string_view parent, ChildList list) {
        if (parent == "/") return list == ChildList::Prims;
        const ChildList last = specpath::last(parent).list;
        if (last == ChildList::Properties) return false;
        return (last == ChildList::VariantSets) == (list == ChildList::Variants);
    }

    Result<Applied> moveTo(const ChildEntry& entry, const std::string& target,
                           Elements targetElements) {
        const Ref<Node> node = entry.node;
        const std::uint64_t order = entry.order;
        if (target != path_ && specpath::hasPrefix(target, path_))
            return fail(ErrorCode::MoveIntoItself,
                        inQuotes(path_) + " cannot be moved below itself, to " + inQuotes(target));
        const Elements parentElements = targetElements.first(targetElements.size() - 1);
        const Node* parent = walk(*doc_.root_, parentElements);
        if (!parent) return noSpec(specpath::parent(target));
        const bool sameParent = parent == walk(*doc_.root_, above());
        const ChildList list = targetElements.back().list;
        if (!hasList(parent->kind, list) || (list == ChildList::Variants && !sameParent))
            return misplaced(node->kind);
        Applied applied{false, node->id, parent->id, order};
        if (target == path_) return applied;
        if (childOf(*parent, targetElements.back()))
            return fail(ErrorCode::SpecExists, "there is a spec at " + inQuotes(target));
        if (!fits(*node, target.size(), targetElements.size()))
            return fail(ErrorCode::InvalidPath,
                        "a path below " + inQuotes(target) + " would become too long");

        applied.changed = true;
        std::string name(targetElements.back().name);
        if (sameParent) {
            editableList(elements_).rename(order, std::move(name));
            return applied;
        }
        editableList(elements_).remove(order);
        const auto placed = editableList(targetElements).append(std::move(name), node);
        applied.order = placed.order;
        applied.renumbered = placed.renumbered;
        return applied;
    }

    void raiseBounds(std::size_t bytes, std::size_t elements) {
        doc_.maxPathBytes_ = std::max(doc_.maxPathBytes_, static_cast<std::uint32_t>(bytes));
        doc_.maxPathElements_ =
            std::max(doc_.maxPathElements_, static_cast<std::uint32_t>(elements));
    }

    // Returns true if all paths below `node` stay valid when its own grows. Measures small
    // subtrees. For large ones it uses the doc's bounds, and measures them again if they have
    // become too high.
    bool fits(const Node& node, std::size_t bytes, std::size_t elements) {
        constexpr std::size_t kSmallSubtree = 256;
        std::size_t budget = kSmallSubtree;
        Extent below = measure(node, budget);
        if (budget == 0) below = {doc_.maxPathBytes_, doc_.maxPathElements_};
        if (budget == 0 && !isWithin(below, bytes, elements)) {
            budget = doc_.specCount_ + 1;
            const Extent all = measure(*doc_.root_, budget);
            doc_.maxPathBytes_ = static_cast<std::uint32_t>(all.bytes + 1);
            doc_.maxPathElements_ = static_cast<std::uint32_t>(all.elements);
            budget = doc_.specCount_ + 1;
            below = measure(node, budget);
        }
        if (!isWithin(below, bytes, elements)) return false;
        raiseBounds(below.bytes + bytes, below.elements + elements);
        return true;
    }
    static bool isWithin(const Extent& below, std::size_t bytes, std::size_t elements) {
        return below.bytes + bytes <= kMaxPathBytes &&
               below.elements + elements <= kMaxPathElements;
    }

    [[nodiscard]] tl::unexpected<Error> misplaced(SpecKind kind) const {
        return fail(ErrorCode::InvalidEdit, "a spec of kind " + std::string(specKindName(kind)) +
                                                " cannot stand where the edit of " +
                                                inQuotes(path_) + " puts it");
    }
    [[nodiscard]] tl::unexpected<Error> noSuchField(SpecKind kind, const SetField& set) const {
        return fail(ErrorCode::SpecKindConflict,
                    inQuotes(path_) + " is of kind " + std::string(specKindName(kind)) +
                        " and cannot have such a field " + inQuotes(set.field));
    }
    static tl::unexpected<Error> rootStays() {
        return fail(ErrorCode::InvalidEdit, "the pseudo-root cannot be deleted or moved");
    }

    LayerDoc& doc_;
    std::string_view path_;
    Elements elements_;
    By by_;
    std::array<std::uint64_t, 16> orders_;  // order numbers of the first `noted_` specs of the path
    std::size_t noted_ = 0;
};

// --- LayerDoc ---------------------------------------------------------------------------------

LayerDoc::LayerDoc() : root_(emptyRoot()) {}
LayerDoc::LayerDoc(const LayerDoc&) = default;
LayerDoc::LayerDoc(LayerDoc&&) noexcept = default;
LayerDoc& LayerDoc::operator=(const LayerDoc&) = default;
LayerDoc& LayerDoc::operator=(LayerDoc&&) noexcept = default;
LayerDoc::~LayerDoc() = default;

Result<LayerDoc::Applied> LayerDoc::apply(std::string_view path, const EditAction& action, By by) {
    const auto elements = specpath::parse(path);
    if (!elements) return tl::unexpected(elements.error());
    return std::visit(Editor(*this, path, *elements, by), action);
}

namespace {

const Node* nodeAt(const Ref<Node>& root, std::string_view path) {
    const auto elements = specpath::parse(path);
    return elements ? walk(*root, *elements) : nullptr;
}

}  // namespace

bool LayerDoc::has(std::string_view path) const { return nodeAt(root_, path) != nullptr; }

std::optional<SpecKind> LayerDoc::kind(std::string_view path) const {
    const Node* node = nodeAt(root_, path);
    return node ? std::optional(node->kind) : std::nullopt;
}

const FieldValue* LayerDoc::field(std::string_view path, std::string_view name) const {
    const Node* node = nodeAt(root_, path);
    return node ? node->field(name) : nullptr;
}

std::vector<std::string> LayerDoc::fieldNames(std::string_view path) const {
    std::vector<std::string> names;
    if (const Node* node = nodeAt(root_, path))
        for (const auto& [name, value] : node->fields) names.push_back(name);
    return names;
}

std::vector<std::string> LayerDoc::children(std::string_view path, ChildList list) const {
    std::vector<std::string> names;
    const Node* node = nodeAt(root_, path);
    if (node && hasList(node->kind, list))
        node->children(list).forEach([&](const ChildEntry& entry) { names.push_back(entry.name); });
    return names;
}

std::string LayerDoc::nextSibling(std::string_view path) const {
    const auto elements = specpath::parse(path);
    if (!elements || elements->empty()) return {};
    const Node* parent = walk(*root_, Elements(*elements).first(elements->size() - 1));
    const ChildEntry* entry = parent ? childOf(*parent, elements->back()) : nullptr;
    if (!entry) return {};
    const ChildEntry* next = parent->children(elements->back().list).next(entry->order);
    return next ? next->name : std::string();
}

std::size_t LayerDoc::specCount() const { return specCount_; }

std::vector<NodeId> LayerDoc::idsAlong(std::string_view path) const {
    std::vector<NodeId> ids{root_->id};
    const auto elements = specpath::parse(path);
    if (!elements) return ids;
    const Node* node = root_.get();
    for (const PathElement& element : *elements) {
        const ChildEntry* entry = childOf(*node, element);
        if (!entry) break;
        node = entry->node.get();
        ids.push_back(node->id);
    }
    return ids;
}

void LayerDoc::visit(const std::function<void(const SpecView&)>& visitor) const {
    visitAll(Walker(*root_, "/", 0, 0, {}), visitor);
}

void LayerDoc::visit(std::string_view path,
                     const std::function<void(const SpecView&)>& visitor) const {
    if (path == "/") return visit(visitor);
    const auto elements = specpath::parse(path);
    if (!elements) return;
    const Node* parent = walk(*root_, Elements(*elements).first(elements->size() - 1));
    const ChildEntry* entry = parent ? childOf(*parent, elements->back()) : nullptr;
    if (entry) visitAll(Walker(*entry->node, path, parent->id, entry->order, entry->name), visitor);
}

SpecTree::SpecTree(const LayerDoc& doc, std::string path) : path_(std::move(path)) {
    const Ref<Node>* node = &doc.root_;
    const auto elements = specpath::parse(path_);
    for (const PathElement& element : *elements) node = &childOf(**node, element)->node;
    top_.root_ = *node;
}

void SpecTree::visit(const std::function<void(const LayerDoc::SpecView&)>& visitor) const {
    visitAll(Walker(*top_.root_, path_, 0, 0, {}), visitor);
}

struct LayerDoc::Walk::State {
    explicit State(LayerDoc whole) : doc(std::move(whole)), walker(*doc.root_, "/", 0, 0, {}) {}

    LayerDoc doc;
    Walker walker;
};

LayerDoc::Walk::Walk(LayerDoc doc) : state_(std::make_unique<State>(std::move(doc))) {}
LayerDoc::Walk::Walk(Walk&&) noexcept = default;
LayerDoc::Walk::~Walk() = default;
const LayerDoc::SpecView* LayerDoc::Walk::next() { return state_->walker.next(); }

bool operator==(const LayerDoc& left, const LayerDoc& right) {
    return equal(*left.root_, *right.root_);
}

std::string LayerDoc::dump() const {
    std::string out;
    visit([&](const SpecView& spec) {
        out.append(spec.path).append(" ").append(specKindName(spec.kind)) += '\n';
        for (const auto& [name, value] : *spec.fields) {
            out.append("  ").append(name).append(" = ");
            appendHex(out, encodeFieldValue(value));
            out += '\n';
        }
    });
    return out;
}

void LayerDoc::reserveIds(NodeId firstFree) { nextId_ = std::max(nextId_, firstFree); }

// --- Builder ----------------------------------------------------------------------------------

struct LayerDoc::Builder::State {
    struct Built {
        Node* node = nullptr;
        std::uint32_t pathBytes = 0;
        std::uint32_t pathElements = 0;
    };

    /// Finds nodes by id. The ids of a doc are mostly dense, because they are assigned in sequence.
    class Index {
    public:
        /// Returns nullptr if there is none. The pointer is valid until the next add().
        [[nodiscard]] const Built* find(NodeId id) const {
            if (id < dense_.size() && dense_[id].node) return &dense_[id];
            if (sparse_.empty()) return nullptr;
            const auto found = sparse_.find(id);
            return found == sparse_.end() ? nullptr : &found->second;
        }
        void add(NodeId id, const Built& built) {
            ++count_;
            if (id >= kSlotsEach * (count_ + kSlotsFirst)) {
                sparse_.emplace(id, built);
            } else {
                if (id >= dense_.size()) dense_.resize(id + 1);
                dense_[id] = built;
            }
        }
        [[nodiscard]] std::size_t count() const { return count_; }

    private:
        // The table has at most this many slots per used one.
        static constexpr std::size_t kSlotsEach = 4, kSlotsFirst = 32 * 1024;

        std::vector<Built> dense_;
        std::unordered_map<NodeId, Built> sparse_;
        std::size_t count_ = 0;
    };

    void add(NodeId id, const Built& built) {
        highest = std::max(highest, id);
        extent.bytes = std::max<std::size_t>(extent.bytes, built.pathBytes);
        extent.elements = std::max<std::size_t>(extent.elements, built.pathElements);
        index.add(id, built);
    }

    /// Starts the fields of this node. Moves the fields of the previous node into it, in an
    /// allocation of the right size.
    void gather(Node* node) {
        if (node == gathered) return;
        if (gathered)
            gathered->fields = Fields(std::make_move_iterator(gatheredFields.begin()),
                                      std::make_move_iterator(gatheredFields.end()));
        gatheredFields.clear();
        gathered = node;
        if (node && !node->fields.empty()) gatheredFields = std::move(node->fields);
    }

    State() { add(kRootNode, {&root.editable(), 1, 0}); }

    // Before finish(), nothing of the tree is shared.
    Ref<Node> root{new Node(kRootNode, SpecKind::PseudoRoot)};
    Index index;
    NodeId highest = 0;
    Extent extent{0, 0};
    Node* gathered = nullptr;  // the node that gets the current fields
    Fields gatheredFields;
};

LayerDoc::Builder::Builder() : state_(std::make_unique<State>()) {}
LayerDoc::Builder::~Builder() = default;

namespace {

std::optional<ChildList> listFor(SpecKind kind) {
    for (const ChildList list : kChildLists)
        if (belongsIn(kind, list)) return list;
    return std::nullopt;
}

}  // namespace

Result<void> LayerDoc::Builder::addSpec(NodeId node, NodeId parent, std::uint64_t order,
                                        SpecKind kind, std::string_view name) {
    const auto problem = [&](ErrorCode code, const char* what) {
        return fail(code, "spec " + std::to_string(node) + ", " + inQuotes(name) + ": " + what);
    };
    if (node == kRootNode && kind == SpecKind::PseudoRoot) return {};  // exists already
    const State::Built* above = state_->index.find(parent);
    if (!above) return problem(ErrorCode::SpecNotFound, "has no parent");
    const auto list = listFor(kind);
    if (node == 0 || !list || !hasList(above->node->kind, *list) || !specpath::isName(*list, name))
        return problem(ErrorCode::InvalidEdit, "cannot be a child of that parent");
    ChildSequence& siblings = above->node->editableChildren(*list);
    if (siblings.find(name)) return problem(ErrorCode::SpecExists, "exists already");
    if (siblings.hasOrder(order))
        return problem(ErrorCode::InvalidEdit, "a sibling has the same order number");
    const Extent extent{above->pathBytes + stepBytes(above->node->kind, *list, name),
                        above->pathElements + 1};
    if (extent.bytes > kMaxPathBytes || extent.elements > kMaxPathElements)
        return problem(ErrorCode::InvalidEdit, "its path is too long");
    if (state_->index.find(node)) return problem(ErrorCode::SpecExists, "exists already");

    const State::Built built{new Node(node, kind), static_cast<std::uint32_t>(extent.bytes),
                             static_cast<std::uint32_t>(extent.elements)};
    siblings.insert({std::string(name), order, Ref<Node>(built.node)});
    state_->add(node, built);
    return {};
}

Result<void> LayerDoc::Builder::addField(NodeId node, std::string_view name, FieldValue value) {
    const State::Built* built = state_->index.find(node);
    if (!built) return fail(ErrorCode::SpecNotFound, "there is no spec " + std::to_string(node));
    state_->gather(built->node);
    Fields& fields = state_->gatheredFields;
    const bool isLast = fields.empty() || fields.back().first < name;
    const auto at = isLast ? fields.end() : fieldPosition(fields, name);
    if (!isLast && at->first == name)
        return fail(ErrorCode::SpecExists, "the field " + inQuotes(name) + " exists already");
    fields.emplace(at, name, std::move(value));
    return {};
}

LayerDoc LayerDoc::Builder::finish() {
    state_->gather(nullptr);
    LayerDoc doc;
    doc.root_ = state_->root;
    doc.nextId_ = state_->highest + 1;
    doc.specCount_ = state_->index.count();
    doc.maxPathBytes_ = static_cast<std::uint32_t>(state_->extent.bytes);
    doc.maxPathElements_ = static_cast<std::uint32_t>(state_->extent.elements);
    state_ = std::make_unique<State>();
    return doc;
}

void forEachBlob(const LayerDoc& doc, const std::function<void(const Value&)>& visit) {
    doc.visit([&](const LayerDoc::SpecView& spec) {
        for (const auto& [name, value] : *spec.fields) forEachBlob(value, visit);
    });
}

}  // namespace usdlive
