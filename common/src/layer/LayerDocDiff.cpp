// Computes the edits that turn one LayerDoc into another, including moves of specs.
#include <algorithm>
#include <stdexcept>
#include <unordered_map>
#include <unordered_set>

#include "usdlive/common/layer/LayerDocNode.h"
#include "usdlive/common/layer/LongestIncreasing.h"

namespace usdlive {

namespace {

using Node = LayerDoc::Node;
using Edits = std::vector<std::pair<std::string, EditAction>>;

// The place of a spec: its parent and the list.
struct ListPlace {
    NodeId parent = 0;
    ChildList list = ChildList::Prims;
    std::string name;
};
using Places = std::unordered_map<NodeId, ListPlace>;

// Finds the specs of `to` that have another place in `from`, by their ids. Looks only where the two
// do not share structure. A wrong match costs edits but does not change the result.
class Matching {
public:
    Matching(const Node& from, const Node& to) {
        places[from.id] = {};
        compare(from, to);
        while (matchChildren() || expand()) {
        }
    }

    std::unordered_map<const Node*, NodeId> sources;  // keyed by the spec of `to`
    std::unordered_set<NodeId> moved;                 // the same ids
    Places places;  // the places in `from` of those, of their ancestors, and more

private:
    // Compares two nodes of the same spec. Children with the same name and id are the same, too.
    void compare(const Node& from, const Node& to) {
        if (&from == &to) return;
        for (const ChildList list : kChildLists) {
            if (!hasList(from.kind, list)) continue;
            const ChildSequence& olds = from.children(list);
            const ChildSequence& news = to.children(list);
            for (const ChildEntry* old : olds.entriesNotSharedWith(news))
                compareOld(from, list, *old, news.find(old->name));
            for (const ChildEntry* now : news.entriesNotSharedWith(olds))
                if (!isSame(olds.find(now->name), now)) addNew(*now->node);
        }
    }

    void compareOld(const Node& parent, ChildList list, const ChildEntry& old,
                    const ChildEntry* now) {
        const bool same = isSame(&old, now);
        if (same && old.node.get() == now->node.get()) return;
        places[old.node->id] = {parent.id, list, old.name};
        if (same)
            compare(*old.node, *now->node);
        else
            addGone(*old.node);
    }

    static bool isSame(const ChildEntry* old, const ChildEntry* now) {
        return old && now && old->node->id == now->node->id && old->node->kind == now->node->kind;
    }

    void addGone(const Node& node) {
        gone_.emplace(node.id, &node);
        goneToExpand_.push_back(&node);
        if (const auto now = new_.find(node.id); now != new_.end()) pair(node, *now->second);
    }

    void addNew(const Node& node) {
        new_.emplace(node.id, &node);
        newToExpand_.push_back(&node);
        if (const auto old = gone_.find(node.id); old != gone_.end()) pair(*old->second, node);
    }

    void pair(const Node& old, const Node& now) {
        if (old.kind != now.kind || !moved.insert(old.id).second) return;
        sources[&now] = old.id;
        pairs_.emplace_back(&old, &now);
    }

    bool matchChildren() {
        if (pairs_.empty()) return false;
        const auto [old, now] = pairs_.back();
        pairs_.pop_back();
        compare(*old, *now);
        return true;
    }

    // Searches below specs without a match. Stops when all specs of one side are matched.
    bool expand() {
        const bool anyGone = gone_.size() > moved.size();
        const bool anyNew = new_.size() > moved.size();
        if (!anyGone || !anyNew || (goneToExpand_.empty() && newToExpand_.empty())) return false;
        for (const Node* node : std::exchange(goneToExpand_, {}))
            if (!moved.contains(node->id)) expandGone(*node);
        for (const Node* node : std::exchange(newToExpand_, {}))
            if (!sources.contains(node)) expandNew(*node);
        return true;
    }

    void expandGone(const Node& node) {
        for (const ChildList list : kChildLists)
            if (hasList(node.kind, list))
                node.children(list).forEach([&](const ChildEntry& child) {
                    places[child.node->id] = {node.id, list, child.name};
                    addGone(*child.node);
                });
    }

    void expandNew(const Node& node) {
        for (const ChildList list : kChildLists)
            if (hasList(node.kind, list))
                node.children(list).forEach([&](const ChildEntry& child) { addNew(*child.node); });
    }

