// Creates the DDS transport of a project.
#pragma once

#include <memory>
#include <string>

#include "transport/Log.h"
#include "transport/Transport.h"
#include "usdlive/common/core/StoreId.h"
#include "usdlive/common/dds/Domain.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct DdsServerOptions {
    dds::DomainSettings domain;
    std::string project;  ///< the name by which clients find it
    std::string url;      ///< WebSocket address of the same project
    StoreId store;        ///< identity of the project's store
    Revision revision = 0;
    /// The limit of one message from a client. A larger one gives FrameTooLarge and closes the
    /// session.
    std::size_t maxMessageBytes = 64ull << 20;
    /// With this many sessions open, new clients are not answered.
    std::size_t maxSessions = 1'256;
    /// The limit of data waiting for a reader. One more frame closes the session with SlowReader.
    std::size_t slowReaderBytes = 16ull << 20;
    /// A reader that acknowledges nothing for this long is also closed with SlowReader.
    std::chrono::milliseconds slowReaderTime{10'000};
    /// A peer that sends nothing for this long is treated as lost.
    std::chrono::milliseconds peerTime{14'000};
    /// The time limit for the hello of a session.
    std::chrono::milliseconds greetTime{10'000};
};

/// Serves a project over DDS (the DD rules): commits once for all clients, everything else to each
/// client. Receives on a thread of its own and posts to the network thread. Error:
/// InvalidConfiguration names the wrong setting of the domain.
[[nodiscard]] Result<std::unique_ptr<Transport>> createDdsServer(boost::asio::io_context& io,
                                                                 DdsServerOptions options,
                                                                 SessionHandler& handler,
                                                                 Background background, Log& log);

}  // namespace usdlive::server
