// What the words behind a verb name: a server, and layers of its project.
#pragma once

#include <string>
#include <vector>

#include "usdlive/client/transport/Connection.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

struct Target {
    client::ServerAddress server;
    std::vector<LayerId> layers;
};

/// Reads `[URL] [LAYER...]`. The first word is the server if it has a colon, which no layer's name
/// has; without one the server is USDLIVE_URL, else ws://127.0.0.1:7447. A layer in the URL is the
/// first layer. A path of several parts in the URL asks the server whether the first names one of
/// its projects. InvalidArgument says which word is wrong.
[[nodiscard]] Result<Target> parseTarget(const std::vector<std::string>& words);

/// The server that is meant where none is named.
[[nodiscard]] std::string defaultServer();

}  // namespace usdlive::cli
