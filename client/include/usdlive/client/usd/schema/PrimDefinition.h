// Declares PrimDefinition, the properties and metadata that schemas define for a prim.
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

/// The definition of one property. It does not change once it is part of a PrimDefinition.
struct PropertyDefinition {
    bool isAttribute = true;  ///< false for a relationship
    pxr::TfToken typeName;    ///< the value type of an attribute, for example "point3f[]"
    pxr::SdfVariability variability = pxr::SdfVariabilityVarying;
    bool custom = false;
    pxr::VtValue fallback;  ///< the fallback value of an attribute; empty if it has none
    /// All fields that have a fallback, including the fields above.
    Fields fields;

    [[nodiscard]] pxr::SdfValueTypeName type() const;
};

/// The properties and metadata that a prim has from its type and its applied API schemas.
///
/// It is immutable, owned by a SchemaRegistry, and safe to read from several threads.
class PrimDefinition {
public:
    using Property = std::shared_ptr<const PropertyDefinition>;

    /// Returns all API schemas from strong to weak: the built-in schemas of the type, then each
    /// applied schema, followed by its own built-in schemas.
    [[nodiscard]] const pxr::TfTokenVector& appliedSchemas() const { return appliedSchemas_; }
    /// Returns the property names in dictionary order, like the property names of a prim.
    [[nodiscard]] const pxr::TfTokenVector& propertyNames() const { return propertyNames_; }
    /// Returns the definition of a property, or null if no schema defines it. The pointer is valid
    /// as long as this object.
    [[nodiscard]] const PropertyDefinition* property(const pxr::TfToken& name) const {
        const auto found = properties_.find(name);
        return found == properties_.end() ? nullptr : found->second.get();
    }
    /// Returns the fallbacks of the prim's metadata.
    [[nodiscard]] const Fields& fields() const { return fields_; }
    /// Returns the documentation of the type's schema.
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
