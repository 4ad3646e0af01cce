// Finds the layers and files that the fields of a layer name.
#pragma once

#include <pxr/base/vt/value.h>

#include <set>
#include <string>
#include <string_view>

namespace usdlive::usd {

/// Returns true for fields that name other layers to compose: sublayers, references, payloads.
[[nodiscard]] bool namesLayers(std::string_view field);
/// Returns true for the metadata that names the layers of value clips.
[[nodiscard]] bool namesClips(std::string_view field);

/// Adds the asset paths in the value of such a field, as authored. A `clips` dictionary, or a part
/// of it, also has templates: see matchesTemplate().
void addNamedAssets(const pxr::VtValue& value, std::set<std::string>& assets);

/// Returns true for the template of a clip set, such as "clips/a.###.usda".
[[nodiscard]] bool isTemplate(std::string_view asset);
/// Returns whether the path is one that the template stands for, with a number in place of each
/// group of "#".
[[nodiscard]] bool matchesTemplate(std::string_view pattern, std::string_view path);

}  // namespace usdlive::usd
