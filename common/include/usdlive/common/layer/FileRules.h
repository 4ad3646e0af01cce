#pragma once

#include <optional>
#include <string_view>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

// ED8-ED11: what an author may write so that every layer can be saved and read back. Files and
// histories may hold other things.

/// The type of value that the type name of an attribute stands for; nothing for a name that Sdf
/// does not know.
[[nodiscard]] std::optional<ValueType> valueTypeOf(std::string_view typeName);

/// Are these the fields of an attribute whose content is of its type?
[[nodiscard]] bool dependsOnType(std::string_view field);
/// ED9: can an attribute of this type have the field (`default`, `timeSamples`, `spline`)? Any
/// other field, an attribute without a type and one of an unknown type can.
[[nodiscard]] bool fitsType(std::string_view typeName, std::string_view field,
                            const FieldValue& content);
/// The same of an edit.
[[nodiscard]] bool fitsType(std::string_view typeName, const SetField& set);
/// The type of the attribute at `path`; empty without one.
[[nodiscard]] std::string_view attributeType(const LayerDoc& doc, std::string_view path);

/// ED8: a type name of a spec of `kind` that can be written. InvalidValue, or InvalidEdit for an
/// attribute that would lose its type.
[[nodiscard]] Result<void> checkTypeName(SpecKind kind, const EditAction& action);

/// ED11: a dictionary holds values of the types that attributes have. InvalidValue.
[[nodiscard]] Result<void> checkDictionary(const SetField& set);

/// ED10: no text can hold this content, and no field says the same.
[[nodiscard]] bool saysNothing(std::string_view field, const FieldValue& content);

}  // namespace usdlive
