// Declares Property, a handle of one attribute or relationship of a Prim.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include <optional>

#include "usdlive/client/usd/stage/AttributeQuery.h"
#include "usdlive/client/usd/stage/Prim.h"

namespace usdlive::stage {

/// A handle of one attribute or relationship. It is cheap to copy, and valid while its prim is
/// valid and a layer or a schema has the property.
///
/// Call only isValid() and operator bool on an invalid property. Threads: see Stage.
class Property {
public:
    Property() = default;

    [[nodiscard]] bool isValid() const { return prim_.isValid() && isKnown(); }
    explicit operator bool() const { return isValid(); }

    [[nodiscard]] const Prim& prim() const { return prim_; }
    [[nodiscard]] const pxr::TfToken& name() const { return name_; }
    [[nodiscard]] pxr::SdfPath path() const { return prim_.path().AppendProperty(name_); }
    [[nodiscard]] bool isAttribute() const;
    [[nodiscard]] bool isRelationship() const { return !isAttribute(); }
    /// Returns true if a layer has the property, and false if only schemas define it.
    [[nodiscard]] bool isAuthored() const;
    /// Returns true if a layer declares the property as custom. A property that schemas define is
    /// never custom.
    [[nodiscard]] bool isCustom() const;
    /// Returns the definition from the schemas, or null if they do not define the property. Valid
    /// as long as the stage.
    [[nodiscard]] const schema::PropertyDefinition* definition() const;

    /// Returns the value type of an attribute, for example "point3f[]".
    [[nodiscard]] pxr::TfToken typeName() const;
    [[nodiscard]] pxr::SdfVariability variability() const;
    /// Returns a query that reads the attribute quickly at many times. Valid until the stage
    /// changes.
    [[nodiscard]] AttributeQuery query(AssetPaths assetPaths = AssetPaths::Resolved) const;
    /// Returns the value of an attribute at a time of the stage, or at the default time if `time`
    /// is empty. Returns an empty value if the attribute has none at that time.
    [[nodiscard]] pxr::VtValue value(std::optional<double> time = {}) const;
    /// Does the same with a query that this property returned.
    [[nodiscard]] pxr::VtValue value(const AttributeQuery& query,
                                     std::optional<double> time = {}) const;

    /// Returns the composed targets of a relationship or the connections of an attribute, as paths
    /// of the stage. Returns none if a layer lists a target with more than 512 elements.
    [[nodiscard]] pxr::SdfPathVector targets() const;
    /// Returns true if a layer lists targets or connections, even an empty list.
    [[nodiscard]] bool hasAuthoredTargets() const;

    /// Returns one composed field, or an empty value if no layer has it.
    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field,
                                        AssetPaths assetPaths = AssetPaths::Resolved) const;
    /// Returns all composed fields that the layers have, and always the type, variability and
    /// custom flag.
    [[nodiscard]] Metadata authoredMetadata(AssetPaths assetPaths = AssetPaths::Resolved) const;

    bool operator==(const Property&) const = default;

private:
    friend class Prim;
    Property(Prim prim, pxr::TfToken name) : prim_(std::move(prim)), name_(std::move(name)) {}
    [[nodiscard]] bool isKnown() const;
    [[nodiscard]] pxr::SdfSpecType specType() const;

    Prim prim_;
    pxr::TfToken name_;
};

}  // namespace usdlive::stage
