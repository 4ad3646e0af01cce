// The base of the classes that generateSchema.py writes for the schemas of prims.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>

#include <optional>
#include <string>
#include <utility>

#include "usdlive/client/usd/stage/Prim.h"
#include "usdlive/client/usd/stage/Stage.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::schemas {

/// One schema of one prim: the base of the classes that generateSchema.py writes.
///
/// A handle like the prim's. Reads composed values and fallbacks; writes to the edit target of the
/// prim's stage. Whether the prim has the schema is only asked by isValid(): a value of a prim
/// without it can be read and written, too, as with pxr.Usd.
class SchemaAccess {
public:
    [[nodiscard]] const stage::Prim& prim() const { return prim_; }
    /// Whether the prim is of this type, or has this API schema. Every prim has a non-applied one.
    [[nodiscard]] bool isValid() const;
    explicit operator bool() const { return isValid(); }

protected:
    /// `instance`: of a multiple-apply API schema.
    SchemaAccess(stage::Prim prim, const char* identifier, const std::string& instance = {});

    /// Names of a multiple-apply schema are templates. Empty: no value, or one of another type.
    template <class T>
    [[nodiscard]] std::optional<T> get(const char* name, std::optional<double> time = {}) const {
        const pxr::VtValue value = valueOf(name, time);
        if (!value.IsHolding<T>()) return {};
        return value.UncheckedGet<T>();
    }
    [[nodiscard]] Result<void> set(const char* name, const pxr::VtValue& value,
                                   std::optional<double> time = {}) const;
    [[nodiscard]] pxr::SdfPathVector targets(const char* name) const;
    [[nodiscard]] Result<void> setTargets(const char* name,
                                          const pxr::SdfPathVector& targets) const;

    /// Author the list of API schemas as UsdPrim::ApplyAPI and RemoveAPI do.
    [[nodiscard]] Result<void> applyToPrim() const;
    [[nodiscard]] Result<void> removeFromPrim() const;
    [[nodiscard]] static Result<stage::Prim> definePrim(stage::Stage& stage,
                                                        const pxr::SdfPath& path, const char* type);

private:
    [[nodiscard]] pxr::TfToken appliedName() const;
    [[nodiscard]] pxr::TfToken propertyName(const char* name) const;
    [[nodiscard]] pxr::VtValue valueOf(const char* name, std::optional<double> time) const;

    stage::Prim prim_;
    pxr::TfToken identifier_, instance_;
};

}  // namespace usdlive::schemas
