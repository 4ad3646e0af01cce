// Compares the states of recorded specs and undoes the difference.
#include "usdlive/client/usd/content/Recorder.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>

#include <algorithm>
#include <map>
#include <ranges>
#include <set>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "usd/content/LayerEdits.h"
#include "usd/content/ListMerge.h"
#include "usd/content/OthersWrites.h"
#include "usd/content/SpecEdits.h"

namespace usdlive::content {

using pxr::SdfLayerHandle;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::TfTokenVector;
using pxr::VtValue;

using Names = std::unordered_set<TfToken, TfToken::HashFunctor>;

constexpr const char* kWrittenSince = "another user has written it since";

/// The order of the children of a prim, a variant or the pseudo-root when one of them was first
/// touched, and when the recording ended.
struct NotedOrder {
    explicit NotedOrder(SdfPath of) : parent(std::move(of)) {}
    /// Gives children that were created since their places among the others.
    void include(const TfTokenVector& present);
    /// Returns true if nobody has moved the children that existed all the time.
    [[nodiscard]] bool isAsWritten(const TfTokenVector& present,
                                   const std::set<TfToken>& restored) const;

    SdfPath parent;
    TfTokenVector before, after;
    Names names;  ///< in `before`
};

/// The content that the scopes of one layer share. Each of many siblings can be a scope, and a list
/// of all of them and a layer for each would be superlinear.
struct SharedContent {
    std::map<SdfPath, std::shared_ptr<NotedOrder>> orders;  // by parent
    SdfLayerRefPtr specs;                                   // copies; null: none yet
};

void NotedOrder::include(const TfTokenVector& present) {
    if (before.empty()) {
        before = present;
        names.insert(present.begin(), present.end());
        return;
    }
    std::set<TfToken> added;
    for (const TfToken& name : present)
        if (names.insert(name).second) added.insert(name);
    before.insert(before.end(), added.begin(), added.end());
    before = arranged(before, present, added);
}

/// The content of a layer at a path, with `deep` also below, at one moment.
class LayerScope {
public:
    LayerScope(SdfLayerRefPtr layer, SdfPath root, bool deep);
    /// Returns the content of the same scope now.
    [[nodiscard]] LayerScope now() const { return {layer, root, deep}; }

    [[nodiscard]] bool has(const SdfPath& path) const { return fields.contains(path); }
    /// Keeps what restores specs that will be deleted: copies of them, and their places.
    void keepSpecs(SharedContent& shared);

    SdfLayerRefPtr layer;
    SdfPath root;
    bool deep;
    std::vector<SdfPath> paths;  ///< parents first, siblings in reverse order
    std::unordered_map<SdfPath, Fields, SdfPath::Hash> fields;
    std::vector<std::shared_ptr<NotedOrder>> orders;
    SdfLayerRefPtr specs;  ///< null: not kept
    std::shared_ptr<OthersWrites> others;

private:
    void keepOrders(SharedContent& shared);
};

LayerScope::LayerScope(SdfLayerRefPtr of, SdfPath at, bool isDeep)
    : layer(std::move(of)), root(std::move(at)), deep(isDeep), others(OthersWrites::of(layer)) {
    if (deep)
        paths = pathsBelow(layer, root);
    else if (layer->HasSpec(root))
        paths = {root};
    for (const SdfPath& path : paths) fields.emplace(path, readFields(layer, path));
}

void LayerScope::keepSpecs(SharedContent& shared) {
    keepOrders(shared);
    if (!deep || !has(root)) return;
    if (!shared.specs || shared.specs->HasSpec(root))  // earlier scopes can be below this one
        shared.specs = pxr::SdfLayer::CreateAnonymous(".usda");
    specs = shared.specs;
    if (root == SdfPath::AbsoluteRootPath()) {
        for (const TfToken& name : primChildren(layer, root))
            pxr::SdfCopySpec(layer, root.AppendChild(name), specs, root.AppendChild(name));
    } else {
        const SdfPath owner = root.GetParentPath();
        if (owner != SdfPath::AbsoluteRootPath()) pxr::SdfCreatePrimInLayer(specs, owner);
        pxr::SdfCopySpec(layer, root, specs, root);
    }
}

// Keeps the order of the children of each prim in the scope, and of the siblings of a prim that may
// be deleted.
void LayerScope::keepOrders(SharedContent& shared) {
    const auto keep = [&](const SdfPath& parent) -> NotedOrder& {
        auto& order = shared.orders[parent];
        if (!order) order = std::make_shared<NotedOrder>(parent);
        return *orders.emplace_back(order);
    };
    for (const SdfPath& path : paths)
        if (const auto children = primChildren(layer, path); !children.empty())
            keep(path).include(children);
    if (!deep || !root.IsPrimPath() || !has(root)) return;
    NotedOrder& siblings = keep(root.GetParentPath());
    if (!siblings.names.contains(root.GetNameToken()))
        siblings.include(primChildren(layer, siblings.parent));
}

/// Undoes what was done to the lists of children in one layer. Sdf copies a list for each child
/// that is removed or moved, so this removes and arranges those of a parent at once.
class ChildrenUndo {
public:
    /// `force` ignores later edits by others.
    ChildrenUndo(SdfLayerHandle layer, bool force) : layer_(std::move(layer)), force_(force) {}

