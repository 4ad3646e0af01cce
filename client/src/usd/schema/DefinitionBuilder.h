#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "SchemaPlugins.h"
#include "usdlive/client/usd/schema/PrimDefinition.h"

namespace usdlive::schema {

using Definitions =
    std::unordered_map<pxr::TfToken, std::unique_ptr<PrimDefinition>, pxr::TfToken::HashFunctor>;
using SchemaIndex = std::unordered_map<pxr::TfToken, const SchemaInfo*, pxr::TfToken::HashFunctor>;
/// By the path of its file's plug-in.
using SchemaLayers = std::map<std::string, pxr::SdfLayerRefPtr>;

/// Builds the definitions of schemas from the classes of generatedSchema.usda, and of prims from
/// these.
///
/// A class has the properties of its bases already. What comes in from built-in and applied API
/// schemas is weaker, except properties that the class marks as overrides of built-in ones.
class DefinitionBuilder {
public:
    DefinitionBuilder(const SchemaPlugins& plugins, const SchemaIndex& index,
                      const SchemaLayers& layers, std::vector<std::string>& problems);

    /// The definition of each schema that has one, by its identifier.
    [[nodiscard]] Definitions buildAll();

    /// `type` may be null.
    [[nodiscard]] static std::unique_ptr<PrimDefinition> compose(
        const SchemaIndex& index, const Definitions& schemas, const PrimDefinition* type,
        const pxr::TfTokenVector& appliedSchemas);

private:
    // Of an API schema and its instance: a prim has only one version of it.
    using Versions = std::map<std::pair<pxr::TfToken, pxr::TfToken>, unsigned>;
    enum class Progress { None, Building, Done };

    bool buildApi(const SchemaInfo& info);
    void buildTyped(const SchemaInfo& info);
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
    // API schemas, each as it was built last. In a cycle that depends on where building began, and
    // what counts is the one that began with the schema itself.
    Definitions built_;
    Definitions done_;
};

}  // namespace usdlive::schema
