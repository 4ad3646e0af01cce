// Reads and writes the properties of a schema of a prim.
#include "usdlive/plugins/schema/SchemaAccess.h"

#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/opaqueValue.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>

#include <algorithm>

#include "usdlive/client/usd/schema/SchemaRegistry.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::schemas {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::TfTokenVector;

namespace {

const TfToken& apiSchemasField() {
    static const TfToken field("apiSchemas");
    return field;
}

bool contains(const TfTokenVector& names, const TfToken& name) {
    return std::ranges::find(names, name) != names.end();
}

// A property of the schema, and the prim's spec that it is written to.
struct Target {
    const schema::PropertyDefinition* definition = nullptr;
    pxr::SdfPrimSpecHandle prim;
    TfToken name;
};

Result<pxr::SdfPrimSpecHandle> specOf(stage::Stage& stage, const SdfPath& path) {
    const usd::TfComplaints complaints;
    if (auto spec = stage.editTarget().primSpec(path)) return spec;
    return fail(ErrorCode::InvalidArgument,
                "cannot edit <" + path.GetString() + ">: " +
                    complaints.text("the stage's edit target does not reach it, or its "
                                    "layer may not be edited"));
}

Result<Target> targetOf(const stage::Prim& prim, const TfToken& identifier, const TfToken& base,
                        const TfToken& name) {
    const auto* schema = prim.stage().schemas().schemaDefinition(identifier);
    if (!schema)
        return fail(ErrorCode::InvalidArgument,
                    "schema '" + identifier.GetString() +
                        "' is unknown. Is the folder of its plug-in in PXR_PLUGINPATH_NAME?");
    const auto* definition = schema->property(base);
    if (!definition)
        return fail(ErrorCode::InvalidArgument, "schema '" + identifier.GetString() +
                                                    "' has no property '" + base.GetString() + "'");
    auto spec = specOf(prim.stage(), prim.path());
    if (!spec) return tl::unexpected(spec.error());
    return Target{definition, *spec, name};
}

Result<void> cannotWrite(const Target& target, const usd::TfComplaints& complaints) {
    return fail(ErrorCode::InvalidArgument,
                "cannot write <" + target.prim->GetPath().AppendProperty(target.name).GetString() +
                    ">: " + complaints.text("its type does not fit"));
}

}  // namespace

SchemaAccess::SchemaAccess(stage::Prim prim, const char* identifier, const std::string& instance)
    : prim_(std::move(prim)), identifier_(identifier), instance_(instance) {}

TfToken SchemaAccess::appliedName() const {
    return instance_.IsEmpty() ? identifier_
                               : TfToken(identifier_.GetString() + ":" + instance_.GetString());
}

TfToken SchemaAccess::propertyName(const char* name) const {
    const TfToken token(name);
    return schema::isNameTemplate(token) ? schema::withInstanceName(token, instance_) : token;
}

bool SchemaAccess::isValid() const {
    if (!prim_) return false;
    const auto* schema = prim_.stage().schemas().find(identifier_);
    if (schema && schema->kind == schema::SchemaKind::NonAppliedApi) return true;
    return contains(prim_.appliedSchemas(), appliedName()) ||
           prim_.stage().schemas().isA(prim_.typeName(), identifier_);
}

pxr::VtValue SchemaAccess::valueOf(const char* name, std::optional<double> time) const {
    const auto property = prim_.property(propertyName(name));
    return property && property.isAttribute() ? property.value(time) : pxr::VtValue();
}

Result<void> SchemaAccess::set(const char* name, const pxr::VtValue& value,
                               std::optional<double> time) const {
    const auto target = targetOf(prim_, identifier_, TfToken(name), propertyName(name));
    if (!target) return tl::unexpected(target.error());
    if (value.IsHolding<pxr::SdfOpaqueValue>())
        return fail(ErrorCode::InvalidArgument,
                    "'" + target->name.GetString() + "' is opaque and has no values");
    const usd::TfComplaints complaints;
    const pxr::SdfChangeBlock block;
    const auto layer = target->prim->GetLayer();
    const SdfPath path = target->prim->GetPath().AppendProperty(target->name);
    if (!layer->GetAttributeAtPath(path) &&
        !pxr::SdfAttributeSpec::New(target->prim, target->name.GetString(),
                                    target->definition->type(), target->definition->variability,
                                    target->definition->custom))
        return cannotWrite(*target, complaints);
    if (time)
        layer->SetTimeSample(path, prim_.stage().editTarget().layerTime(*time), value);
    else
        layer->SetField(path, pxr::SdfFieldKeys->Default, value);
    return {};
}

