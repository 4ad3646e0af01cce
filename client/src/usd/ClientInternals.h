// The door to the inside of a Client, for tests and tools of this project. Not installed.
#pragma once

#include <functional>
#include <memory>

#include "session/Session.h"
#include "transport/Connection.h"
#include "usdlive/client/usd/Client.h"

namespace usdlive::client {

struct ClientInternals {
    using Connector = std::function<Result<std::unique_ptr<Connection>>()>;
    /// Client::connect() over connections of another kind.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(Connector connector,
                                                                   Client::Options options);
    /// Over a single connection: unsent work is kept only where `stateFolder` is set, and cannot
    /// be sent.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(
        std::unique_ptr<Connection> connection, Client::Options options);

private:
    static Result<std::unique_ptr<Client>> make(std::unique_ptr<Connection> connection,
                                                Connector connector, Client::Options options);
};

}  // namespace usdlive::client
