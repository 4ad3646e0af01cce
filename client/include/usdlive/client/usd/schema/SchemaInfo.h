// Declares SchemaInfo, the description of one schema in a plugInfo.json, and functions for schema
// names.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/tf/type.h>

#include <string>
#include <utility>
#include <vector>

namespace usdlive::schema {

enum class SchemaKind {
    AbstractBase,
    AbstractTyped,
    ConcreteTyped,
    NonAppliedApi,
    SingleApplyApi,
    MultipleApplyApi
};

/// An instance name of a multiple-apply API schema, for example "lightLink", and the types that
/// this instance may be applied to.
struct InstanceRule {
    pxr::TfToken instance;
    pxr::TfTokenVector canOnlyApplyTo;
};

/// The description of one schema in a plugInfo.json. A value type.
struct SchemaInfo {
    pxr::TfToken identifier;  ///< the name in files, for example "Mesh" or "Capsule_1"
    pxr::TfToken family;      ///< the identifier without its version, for example "Capsule"
    unsigned version = 0;
    SchemaKind kind = SchemaKind::AbstractBase;
    pxr::TfType type;
    std::string plugin;  ///< the name of the plug-in that declares the schema

    pxr::TfTokenVector autoApplyTo;           ///< these types, and all types that derive from them
    pxr::TfTokenVector canOnlyApplyTo;        ///< types; empty: any type
    pxr::TfTokenVector allowedInstanceNames;  ///< for a multiple-apply schema; empty: any name
    std::vector<InstanceRule> instanceRules;  ///< for a multiple-apply schema

    [[nodiscard]] bool isTyped() const { return kind <= SchemaKind::ConcreteTyped; }
    [[nodiscard]] bool isAbstract() const { return kind <= SchemaKind::AbstractTyped; }
    [[nodiscard]] bool isApplied() const { return kind >= SchemaKind::SingleApplyApi; }
};

/// Splits an identifier into family and version. "Capsule_1" is version 1 of "Capsule"; an
/// identifier without a number at its end is version 0.
[[nodiscard]] std::pair<pxr::TfToken, unsigned> familyAndVersion(const pxr::TfToken& identifier);

/// The parts of the name of an applied API schema. "CollectionAPI:lightLink" is the schema
/// "CollectionAPI" with the instance name "lightLink".
struct AppliedName {
    pxr::TfToken schema;
    pxr::TfToken instance;  ///< empty if there is no instance name
};
[[nodiscard]] AppliedName parseAppliedName(const pxr::TfToken& name);

/// Returns true if one part of the name is "__INSTANCE_NAME__". The names in a multiple-apply
/// schema have this form.
[[nodiscard]] bool isNameTemplate(const pxr::TfToken& name);
/// Replaces the placeholder in a name with `instance`.
[[nodiscard]] pxr::TfToken withInstanceName(const pxr::TfToken& nameTemplate,
                                            const pxr::TfToken& instance);
/// Returns the part of the name behind the placeholder, or the whole name if it has no placeholder.
[[nodiscard]] std::string templateBaseName(const pxr::TfToken& nameTemplate);

}  // namespace usdlive::schema
