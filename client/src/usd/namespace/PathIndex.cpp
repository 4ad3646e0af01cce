// Keeps an index of the fields that refer to paths, so that an edit does not read the whole stage.
#include "usd/namespace/PathIndex.h"

#include <algorithm>
#include <iterator>

namespace usdlive::naming {

using pxr::SdfPath;

namespace {

// After more renames, reading the layer again costs less than following them.
constexpr std::size_t kMaxMoves = 64;
// Entries of earlier values stay in the index. After this many, the layer is read again.
constexpr std::size_t kMaxStale = 100'000;

bool isNew(const pxr::SdfChangeList::Entry& entry) {
    const auto& flags = entry.flags;
    return flags.didAddInertPrim || flags.didAddNonInertPrim || flags.didAddProperty ||
           flags.didAddPropertyWithOnlyRequiredFields || flags.didChangePrimVariantSets;
}

// Returns true if the renames have the same result in any order. The result of a swap depends on
// the order.
bool areIndependent(const PathMoves& renames) {
    pxr::SdfPathVector paths;
    for (const auto& [from, to] : renames) paths.insert(paths.end(), {from, to});
    std::ranges::sort(paths);  // a path is before all paths below it
    return std::ranges::adjacent_find(paths, [](const SdfPath& one, const SdfPath& next) {
               return next.HasPrefix(one);
           }) == paths.end();
}

}  // namespace

void LayerPaths::read() {
    if (isRead_ || !layer_) return;
    byTarget_.clear();
    moves_.clear();
    entries_ = 0;
    readBelow(SdfPath::AbsoluteRootPath());
    entriesOfLayer_ = entries_;
    isRead_ = true;
}

void LayerPaths::readBelow(const SdfPath& path) {
    if (layer_->HasSpec(path))
        layer_->Traverse(path, [this](const SdfPath& spec) { readSpec(spec); });
}

void LayerPaths::readSpec(const SdfPath& spec) {
    pxr::SdfPathSet paths;
    visitPathFields(layer_, spec, [&](const pxr::TfToken&, const pxr::VtValue& value) {
        collectPaths(value, paths);
    });
    for (const SdfPath& path : paths)
        if (path.IsAbsolutePath()) {
            byTarget_[path].push_back({spec, moves_.size()});
            ++entries_;
        }
}

void LayerPaths::follow(const pxr::SdfChangeList& changes) {
    if (!isRead_) return;
    const auto& entries = changes.GetEntryList();
    PathMoves renames;
    for (const auto& [path, entry] : entries)
        if (entry.flags.didRename && !entry.oldPath.IsEmpty())
            renames.push_back({entry.oldPath, path});
    if (!areIndependent(renames) || moves_.size() + renames.size() > kMaxMoves) return forget();
    moves_.insert(moves_.end(), renames.begin(), renames.end());
    const PathMap renamed(renames);
    for (const auto& [path, entry] : entries) {
        if (entry.flags.didReplaceContent || entry.flags.didReloadContent ||
            entries_ > 2 * entriesOfLayer_ + kMaxStale)
            return forget();
        // The entries have no order in time. A spec may have changed before it was renamed.
        const SdfPath now = renamed.after(path);
        readChanged(path, entry);
        if (now != path) readChanged(now, entry);
    }
}

void LayerPaths::readChanged(const SdfPath& path, const pxr::SdfChangeList::Entry& entry) {
    if (isNew(entry))
        readBelow(path);
    else if (layer_->HasSpec(path))
        readSpec(path);
}

void LayerPaths::specsWithPathsTo(const SdfPath& path, pxr::SdfPathVector& specs) {
    read();
    const auto [begin, end] = byTarget_.FindSubtreeRange(path);
    for (auto at = begin; at != end; ++at)
        for (const auto& entry : at->second) {
            SdfPath spec = entry.spec;
            for (std::size_t i = entry.moved; i < moves_.size(); ++i)
                spec = spec.ReplacePrefix(moves_[i].from, moves_[i].to);
            specs.push_back(spec);
        }
}

PathIndex::PathIndex() {
    changedKey_ = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &PathIndex::onChanged);
}

PathIndex::~PathIndex() { pxr::TfNotice::Revoke(changedKey_); }

void PathIndex::onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice) {
    if (std::this_thread::get_id() != thread_) {
        stale_ = true;
        return;
    }
    for (const auto& [layer, changes] : notice.GetChangeListVec())
        if (const auto known = layers_.find(layer); known != layers_.end())
            known->second.follow(changes);
}

LayerPaths& PathIndex::of(const pxr::SdfLayerHandle& layer) {
    if (stale_.exchange(false))
        for (auto& [known, paths] : layers_) paths.forget();
    return layers_.try_emplace(layer, layer).first->second;
}

void PathIndex::keepOnly(const std::set<pxr::SdfLayerHandle>& layers) {
    std::erase_if(layers_, [&](const auto& entry) { return !layers.contains(entry.first); });
}

}  // namespace usdlive::naming