    [[nodiscard]] bool force() const { return force_; }
    /// Removes the spec with everything below it, at the latest in finish().
    void remove(const SdfPath& path) { removed_[ownerOf(path)].insert(path); }
    /// Removes the children of `owner` for which remove() was called.
    void removeBelow(const SdfPath& owner);
    /// Returns the spec at or above `path` that will be removed, or an empty path.
    [[nodiscard]] SdfPath removedAt(SdfPath path) const;
    void restore(const SdfPath& path, const SdfLayerHandle& specs);
    /// Restores the order of children in finish(), or only the places of the restored ones if
    /// others have moved some since.
    void arrange(const NotedOrder& order) { orders_.emplace(order.parent, &order); }
    void finish();

private:
    SdfLayerHandle layer_;
    bool force_;
    std::map<SdfPath, std::set<SdfPath>> removed_;   // by owner
    std::map<SdfPath, std::set<TfToken>> restored_;  // prims, by parent
    std::map<SdfPath, const NotedOrder*> orders_;
};

void ChildrenUndo::removeBelow(const SdfPath& owner) {
    if (const auto removed = removed_.extract(owner)) removeSpecs(layer_, owner, removed.mapped());
}

SdfPath ChildrenUndo::removedAt(SdfPath path) const {
    for (; !removed_.empty() && !path.IsEmpty(); path = ownerOf(path))
        if (const auto removed = removed_.find(ownerOf(path));
            removed != removed_.end() && removed->second.contains(path))
            return path;
    return {};
}

void ChildrenUndo::restore(const SdfPath& path, const SdfLayerHandle& specs) {
    pxr::SdfCopySpec(specs, path, layer_, path);
    if (path.IsPrimPath()) restored_[path.GetParentPath()].insert(path.GetNameToken());
}

bool NotedOrder::isAsWritten(const TfTokenVector& present,
                             const std::set<TfToken>& restored) const {
    const Names later(after.begin(), after.end()), now(present.begin(), present.end());
    const auto common = [&](const TfTokenVector& all) {
        TfTokenVector some;
        std::ranges::copy_if(all, std::back_inserter(some), [&](const TfToken& name) {
            return names.contains(name) && later.contains(name) && now.contains(name) &&
                   !restored.contains(name);
        });
        return some;
    };
    return common(present) == common(after);
}

void ChildrenUndo::finish() {
    while (!removed_.empty()) removeBelow(removed_.begin()->first);
    for (const auto& [parent, order] : orders_) {
        const TfTokenVector present = primChildren(layer_, parent);
        if (present == order->before) continue;
        std::set<TfToken> names = restored_[parent];
        if (force_ || order->isAsWritten(present, names))
            names.insert(order->before.begin(), order->before.end());
        content::arrange(layer_, parent, order->before, names);
    }
}

/// The edits in one scope and their undo.
class ScopeDifference {
public:
    ScopeDifference(LayerScope before, LayerScope after);

