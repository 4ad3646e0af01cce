// Parses and combines the paths of specs.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// The list of its parent that contains a spec.
enum class ChildList : std::uint8_t { Prims, Properties, VariantSets, Variants };

/// One step from a spec to its child.
struct PathElement {
    ChildList list;
    std::string_view name;  ///< a view into the parsed text
    bool operator==(const PathElement&) const = default;
};

/// Operations on the path of a spec. A path is a text as Sdf writes it, absolute: `/`, `/A/B`,
/// `/A.x`, `/A{set=}` (the variant set), `/A{set=one}` (the variant), `/A{set=one}B.x`. Target
/// paths (`.r[/T]`) are no specs of the model: they follow from the list op.
namespace specpath {

/// PA1: splits a path. At most 16 KiB and 1,024 elements; the pseudo-root has none. Error:
/// ErrorCode::InvalidPath with the reason.
[[nodiscard]] Result<std::vector<PathElement>> parse(std::string_view path);

/// PA2: returns true if a child in that list can have this name. Prims and variant sets: OpenUSD
/// identifiers (UTF-8). Properties: identifiers separated by `:`. Variants: characters that can
/// follow the first in an identifier, and `|` and `-`, with an optional leading `.`; never empty.
[[nodiscard]] bool isName(ChildList list, std::string_view name);

/// Returns `path` extended by one child: ("/A", {Properties, "x"}) gives "/A.x". Precondition:
/// `path` may have such children (for a Variants child, `path` is a variant set).
[[nodiscard]] std::string child(std::string_view path, ChildList list, std::string_view name);
/// Extends `path` in place.
void extend(std::string& path, ChildList list, std::string_view name);

/// Returns the parent's path: "/A{v=one}B" gives "/A{v=one}", "/A{v=one}" gives "/A{v=}", "/A{v=}"
/// gives "/A", "/" gives "". Precondition: a valid path.
[[nodiscard]] std::string_view parentView(std::string_view path, std::string& scratch);
[[nodiscard]] std::string parent(std::string_view path);
/// Returns the last element. Precondition: a valid path, not "/".
[[nodiscard]] PathElement last(std::string_view path);

/// Returns true if `path` is the spec `ancestor` or below it. A variant `/A{v=one}` is below its
/// set `/A{v=}`.
[[nodiscard]] bool hasPrefix(std::string_view path, std::string_view ancestor);

/// Replaces the prefix `ancestor` of `path` by another spec of the same list and adjusts the
/// separators: ("/A/B.x", "/A", "/") gives "/B.x". Works for the content of a variant, too.
/// Precondition: hasPrefix(path, ancestor).
[[nodiscard]] std::string replacePrefix(std::string_view path, std::string_view ancestor,
                                        std::string_view newAncestor);

}  // namespace specpath
}  // namespace usdlive
