// Checks and applies edits of one field.
#pragma once

#include "usdlive/common/core/Result.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive {

// Applies ED5 and ED6 to the content of one field.

/// Checks the edit by itself: a value of the part's kind, at least one key, a finite time
/// (InvalidEdit, InvalidValue), and D1 on the pseudo-root (ForbiddenValue).
[[nodiscard]] Result<void> checkSet(bool pseudoRoot, const SetField& set);
/// Refuses a field that looks like a list of children. Files may contain one that is none, because
/// metadata of a plug-in can have such a name.
[[nodiscard]] Result<void> checkAuthored(const SetField& set);
[[nodiscard]] Result<void> checkErase(const EraseField& erase);

/// ED7: returns false for a field that the text format cannot write for this kind of property. Any
/// other field is metadata and allowed.
[[nodiscard]] bool canHave(SpecKind kind, const SetField& set);

/// Returns true if the edit turns a prim into an `over`, which states nothing about the prim.
[[nodiscard]] bool makesOver(const SetField& set);

// The following expect edits that have passed the checks.

/// Returns true if the edit would not change the field. nullptr is an absent field.
[[nodiscard]] bool holdsAlready(const FieldValue* field, const SetField& set);
void setPart(FieldValue& field, const SetField& set);
[[nodiscard]] bool holdsPart(const FieldValue& field, const FieldPart& part);
/// Returns false when the field is empty afterwards and has to be erased as a whole. Precondition:
/// holdsPart().
[[nodiscard]] bool erasePart(FieldValue& field, const FieldPart& part);

/// Returns the entry at the key path, one key per level, or nullptr if there is none.
[[nodiscard]] const Dictionary::Entry* entryAt(const Dictionary* dictionary,
                                               const std::vector<std::string>& path);

}  // namespace usdlive
