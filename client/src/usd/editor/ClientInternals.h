// Access to the internals of a Client, for tests and tools of this project. Not installed.
#pragma once

#include <functional>
#include <memory>

#include "session/Session.h"
#include "transport/Connection.h"
#include "usdlive/client/usd/Client.h"

namespace usdlive::client {

struct ClientInternals {
    using Connector = std::function<Result<std::unique_ptr<Connection>>()>;
    /// Does the same as Client::connect(), with connections made by `connector`.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(Connector connector,
                                                                   Client::Options options);
    /// Connects over a single connection. Unsent edits are kept only if `stateFolder` is set, and
    /// cannot be sent.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(
        std::unique_ptr<Connection> connection, Client::Options options);

private:
    static Result<std::unique_ptr<Client>> make(std::unique_ptr<Connection> connection,
                                                Connector connector, Client::Options options);
};

}  // namespace usdlive::client
