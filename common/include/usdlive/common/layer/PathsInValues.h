// The paths of specs in the values of edits and fields (M15).
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// The kinds of things that a path in a value names.
enum class PathRole {
    Object,  ///< an object of a stage: a target, a connection, an internal arc, a path in a
             ///< dictionary
    Place    ///< a place, whatever is there: both sides of a relocate
};

/// Returns whether the values of an action may contain paths. Takes constant time, except for
/// dictionaries.
[[nodiscard]] bool mayHavePaths(const EditAction& action);
/// The same for the content of a field.
[[nodiscard]] bool mayHavePaths(const FieldValue& content);

/// Receives a path and returns the one to replace it by, or nothing if the object has been deleted.
using PathChange = std::function<std::optional<std::string>(std::string_view path, PathRole role)>;

/// Replaces the paths in the values of an action, always in the same order. Only absolute paths of
/// prims, properties and variants (PA1). Returns false if the action writes a path that has been
/// deleted and nothing else: a target, an arc, a relocate. Such a path is removed from a list, and
/// stays in dictionaries, in samples, and in an action that erases.
[[nodiscard]] bool changePaths(EditAction& action, const PathChange& change);
/// The same for the content of a field.
[[nodiscard]] bool changePaths(FieldValue& content, const PathChange& change);

/// Calls `visit` for each path in the order of changePaths().
void forEachPath(const EditAction& action,
                 const std::function<void(std::string_view path, PathRole role)>& visit);

}  // namespace usdlive
