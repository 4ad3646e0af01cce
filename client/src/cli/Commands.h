#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

// What each command of `usdlive` does. They print to standard output; an error is for the caller to
// show.
namespace usdlive::cli {

struct CatOptions {
    std::string url;  ///< with the layer
    Revision revision = 0;
};
struct LogOptions {
    std::string url;
    std::string layer;
    Revision from = 0;  ///< 0: the latest
    std::size_t limit = 20;
    bool all = false;  ///< every edit of a commit
    bool json = false;
};
struct WatchOptions {
    std::string url;
    std::string layer;
    bool json = false;
};

Result<void> list(const std::string& url);
Result<void> cat(const CatOptions& options);
Result<void> tree(const CatOptions& options);
Result<void> log(const LogOptions& options);
/// Until SIGINT or SIGTERM.
Result<void> watch(const WatchOptions& options);
Result<void> save(const std::string& url, const std::vector<std::string>& layers);
/// Becomes `usdlive-server`; returns only when that fails.
Error serve(char** arguments);

}  // namespace usdlive::cli
