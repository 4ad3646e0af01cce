// Verbs that compose a stage, from files or from the layers of a project.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "cli/Target.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

struct ServedRoot {
    Target target;           ///< with one layer
    Revision revision = 0;   ///< 0: the newest
    std::string checkpoint;  ///< used instead of the revision
};

struct ComposedOptions {
    std::string root;                  ///< a file, or a usdlive:// address with a revision
    std::optional<ServedRoot> served;  ///< a layer of a project, instead of the file
    std::string session;               ///< a file; empty: an anonymous layer
    std::string base;   ///< paths of files are relative to it; empty: the folder of the root
    std::string out;    ///< empty: standard output
    std::string batch;  ///< a file that lists stages, instead of a root
    std::size_t fold = 64;
    bool json = false;
};

/// Prints everything that a stage shows as JSON.
Result<void> dumpComposed(const ComposedOptions& options);
/// Prints the prims of a stage with their types.
Result<void> treeComposed(const ComposedOptions& options);
/// Writes a stage as one layer, in the format that the name of the file says; prints it as text.
Result<void> flattenComposed(const ComposedOptions& options);

}  // namespace usdlive::cli
