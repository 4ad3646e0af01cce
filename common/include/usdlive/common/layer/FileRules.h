// The rules for content that every layer file can have.
#pragma once

#include <optional>
#include <string_view>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

// ED8-ED12: the limits for authors, so that every layer can be saved and read back. Files and
// histories may contain more.

/// Returns the value type of an attribute's type name, or nothing for a name that Sdf does not
/// know.
[[nodiscard]] std::optional<ValueType> valueTypeOf(std::string_view typeName);

/// Returns true for the fields of an attribute whose content has the attribute's type.
[[nodiscard]] bool dependsOnType(std::string_view field);
/// ED9: returns true if an attribute of this type can have the field (`default`, `timeSamples`,
/// `spline`). Other fields fit always, and so does any field if the attribute has no type or an
/// unknown one.
[[nodiscard]] bool fitsType(std::string_view typeName, std::string_view field,
                            const FieldValue& content);
/// The same for an edit.
[[nodiscard]] bool fitsType(std::string_view typeName, const SetField& set);
/// Returns the type of the attribute at `path`, or an empty text if there is none.
[[nodiscard]] std::string_view attributeType(const LayerDoc& doc, std::string_view path);

/// ED8: checks that the type name can be written for a spec of `kind`. Errors: InvalidValue;
/// InvalidEdit if an attribute would lose its type.
[[nodiscard]] Result<void> checkTypeName(SpecKind kind, const EditAction& action);

/// ED11: checks that a dictionary holds only values of types that attributes have. Error:
/// InvalidValue.
[[nodiscard]] Result<void> checkDictionary(const SetField& set);

/// ED12: checks that no text or key of the edit holds a NUL. Does not see into blobs. Error:
/// InvalidValue.
[[nodiscard]] Result<void> checkTexts(const SetField& set);
/// Returns true if a text or key in the bytes of a valid leaf holds a NUL.
[[nodiscard]] bool holdsNul(ValueType type, ByteView bytes);

/// Checks that a file can have the content that an edit of the spec at `path` writes (ED8, ED9,
/// ED11, ED12). Errors: InvalidValue, InvalidEdit.
[[nodiscard]] Result<void> checkForFile(const LayerDoc& doc, std::string_view path,
                                        const EditAction& action);

/// ED10: returns true for content that the text format cannot write and that means the same as no
/// field.
[[nodiscard]] bool saysNothing(std::string_view field, const FieldValue& content);

}  // namespace usdlive