pxr::SdfPathVector SchemaAccess::targets(const char* name) const {
    const auto property = prim_.property(propertyName(name));
    return property ? property.targets() : pxr::SdfPathVector();
}

Result<void> SchemaAccess::setTargets(const char* name, const pxr::SdfPathVector& targets) const {
    const auto target = targetOf(prim_, identifier_, TfToken(name), propertyName(name));
    if (!target) return tl::unexpected(target.error());
    pxr::SdfPathVector mapped;
    for (const auto& path : targets) {
        mapped.push_back(prim_.stage().editTarget().specPath(path));
        if (mapped.back().IsEmpty())
            return fail(ErrorCode::InvalidPath, "cannot target <" + path.GetString() +
                                                    ">: the edit target does not reach it");
    }
    const usd::TfComplaints complaints;
    const pxr::SdfChangeBlock block;
    const SdfPath path = target->prim->GetPath().AppendProperty(target->name);
    auto spec = target->prim->GetLayer()->GetRelationshipAtPath(path);
    if (!spec)
        spec = pxr::SdfRelationshipSpec::New(target->prim, target->name.GetString(),
                                             target->definition->custom,
                                             target->definition->variability);
    if (!spec) return cannotWrite(*target, complaints);
    spec->GetLayer()->SetField(path, pxr::SdfFieldKeys->TargetPaths,
                               pxr::SdfPathListOp::CreateExplicit(mapped));
    return {};
}

Result<void> SchemaAccess::applyToPrim() const {
    std::string whyNot;
    if (!prim_.stage().schemas().canApply(appliedName(), prim_.typeName(), &whyNot))
        return fail(ErrorCode::InvalidArgument, "<" + prim_.path().GetString() + ">: " + whyNot);
    const auto spec = specOf(prim_.stage(), prim_.path());
    if (!spec) return tl::unexpected(spec.error());
    auto list = (*spec)->GetInfo(apiSchemasField()).GetWithDefault<pxr::SdfTokenListOp>();
    const bool isExplicit = list.IsExplicit();
    auto names = isExplicit ? list.GetExplicitItems() : list.GetPrependedItems();
    if (contains(names, appliedName())) return {};
    names.push_back(appliedName());
    if (isExplicit)
        list.SetExplicitItems(names);
    else
        list.SetPrependedItems(names);
    (*spec)->SetInfo(apiSchemasField(), pxr::VtValue(list));
    return {};
}

Result<void> SchemaAccess::removeFromPrim() const {
    const auto spec = specOf(prim_.stage(), prim_.path());
    if (!spec) return tl::unexpected(spec.error());
    auto list = (*spec)->GetInfo(apiSchemasField()).GetWithDefault<pxr::SdfTokenListOp>();
    const auto without = [&](TfTokenVector names) {
        std::erase(names, appliedName());
        return names;
    };
    if (list.IsExplicit()) {
        list.SetExplicitItems(without(list.GetExplicitItems()));
    } else {
        list.SetPrependedItems(without(list.GetPrependedItems()));
        list.SetAppendedItems(without(list.GetAppendedItems()));
        list.SetAddedItems(without(list.GetAddedItems()));
        auto deleted = list.GetDeletedItems();
        if (!contains(deleted, appliedName())) deleted.push_back(appliedName());
        list.SetDeletedItems(deleted);
    }
    (*spec)->SetInfo(apiSchemasField(), pxr::VtValue(list));
    return {};
}

Result<stage::Prim> SchemaAccess::definePrim(stage::Stage& stage, const SdfPath& path,
                                             const char* type) {
    {
        const pxr::SdfChangeBlock block;
        for (const auto& prefix : path.GetPrefixes()) {
            const auto prim = stage.prim(prefix);
            if (prefix != path && prim && prim.has(stage::PrimFlag::Defined)) continue;
            const auto spec = specOf(stage, prefix);
            if (!spec) return tl::unexpected(spec.error());
            (*spec)->SetSpecifier(pxr::SdfSpecifierDef);
            if (prefix == path) (*spec)->SetTypeName(type);
        }
    }
    if (auto prim = stage.prim(path)) return prim;
    return fail(ErrorCode::InvalidPath,
                "cannot define <" + path.GetString() +
                    ">: it is no path of a prim, or a prim above it is inactive or not loaded");
}

}  // namespace usdlive::schemas
