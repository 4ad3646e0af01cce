// Reads the schemas of all plug-ins and keeps the definitions that were requested.
#include "usdlive/client/usd/schema/SchemaRegistry.h"

#include <pxr/base/tf/hash.h>
#include <pxr/base/tf/pathUtils.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <mutex>
#include <shared_mutex>

#include "usd/schema/DefinitionBuilder.h"
#include "usd/schema/SchemaPlugins.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::schema {

using pxr::TfToken;
using pxr::TfTokenVector;

namespace {

// The key of a composed definition: a type and its applied API schemas.
struct DefinitionKey {
    TfToken type;
    TfTokenVector schemas;

    bool operator==(const DefinitionKey&) const = default;
};
struct DefinitionKeyHash {
    std::size_t operator()(const DefinitionKey& key) const {
        return pxr::TfHash::Combine(key.type, key.schemas);
    }
};

pxr::SdfLayerRefPtr openSchemaLayer(const std::string& plugin, const std::string& folder,
                                    std::vector<std::string>& problems) {
    const std::string path = pxr::TfStringCatPaths(folder, "generatedSchema.usda");
    const usd::TfComplaints complaints;
    auto layer = pxr::SdfLayer::OpenAsAnonymous(path);
    if (!layer)
        problems.push_back("schemas of plug-in '" + plugin +
                           "' are without properties: cannot read " + path + ": " +
                           complaints.text("no such file"));
    return layer;
}

void addFallbackTypes(const pxr::SdfLayerHandle& layer, pxr::VtDictionary& types) {
    const auto declared = layer->GetFieldAs<pxr::VtDictionary>(pxr::SdfPath::AbsoluteRootPath(),
                                                               TfToken("fallbackPrimTypes"));
    for (const auto& [type, fallbacks] : declared)
        if (fallbacks.IsHolding<pxr::VtTokenArray>()) types.insert({type, fallbacks});
}

}  // namespace

struct SchemaRegistry::State {
    std::vector<std::string> problems;
    SchemaPlugins plugins;
    SchemaIndex index;
    Definitions schemas;
    pxr::VtDictionary fallbackPrimTypes;
    const PrimDefinition empty;

    std::shared_mutex mutex;  // guards `composed`
    std::unordered_map<DefinitionKey, std::unique_ptr<PrimDefinition>, DefinitionKeyHash> composed;

    State() : plugins(readSchemaPlugins(problems)) {
        for (const auto& info : plugins.schemas) index.emplace(info.identifier, &info);
        checkTypeNames();
        SchemaLayers layers;
        for (const auto& [plugin, folder] : plugins.resourcePaths) {
            if (!needsDefinitions(plugin)) continue;
            auto layer = openSchemaLayer(plugin, folder, problems);
            if (!layer) continue;
            addFallbackTypes(layer, fallbackPrimTypes);
            layers.emplace(plugin, std::move(layer));
        }
        schemas = DefinitionBuilder(plugins, index, layers, problems).buildAll();
    }

    [[nodiscard]] bool needsDefinitions(const std::string& plugin) const {
        return std::ranges::any_of(plugins.schemas, [&](const SchemaInfo& info) {
            return info.plugin == plugin &&
                   (info.isApplied() || info.kind == SchemaKind::ConcreteTyped);
        });
    }

    // Reports unknown names. Such lists contain names in files, but authors of schemas sometimes
    // write C++ names.
    void checkTypeNames() {
        for (const auto& info : plugins.schemas)
            for (const auto& name : info.canOnlyApplyTo)
                if (!index.contains(name))
                    problems.push_back("schema '" + info.identifier.GetString() +
                                       "': 'apiSchemaCanOnlyApplyTo' has the unknown schema '" +
                                       name.GetString() + "'");
    }
};

SchemaRegistry::SchemaRegistry() : state_(std::make_unique<State>()) {}
SchemaRegistry::~SchemaRegistry() = default;

const std::vector<std::string>& SchemaRegistry::problems() const { return state_->problems; }

const SchemaInfo* SchemaRegistry::find(const TfToken& identifier) const {
    const auto found = state_->index.find(identifier);
    return found == state_->index.end() ? nullptr : found->second;
}

const SchemaInfo* SchemaRegistry::find(const TfToken& family, unsigned version) const {
    for (const auto* info : versions(family))
        if (info->version == version) return info;
    return nullptr;
}

