// Declares SchemaRegistry, which reads the schemas of all plug-ins and returns prim definitions.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/dictionary.h>

#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/schema/SchemaInfo.h"

namespace usdlive::schema {

/// The schemas of all plug-ins that PlugRegistry knows when the registry is created: those of
/// usd-core and those on PXR_PLUGINPATH_NAME. The constructor reads plugInfo.json and
/// generatedSchema.usda files. It loads no plug-in library.
///
/// Safe to use from several threads at once. All returned references and pointers are valid as long
/// as the registry. The registry keeps one definition for each requested pair of a type and a list
/// of API schemas. It never drops one.
class SchemaRegistry {
public:
    SchemaRegistry();
    ~SchemaRegistry();
    SchemaRegistry(const SchemaRegistry&) = delete;
    SchemaRegistry& operator=(const SchemaRegistry&) = delete;

    /// Returns one sentence for each part of a plug-in that was ignored: malformed metadata, a
    /// missing file, a second schema with the same identifier, or schemas that cannot include each
    /// other.
    [[nodiscard]] const std::vector<std::string>& problems() const;

    /// Returns null if there is no such schema.
    [[nodiscard]] const SchemaInfo* find(const pxr::TfToken& identifier) const;
    [[nodiscard]] const SchemaInfo* find(const pxr::TfToken& family, unsigned version) const;
    /// Returns all versions of a schema, from the newest to the oldest.
    [[nodiscard]] std::vector<const SchemaInfo*> versions(const pxr::TfToken& family) const;
    /// Returns all schemas, sorted by identifier.
    [[nodiscard]] std::vector<const SchemaInfo*> all() const;
    /// Returns true if the schema `identifier` is `base` or derives from it. Both are names as they
    /// appear in files.
    [[nodiscard]] bool isA(const pxr::TfToken& identifier, const pxr::TfToken& base) const;

    /// Returns the definition of a prim. An unknown or abstract type adds nothing. An API schema
    /// adds nothing if it is unknown, if it needs an instance name and has none, or if it has an
    /// instance name and takes none.
    [[nodiscard]] const PrimDefinition& definition(const pxr::TfToken& type,
                                                   const pxr::TfTokenVector& appliedSchemas) const;
    /// Returns the definition of one schema of any kind, or null if the schema is unknown or has no
    /// definition. The names of a multiple-apply schema are templates.
    [[nodiscard]] const PrimDefinition* schemaDefinition(const pxr::TfToken& identifier) const;
    /// Returns true if `property` belongs to the definition of such a prim.
    [[nodiscard]] bool isBuiltIn(const pxr::TfToken& type, const pxr::TfTokenVector& appliedSchemas,
                                 const pxr::TfToken& property) const;

    /// Returns the type whose schema applies to a prim of type `type`. This is `type` if its schema
    /// is registered, else the first concrete type that `fallbackPrimTypes` lists for it, else
    /// empty. `fallbackPrimTypes` is metadata of the stage.
    [[nodiscard]] pxr::TfToken effectiveType(const pxr::TfToken& type,
                                             const pxr::VtDictionary& fallbackPrimTypes) const;
    /// Returns the fallback types that the schemas recommend to write as `fallbackPrimTypes`
    /// metadata.
    [[nodiscard]] const pxr::VtDictionary& fallbackPrimTypes() const;

    /// Returns true if the API schema `appliedName`, for example "CollectionAPI:lights", may be
    /// applied to a prim of type `primType`. If it returns false, it writes the reason to `whyNot`.
    [[nodiscard]] bool canApply(const pxr::TfToken& appliedName, const pxr::TfToken& primType,
                                std::string* whyNot = nullptr) const;

private:
    struct State;
    const std::unique_ptr<State> state_;
};

}  // namespace usdlive::schema
