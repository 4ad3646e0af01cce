#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include <optional>

#include "usdlive/client/usd/stage/AttributeQuery.h"
#include "usdlive/client/usd/stage/Prim.h"

namespace usdlive::stage {

/// An attribute or a relationship of a prim. A handle, as Prim is one.
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
    /// Whether any layer has it; else only schemas do.
    [[nodiscard]] bool isAuthored() const;
    [[nodiscard]] bool isCustom() const;
    /// What schemas say; null: it is not built in.
    [[nodiscard]] const schema::PropertyDefinition* definition() const;

    /// Of an attribute.
    [[nodiscard]] pxr::TfToken typeName() const;
    [[nodiscard]] pxr::SdfVariability variability() const;
    /// Of an attribute, for reading at many times. Valid until the stage changes.
    [[nodiscard]] AttributeQuery query(AssetPaths assetPaths = AssetPaths::Resolved) const;
    /// Of an attribute: at the default time, or at a time of the stage. Empty: it has none there.
    [[nodiscard]] pxr::VtValue value(std::optional<double> time = {}) const;
    /// The same, of query().
    [[nodiscard]] pxr::VtValue value(const AttributeQuery& query,
                                     std::optional<double> time = {}) const;

    /// Targets of a relationship, connections of an attribute: composed, and as paths of the stage.
    [[nodiscard]] pxr::SdfPathVector targets() const;
    [[nodiscard]] bool hasAuthoredTargets() const;

    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field,
                                        AssetPaths assetPaths = AssetPaths::Resolved) const;
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
