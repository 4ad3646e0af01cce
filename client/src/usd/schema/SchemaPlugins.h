#pragma once

#include <pxr/base/tf/token.h>

#include <map>
#include <string>
#include <vector>

#include "usdlive/client/usd/schema/SchemaInfo.h"

namespace usdlive::schema {

/// What the plugInfo.json files say of schemas.
struct SchemaPlugins {
    std::vector<SchemaInfo> schemas;  ///< in the order of their identifiers, each once
    std::map<std::string, std::string> resourcePaths;  ///< of plug-ins that have schemas, by name
    /// Types that plug-ins other than the schema's own apply an API schema to.
    std::map<pxr::TfToken, pxr::TfTokenVector> autoApply;
};

/// Asks PlugRegistry. Adds a sentence to `problems` for each entry that is malformed, and for each
/// schema that is passed over.
[[nodiscard]] SchemaPlugins readSchemaPlugins(std::vector<std::string>& problems);

}  // namespace usdlive::schema