    std::unordered_map<NodeId, const Node*> gone_, new_;
    std::vector<const Node*> goneToExpand_, newToExpand_;
    std::vector<std::pair<const Node*, const Node*>> pairs_;
};

}  // namespace

// Makes the edits from the root down. Tries each structural edit on a working copy of `from`, so
// that every next step starts from the actual state. Below a spec that is in its place, paths are
// those of `to`. A spec that has to be deleted but contains a wanted one is first renamed to a free
// name and deleted at the end.
class LayerDocDiff {
public:
    LayerDocDiff(const LayerDoc& from, const LayerDoc& to)
        : work_(from), to_(to), matching_(*from.root_, *to.root_) {
        work_.reserveIds(to.nextId());
        pending_ = matching_.moved;
    }

    Edits run() {
        align(*to_.root_, "/", {});
        for (const Leftover& leftover : leftovers_) deleteLeftovers(leftover);
        return std::move(edits_);
    }

private:
    struct Leftover {
        std::string path;
        ChildList list;
        const Node* to;
    };

    // Makes the spec at `path` and everything below it equal to `to`.
    void align(const Node& to, const std::string& path, const ListPlace& place) {
        const Node* node = at(path);
        if (node == &to) return;
        matching_.places[node->id] = place;
        alignFields(*node, to, path);
        for (const ChildList list : kChildLists)
            if (hasList(to.kind, list)) alignList(to, path, list);
        for (const ChildList list : kChildLists)
            if (hasList(to.kind, list)) alignChildren(to, path, list);
    }

    void alignFields(const Node& from, const Node& to, const std::string& path) {
        auto old = from.fields.begin();
        auto now = to.fields.begin();
        while (old != from.fields.end() || now != to.fields.end()) {
            const bool takeOld =
                now == to.fields.end() || (old != from.fields.end() && old->first <= now->first);
            const bool takeNew =
                old == from.fields.end() || (now != to.fields.end() && now->first <= old->first);
            const std::string& name = takeOld ? old->first : now->first;
            for (auto& action : fieldDifference(name, takeOld ? &old->second : nullptr,
                                                takeNew ? &now->second : nullptr))
                edits_.emplace_back(path, std::move(action));
            if (takeOld) ++old;
            if (takeNew) ++now;
        }
    }

    void alignList(const Node& to, const std::string& path, ChildList list) {
        const ChildSequence& wanted = to.children(list);
        if (wanted.sharesAll(at(path)->children(list))) return;
        for (const ChildEntry* entry : wanted.entriesNotSharedWith(at(path)->children(list)))
            alignEntry(path, list, *entry);
        if (at(path)->children(list).size() != wanted.size())
            leftovers_.push_back({path, list, &to});
        alignOrder(path, list, wanted);
    }

    void alignChildren(const Node& to, const std::string& path, ChildList list) {
        const Node* node = at(path);
        const NodeId id = node->id;
        for (const ChildEntry* entry : to.children(list).entriesNotSharedWith(node->children(list)))
            align(*entry->node, specpath::child(path, list, entry->name), {id, list, entry->name});
    }

    // Moves or creates the spec `entry` at its place, or keeps one there that can become it.
    void alignEntry(const std::string& path, ChildList list, const ChildEntry& entry) {
        const Node* parent = at(path);
        const ChildEntry* there = parent->children(list).find(entry.name);
        const auto source = matching_.sources.find(entry.node.get());
        const NodeId wanted = source == matching_.sources.end() ? 0 : source->second;
        if (there && there->node->kind == entry.node->kind &&
            (wanted ? there->node->id == wanted : !pending_.contains(there->node->id))) {
            pending_.erase(wanted);
            return;
        }
        if (there) evict(path, list, *there);
        if (wanted && move(wanted, path, list, entry.name)) return;
        create(specpath::child(path, list, entry.name), entry.node->kind);
    }

    void create(const std::string& path, SpecKind kind) { mustApply(path, CreateSpec{kind}); }

    bool move(NodeId id, const std::string& parent, ChildList list, const std::string& name) {
        if (!pending_.contains(id)) return false;  // it was deleted together with an ancestor
        pending_.erase(id);
        if (!apply(pathOf(id), MoveSpec{{parent, {}}, name})) return false;
        matching_.places[id] = {at(parent)->id, list, name};
        return true;
    }

