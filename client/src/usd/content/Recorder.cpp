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

constexpr const char* kWrittenSince = "another user has written it since";

/// The content of a layer at a path, with `deep` also below, at one moment.
class LayerScope {
public:
    LayerScope(SdfLayerRefPtr layer, SdfPath root, bool deep);
    /// Returns the content of the same scope now.
    [[nodiscard]] LayerScope now() const;

    [[nodiscard]] bool has(const SdfPath& path) const { return fields.contains(path); }
    /// Copies the specs themselves, for those that will be deleted.
    void keepSpecs();

    SdfLayerRefPtr layer;
    SdfPath root;
    bool deep;
    std::vector<SdfPath> paths;  ///< parents first, siblings in reverse order
    std::unordered_map<SdfPath, Fields, SdfPath::Hash> fields;
    std::map<SdfPath, TfTokenVector> order;  ///< the order of the children of prims
    SdfLayerRefPtr specs;
    std::shared_ptr<OthersWrites> others;

private:
    void keepOrder(const SdfPath& parent) { order[parent] = primChildren(layer, parent); }
};

LayerScope::LayerScope(SdfLayerRefPtr of, SdfPath at, bool isDeep)
    : layer(std::move(of)), root(std::move(at)), deep(isDeep), others(OthersWrites::of(layer)) {
    if (deep)
        paths = pathsBelow(layer, root);
    else if (layer->HasSpec(root))
        paths = {root};
    for (const SdfPath& path : paths) {
        fields.emplace(path, readFields(layer, path));
        if (!path.IsPropertyPath()) keepOrder(path);
    }
}

LayerScope LayerScope::now() const {
    LayerScope scope(layer, root, deep);
    for (const auto& [parent, names] : order) scope.keepOrder(parent);
    return scope;
}

void LayerScope::keepSpecs() {
    // A prim that will be deleted is restored to its place. Others do not change the order of their
    // siblings, and copying it for each of many siblings would be superlinear.
    if (deep && root.IsPrimPath() && has(root)) keepOrder(root.GetParentPath());
    specs = pxr::SdfLayer::CreateAnonymous(".usda");
    if (!deep) return;
    if (root == SdfPath::AbsoluteRootPath()) {
        for (const TfToken& name : primChildren(layer, root))
            pxr::SdfCopySpec(layer, root.AppendChild(name), specs, root.AppendChild(name));
    } else if (has(root)) {
        const SdfPath owner = root.GetParentPath();
        if (owner != SdfPath::AbsoluteRootPath()) pxr::SdfCreatePrimInLayer(specs, owner);
        pxr::SdfCopySpec(layer, root, specs, root);
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
    /// `force` ignores later edits by others.
    void undo(bool force, std::vector<Kept>& kept) const;
    /// Reverts edits of registers and specs that others have written after written().
    /// `replaced` are the values that the earlier edits replaced.
    using Replaced = std::map<std::tuple<SdfPath, TfToken, Part>, VtValue>;
    void keepOthers(const Replaced& replaced, std::vector<Kept>& kept) const;
    void addReplaced(Replaced& replaced) const;
    [[nodiscard]] Revision written() const { return written_; }
    void setWritten(Revision written) { written_ = written; }
    /// Returns whether others have written the layer after written().
    [[nodiscard]] bool isFollowed() const { return after_.others->last() > written_; }

private:
    // Return the reason why something was not undone, or an empty text on success.
    std::string takeBack(const Change& change) const;
    std::string undoCreate(const SdfPath& path) const;
    std::string restore(const SdfPath& path, bool force) const;
    void removeCreated(bool force, std::vector<Kept>& kept) const;
    void arrangeChildren(bool force, const std::vector<SdfPath>& restored) const;
    bool isOrderAsWritten(const SdfPath& parent) const;
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
        scope->order = {};
        scope->specs = {};
    }
}

void ScopeDifference::addReplaced(Replaced& replaced) const {
    for (const Change& change : changes_)
        replaced.try_emplace({change.path, change.field, change.part}, change.before);
}

