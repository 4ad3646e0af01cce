// Requests to servers of usdlive.
#pragma once

#include <functional>

#include "usdlive/common/fetch/Http.h"

namespace usdlive::fetch {

/// Sends a GET request to a server of usdlive, on a connection of its own, and waits for the whole
/// answer (see get()). Uses what this user knows about the server (KnownServers): it is encrypted
/// if the request's origin or the entry says so, and has the user's token unless it has a header
/// Authorization. The answer 401 is a
/// failure. Failures say what to do, for example if no server is running. Any thread.
[[nodiscard]] Fetched<HttpAnswer> getFromServer(HttpRequest request, const HttpLimits& limits,
                                                std::function<bool()> isStopped = {});

}  // namespace usdlive::fetch