    [[nodiscard]] bool isEmpty() const {
        return created_.empty() && deleted_.empty() && changes_.empty();
    }
    /// Keeps only the moment of an empty difference, which keepOthers() needs.
    void dropContent();
    [[nodiscard]] const SdfLayerRefPtr& layer() const { return before_.layer; }
    void undo(ChildrenUndo& children, std::vector<Kept>& kept) const;
    /// Reverts edits of registers and specs that others have written after written().
    /// `replaced` are the values that the earlier edits replaced.
    using Replaced = std::map<std::tuple<SdfPath, TfToken, Part>, VtValue>;
    void keepOthers(const Replaced& replaced, ChildrenUndo& children,
                    std::vector<Kept>& kept) const;
    void addReplaced(Replaced& replaced) const;
    [[nodiscard]] Revision written() const { return written_; }
    void setWritten(Revision written) { written_ = written; }
    /// Returns whether others have written the layer after written().
    [[nodiscard]] bool isFollowed() const { return after_.others->last() > written_; }

private:
    // Return the reason why something was not undone, or an empty text on success.
    std::string takeBack(const Change& change) const;
    std::string undoCreate(const SdfPath& path, ChildrenUndo& children) const;
    std::string restore(const SdfPath& path, bool force, ChildrenUndo& children) const;
    void removeCreated(ChildrenUndo& children, std::vector<Kept>& kept) const;
    void write(const Change& change, const VtValue& value) const {
        writeRegister(layer(), change.path, change.field, change.part, value);
    }