void ScopeDifference::keepOthers(const Replaced& replaced, std::vector<Kept>& kept) const {
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
        if (!layer()->HasSpec(path) || !after_.others->changedSpec(path, written_)) continue;
        removeSpec(layer(), path);
        kept.push_back({id, path, {}, {}, kWrittenSince});
    }
    for (auto path = deleted_.rbegin(); path != deleted_.rend(); ++path) {
        const auto isTheirs = [&](const SdfPath& below) {
            return below.HasPrefix(*path) && after_.others->wroteSpec(below, written_);
        };
        if (std::ranges::none_of(before_.paths, isTheirs)) continue;
        if (restore(*path, true).empty()) kept.push_back({id, *path, {}, {}, kWrittenSince});
    }
}

void ScopeDifference::undo(bool force, std::vector<Kept>& kept) const {
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
    removeCreated(force, kept);
    std::vector<SdfPath> restored;
    // In reverse order, which restores the order of siblings.
    for (auto path = deleted_.rbegin(); path != deleted_.rend(); ++path) {
        if (auto reason = restore(*path, force); !reason.empty())
            keep(*path, std::move(reason));
        else
            restored.push_back(*path);
    }
    arrangeChildren(force, restored);
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
void ScopeDifference::removeCreated(bool force, std::vector<Kept>& kept) const {
    if (force) {
        for (const SdfPath& path : created_)
            if (path == after_.root || before_.has(ownerOf(path))) removeSpec(layer(), path);
        return;
    }
    for (auto path = created_.rbegin(); path != created_.rend(); ++path)
        if (auto reason = undoCreate(*path); !reason.empty())
            kept.push_back({layer()->GetIdentifier(), *path, {}, {}, std::move(reason)});
}

std::string ScopeDifference::undoCreate(const SdfPath& path) const {
    if (!layer()->HasSpec(path)) return {};
    if (!changesBetween(path, after_.fields.at(path), readFields(layer(), path)).empty())
        return "another user has changed it since";
    if (after_.others->wroteSpec(path, written_)) return kWrittenSince;
    if (pathsBelow(layer(), path).size() > 1) return "another user's edits are below it";
    removeSpec(layer(), path);
    return {};
}

std::string ScopeDifference::restore(const SdfPath& path, bool force) const {
    if (!force && layer()->HasSpec(path)) return "another user has created it again";
    if (!force && after_.others->changedSpec(path, written_))
        return "another user has deleted it since";
    if (!layer()->HasSpec(ownerOf(path))) return "its parent is no longer there";
    pxr::SdfCopySpec(before_.specs, path, layer(), path);
    return {};
}

void ScopeDifference::arrangeChildren(bool force, const std::vector<SdfPath>& restored) const {
    for (const auto& [parent, order] : before_.order) {
        if (primChildren(layer(), parent) == order) continue;
        std::set<TfToken> names;
        if (force || isOrderAsWritten(parent)) names.insert(order.begin(), order.end());
        for (const SdfPath& path : restored)
            if (path.GetParentPath() == parent) names.insert(path.GetNameToken());
        arrange(layer(), parent, order, names);
    }
}

// Returns true if nobody has moved the children that existed all the time.
bool ScopeDifference::isOrderAsWritten(const SdfPath& parent) const {
    const auto after = after_.order.find(parent);
    if (after == after_.order.end()) return primChildren(layer(), parent).empty();
    const TfTokenVector& written = after->second;
    const TfTokenVector& earlier = before_.order.at(parent);
    const auto common = [&](const TfTokenVector& names) {
        TfTokenVector both;
        std::ranges::copy_if(names, std::back_inserter(both), [&](const TfToken& name) {
            return std::ranges::find(written, name) != written.end() &&
                   std::ranges::find(earlier, name) != earlier.end();
        });
        return both;
    };
    return common(primChildren(layer(), parent)) == common(written);
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
    for (auto difference = differences_->rbegin(); difference != differences_->rend(); ++difference)
        difference->undo(!isShared(difference->layer()), kept);
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
    auto differences = *differences_;
    for (ScopeDifference& difference : differences | std::views::reverse) {
        const auto since = written.find(difference.layer());
        if (since == written.end() || !isShared(difference.layer())) continue;
        difference.setWritten(since->second);
        difference.keepOthers(replaced.at(difference.layer()), kept);
    }
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
    scopes_.back()->keepSpecs();
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
    scopes_.clear();
    touched_.clear();
    return Record(std::exchange(closed_, {}));
}

}  // namespace usdlive::content
