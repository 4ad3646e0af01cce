// Builds prim definitions from the classes of generatedSchema.usda and from applied API schemas.
#include "usd/schema/DefinitionBuilder.h"

#include <pxr/base/tf/getenv.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <set>

namespace usdlive::schema {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::TfTokenVector;
using pxr::VtValue;

namespace {

// These fields have no fallback: composition and population ignore schemas, and custom data is only
// for the schema generator.
bool isWithoutFallback(const TfToken& field) {
    static const auto fields = [] {
        const auto& keys = *pxr::SdfFieldKeys;
        const auto& children = pxr::SdfChildrenKeys->allTokens;
        std::set<TfToken> all{keys.InheritPaths, keys.Payload,          keys.References,
                              keys.Specializes,  keys.VariantSelection, keys.VariantSetNames,
                              keys.CustomData,   keys.Active,           keys.Instanceable,
                              keys.TimeSamples,  keys.Spline,           keys.ConnectionPaths,
                              keys.TargetPaths,  keys.Specifier,        keys.Kind,
                              TfToken("clips"),  TfToken("clipSets")};
        all.insert(children.begin(), children.end());
        return all;
    }();
    return fields.contains(field);
}

Fields fallbackFields(const SdfLayerHandle& layer, const SdfPath& path) {
    Fields fields;
    for (const auto& field : layer->ListFields(path))
        if (!isWithoutFallback(field)) fields.emplace(field, layer->GetField(path, field));
    return fields;
}

template <class T>
T valueOf(const Fields& fields, const TfToken& name, T otherwise) {
    const auto found = fields.find(name);
    return found == fields.end() ? otherwise : found->second.GetWithDefault<T>(otherwise);
}

// Copies frequently read fields into the members.
void readMembers(PropertyDefinition& property) {
    const auto& keys = *pxr::SdfFieldKeys;
    property.typeName = valueOf(property.fields, keys.TypeName, TfToken());
    property.variability = valueOf(property.fields, keys.Variability, pxr::SdfVariabilityVarying);
    property.custom = valueOf(property.fields, keys.Custom, false);
    const auto fallback = property.fields.find(keys.Default);
    property.fallback = fallback == property.fields.end() ? VtValue() : fallback->second;
}

std::shared_ptr<PropertyDefinition> readProperty(const SdfLayerHandle& layer, const SdfPath& path) {
    auto property = std::make_shared<PropertyDefinition>();
    property->isAttribute = layer->GetSpecType(path) == pxr::SdfSpecTypeAttribute;
    property->fields = fallbackFields(layer, path);
    readMembers(*property);
    return property;
}

// Merges dictionaries. Documentation is not inherited, because it describes one schema.
void addFields(Fields& stronger, const Fields& weaker) {
    for (const auto& [field, value] : weaker) {
        if (field == pxr::SdfFieldKeys->Documentation) continue;
        auto& known = stronger[field];
        if (known.IsEmpty())
            known = value;
        else if (known.IsHolding<pxr::VtDictionary>() && value.IsHolding<pxr::VtDictionary>())
            known = pxr::VtDictionaryOverRecursive(known.UncheckedGet<pxr::VtDictionary>(),
                                                   value.UncheckedGet<pxr::VtDictionary>());
    }
}

bool haveOneType(const PropertyDefinition& one, const PropertyDefinition& other) {
    return one.isAttribute == other.isAttribute && one.typeName == other.typeName;
}

SdfPath classPath(const TfToken& identifier) {
    return SdfPath::AbsoluteRootPath().AppendChild(identifier);
}

TfTokenVector overrideNames(const SdfLayerHandle& layer, const SdfPath& path) {
    pxr::VtTokenArray names;
    layer->HasFieldDictKey(path, pxr::SdfFieldKeys->CustomData,
                           TfToken("apiSchemaOverridePropertyNames"), &names);
    return {names.begin(), names.end()};
}

std::string documentationOf(const SdfLayerHandle& layer, const SdfPath& path) {
    std::string text;
    if (!layer->HasFieldDictKey(path, pxr::SdfFieldKeys->CustomData, TfToken("userDocBrief"),
                                &text))
        layer->HasField(path, pxr::SdfFieldKeys->Documentation, &text);
    return text;
}

}  // namespace

pxr::SdfValueTypeName PropertyDefinition::type() const {
    return pxr::SdfSchema::GetInstance().FindType(typeName);
}

DefinitionBuilder::DefinitionBuilder(const SchemaPlugins& plugins, const SchemaIndex& index,
                                     const SchemaLayers& layers, std::vector<std::string>& problems)
    : plugins_(plugins), index_(index), layers_(layers), problems_(problems) {}

Definitions DefinitionBuilder::buildAll() {
    findAutoApplied();
    for (const auto& info : plugins_.schemas)
        if (info.isApplied()) {
            (void)buildApi(info);
            done_[info.identifier] = std::make_unique<PrimDefinition>(*built_.at(info.identifier));
        }
    for (const auto& info : plugins_.schemas)
        if (info.isTyped())
            buildTyped(info);
        else if (info.kind == SchemaKind::NonAppliedApi)
            buildNonApplied(info);
    return std::move(done_);
}

// Finds the schemas that are applied to a type and to all types that derive from it. The later name
// in dictionary order is the stronger one, so that a newer version comes before an older one.
void DefinitionBuilder::findAutoApplied() {
    if (pxr::TfGetenvBool("USD_DISABLE_AUTO_APPLY_API_SCHEMAS", false)) return;
    std::map<TfToken, TfTokenVector> targets = plugins_.autoApply;
    for (const auto& info : plugins_.schemas) {
        if (info.autoApplyTo.empty()) continue;
        auto& types = targets[info.identifier];
        types.insert(types.end(), info.autoApplyTo.begin(), info.autoApplyTo.end());
    }
    for (const auto& [schema, names] : targets) {
        std::set<pxr::TfType> types;
        for (const auto& name : names) {
            const auto found = index_.find(name);
            if (found == index_.end()) continue;
            types.insert(found->second->type);
            found->second->type.GetAllDerivedTypes(&types);
        }
        for (const auto& type : types) autoApplied_[type].push_back(schema);
    }
    for (auto& [type, schemas] : autoApplied_)
        std::ranges::sort(schemas, [](const TfToken& one, const TfToken& other) {
            return pxr::TfDictionaryLessThan()(other, one);
        });
}

SdfLayerHandle DefinitionBuilder::layerOf(const SchemaInfo& info) const {
    const auto found = layers_.find(info.plugin);
    return found == layers_.end() ? SdfLayerHandle() : SdfLayerHandle(found->second);
}

std::unique_ptr<PrimDefinition> DefinitionBuilder::readClass(const SchemaInfo& info,
                                                             const TfTokenVector& overrides) {
    auto definition = std::make_unique<PrimDefinition>();
    if (info.isApplied())
        definition->appliedSchemas_ = {
            info.kind == SchemaKind::MultipleApplyApi
                ? TfToken(info.identifier.GetString() + ":__INSTANCE_NAME__")
                : info.identifier};
    const auto layer = layerOf(info);
    const SdfPath path = classPath(info.identifier);
    if (!layer || !layer->HasSpec(path)) {
        // The base of all types and the bases of API schemas have no class.
        if (layer && info.kind != SchemaKind::AbstractBase)
            problems_.push_back("schema '" + info.identifier.GetString() +
                                "': generatedSchema.usda of plug-in '" + info.plugin +
                                "' has no class of this name");
        return definition;
    }
    definition->documentation_ = documentationOf(layer, path);
    definition->fields_ = fallbackFields(layer, path);
    for (const auto& name :
         layer->GetFieldAs<TfTokenVector>(path, pxr::SdfChildrenKeys->PropertyChildren))
        if (std::ranges::find(overrides, name) == overrides.end())
            definition->properties_.emplace(name, readProperty(layer, path.AppendProperty(name)));
    return definition;
}

TfTokenVector DefinitionBuilder::builtInSchemas(const SchemaInfo& info) {
    TfTokenVector names;
    if (const auto layer = layerOf(info)) {
        const auto list = layer->GetFieldAs<pxr::SdfTokenListOp>(classPath(info.identifier),
                                                                 TfToken("apiSchemas"));
        list.ApplyOperations(&names);
    }
    const auto automatic = autoApplied_.find(info.type);
    if (automatic != autoApplied_.end())
        names.insert(names.end(), automatic->second.begin(), automatic->second.end());

    // A template may include templates only, and any other schema may include no template.
    const bool isTemplate = info.kind == SchemaKind::MultipleApplyApi;
    std::erase_if(names, [&](const TfToken& name) {
        if (isNameTemplate(name) == isTemplate) return false;
        problems_.push_back("schema '" + info.identifier.GetString() + "' cannot include '" +
                            name.GetString() +
                            "': only templates of multiple-apply schemas include each other");
        return true;
    });
    return names;
}

// Returns false if a cycle was cut. The result then depends on the schema at which building began,
// and must be built again for another first schema.
bool DefinitionBuilder::buildApi(const SchemaInfo& info) {
    auto& progress = progress_[info.identifier];
    if (progress == Progress::Done) return true;
    progress = Progress::Building;
    const auto layer = layerOf(info);
    const auto overrides =
        layer ? overrideNames(layer, classPath(info.identifier)) : TfTokenVector();
    auto definition = readClass(info, overrides);
    Versions versions{{{info.family, TfToken()}, info.version}};
    bool complete = true;
    const auto names = builtInSchemas(info);
    for (const auto& name : names) {
        const auto [schema, instance] = parseAppliedName(name);
        const auto found = index_.find(schema);
        const std::string what = "schema '" + info.identifier.GetString() + "' cannot include '" +
                                 name.GetString() + "'";
        if (found == index_.end() || !found->second->isApplied()) {
            problems_.push_back(what + ": there is no API schema of this name that can be applied");
            continue;
        }
        if (progress_[schema] == Progress::Building) {
            problems_.push_back(what + ": they include each other");
            complete = false;
            continue;
        }
        if (!buildApi(*found->second)) complete = false;
        if (!addWeaker(index_, *definition, *built_.at(schema), instance, versions))
            problems_.push_back(what + ": it has another version of one of its schemas already");
    }
    if (!names.empty()) applyOverrides(info, overrides, *definition);
    finish(*definition);
    built_[info.identifier] = std::move(definition);
    progress_[info.identifier] = complete ? Progress::Done : Progress::None;
    return complete;
}

void DefinitionBuilder::buildTyped(const SchemaInfo& info) {
    const auto layer = layerOf(info);
    const auto overrides =
        layer ? overrideNames(layer, classPath(info.identifier)) : TfTokenVector();
    auto definition = readClass(info, overrides);
    auto own = compose(index_, done_, definition.get(), builtInSchemas(info));
    applyOverrides(info, overrides, *own);
    finish(*own);
    done_[info.identifier] = std::move(own);
}

// Some of these schemas consist of C++ functions only and have no class.
void DefinitionBuilder::buildNonApplied(const SchemaInfo& info) {
    const auto layer = layerOf(info);
    if (!layer || !layer->HasSpec(classPath(info.identifier))) return;
    auto definition = readClass(info, {});
    finish(*definition);
    done_[info.identifier] = std::move(definition);
}

void DefinitionBuilder::applyOverrides(const SchemaInfo& info, const TfTokenVector& overrides,
                                       PrimDefinition& definition) {
    const auto layer = layerOf(info);
    for (const auto& name : overrides) {
        const auto found = definition.properties_.find(name);
        const SdfPath path = classPath(info.identifier).AppendProperty(name);
        if (found == definition.properties_.end() || !layer->HasSpec(path)) continue;
        const auto property = readProperty(layer, path);
        if (!haveOneType(*property, *found->second)) {
            problems_.push_back("schema '" + info.identifier.GetString() + "' cannot override '" +
                                name.GetString() + "': it is of another type");
            continue;
        }
        const auto& keys = *pxr::SdfFieldKeys;
        const auto& defined = found->second->fields;
        property->fields.insert(defined.begin(), defined.end());
        // An override cannot change the variability.
        if (const auto varies = defined.find(keys.Variability); varies != defined.end())
            property->fields[keys.Variability] = varies->second;
        readMembers(*property);
        found->second = property;
    }
}

std::unique_ptr<PrimDefinition> DefinitionBuilder::compose(const SchemaIndex& index,
                                                           const Definitions& schemas,
                                                           const PrimDefinition* type,
                                                           const TfTokenVector& appliedSchemas) {
    auto result =
        type ? std::make_unique<PrimDefinition>(*type) : std::make_unique<PrimDefinition>();
    Versions versions;
    for (const auto& name : result->appliedSchemas_) {
        const auto [schema, instance] = parseAppliedName(name);
        const auto& info = *index.at(schema);
        versions.emplace(std::pair(info.family, instance), info.version);
    }
    for (const auto& name : appliedSchemas) {
        const auto [schema, instance] = parseAppliedName(name);
        const auto info = index.find(schema);
        if (info == index.end() || !info->second->isApplied()) continue;
        const bool wantsInstance = info->second->kind == SchemaKind::MultipleApplyApi;
        if (wantsInstance == instance.IsEmpty()) continue;
        const auto api = schemas.find(schema);
        if (api != schemas.end()) (void)addWeaker(index, *result, *api->second, instance, versions);
    }
    finish(*result);
    return result;
}

bool DefinitionBuilder::addWeaker(const SchemaIndex& index, PrimDefinition& target,
                                  const PrimDefinition& api, const TfToken& instance,
                                  Versions& versions) {
    const auto named = [&](const TfToken& name) {
        return instance.IsEmpty() ? name : withInstanceName(name, instance);
    };
    TfTokenVector names;
    for (const auto& name : api.appliedSchemas_) names.push_back(named(name));
    if (!addSchemaNames(index, target, names, versions)) return false;
    for (const auto& [name, property] : api.properties_) addProperty(target, named(name), property);
    addFields(target.fields_, api.fields_);
    return true;
}

// Adds all schemas, or none if one of them is already there in another version.
bool DefinitionBuilder::addSchemaNames(const SchemaIndex& index, PrimDefinition& target,
                                       const TfTokenVector& names, Versions& versions) {
    Versions all = versions;
    TfTokenVector added;
    for (const auto& name : names) {
        const auto [schema, instance] = parseAppliedName(name);
        const auto& info = *index.at(schema);
        const auto [known, isNew] = all.emplace(std::pair(info.family, instance), info.version);
        if (isNew) added.push_back(name);
        if (known->second != info.version) return false;
    }
    versions = std::move(all);
    target.appliedSchemas_.insert(target.appliedSchemas_.end(), added.begin(), added.end());
    return true;
}

// Adds the weaker definition's fields that the stronger definition does not have, except the
// documentation.
void DefinitionBuilder::addProperty(PrimDefinition& target, const TfToken& name,
                                    const PrimDefinition::Property& weaker) {
    const auto [entry, isNew] = target.properties_.emplace(name, weaker);
    auto& stronger = entry->second;
    if (isNew || !haveOneType(*stronger, *weaker)) return;
    auto both = std::make_shared<PropertyDefinition>(*stronger);
    addFields(both->fields, weaker->fields);
    if (both->fields == stronger->fields) return;
    readMembers(*both);
    stronger = both;
}

void DefinitionBuilder::finish(PrimDefinition& definition) {
    auto& names = definition.propertyNames_;
    names.clear();
    for (const auto& [name, property] : definition.properties_) names.push_back(name);
    std::ranges::sort(names, pxr::TfDictionaryLessThan());
}

}  // namespace usdlive::schema
