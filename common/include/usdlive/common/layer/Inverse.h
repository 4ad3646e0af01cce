// The inverse of executed edits, computed against the present.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

// The inverse of an edit is made in two steps: from the doc directly before the edit, and from the
// doc directly after it. Names and paths are those of then. The owner of an inverse follows the
// specs that it names through later moves.

/// A register that an edit has written.
struct WrittenRegister {
    /// A part of the field; nothing: it is absent.
    struct Content {
        FieldPart part;
        std::optional<FieldValue> before, after;
    };
    std::string field;
    Content own;  ///< the part that the edit names
    /// A larger part that the edit has replaced, because it could not hold the part: a field of
    /// another form, a value in the place of a dictionary.
    std::optional<Content> replaced = {};
    std::optional<Value> next = {};  ///< the item that followed a list item before the edit
    ValueType form = ValueType::None;
    bool changed = true;
};
/// A spec that an edit has created.
struct CreatedSpec {};
/// A spec that an edit has deleted, with everything below it.
struct DeletedSpec {
    SpecTree content;
    std::string next;  ///< the sibling that followed it; empty: it was the last
};
/// A spec, or the object at a place (M15), that an edit has moved.
struct MovedSpec {
    std::string parent, name, next;  ///< before the move
    bool place = false;
};
/// A spec that has got another place among its siblings.
struct PlacedSpec {
    std::string next;  ///< before the edit
};
/// The inverse of one edit. std::monostate: there is nothing to take back.
using Inverse =
    std::variant<std::monostate, WrittenRegister, CreatedSpec, DeletedSpec, MovedSpec, PlacedSpec>;

/// Returns the inverse of an edit that will be applied to `doc`. Takes time in proportion to what
/// the edit names, not to the doc. Call completeInverse() when it was applied.
[[nodiscard]] Inverse inverseBefore(const LayerDoc& doc, const std::string& path,
                                    const EditAction& action);
/// `path` is that of the spec before the edit.
void completeInverse(Inverse& inverse, const LayerDoc& doc, const std::string& path);

/// Returns the edits that restore what the register held, against its present content (nullptr:
/// absent); none if it holds that already. Returns nothing if the register has to be kept: it
/// does not hold any more what the edit wrote, or `isOthers` returns true for a part that would be
/// restored. A field that was written as a whole is restored part by part if others have changed
/// some.
[[nodiscard]] std::optional<std::vector<EditAction>> restoredRegister(
    const WrittenRegister& written, const FieldValue* present,
    const std::function<bool(const FieldPart&)>& isOthers);
/// Returns the edits that create deleted specs again, with the topmost at `path`.
[[nodiscard]] std::vector<std::pair<std::string, EditAction>> restoredSpecs(
    const SpecTree& content, const std::string& path);

/// Returns the content of a part of a field; nothing if it is absent. For a list item it is the
/// item.
[[nodiscard]] std::optional<FieldValue> contentOf(const FieldValue* field, const FieldPart& part);
/// Returns whether a write of one part also writes the other.
[[nodiscard]] bool overlap(const FieldPart& one, const FieldPart& other);
/// Returns about how many bytes of memory an inverse takes. Takes time in proportion to what an
/// edit has deleted.
[[nodiscard]] std::size_t memoryOf(const Inverse& inverse);

}  // namespace usdlive
