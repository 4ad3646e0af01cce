// The words after a verb: a server and layers of its project.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "transport/Connection.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

struct Target {
    client::ServerAddress server;
    std::vector<LayerId> layers;
};

/// Returns true if the word is meant as the address of a server: it has `://`, or a colon after a
/// text that can be a host. No layer name has a colon.
[[nodiscard]] bool looksLikeAddress(std::string_view word);

/// Reads `[URL] [LAYER...]`. The first word is the server if it contains a colon. The default
/// server is USDLIVE_URL, or ws://127.0.0.1:7447. A layer in the URL becomes the first layer. If
/// the URL has a path of several parts, asks the server whether the first is one of its projects.
/// Error: InvalidArgument names the wrong word.
[[nodiscard]] Result<Target> parseTarget(const std::vector<std::string>& words);

/// Returns the default server.
[[nodiscard]] std::string defaultServer();

}  // namespace usdlive::cli
