// Checks what a provider writes, and stores it as specs.
#include "SourceData.h"

#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include <utility>

namespace usdlive::edf {

using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Some 1.5 GB in SdfData.
constexpr std::size_t kMaxSpecs = 2'000'000;
constexpr int kMaxWarnings = 20;

}  // namespace

SourceData::SourceData(SdfPath root, Adds adds, pxr::SdfDataRefPtr into, std::string label,
                       std::shared_ptr<std::atomic<bool>> isCancelled)
    : root_(std::move(root)),
      adds_(adds),
      label_(std::move(label)),
      isCancelled_(std::move(isCancelled)),
      data_(std::move(into)) {
    data_->CreateSpec(root_, pxr::SdfSpecTypePrim);
}

bool SourceData::refuse(const std::string& reason) {
    if (refusal_.empty()) refusal_ = reason;
    return false;
}

bool SourceData::isPrim(const SdfPath& path) const {
    return data_->GetSpecType(path) == pxr::SdfSpecTypePrim;
}

bool SourceData::CreatePrim(const SdfPath& parent, const std::string& name,
                            pxr::SdfSpecifier specifier, const TfToken& typeName) {
    if (!isPrim(parent))
        return refuse("there is no prim " + parent.GetAsString() + " for the child " + name);
    if (!SdfPath::IsValidIdentifier(name)) return refuse("'" + name + "' is no name of a prim");
    if (!typeName.IsEmpty() && !SdfPath::IsValidIdentifier(typeName.GetString()))
        return refuse("'" + typeName.GetString() + "' is no type of a prim");
    if (specifier < pxr::SdfSpecifierDef || specifier >= pxr::SdfNumSpecifiers)
        return refuse("unknown specifier of " + name);
    const TfToken token(name);
    const SdfPath path = parent.AppendChild(token);
    if (data_->HasSpec(path)) return refuse(path.GetAsString() + " was created twice");
    if (++specs_ > kMaxSpecs)
        return refuse("more than " + std::to_string(kMaxSpecs) + " prims and properties");
    data_->CreateSpec(path, pxr::SdfSpecTypePrim);
    data_->Set(path, SdfFieldKeys->Specifier, VtValue(specifier));
    if (!typeName.IsEmpty()) data_->Set(path, SdfFieldKeys->TypeName, VtValue(typeName));
    children_[parent].prims.push_back(token);
    return true;
}

bool SourceData::createProperty(const SdfPath& prim, const TfToken& name, pxr::SdfSpecType type) {
    if (!isPrim(prim) || (prim == root_ && adds_ == Adds::ChildrenOnly))
        return refuse("there is no prim " + prim.GetAsString() + " for the property " +
                      name.GetString());
    if (!SdfPath::IsValidNamespacedIdentifier(name.GetString()))
        return refuse("'" + name.GetString() + "' is no name of a property");
    const SdfPath path = prim.AppendProperty(name);
    if (data_->HasSpec(path)) return refuse(path.GetAsString() + " was created twice");
    if (++specs_ > kMaxSpecs)
        return refuse("more than " + std::to_string(kMaxSpecs) + " prims and properties");
    data_->CreateSpec(path, type);
    children_[prim].properties.push_back(name);
    return true;
}

bool SourceData::CreateAttribute(const SdfPath& prim, const TfToken& name,
                                 const pxr::SdfValueTypeName& typeName,
                                 pxr::SdfVariability variability, const VtValue& value) {
    if (!typeName)
        return refuse("the attribute " + name.GetString() + " of " + prim.GetAsString() +
                      " has no type");
    if (!createProperty(prim, name, pxr::SdfSpecTypeAttribute)) return false;
    const SdfPath path = prim.AppendProperty(name);
    data_->Set(path, SdfFieldKeys->TypeName, VtValue(typeName.GetAsToken()));
    data_->Set(path, SdfFieldKeys->Variability, VtValue(variability));
    return value.IsEmpty() || setDefault(path, typeName.GetType(), value);
}