    void evict(const std::string& path, ChildList list, const ChildEntry& entry) {
        const std::string own = specpath::child(path, list, entry.name);
        const NodeId id = entry.node->id;
        if (holdsPending(id)) {
            const std::string name = freeName(path, list);
            if (apply(own, MoveSpec{{specpath::parent(own), {}}, name})) {
                matching_.places[id] = {at(path)->id, list, name};
                return;
            }
        }
        remove(own);
    }

    void remove(const std::string& path) {
        for (const NodeId id : mustApply(path, DeleteSpec{}).erased) pending_.erase(id);
    }

    // Returns true if the spec, or one below it, has to be moved elsewhere.
    [[nodiscard]] bool holdsPending(NodeId id) const {
        if (pending_.contains(id)) return true;
        return std::any_of(pending_.begin(), pending_.end(), [&](NodeId below) {
            while (below != id && below != 0) below = matching_.places.at(below).parent;
            return below == id;
        });
    }

    [[nodiscard]] std::string freeName(const std::string& path, ChildList list) {
        while (true) {
            std::string name = "_" + std::to_string(++names_);
            const std::string own = specpath::child(path, list, name);
            if (!work_.has(own) && !to_.has(own)) return name;
        }
    }

    void deleteLeftovers(const Leftover& leftover) {
        const ChildSequence& wanted = leftover.to->children(leftover.list);
        std::vector<std::string> names;
        for (const ChildEntry* entry :
             at(leftover.path)->children(leftover.list).entriesNotSharedWith(wanted))
            if (!wanted.find(entry->name)) names.push_back(entry->name);
        for (const auto& name : names) remove(specpath::child(leftover.path, leftover.list, name));
    }

    // Sorts the children as in `wanted`; all of them exist. Keeps the longest run that is in order
    // already.
    void alignOrder(const std::string& path, ChildList list, const ChildSequence& wanted) {
        if (at(path)->children(list).isInOrderOf(wanted)) return;
        std::unordered_map<std::string_view, std::size_t> positions;
        at(path)->children(list).forEach(
            [&](const ChildEntry& entry) { positions.emplace(entry.name, positions.size()); });
        const auto entries = wanted.entries();
        std::vector<std::size_t> numbers;
        numbers.reserve(entries.size());
        for (const ChildEntry* entry : entries) numbers.push_back(positions.at(entry->name));
        const std::vector<bool> stays = longestIncreasing(numbers);
        for (std::size_t i = entries.size(); i-- > 0;)
            if (!stays[i])
                mustApply(specpath::child(path, list, entries[i]->name),
                          PlaceSpec{i + 1 < entries.size() ? entries[i + 1]->name : ""});
    }

    // Returns the node at `path`. Valid until the next structural edit. Cached, because the same
    // path is often requested several times.
    [[nodiscard]] const Node* at(const std::string& path) {
        if (atNode_ && atPath_ == path) return atNode_;
        atNode_ = work_.root_.get();
        atPath_ = path;
        const auto elements = specpath::parse(path);
        for (const PathElement& element : *elements)
            atNode_ = atNode_->children(element.list).find(element.name)->node.get();
        return atNode_;
    }

    [[nodiscard]] std::string pathOf(NodeId id) const {
        const ListPlace& place = matching_.places.at(id);
        if (place.parent == 0) return "/";
        return specpath::child(pathOf(place.parent), place.list, place.name);
    }

    bool apply(const std::string& path, EditAction action) {
        atNode_ = nullptr;
        if (!work_.apply(path, action)) return false;
        edits_.emplace_back(path, std::move(action));
        return true;
    }

    LayerDoc::Applied mustApply(const std::string& path, EditAction action) {
        atNode_ = nullptr;
        auto applied = work_.apply(path, action);
        if (!applied) throw std::logic_error("difference(): " + applied.error().message);
        edits_.emplace_back(path, std::move(action));
        return *std::move(applied);
    }

    LayerDoc work_;
    const LayerDoc& to_;
    Matching matching_;
    std::unordered_set<NodeId> pending_;  // specs that are not in their places yet
    std::vector<Leftover> leftovers_;
    std::uint64_t names_ = 0;
    std::string atPath_;
    const Node* atNode_ = nullptr;
    Edits edits_;
};

Edits difference(const LayerDoc& from, const LayerDoc& to) { return LayerDocDiff(from, to).run(); }

}  // namespace usdlive
