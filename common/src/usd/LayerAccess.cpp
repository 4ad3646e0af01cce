// Reads and replaces the data of an SdfLayer below its public API, and checks the types of fields.
#include "LayerAccess.h"

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <unordered_set>

#include "LeafCodec.h"
#include "RegisteredMetadata.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::usd {

namespace {

// Gives access to functions that Sdf reserves for file formats.
class FormatAccess : public pxr::SdfFileFormat {
public:
    using pxr::SdfFileFormat::_GetLayerData;
    using pxr::SdfFileFormat::_SetLayerData;
};

// Sdf has this function for itself only (SdfLayer::_SwapData). An explicit template instantiation
// may name private members.
pxr::SdfAbstractDataRefPtr& dataOf(pxr::SdfLayer& layer);
template <pxr::SdfAbstractDataRefPtr pxr::SdfLayer::* Data>
struct LayerData {
    friend pxr::SdfAbstractDataRefPtr& dataOf(pxr::SdfLayer& layer) { return layer.*Data; }
};
template struct LayerData<&pxr::SdfLayer::_data>;

bool isSubLayers(const pxr::SdfPath& path, const pxr::TfToken& field) {
    return field == pxr::SdfFieldKeys->SubLayers && path == pxr::SdfPath::AbsoluteRootPath();
}

Result<ListOp> readSubLayers(const pxr::SdfAbstractData& data, const pxr::VtValue& value) {
    if (!value.IsHolding<std::vector<std::string>>())
        return fail(ErrorCode::UnsupportedValue, "is of type " + value.GetTypeName());
    const auto& assets = value.UncheckedGet<std::vector<std::string>>();
    const auto offsets =
        data.Get(pxr::SdfPath::AbsoluteRootPath(), pxr::SdfFieldKeys->SubLayerOffsets)
            .GetWithDefault<pxr::SdfLayerOffsetVector>();
    ListOp list;
    list.itemType = ValueType::SubLayer;
    list.isExplicit = true;
    for (std::size_t index = 0; index < assets.size(); ++index) {
        const auto offset = index < offsets.size() ? offsets[index] : pxr::SdfLayerOffset();
        Bytes bytes;
        appendText(bytes, assets[index]);
        appendNumber<double>(bytes, offset.GetOffset());
        appendNumber<double>(bytes, offset.GetScale());
        if (auto valid = validateValue(ValueType::SubLayer, bytes); !valid)
            return fail(ErrorCode::UnsupportedValue, valid.error().message);
        list[ListName::Explicit].emplace_back(ValueType::SubLayer, std::move(bytes));
    }
    return list;
}

Result<DecodedField> decodeSubLayers(const FieldValue& value) {
    const auto* list = value.as<ListOp>();
    if (!list || !list->isExplicit || list->itemType != ValueType::SubLayer)
        return fail(ErrorCode::InvalidValue, "subLayers is not an explicit list of sublayers");
    std::vector<std::string> assets;
    pxr::SdfLayerOffsetVector offsets;
    for (const Value& item : (*list)[ListName::Explicit]) {
        ByteReader in(item.bytes());
        assets.emplace_back(in.text());
        const double offset = in.f64();
        const double scale = in.f64();
        if (!in.finished() || item.type() != ValueType::SubLayer)
            return fail(ErrorCode::InvalidValue, "an item of subLayers is not a sublayer");
        offsets.emplace_back(offset, scale);
    }
    return DecodedField{pxr::VtValue::Take(assets), std::move(offsets)};
}

}  // namespace

bool isStructural(const pxr::TfToken& field) {
    const auto& children = pxr::SdfChildrenKeys->allTokens;
    return std::ranges::find(children, field) != children.end() ||
           field == pxr::SdfFieldKeys->SubLayerOffsets;
}

pxr::SdfAbstractDataConstPtr layerData(const pxr::SdfLayer& layer) {
    return FormatAccess::_GetLayerData(layer);
}

void setLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr data) {
    FormatAccess::_SetLayerData(get_pointer(layer), data);
}

void swapLayerData(const pxr::SdfLayerHandle& layer, pxr::SdfAbstractDataRefPtr& data) {
    dataOf(*layer).swap(data);
}

const pxr::TfToken& childrenField(ChildList list) {
    switch (list) {
        case ChildList::Prims:
            return pxr::SdfChildrenKeys->PrimChildren;
        case ChildList::Properties:
            return pxr::SdfChildrenKeys->PropertyChildren;
        case ChildList::VariantSets:
            return pxr::SdfChildrenKeys->VariantSetChildren;
        case ChildList::Variants:
            break;
    }
    return pxr::SdfChildrenKeys->VariantChildren;
}

std::optional<SpecKind> specKind(pxr::SdfSpecType type) {
    switch (type) {
        case pxr::SdfSpecTypeAttribute:
        case pxr::SdfSpecTypePrim:
        case pxr::SdfSpecTypePseudoRoot:
        case pxr::SdfSpecTypeRelationship:
        case pxr::SdfSpecTypeVariant:
        case pxr::SdfSpecTypeVariantSet:
            return SpecKind(type);
        default:
            return std::nullopt;
    }
}

