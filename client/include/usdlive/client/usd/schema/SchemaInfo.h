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

/// The instance of a multiple-apply API schema, "lightLink", or nothing; and types that only this
/// instance may be applied to.
struct InstanceRule {
    pxr::TfToken instance;
    pxr::TfTokenVector canOnlyApplyTo;
};

/// What a plugInfo.json says of one schema.
struct SchemaInfo {
    pxr::TfToken identifier;  ///< the name in files: "Mesh", "Capsule_1", "CollectionAPI"
    pxr::TfToken family;      ///< the identifier without its version: "Capsule"
    unsigned version = 0;
    SchemaKind kind = SchemaKind::AbstractBase;
    pxr::TfType type;
    std::string plugin;  ///< the name of the library that declares it

    pxr::TfTokenVector autoApplyTo;           ///< types, and all that derive from them
    pxr::TfTokenVector canOnlyApplyTo;        ///< types; empty: any
    pxr::TfTokenVector allowedInstanceNames;  ///< of a multiple-apply schema; empty: any
    std::vector<InstanceRule> instanceRules;  ///< of a multiple-apply schema

    [[nodiscard]] bool isTyped() const { return kind <= SchemaKind::ConcreteTyped; }
    [[nodiscard]] bool isAbstract() const { return kind <= SchemaKind::AbstractTyped; }
    [[nodiscard]] bool isApplied() const { return kind >= SchemaKind::SingleApplyApi; }
};

/// "Capsule_1" is version 1 of "Capsule"; a name without a number at its end is version 0.
[[nodiscard]] std::pair<pxr::TfToken, unsigned> familyAndVersion(const pxr::TfToken& identifier);

/// "CollectionAPI:lightLink" is the schema "CollectionAPI" and the instance "lightLink".
struct AppliedName {
    pxr::TfToken schema;
    pxr::TfToken instance;  ///< empty: applied without one
};
[[nodiscard]] AppliedName parseAppliedName(const pxr::TfToken& name);

/// Names of a multiple-apply schema have "__INSTANCE_NAME__" as one of their parts.
[[nodiscard]] bool isNameTemplate(const pxr::TfToken& name);
[[nodiscard]] pxr::TfToken withInstanceName(const pxr::TfToken& nameTemplate,
                                            const pxr::TfToken& instance);
/// What follows the placeholder; the whole name if it has none.
[[nodiscard]] std::string templateBaseName(const pxr::TfToken& nameTemplate);

}  // namespace usdlive::schema
