#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/dictionary.h>

#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/schema/SchemaInfo.h"

namespace usdlive::schema {

/// The schemas of all plug-ins that PlugRegistry knows when this is created: usd-core's own and
/// those on PXR_PLUGINPATH_NAME. Reads plugInfo.json and generatedSchema.usda; no library is
/// loaded.
///
/// Safe to use from several threads at once. Everything that it returns lives as long as it does.
/// It keeps one definition for each pair of a type and a list of API schemas that was asked for.
class SchemaRegistry {
public:
    SchemaRegistry();
    ~SchemaRegistry();
    SchemaRegistry(const SchemaRegistry&) = delete;
    SchemaRegistry& operator=(const SchemaRegistry&) = delete;

    /// Sentences on what was passed over: malformed metadata, missing files, two schemas with one
    /// identifier, schemas that cannot include each other.
    [[nodiscard]] const std::vector<std::string>& problems() const;

    /// Null: no schema of this name.
    [[nodiscard]] const SchemaInfo* find(const pxr::TfToken& identifier) const;
    [[nodiscard]] const SchemaInfo* find(const pxr::TfToken& family, unsigned version) const;
    /// All versions, the newest first.
    [[nodiscard]] std::vector<const SchemaInfo*> versions(const pxr::TfToken& family) const;
    /// All schemas, in the order of their identifiers.
    [[nodiscard]] std::vector<const SchemaInfo*> all() const;
    /// Whether schema `identifier` is `base` or inherits from it; both are names in files.
    [[nodiscard]] bool isA(const pxr::TfToken& identifier, const pxr::TfToken& base) const;

    /// The definition of a prim. A type that is unknown or abstract adds nothing, and neither does
    /// an API schema that is unknown, or that is applied with an instance name although it has
    /// none, or without although it needs one.
    [[nodiscard]] const PrimDefinition& definition(const pxr::TfToken& type,
                                                   const pxr::TfTokenVector& appliedSchemas) const;
    /// The definition of one schema of any kind; null if it is unknown or has none. The names of a
    /// multiple-apply schema are templates.
    [[nodiscard]] const PrimDefinition* schemaDefinition(const pxr::TfToken& identifier) const;
    /// Whether `property` belongs to the definition of such a prim.
    [[nodiscard]] bool isBuiltIn(const pxr::TfToken& type, const pxr::TfTokenVector& appliedSchemas,
                                 const pxr::TfToken& property) const;

    /// The type to use for a prim of type `type`: the same if a schema of this name is registered,
    /// else the first known one that `fallbackPrimTypes`, metadata of the root layer, lists for it;
    /// else empty.
    [[nodiscard]] pxr::TfToken effectiveType(const pxr::TfToken& type,
                                             const pxr::VtDictionary& fallbackPrimTypes) const;
    /// What the schemas recommend to write as this metadata.
    [[nodiscard]] const pxr::VtDictionary& fallbackPrimTypes() const;

    /// Whether a prim of this type may have API schema `appliedName`, "CollectionAPI:lights". If
    /// not, `whyNot` says why.
    [[nodiscard]] bool canApply(const pxr::TfToken& appliedName, const pxr::TfToken& primType,
                                std::string* whyNot = nullptr) const;

private:
    struct State;
    const std::unique_ptr<State> state_;
};

}  // namespace usdlive::schema
