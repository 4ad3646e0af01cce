#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// Which list of its parent a spec stands in.
enum class ChildList : std::uint8_t { Prims, Properties, VariantSets, Variants };

/// One step from a spec to its child.
struct PathElement {
    ChildList list;
    std::string_view name;  ///< into the text parsed
    bool operator==(const PathElement&) const = default;
};

/// The text of a spec's path as Sdf writes it, absolute: `/`, `/A/B`, `/A.x`, `/A{set=}` (the
/// variant set), `/A{set=one}` (the variant), `/A{set=one}B.x`. Target paths (`.r[/T]`) are no
/// specs of ours: they follow from the list op. A path is addressed as text everywhere; these are
/// its operations.
namespace specpath {

/// PA1: splits a path; ErrorCode::InvalidPath with the reason otherwise. At most 16 KiB and 1,024
/// elements. The pseudo-root has no elements.
[[nodiscard]] Result<std::vector<PathElement>> parse(std::string_view path);

/// PA2: may a child in that list be called so? Prims and variant sets: identifiers as OpenUSD takes
/// them (UTF-8). Properties: identifiers with `:` between them. Variants: what identifiers go on
/// with, `|` and `-`, after a `.` or not; never empty.
[[nodiscard]] bool isName(ChildList list, std::string_view name);

/// `path` extended by one child: ("/A", {Properties, "x"}) gives "/A.x".
/// Precondition: `path` may have such children (a Variants child: `path` is a variant set).
[[nodiscard]] std::string child(std::string_view path, ChildList list, std::string_view name);
/// The same, in place.
void extend(std::string& path, ChildList list, std::string_view name);

/// The parent's path: "/A{v=one}B" gives "/A{v=one}", "/A{v=one}" gives "/A{v=}", "/A{v=}" gives
/// "/A",
/// "/" gives "". Precondition: a valid path.
[[nodiscard]] std::string_view parentView(std::string_view path, std::string& scratch);
[[nodiscard]] std::string parent(std::string_view path);
/// The last element. Precondition: a valid path, not "/".
[[nodiscard]] PathElement last(std::string_view path);

/// Is `path` the spec `ancestor` or below it? A variant `/A{v=one}` is below its set `/A{v=}`.
[[nodiscard]] bool hasPrefix(std::string_view path, std::string_view ancestor);

/// What follows `ancestor` in `path`; precondition: hasPrefix. replacePrefix joins it to another
/// spec (of the same list), minding the separators: ("/A/B.x", "/A", "/") gives "/B.x"; a variant's
/// content likewise.
[[nodiscard]] std::string replacePrefix(std::string_view path, std::string_view ancestor,
                                        std::string_view newAncestor);

}  // namespace specpath
}  // namespace usdlive
