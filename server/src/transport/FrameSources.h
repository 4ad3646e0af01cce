// Produces the frames that are sent beside a session's stream.
#pragma once

#include <boost/asio/io_context.hpp>
#include <deque>
#include <functional>
#include <memory>
#include <optional>

#include "transport/Transport.h"

namespace usdlive::server {

/// Produces the frames that one session is sent beside its stream: in the background, one at a
/// time, in turns. Network thread.
class FrameSources : public std::enable_shared_from_this<FrameSources> {
public:
    /// Not called after clear() or after the session, the only owner of this object, is destroyed.
    struct Session {
        std::function<std::size_t()> partBytes;  ///< size of the next frame; 0: no room
        std::function<void(SharedBytes)> send;
        std::function<void()> failed;  ///< a source threw, which is a bug
    };

    FrameSources(boost::asio::io_context& io, const Background& background, Session session)
        : io_(io), background_(background), session_(std::move(session)) {}

    /// Returns false if there are Transport::kMaxSources already.
    [[nodiscard]] bool add(FrameSource source);
    /// Produces the next frame if there is room. Call it when room has become free.
    void produce();
    /// Drops all sources for good.
    void clear();

private:
    void onProduced(const std::shared_ptr<FrameSource>& source,
                    const std::optional<SharedBytes>& frame);

    boost::asio::io_context& io_;
    const Background& background_;
    const Session session_;
    std::deque<std::shared_ptr<FrameSource>> sources_;
    bool producing_ = false;  // one source is running and not in sources_
    bool cleared_ = false;
};

}  // namespace usdlive::server
