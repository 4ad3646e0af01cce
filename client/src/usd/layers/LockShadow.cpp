// Copies the locked content of a layer, and restores it.
#include "usd/layers/LockShadow.h"

#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "usd/content/MappedValue.h"
#include "usd/content/SpecEdits.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::layers {

using pxr::SdfLayerHandle;
using pxr::SdfPath;

namespace {

// Copies the spec's own fields from `from` to `to`. Returns true if a field differed.
bool copyOwnFields(const SdfLayerHandle& from, const SdfLayerHandle& to, const SdfPath& path) {
    bool changed = false;
    auto fields = from->ListFields(path);
    for (const auto& field : to->ListFields(path))
        if (std::ranges::find(fields, field) == fields.end()) fields.push_back(field);
    for (const auto& field : fields) {
        if (usd::isStructural(field)) continue;
        const auto value = from->GetField(path, field), present = to->GetField(path, field);
        if (value == present) continue;
        changed = true;
        if (content::isListOp(value) || content::isListOp(present))
            content::setListOp(to, path, field, value);
        else if (value.IsEmpty())
            to->EraseField(path, field);
        else
            to->SetField(path, field, value);
    }
    return changed;
}

bool copyWholeSpec(const SdfLayerHandle& from, const SdfLayerHandle& to, const SdfPath& path) {
    const SdfPath parent = path.GetParentPath();
    if (parent.IsPrimPath() && !to->HasSpec(parent) && !pxr::SdfJustCreatePrimInLayer(to, parent))
        return false;
    return pxr::SdfCopySpec(from, path, to, path);
}

}  // namespace

LockShadow::LockShadow(const SdfLayerHandle& layer, const SpecLockTable& locks) {
    take(layer, locks);
}

void LockShadow::take(const SdfLayerHandle& layer, const SpecLockTable& locks) {
    edits_ = {};
    content_ = pxr::SdfLayer::CreateAnonymous(".usda");
    SdfPath top;
    for (const auto& [path, owner] : locks.inEffect()) {
        // Sorted: specs below a locked prim are copied with it.
        if (!top.IsEmpty() && path.HasPrefix(top)) continue;
        if (path.IsPrimPath()) top = path;
        if (layer->HasSpec(path)) copyWholeSpec(layer, content_, path);
    }
}

bool LockShadow::isLike(const SdfLayerHandle& layer, const SdfPath& there,
                        const SdfPath& path) const {
    std::vector<SdfPath> specs;
    content_->Traverse(path, [&](const SdfPath& spec) { specs.push_back(spec); });
    std::size_t count = 0;
    layer->Traverse(there, [&](const SdfPath&) { ++count; });
    return count == specs.size() && std::ranges::all_of(specs, [&](const SdfPath& spec) {
               const SdfPath other = spec.ReplacePrefix(path, there);
               if (!layer->HasSpec(other)) return false;
               const auto fields = content_->ListFields(spec);
               return fields.size() == layer->ListFields(other).size() &&
                      std::ranges::all_of(fields, [&](const auto& field) {
                          return content_->GetField(spec, field) == layer->GetField(other, field);
                      });
           });
}

void LockShadow::adopt(const SdfLayerHandle& layer, const SdfPath& path) {
    if (layer->HasSpec(path) && has(path))
        copyOwnFields(layer, content_, path);
    else if (layer->HasSpec(path))
        copyWholeSpec(layer, content_, path);
    else if (has(path))
        content::removeSpec(content_, path);
}

bool LockShadow::restoreFields(const SdfLayerHandle& layer, const SdfPath& path) const {
    return copyOwnFields(content_, layer, path);
}

bool LockShadow::restoreSpec(const SdfLayerHandle& layer, const SdfPath& path) const {
    return copyWholeSpec(content_, layer, path);
}

void LockShadow::note(const SdfLayerHandle& layer, const pxr::SdfChangeList& changes, bool applied,
                      const SpecLockTable& locks) {
    for (const auto& [path, entry] : changes.GetEntryList()) {
        if (entry.flags.didReplaceContent) return take(layer, locks);
        const SdfPath spec =
            path.ContainsTargetPath() ? path.GetPrimOrPrimVariantSelectionPath() : path;
        if (spec == SdfPath::AbsoluteRootPath()) continue;
        const SdfPath composed = spec.StripAllVariantSelections();
        auto& noted = applied ? edits_.applied : edits_.changed;
        if (locks.covers(composed) || locks.hasLockBelow(composed)) noted.insert(spec);
        if (entry.flags.didRename) noted.insert(entry.oldPath);
        if (applied) continue;
        if (entry.flags.didRename) edits_.renamed[entry.oldPath] = path;
        if (entry.flags.didAddInertPrim || entry.flags.didAddNonInertPrim)
            edits_.added.insert(path);
    }
}

LockShadow::Edits LockShadow::takeEdits() { return std::exchange(edits_, {}); }

}  // namespace usdlive::layers
