// Reads the descriptions of schemas in plugInfo.json files. Malformed metadata is ignored and
// reported, so that one broken plug-in does not affect the others.
#include "usd/schema/SchemaPlugins.h"

#include <pxr/base/js/value.h>
#include <pxr/base/plug/plugin.h>
#include <pxr/base/plug/registry.h>
#include <pxr/base/tf/type.h>

#include <algorithm>
#include <optional>
#include <set>

namespace usdlive::schema {

using pxr::JsObject;
using pxr::JsValue;
using pxr::TfToken;
using pxr::TfTokenVector;
using pxr::TfType;

namespace {

const JsValue* entryOf(const JsObject& object, const std::string& key) {
    const auto found = object.find(key);
    return found == object.end() ? nullptr : &found->second;
}

std::optional<SchemaKind> kindNamed(const std::string& name) {
    using enum SchemaKind;
    static const std::map<std::string, SchemaKind> kinds{
        {"abstractBase", AbstractBase},     {"abstractTyped", AbstractTyped},
        {"concreteTyped", ConcreteTyped},   {"nonAppliedAPI", NonAppliedApi},
        {"singleApplyAPI", SingleApplyApi}, {"multipleApplyAPI", MultipleApplyApi}};
    const auto found = kinds.find(name);
    if (found == kinds.end()) return std::nullopt;
    return found->second;
}

class PluginReader {
public:
    explicit PluginReader(std::vector<std::string>& problems) : problems_(problems) {}

    SchemaPlugins read() {
        const auto base = TfType::FindByName("UsdSchemaBase");
        if (base.IsUnknown()) {
            problems_.emplace_back("no schemas: no plug-in declares the type UsdSchemaBase");
            return {};
        }
        std::set<TfType> types;
        pxr::PlugRegistry::GetAllDerivedTypes(base, &types);
        types.insert(base);
        for (const auto& type : types) readType(base, type);
        for (const auto& plugin : pxr::PlugRegistry::GetInstance().GetAllPlugins())
            readAutoApply(*plugin);
        keepOneOfEachIdentifier();
        return std::move(result_);
    }

private:
    void report(const std::string& where, const std::string& what) {
        problems_.push_back(where + ": " + what);
    }

    TfTokenVector names(const JsObject& object, const std::string& key, const std::string& where) {
        const JsValue* value = entryOf(object, key);
        if (!value) return {};
        // An empty list has no element type.
        if (value->IsArray() && value->GetJsArray().empty()) return {};
        if (!value->IsArrayOf<std::string>()) {
            report(where, "'" + key + "' is no list of strings");
            return {};
        }
        return pxr::TfToTokenVector(value->GetArrayOf<std::string>());
    }

    // Returns the name in files. Older plugInfo.json files contain it only as the alias of the
    // type.
    std::string identifierOf(const TfType& base, const TfType& type, const JsObject& metadata,
                             const std::string& where) {
        if (const JsValue* value = entryOf(metadata, "schemaIdentifier")) {
            if (value->IsString()) return value->GetString();
            report(where, "'schemaIdentifier' is no string");
        }
        const auto aliases = base.GetAliases(type);
        return aliases.size() == 1 ? aliases.front() : std::string();
    }

    void readType(const TfType& base, const TfType& type) {
        const auto plugin = pxr::PlugRegistry::GetInstance().GetPluginForType(type);
        if (!plugin) return;
        const JsObject metadata = plugin->GetMetadataForType(type);
        const std::string where =
            "plug-in '" + plugin->GetName() + "', type '" + type.GetTypeName() + "'";
        const JsValue* kindName = entryOf(metadata, "schemaKind");
        if (!kindName) return;  // a class without a schema, derived in a library
        const auto kind = kindName->IsString() ? kindNamed(kindName->GetString()) : std::nullopt;
        if (!kind) return report(where, "'schemaKind' is none of the kinds of schemas");
        const std::string identifier = identifierOf(base, type, metadata, where);
        if (identifier.empty()) return report(where, "it has no 'schemaIdentifier'");

        SchemaInfo info;
        info.identifier = TfToken(identifier);
        std::tie(info.family, info.version) = familyAndVersion(info.identifier);
        info.kind = *kind;
        info.type = type;
        info.plugin = plugin->GetName();
        if (info.isApplied()) readApplying(metadata, where, info);
        result_.resourcePaths.emplace(info.plugin, plugin->GetResourcePath());
        result_.schemas.push_back(std::move(info));
    }

    void readApplying(const JsObject& metadata, const std::string& where, SchemaInfo& info) {
        info.canOnlyApplyTo = names(metadata, "apiSchemaCanOnlyApplyTo", where);
        if (info.kind == SchemaKind::SingleApplyApi) {
            info.autoApplyTo = names(metadata, "apiSchemaAutoApplyTo", where);
            return;
        }
        info.allowedInstanceNames = names(metadata, "apiSchemaAllowedInstanceNames", where);
        const JsValue* instances = entryOf(metadata, "apiSchemaInstances");
        if (!instances) return;
        if (!instances->IsObject()) return report(where, "'apiSchemaInstances' is no dictionary");
        for (const auto& [instance, rules] : instances->GetJsObject()) {
            if (!rules.IsObject()) {
                report(where, "'apiSchemaInstances:" + instance + "' is no dictionary");
                continue;
            }
            auto types = names(rules.GetJsObject(), "apiSchemaCanOnlyApplyTo", where);
            if (!types.empty()) info.instanceRules.push_back({TfToken(instance), std::move(types)});
        }
    }

    // Reads entries such as "AutoApplyAPISchemas": {"LabelAPI": {"apiSchemaAutoApplyTo": ["Mesh"]}}
    void readAutoApply(pxr::PlugPlugin& plugin) {
        const JsObject metadata = plugin.GetMetadata();
        const JsValue* schemas = entryOf(metadata, "AutoApplyAPISchemas");
        if (!schemas) return;
        const std::string where = "plug-in '" + plugin.GetName() + "'";
        if (!schemas->IsObject()) return report(where, "'AutoApplyAPISchemas' is no dictionary");
        for (const auto& [schema, value] : schemas->GetJsObject()) {
            if (!value.IsObject()) {
                report(where, "'AutoApplyAPISchemas:" + schema + "' is no dictionary");
                continue;
            }
            const auto types = names(value.GetJsObject(), "apiSchemaAutoApplyTo", where);
            auto& known = result_.autoApply[TfToken(schema)];
            known.insert(known.end(), types.begin(), types.end());
        }
    }

    // Keeps one schema of each identifier. The choice does not depend on the order in which
    // libraries were registered.
    void keepOneOfEachIdentifier() {
        const auto order = [](const SchemaInfo& info) {
            return std::tuple(info.identifier.GetString(), info.plugin, info.type.GetTypeName());
        };
        auto& schemas = result_.schemas;
        std::ranges::sort(schemas, {}, order);
        for (std::size_t at = 1; at < schemas.size();) {
            const auto& first = schemas[at - 1];
            const auto& second = schemas[at];
            if (first.identifier != second.identifier) {
                ++at;
                continue;
            }
            report("schema '" + first.identifier.GetString() + "'",
                   "plug-in '" + second.plugin + "' declares it, too; the one of plug-in '" +
                       first.plugin + "' is used");
            schemas.erase(schemas.begin() + std::ptrdiff_t(at));
        }
    }

    std::vector<std::string>& problems_;
    SchemaPlugins result_;
};

}  // namespace

SchemaPlugins readSchemaPlugins(std::vector<std::string>& problems) {
    return PluginReader(problems).read();
}

}  // namespace usdlive::schema
