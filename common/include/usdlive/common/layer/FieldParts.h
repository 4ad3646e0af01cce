#pragma once

#include "usdlive/common/core/Result.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive {

// ED5 and ED6 on the content of one field.

/// Does the edit make sense by itself? A value that is there and of the part's kind, keys, a finite
/// time (InvalidEdit, InvalidValue), and D1 on the pseudo-root (ForbiddenValue).
[[nodiscard]] Result<void> checkSet(bool pseudoRoot, const SetField& set);
/// An author may not set a field that looks like a list of children. Files may hold some that are
/// none: a plug-in's metadata can be called so.
[[nodiscard]] Result<void> checkAuthored(const SetField& set);
[[nodiscard]] Result<void> checkErase(const EraseField& erase);

/// ED7: no text could hold it otherwise. Whatever else a property of the other kind has is only
/// metadata.
[[nodiscard]] bool canHave(SpecKind kind, const SetField& set);

/// Does it make a prim an `over`, which states nothing about the prim?
[[nodiscard]] bool makesOver(const SetField& set);

// The following take edits that have passed the checks.

/// Would the edit leave the field as it is? nullptr is "absent".
[[nodiscard]] bool holdsAlready(const FieldValue* field, const SetField& set);
void setPart(FieldValue& field, const SetField& set);
[[nodiscard]] bool holdsPart(const FieldValue& field, const FieldPart& part);
/// False when nothing is left, so that the field has to go as a whole. Precondition: holdsPart().
[[nodiscard]] bool erasePart(FieldValue& field, const FieldPart& part);

/// What stands at the key path, one key a level; nullptr: nothing, or there is no dictionary.
[[nodiscard]] const Dictionary::Entry* entryAt(const Dictionary* dictionary,
                                               const std::vector<std::string>& path);

/// Are these the same item of a list (itemKey)?
[[nodiscard]] bool sameItem(const Value& left, const Value& right);

}  // namespace usdlive
