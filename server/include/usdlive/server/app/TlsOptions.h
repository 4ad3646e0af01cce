// Loads the certificate that the options name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "usdlive/common/core/Result.h"
#include "usdlive/server/app/Options.h"
#include "usdlive/server/transport/ServerTls.h"

namespace usdlive::server {

/// Returns nullptr if the options demand no encryption. `hosts`: the names under which the server
/// answers. With `auto`, the first start creates the certificate in `.usdlive/tls` of the served
/// folder. Error: InvalidConfiguration says what mends it.
[[nodiscard]] Result<std::unique_ptr<ServerTls>> loadTls(const ServerOptions& options,
                                                         std::vector<std::string> hosts);

}  // namespace usdlive::server