bool SourceData::setDefault(const SdfPath& attribute, const pxr::TfType& type,
                            const VtValue& value) {
    if (value.GetType() != type)
        return refuse("the value of " + attribute.GetAsString() + " is of type " +
                      value.GetTypeName() + ", not " + type.GetTypeName());
    data_->Set(attribute, SdfFieldKeys->Default, value);
    return true;
}

bool SourceData::CreateRelationship(const SdfPath& prim, const TfToken& name,
                                    const pxr::SdfPathVector& targets) {
    if (!createProperty(prim, name, pxr::SdfSpecTypeRelationship)) return false;
    const SdfPath path = prim.AppendProperty(name);
    for (const SdfPath& target : targets)
        if (!target.IsAbsolutePath())
            return refuse(path.GetAsString() + " has a target that is no absolute path");
    data_->Set(path, SdfFieldKeys->Variability, VtValue(pxr::SdfVariabilityUniform));
    data_->Set(path, SdfFieldKeys->TargetPaths,
               VtValue(pxr::SdfPathListOp::CreateExplicit(targets)));
    return true;
}

bool SourceData::SetField(const SdfPath& path, const TfToken& field, const VtValue& value) {
    const auto place = path.GetAsString() + ": ";
    const auto type = data_->GetSpecType(path);
    if (type == pxr::SdfSpecTypeUnknown || (path == root_ && adds_ == Adds::ChildrenOnly))
        return refuse(place + "there is nothing to set " + field.GetString() + " on");
    const auto& schema = pxr::SdfSchema::GetInstance();
    const auto* definition = schema.GetFieldDefinition(field);
    if (!definition || !schema.IsValidFieldForSpec(field, type))
        return refuse(place + "the field " + field.GetString() + " is unknown here");
    if (definition->HoldsChildren() || definition->IsReadOnly())
        return refuse(place + "the field " + field.GetString() + " cannot be set");
    if (value.IsEmpty()) return refuse(place + "no value for the field " + field.GetString());
    if (field == SdfFieldKeys->Default && type == pxr::SdfSpecTypeAttribute) {
        const auto named = schema.FindType(data_->GetAs<TfToken>(path, SdfFieldKeys->TypeName));
        return setDefault(path, named.GetType(), value);
    }
    if (!definition->GetFallbackValue().IsEmpty() &&
        value.GetTypeid() != definition->GetFallbackValue().GetTypeid())
        return refuse(place + "the field " + field.GetString() + " is of type " +
                      value.GetTypeName() + ", not " +
                      definition->GetFallbackValue().GetTypeName());
    if (const auto allowed = definition->IsValidValue(value); !allowed)
        return refuse(place + "the value of " + field.GetString() +
                      " is not allowed: " + allowed.GetWhyNot());
    data_->Set(path, field, value);
    return true;
}

bool SourceData::HasField(const SdfPath& path, const TfToken& field) const {
    return data_->Has(path, field);
}

bool SourceData::HasAttribute(const SdfPath& attribute) const {
    return data_->GetSpecType(attribute) == pxr::SdfSpecTypeAttribute;
}

bool SourceData::DeferChildren(const SdfPath& prim) {
    if (!isPrim(prim) || prim == root_)
        return refuse("the children of " + prim.GetAsString() + " cannot be deferred");
    deferred_.insert(prim);
    return true;
}

void SourceData::Warn(const std::string& text) {
    if (IsCancelled() || ++warnings_ > kMaxWarnings) return;
    TF_WARN("edf: %s: %s", label_.c_str(), text.c_str());
}

void SourceData::finish() {
    for (auto& [path, children] : children_) {
        if (!children.prims.empty())
            data_->Set(path, pxr::SdfChildrenKeys->PrimChildren, VtValue::Take(children.prims));
        if (!children.properties.empty())
            data_->Set(path, pxr::SdfChildrenKeys->PropertyChildren,
                       VtValue::Take(children.properties));
    }
    for (const SdfPath& path : deferred_)
        if (children_.contains(path) && data_->Has(path, pxr::SdfChildrenKeys->PrimChildren))
            refuse("the children of " + path.GetAsString() + " are deferred, and were created");
}

}  // namespace usdlive::edf