pxr::SdfPath parentOf(const pxr::SdfPath& path) {
    if (!path.IsPrimVariantSelectionPath()) return path.GetParentPath();
    const auto [set, variant] = path.GetVariantSelection();
    if (variant.empty()) return path.GetParentPath();
    return path.GetParentPath().AppendVariantSelection(set, {});
}

pxr::SdfPath childOf(const pxr::SdfPath& parent, ChildList list, const pxr::TfToken& name) {
    switch (list) {
        case ChildList::Prims:
            return parent.AppendChild(name);
        case ChildList::Properties:
            return parent.AppendProperty(name);
        case ChildList::VariantSets:
            return parent.AppendVariantSelection(name.GetString(), {});
        case ChildList::Variants:
            break;
    }
    const auto set = parent.GetVariantSelection().first;
    return parent.GetParentPath().AppendVariantSelection(set, name.GetString());
}

Result<std::optional<FieldValue>> readField(const pxr::SdfAbstractData& data,
                                            const pxr::SdfPath& path, const pxr::TfToken& field,
                                            BlobSink& blobs) {
    pxr::VtValue value;
    if (!data.Has(path, field, &value) || value.IsEmpty()) return std::nullopt;
    if (isSubLayers(path, field)) {
        auto list = readSubLayers(data, value);
        if (!list) return tl::unexpected(within(list.error(), path, field));
        return FieldValue(*std::move(list));
    }
    // A dictionary is always decoded as one, so that its keys merge, whether or not a plug-in
    // declares the field here.
    const auto* unregistered = value.IsHolding<pxr::SdfUnregisteredValue>()
                                   ? &value.UncheckedGet<pxr::SdfUnregisteredValue>().GetValue()
                                   : nullptr;
    const bool dictionary = unregistered && unregistered->IsHolding<pxr::VtDictionary>();
    auto content = encodeValue(dictionary ? *unregistered : value, blobs);
    if (!content) return tl::unexpected(within(content.error(), path, field));
    return *std::move(content);
}

Result<DecodedField> decodeField(const pxr::SdfPath& path, const pxr::TfToken& field,
                                 const FieldValue& value, BlobSource& blobs) {
    if (isSubLayers(path, field)) return decodeSubLayers(value);
    auto decoded = decodeValue(field, value, blobs);
    if (!decoded) return tl::unexpected(within(decoded.error(), path, field));
    *decoded = asRegistered(path, field, *std::move(decoded));
    if (auto proper = checkType(path, field, decoded->GetTypeid()); !proper)
        return tl::unexpected(proper.error());
    return DecodedField{*std::move(decoded), std::nullopt};
}

Result<void> checkType(const pxr::SdfPath& path, const pxr::TfToken& field,
                       const std::type_info& type) {
    if (field != pxr::SdfFieldKeys->Active && field != pxr::SdfFieldKeys->Kind) return {};
    if (type == pxr::SdfSchema::GetInstance().GetFallback(field).GetTypeid()) return {};
    return fail(ErrorCode::InvalidValue, path.GetAsString() + ", field " + field.GetString() +
                                             ": has a type that this field does not support");
}

std::optional<TargetFields> targetFields(std::optional<SpecKind> kind, const pxr::TfToken& field) {
    if (kind == SpecKind::Relationship && field == pxr::SdfFieldKeys->TargetPaths)
        return TargetFields{field, pxr::SdfChildrenKeys->RelationshipTargetChildren,
                            pxr::SdfSpecTypeRelationshipTarget};
    if (kind == SpecKind::Attribute && field == pxr::SdfFieldKeys->ConnectionPaths)
        return TargetFields{field, pxr::SdfChildrenKeys->ConnectionChildren,
                            pxr::SdfSpecTypeConnection};
    return std::nullopt;
}

pxr::SdfPathVector targetsIn(const pxr::VtValue& value) {
    if (!value.IsHolding<pxr::SdfPathListOp>()) return {};
    const auto& op = value.UncheckedGet<pxr::SdfPathListOp>();
    pxr::SdfPathVector targets;
    std::unordered_set<pxr::SdfPath, pxr::SdfPath::Hash> seen;
    for (const auto* items : {&op.GetExplicitItems(), &op.GetAddedItems(), &op.GetPrependedItems(),
                              &op.GetAppendedItems()})
        for (const pxr::SdfPath& target : *items)
            // The target paths that Sdf itself accepts.
            if (target.IsAbsolutePath() && !target.ContainsPrimVariantSelection() &&
                seen.insert(target).second)
                targets.push_back(target);
    return targets;
}

Error within(const Error& error, const pxr::SdfPath& path, const pxr::TfToken& field) {
    return {error.code, path.GetAsString() + ", field " + field.GetString() + ": " + error.message};
}

}  // namespace usdlive::usd
