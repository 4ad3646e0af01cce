// Creates, removes and moves specs.
#include "usd/content/SpecEdits.h"

#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/listEditorProxy.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/propertySpec.h>
#include <pxr/usd/sdf/proxyTypes.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

namespace usdlive::content {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::VtValue;

namespace {

bool makeProperty(const SdfLayerHandle& layer, const SdfPath& path, const SdfLayerHandle& source,
                  const SdfPath& from) {
    const SdfPath owner = path.GetParentPath();
    if (!layer->HasSpec(owner) && !pxr::SdfJustCreatePrimInLayer(layer, owner)) return false;
    if (const auto attribute = source->GetAttributeAtPath(from))
        return pxr::SdfJustCreatePrimAttributeInLayer(layer, path, attribute->GetTypeName(),
                                                      attribute->GetVariability(),
                                                      attribute->IsCustom());
    const auto relationship = source->GetRelationshipAtPath(from);
    const auto prim = layer->GetPrimAtPath(owner);
    return relationship && prim &&
           pxr::SdfRelationshipSpec::New(prim, path.GetName(), relationship->IsCustom(),
                                         relationship->GetVariability());
}

// Creates the variant sets on the way to `path`. Sdf would move their names to the front of the
// list, where they are stronger.
bool makeVariantSets(const SdfLayerHandle& layer, const SdfPath& path) {
    for (const SdfPath& prefix : path.GetPrefixes()) {
        if (!prefix.IsPrimVariantSelectionPath()) continue;
        const SdfPath owner = prefix.GetParentPath();
        const std::string set = prefix.GetVariantSelection().first;
        if (layer->HasSpec(owner.AppendVariantSelection(set, ""))) continue;
        if (!layer->HasSpec(owner) && !pxr::SdfJustCreatePrimInLayer(layer, owner)) return false;
        const auto variant =
            pxr::TfDynamic_cast<pxr::SdfVariantSpecHandle>(layer->GetObjectAtPath(owner));
        const auto made = variant ? pxr::SdfVariantSetSpec::New(variant, set)
                                  : pxr::SdfVariantSetSpec::New(layer->GetPrimAtPath(owner), set);
        if (!made) return false;
        auto names = layer->GetPrimAtPath(owner)->GetVariantSetNameList();
        if (names.ContainsItemEdit(set)) continue;
        names.IsExplicit() ? names.GetExplicitItems().push_back(set)
                           : names.GetPrependedItems().push_back(set);
    }
    return true;
}

template <class Op, class Proxy>
void assign(Proxy proxy, const VtValue& value) {
    proxy.ClearEdits();
    if (!value.IsHolding<Op>()) return;
    const Op& op = value.UncheckedGet<Op>();
    if (op.IsExplicit()) {
        proxy.ClearEditsAndMakeExplicit();
        proxy.GetExplicitItems() = op.GetExplicitItems();
        return;
    }
    proxy.GetAddedItems() = op.GetAddedItems();
    proxy.GetPrependedItems() = op.GetPrependedItems();
    proxy.GetAppendedItems() = op.GetAppendedItems();
    proxy.GetDeletedItems() = op.GetDeletedItems();
    proxy.GetOrderedItems() = op.GetOrderedItems();
}

}  // namespace

bool makeSpecLike(const SdfLayerHandle& layer, const SdfPath& path, const SdfLayerHandle& source,
                  const SdfPath& from) {
    if (path.ContainsPrimVariantSelection() && !makeVariantSets(layer, path)) return false;
    if (path.IsPropertyPath()) return makeProperty(layer, path, source, from);
    if (!path.IsPrimOrPrimVariantSelectionPath()) return false;
    const bool isSet =
        path.IsPrimVariantSelectionPath() && path.GetVariantSelection().second.empty();
    return isSet || pxr::SdfJustCreatePrimInLayer(layer, path);
}

void removeSpec(const SdfLayerHandle& layer, const SdfPath& path) {
    if (!layer->HasSpec(path)) return;
    if (path.IsPrimVariantSelectionPath()) {
        const auto [set, variant] = path.GetVariantSelection();
        const SdfPath owner = path.GetParentPath();
        const auto sets = pxr::TfDynamic_cast<pxr::SdfVariantSetSpecHandle>(
            layer->GetObjectAtPath(owner.AppendVariantSelection(set, "")));
        if (!sets) return;
        if (!variant.empty()) {
            const auto spec =
                pxr::TfDynamic_cast<pxr::SdfVariantSpecHandle>(layer->GetObjectAtPath(path));
            if (spec) sets->RemoveVariant(spec);
        } else if (const auto prim = layer->GetPrimAtPath(owner)) {
            prim->RemoveVariantSet(set);
        }
        return;
    }
    pxr::SdfBatchNamespaceEdit edits;
    edits.Add(pxr::SdfNamespaceEdit::Remove(path));
    layer->Apply(edits);
}

void removeSpecs(const SdfLayerHandle& layer, const SdfPath& owner,
                 const std::set<SdfPath>& paths) {
    constexpr std::size_t kFew = 64;  // setting the list of those that stay takes as long
    const auto prim = layer->GetPrimAtPath(owner);
    if (paths.size() > kFew && prim && layer->PermissionToEdit()) {
        const auto isRemoved = [&](const auto& spec) { return paths.contains(spec->GetPath()); };
        auto prims = prim->GetNameChildren().values();
        if (std::erase_if(prims, isRemoved) > 0) prim->SetNameChildren(prims);
        auto properties = prim->GetProperties().values();
        if (std::erase_if(properties, isRemoved) > 0) prim->SetProperties(properties);
    }
    for (const SdfPath& path : paths) removeSpec(layer, path);
}

void moveSpec(const SdfLayerHandle& layer, const SdfPath& from, const SdfPath& to) {
    const bool renamed = from.GetParentPath() == to.GetParentPath();
    if (!renamed && to.IsPrimPath() && !layer->HasSpec(to.GetParentPath()))
        pxr::SdfJustCreatePrimInLayer(layer, to.GetParentPath());
    pxr::SdfBatchNamespaceEdit edits;
    edits.Add(from, to, renamed ? pxr::SdfNamespaceEdit::Same : pxr::SdfNamespaceEdit::AtEnd);
    layer->Apply(edits);
}

void setListOp(const SdfLayerHandle& layer, const SdfPath& path, const pxr::TfToken& field,
               const VtValue& value) {
    if (layer->GetField(path, field) == value) return;
    const auto& keys = pxr::SdfFieldKeys;
    if (field == keys->TargetPaths) {
        if (const auto relationship = layer->GetRelationshipAtPath(path))
            assign<pxr::SdfPathListOp>(relationship->GetTargetPathList(), value);
    } else if (field == keys->ConnectionPaths) {
        if (const auto attribute = layer->GetAttributeAtPath(path))
            assign<pxr::SdfPathListOp>(attribute->GetConnectionPathList(), value);
    } else if (field == keys->VariantSetNames) {
        if (const auto prim = layer->GetPrimAtPath(path))
            assign<pxr::SdfStringListOp>(prim->GetVariantSetNameList(), value);
    } else if (value.IsEmpty()) {
        layer->EraseField(path, field);
    } else {
        layer->SetField(path, field, value);
    }
}

}  // namespace usdlive::content
