// Declares DefinitionBuilder, which builds the prim definitions of a SchemaRegistry.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "usd/schema/SchemaPlugins.h"
#include "usdlive/client/usd/schema/PrimDefinition.h"

namespace usdlive::schema {

using Definitions =
    std::unordered_map<pxr::TfToken, std::unique_ptr<PrimDefinition>, pxr::TfToken::HashFunctor>;
using SchemaIndex = std::unordered_map<pxr::TfToken, const SchemaInfo*, pxr::TfToken::HashFunctor>;
/// The layers of generatedSchema.usda files, by the name of their plug-in.
using SchemaLayers = std::map<std::string, pxr::SdfLayerRefPtr>;

/// Builds the definitions of schemas from the classes of generatedSchema.usda, and the definitions
/// of prims from these.
///
/// A class already contains the properties of its bases. Properties of built-in and applied API
/// schemas are weaker, except those that the class marks as overrides of built-in properties.
class DefinitionBuilder {
public:
    DefinitionBuilder(const SchemaPlugins& plugins, const SchemaIndex& index,
                      const SchemaLayers& layers, std::vector<std::string>& problems);

    /// Returns the definitions of all schemas that have one, by identifier.
    [[nodiscard]] Definitions buildAll();

    /// Returns the definition of a prim. `type` may be null. Ignores API schemas that are unknown
    /// or applied in a wrong form.
    [[nodiscard]] static std::unique_ptr<PrimDefinition> compose(
        const SchemaIndex& index, const Definitions& schemas, const PrimDefinition* type,
        const pxr::TfTokenVector& appliedSchemas);

private:
    // The version of each API schema family and instance name. A prim has only one version of each.
    using Versions = std::map<std::pair<pxr::TfToken, pxr::TfToken>, unsigned>;
    enum class Progress { None, Building, Done };

    bool buildApi(const SchemaInfo& info);
    void buildTyped(const SchemaInfo& info);
    void buildNonApplied(const SchemaInfo& info);
    std::unique_ptr<PrimDefinition> readClass(const SchemaInfo& info,
                                              const pxr::TfTokenVector& overrides);
    pxr::SdfLayerHandle layerOf(const SchemaInfo& info) const;
    pxr::TfTokenVector builtInSchemas(const SchemaInfo& info);
    void applyOverrides(const SchemaInfo& info, const pxr::TfTokenVector& overrides,
                        PrimDefinition& definition);
    void findAutoApplied();

    static bool addWeaker(const SchemaIndex& index, PrimDefinition& target,
                          const PrimDefinition& api, const pxr::TfToken& instance,
                          Versions& versions);
    static bool addSchemaNames(const SchemaIndex& index, PrimDefinition& target,
                               const pxr::TfTokenVector& names, Versions& versions);
    static void addProperty(PrimDefinition& target, const pxr::TfToken& name,
                            const PrimDefinition::Property& weaker);
    static void finish(PrimDefinition& definition);

    const SchemaPlugins& plugins_;
    const SchemaIndex& index_;
    const SchemaLayers& layers_;
    std::vector<std::string>& problems_;
    std::map<pxr::TfType, pxr::TfTokenVector> autoApplied_;
    std::map<pxr::TfToken, Progress> progress_;
    // The latest definition of each API schema. In a cycle it depends on the schema at which
    // building began; the valid definition is the one that began with the schema itself.
    Definitions built_;
    Definitions done_;
};

}  // namespace usdlive::schema
