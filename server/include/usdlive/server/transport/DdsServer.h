#pragma once

#include <memory>
#include <string>

#include "usdlive/common/dds/Domain.h"
#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/Transport.h"

namespace boost::asio {
class io_context;
}

namespace usdlive::server {

struct DdsServerOptions {
    dds::DomainSettings domain;
    std::string project;  ///< by which clients find it
    std::string url;      ///< of the same project by WebSocket
    Revision revision = 0;
    /// Of one message from a client; larger: FrameTooLarge and close.
    std::size_t maxMessageBytes = 64ull << 20;
    /// Who comes when there are as many is not answered.
    std::size_t maxSessions = 1'256;
    /// What may wait for a reader. One more frame than this and it is cut with SlowReader.
    std::size_t slowReaderBytes = 16ull << 20;
    /// So long may nothing of what was sent be acknowledged; then the reader is cut, too.
    std::chrono::milliseconds slowReaderTime{10'000};
    /// A peer that has said nothing for so long is taken for dead.
    std::chrono::milliseconds peerTime{14'000};
};

/// Serves a project over DDS (rules DD1 and on): commits once for all clients, the rest to each of
/// them. What comes is taken on a thread of its own and posted to the network thread.
/// InvalidConfiguration: what is wrong with the domain's settings.
[[nodiscard]] Result<std::unique_ptr<Transport>> createDdsServer(boost::asio::io_context& io,
                                                                 DdsServerOptions options,
                                                                 SessionHandler& handler,
                                                                 Background background, Log& log);

}  // namespace usdlive::server