    LayerScope before_, after_;
    std::vector<SdfPath> created_, deleted_;  // deleted_: without the specs below them
    std::vector<Change> changes_;
    Revision written_;  // when the edits were made; others write later
};

ScopeDifference::ScopeDifference(LayerScope before, LayerScope after)
    : before_(std::move(before)), after_(std::move(after)), written_(after_.others->last()) {
    const auto isGone = [this](const SdfPath& path) {
        return before_.has(path) && !after_.has(path);
    };
    for (const SdfPath& path : before_.paths)
        if (isGone(path) && !isGone(ownerOf(path))) deleted_.push_back(path);
    for (const SdfPath& path : after_.paths) {
        if (!before_.has(path)) {
            created_.push_back(path);
            continue;
        }
        auto changes = changesBetween(path, before_.fields.at(path), after_.fields.at(path));
        std::ranges::move(changes, std::back_inserter(changes_));
    }
}

void ScopeDifference::dropContent() {
    for (LayerScope* scope : {&before_, &after_}) {
        scope->paths = {};
        scope->fields = {};
        scope->orders = {};
        scope->specs = {};
    }
}

void ScopeDifference::addReplaced(Replaced& replaced) const {
    for (const Change& change : changes_)
        replaced.try_emplace({change.path, change.field, change.part}, change.before);
}

void ScopeDifference::keepOthers(const Replaced& replaced, ChildrenUndo& children,
                                 std::vector<Kept>& kept) const {
    const std::string& id = layer()->GetIdentifier();
    // The undo of the earlier edits has restored what they replaced. If something else was there,
    // and commits were missed, others have written it.
    const auto isOther = [&](const Change& change) {
        const auto found = replaced.find({change.path, change.field, change.part});
        return found != replaced.end() && !isSame(found->second, change.before);
    };
    const bool hasMissed = after_.others->hasMissed(written_);
    for (const Change& change : changes_) {
        if (!after_.others->wroteRegister(change, written_) && !(hasMissed && isOther(change)))
            continue;
        write(change, change.before);
        kept.push_back({id, change.path, change.field, change.part, kWrittenSince});
    }
    for (const SdfPath& path : created_) {  // others have deleted it since
        if (!layer()->HasSpec(path) || !children.removedAt(path).IsEmpty() ||
            !after_.others->changedSpec(path, written_))
            continue;
        children.remove(path);
        kept.push_back({id, path, {}, {}, kWrittenSince});
    }
    for (auto path = deleted_.rbegin(); path != deleted_.rend(); ++path) {
        const auto isTheirs = [&](const SdfPath& below) {
            return below.HasPrefix(*path) && after_.others->wroteSpec(below, written_);
        };
        if (std::ranges::none_of(before_.paths, isTheirs)) continue;
        if (restore(*path, true, children).empty())
            kept.push_back({id, *path, {}, {}, kWrittenSince});
    }
}

void ScopeDifference::undo(ChildrenUndo& children, std::vector<Kept>& kept) const {
    const bool force = children.force();
    const auto keep = [&](const SdfPath& path, std::string reason) {
        kept.push_back({layer()->GetIdentifier(), path, {}, {}, std::move(reason)});
    };
    for (const Change& change : changes_) {
        if (force && layer()->HasSpec(change.path)) {
            write(change, change.before);
        } else if (auto reason = takeBack(change); !reason.empty()) {
            keep(change.path, std::move(reason));
            kept.back().field = change.field;
            kept.back().part = change.part;
        }
    }
    removeCreated(children, kept);
    // In reverse order, which restores the order of siblings.
    for (auto path = deleted_.rbegin(); path != deleted_.rend(); ++path)
        if (auto reason = restore(*path, force, children); !reason.empty())
            keep(*path, std::move(reason));
    for (const auto& order : before_.orders) children.arrange(*order);
}

std::string ScopeDifference::takeBack(const Change& change) const {
    if (!layer()->HasSpec(change.path)) return "it is no longer there";
    const VtValue present = readRegister(layer(), change.path, change.field, change.part);
    if (isSame(present, change.after)) {
        if (after_.others->wroteRegister(change, written_)) return kWrittenSince;
        write(change, change.before);
        return {};
    }
    if (isSame(present, change.before)) return {};
    const auto merged = undoneList(present, change.after, change.before);
    if (!merged) return "another user has changed it since";
    write(change, *merged);
    return {};
}

// With force removes the specs with everything below. Otherwise removes them from the leaves up and
// keeps specs that others have written or extended.
void ScopeDifference::removeCreated(ChildrenUndo& children, std::vector<Kept>& kept) const {
    if (children.force()) {
        for (const SdfPath& path : created_)
            if (path == after_.root || before_.has(ownerOf(path))) children.remove(path);
        return;
    }
    for (auto path = created_.rbegin(); path != created_.rend(); ++path)
        if (auto reason = undoCreate(*path, children); !reason.empty())
            kept.push_back({layer()->GetIdentifier(), *path, {}, {}, std::move(reason)});
}

std::string ScopeDifference::undoCreate(const SdfPath& path, ChildrenUndo& children) const {
    children.removeBelow(path);
    if (!layer()->HasSpec(path)) return {};
    if (!changesBetween(path, after_.fields.at(path), readFields(layer(), path)).empty())
        return "another user has changed it since";
    if (after_.others->wroteSpec(path, written_)) return kWrittenSince;
    if (pathsBelow(layer(), path).size() > 1) return "another user's edits are below it";
    children.remove(path);
    return {};
}

std::string ScopeDifference::restore(const SdfPath& path, bool force,
                                     ChildrenUndo& children) const {
    if (const SdfPath removed = children.removedAt(path); !removed.IsEmpty())
        children.removeBelow(ownerOf(removed));
    if (!force && layer()->HasSpec(path)) return "another user has created it again";
    if (!force && after_.others->changedSpec(path, written_))
        return "another user has deleted it since";
    if (!layer()->HasSpec(ownerOf(path))) return "its parent is no longer there";
    if (!before_.specs) return "its content was not recorded";
    children.restore(path, before_.specs);
    return {};
}

Record::Record() : Record(std::vector<ScopeDifference>()) {}

Record::Record(std::vector<ScopeDifference> differences)
    : differences_(std::make_shared<const std::vector<ScopeDifference>>(std::move(differences))) {}

bool Record::isEmpty() const {
    return std::ranges::all_of(*differences_, &ScopeDifference::isEmpty);
}

std::vector<SdfLayerHandle> Record::layers() const {
    std::vector<SdfLayerHandle> layers;
    for (const auto& difference : *differences_)
        if (const SdfLayerHandle layer = difference.layer();
            !difference.isEmpty() && std::ranges::find(layers, layer) == layers.end())
            layers.push_back(layer);
    return layers;
}

bool Record::isFollowed(const SdfLayerHandle& layer) const {
    return std::ranges::any_of(*differences_, [&](const ScopeDifference& difference) {
        return SdfLayerHandle(difference.layer()) == layer && difference.isFollowed();
    });
}

std::vector<Kept> Record::undo(const IsShared& isShared) const {
    const pxr::SdfChangeBlock block;
    std::vector<Kept> kept;
    std::map<SdfLayerHandle, ChildrenUndo> layers;
    for (const ScopeDifference& difference : *differences_ | std::views::reverse) {
        const SdfLayerHandle layer = difference.layer();
        auto children = layers.find(layer);
        if (children == layers.end())
            children = layers.try_emplace(layer, layer, !isShared(layer)).first;
        difference.undo(children->second, kept);
    }
    for (auto& [layer, children] : layers) children.finish();
    return kept;
}

std::vector<Kept> Record::keepOthers(const Record& earlier, const IsShared& isShared) {
    std::map<SdfLayerHandle, Revision> written;
    std::map<SdfLayerHandle, ScopeDifference::Replaced> replaced;
    for (const auto& difference : *earlier.differences_) {
        written.emplace(difference.layer(), difference.written());
        difference.addReplaced(replaced[difference.layer()]);
    }
    const pxr::SdfChangeBlock block;
    std::vector<Kept> kept;
    std::map<SdfLayerHandle, ChildrenUndo> layers;
    auto differences = *differences_;
    for (ScopeDifference& difference : differences | std::views::reverse) {
        const auto since = written.find(difference.layer());
        if (since == written.end() || !isShared(difference.layer())) continue;
        difference.setWritten(since->second);
        auto& children =
            layers.try_emplace(difference.layer(), difference.layer(), false).first->second;
        difference.keepOthers(replaced.at(difference.layer()), children, kept);
    }
    for (auto& [layer, children] : layers) children.finish();
    *this = Record(std::move(differences));
    return kept;
}

Recorder::Recorder() = default;
Recorder::~Recorder() = default;
Recorder::Recorder(Recorder&&) noexcept = default;

void Recorder::touch(const SdfLayerHandle& layer, const SdfPath& path, bool deep) {
    if (isTouched(layer, path, deep)) return;
    auto& touched = touched_[layer];
    // Scopes do not overlap, so that each undoes its part of the edits: those within the new one
    // end here, in the order in which they began.
    std::set<std::size_t> within;
    for (auto at = touched.lower_bound(path);
         deep && at != touched.end() && at->first.HasPrefix(path); at = touched.erase(at))
        within.insert(at->second.index);
    for (const std::size_t index : within) close(*std::exchange(scopes_[index], nullptr));
    touched[path] = {scopes_.size(), deep};
    scopes_.push_back(std::make_unique<LayerScope>(layer, path, deep));
    auto& shared = shared_[layer];
    if (!shared) shared = std::make_shared<SharedContent>();
    scopes_.back()->keepSpecs(*shared);
}

bool Recorder::isTouched(const SdfLayerHandle& layer, const SdfPath& path, bool deep) const {
    const auto touched = touched_.find(layer);
    if (touched == touched_.end()) return false;
    for (SdfPath at = path; !at.IsEmpty(); at = at.GetParentPath()) {
        const auto found = touched->second.find(at);
        if (found != touched->second.end() && (found->second.deep || (at == path && !deep)))
            return true;
    }
    return false;
}

void Recorder::close(const LayerScope& before) {
    ScopeDifference difference(before, before.now());
    if (difference.isEmpty()) difference.dropContent();
    closed_.push_back(std::move(difference));
}

void Recorder::forget(const SdfLayerHandle& layer) {
    touched_.erase(layer);
    shared_.erase(layer);
    for (auto& scope : scopes_)
        if (scope && SdfLayerHandle(scope->layer) == layer) scope.reset();
    std::erase_if(closed_,
                  [&](const ScopeDifference& one) { return SdfLayerHandle(one.layer()) == layer; });
}

void Recorder::touchWithAncestors(const SdfLayerHandle& layer, const SdfPath& path) {
    for (const SdfPath& prefix : path.GetPrefixes())
        if (!layer->HasSpec(prefix)) return touch(layer, prefix, true);
    touch(layer, path, true);
}

Record Recorder::finish() {
    for (const auto& scope : scopes_)
        if (scope) close(*scope);
    for (const auto& [layer, shared] : shared_)
        for (const auto& [parent, order] : shared->orders)
            order->after = primChildren(layer, parent);
    scopes_.clear();
    touched_.clear();
    shared_.clear();
    return Record(std::exchange(closed_, {}));
}

}  // namespace usdlive::content
