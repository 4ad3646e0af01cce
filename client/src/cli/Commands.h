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
    std::string checkpoint;  ///< instead of a revision
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

/// `states`: beside each layer what is known of it.
Result<void> list(const std::string& url, bool states);
/// Who is there, and where.
Result<void> who(const std::string& url);
Result<void> cat(const CatOptions& options);
Result<void> tree(const CatOptions& options);
Result<void> log(const LogOptions& options);
/// Until SIGINT or SIGTERM.
Result<void> watch(const WatchOptions& options);
/// In the name of the system's user; an error says who holds it.
Result<void> setLocked(const std::string& url, bool locked);
Result<void> save(const std::string& url, const std::vector<std::string>& layers, bool force);
Result<void> reload(const std::string& url, const std::vector<std::string>& layers);
/// Names what the project is now.
Result<void> createCheckpoint(const std::string& url, const std::string& name);
Result<void> listCheckpoints(const std::string& url);
Result<void> setMuted(const std::string& url, const std::string& layer, bool muted);
/// Becomes `usdlive-server`; returns only when that fails.
Error serve(char** arguments);

}  // namespace usdlive::cli
