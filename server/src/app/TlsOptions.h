// Loads the certificate that the options name.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "app/Options.h"
#include "transport/ServerTls.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Returns nullptr if the options demand no encryption. `hosts`: the names under which the server
/// answers. With `auto`, the first start creates the certificate in `.usdlive/tls` of the served
/// folder. Error: InvalidConfiguration says what mends it.
[[nodiscard]] Result<std::unique_ptr<ServerTls>> loadTls(const ServerOptions& options,
                                                         std::vector<std::string> hosts);

/// Returns the fingerprint of the certificate that `--tls auto` uses for the folder, and creates it
/// if there is none: for this machine and `host`. Error: InvalidConfiguration.
[[nodiscard]] Result<std::string> ownFingerprint(const std::filesystem::path& folder,
                                                 const std::string& host);

}  // namespace usdlive::server