std::vector<const SchemaInfo*> SchemaRegistry::versions(const TfToken& family) const {
    std::vector<const SchemaInfo*> found;
    for (const auto& info : state_->plugins.schemas)
        if (info.family == family) found.push_back(&info);
    std::ranges::sort(found, std::greater(), &SchemaInfo::version);
    return found;
}

std::vector<const SchemaInfo*> SchemaRegistry::all() const {
    std::vector<const SchemaInfo*> found;
    for (const auto& info : state_->plugins.schemas) found.push_back(&info);
    return found;
}

bool SchemaRegistry::isA(const TfToken& identifier, const TfToken& base) const {
    const auto* one = find(identifier);
    const auto* other = find(base);
    return one && other && one->type.IsA(other->type);
}

const PrimDefinition& SchemaRegistry::definition(const TfToken& type,
                                                 const TfTokenVector& appliedSchemas) const {
    const auto* info = find(type);
    const bool isConcrete = info && info->kind == SchemaKind::ConcreteTyped;
    const PrimDefinition* ofType = isConcrete ? schemaDefinition(type) : nullptr;
    if (appliedSchemas.empty()) return ofType ? *ofType : state_->empty;

    DefinitionKey key{isConcrete ? type : TfToken(), appliedSchemas};
    {
        const std::shared_lock lock(state_->mutex);
        const auto found = state_->composed.find(key);
        if (found != state_->composed.end()) return *found->second;
    }
    auto composed =
        DefinitionBuilder::compose(state_->index, state_->schemas, ofType, appliedSchemas);
    const std::unique_lock lock(state_->mutex);
    return *state_->composed.try_emplace(std::move(key), std::move(composed)).first->second;
}

const PrimDefinition* SchemaRegistry::schemaDefinition(const TfToken& identifier) const {
    const auto found = state_->schemas.find(identifier);
    return found == state_->schemas.end() ? nullptr : found->second.get();
}

bool SchemaRegistry::isBuiltIn(const TfToken& type, const TfTokenVector& appliedSchemas,
                               const TfToken& property) const {
    return definition(type, appliedSchemas).property(property) != nullptr;
}

const pxr::VtDictionary& SchemaRegistry::fallbackPrimTypes() const {
    return state_->fallbackPrimTypes;
}

TfToken SchemaRegistry::effectiveType(const TfToken& type,
                                      const pxr::VtDictionary& fallbackPrimTypes) const {
    if (type.IsEmpty() || find(type)) return type;
    const auto fallbacks = fallbackPrimTypes.find(type.GetString());
    if (fallbacks == fallbackPrimTypes.end()) return {};
    for (const auto& name : fallbacks->second.GetWithDefault<pxr::VtTokenArray>()) {
        const auto* info = find(name);
        if (info && info->kind == SchemaKind::ConcreteTyped) return name;
    }
    return {};
}

bool SchemaRegistry::canApply(const TfToken& appliedName, const TfToken& primType,
                              std::string* whyNot) const {
    const auto refuse = [&](const std::string& reason) {
        if (whyNot) *whyNot = "cannot apply '" + appliedName.GetString() + "': " + reason;
        return false;
    };
    const auto [schema, instance] = parseAppliedName(appliedName);
    const auto* info = find(schema);
    if (!info) return refuse("there is no schema of this name");
    if (!info->isApplied()) return refuse("it is no API schema that can be applied");
    TfTokenVector types = info->canOnlyApplyTo;
    if (info->kind == SchemaKind::SingleApplyApi) {
        if (!instance.IsEmpty()) return refuse("it has no instances");
    } else {
        if (instance.IsEmpty()) return refuse("it needs the name of an instance");
        const auto& allowed = info->allowedInstanceNames;
        if (!allowed.empty() && std::ranges::find(allowed, instance) == allowed.end())
            return refuse("its instances have other names");
        const std::string last = pxr::TfStringGetSuffix(instance.GetString(), ':');
        const std::string name = last.empty() ? instance.GetString() : last;
        for (const auto& property : schemaDefinition(schema)->propertyNames())
            if (templateBaseName(property) == name)
                return refuse("one of its properties is named '" + name + "'");
        for (const auto& rule : info->instanceRules)
            if (rule.instance == instance) types = rule.canOnlyApplyTo;
    }
    if (types.empty()) return true;
    if (std::ranges::any_of(types, [&](const TfToken& type) { return isA(primType, type); }))
        return true;
    return refuse("only to prims of type " + pxr::TfStringJoin(pxr::TfToStringVector(types), ", "));
}

}  // namespace usdlive::schema
