#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include <map>
#include <memory>
#include <unordered_map>

namespace usdlive::schema {

/// Fields by name, in the order of their names.
using Fields = std::map<pxr::TfToken, pxr::VtValue>;

/// What schemas say of one property. Immutable when it is part of a PrimDefinition.
struct PropertyDefinition {
    bool isAttribute = true;  ///< else a relationship
    pxr::TfToken typeName;    ///< of an attribute: "point3f[]"
    pxr::SdfVariability variability = pxr::SdfVariabilityVarying;
    bool custom = false;
    pxr::VtValue fallback;  ///< of an attribute; empty: it has none
    /// All fields that have fallbacks, including the ones above.
    Fields fields;

    [[nodiscard]] pxr::SdfValueTypeName type() const;
};

/// The properties and metadata that a prim has from its type and its applied API schemas.
///
/// Immutable once built; a SchemaRegistry owns it and threads may share it.
class PrimDefinition {
public:
    using Property = std::shared_ptr<const PropertyDefinition>;

    /// All API schemas, strong to weak: built-in ones of the type, then each applied one with its
    /// own built-in ones.
    [[nodiscard]] const pxr::TfTokenVector& appliedSchemas() const { return appliedSchemas_; }
    /// In the order of a dictionary, as the properties of a prim.
    [[nodiscard]] const pxr::TfTokenVector& propertyNames() const { return propertyNames_; }
    /// Null: no schema has such a property, so that it is not built in.
    [[nodiscard]] const PropertyDefinition* property(const pxr::TfToken& name) const {
        const auto found = properties_.find(name);
        return found == properties_.end() ? nullptr : found->second.get();
    }
    /// Fallbacks of the prim's metadata.
    [[nodiscard]] const Fields& fields() const { return fields_; }
    [[nodiscard]] const std::string& documentation() const { return documentation_; }

private:
    friend class DefinitionBuilder;

    pxr::TfTokenVector appliedSchemas_;
    pxr::TfTokenVector propertyNames_;
    std::unordered_map<pxr::TfToken, Property, pxr::TfToken::HashFunctor> properties_;
    Fields fields_;
    std::string documentation_;
};

}  // namespace usdlive::schema
