// Declares what the examples use of UsdPrim; see stage.h.
#pragma once

#include <pxr/base/tf/token.h>

#include <functional>

namespace pxr {

class UsdPrim {
public:
    using PropertyPredicateFunc = std::function<bool(const TfToken& propertyName)>;
    explicit operator bool() const;
    TfTokenVector GetAllChildrenNames() const;
    TfTokenVector GetPropertyNames(const PropertyPredicateFunc& predicate = {}) const;
};

}  // namespace pxr
