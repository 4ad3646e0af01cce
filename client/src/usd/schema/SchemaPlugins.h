// Declares the reader of the schema descriptions in plugInfo.json files.
#pragma once

#include <pxr/base/tf/token.h>

#include <map>
#include <string>
#include <vector>

#include "usdlive/client/usd/schema/SchemaInfo.h"

namespace usdlive::schema {

/// The descriptions of schemas in the plugInfo.json files of all plug-ins.
struct SchemaPlugins {
    std::vector<SchemaInfo> schemas;  ///< in the order of their identifiers, each once
    std::map<std::string, std::string> resourcePaths;  ///< by name of a plug-in that has schemas
    /// API schemas, with the types that plug-ins other than the schema's own apply them to.
    std::map<pxr::TfToken, pxr::TfTokenVector> autoApply;
};

/// Reads the metadata from PlugRegistry. Adds a sentence to `problems` for each malformed entry and
/// for each schema that is ignored.
[[nodiscard]] SchemaPlugins readSchemaPlugins(std::vector<std::string>& problems);

}  // namespace usdlive::schema
