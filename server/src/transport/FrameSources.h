#pragma once

#include <boost/asio/io_context.hpp>
#include <deque>
#include <functional>
#include <memory>
#include <optional>

#include "usdlive/server/transport/Transport.h"

namespace usdlive::server {

/// What one session is sent beside its stream: frames that sources make in the background, one at a
/// time, by turns. Network thread.
class FrameSources : public std::enable_shared_from_this<FrameSources> {
public:
    /// Not called after clear(), nor once the session, which alone holds this, is gone.
    struct Session {
        std::function<bool()> hasRoom;
        std::function<void(SharedBytes)> send;
        std::function<void()> failed;  ///< a source threw: a bug, without the rest of it
    };

    FrameSources(boost::asio::io_context& io, const Background& background, Session session)
        : io_(io), background_(background), session_(std::move(session)) {}

    /// False: there are Transport::kMaxSources already.
    [[nodiscard]] bool add(FrameSource source);
    /// Has the next frame made, if there is room: to be called when some has become free.
    void produce();
    /// For good.
    void clear();

private:
    void onProduced(const std::shared_ptr<FrameSource>& source,
                    const std::optional<SharedBytes>& frame);

    boost::asio::io_context& io_;
    const Background& background_;
    const Session session_;
    std::deque<std::shared_ptr<FrameSource>> sources_;
    bool producing_ = false;  // one of them is at work, and not in sources_
    bool cleared_ = false;
};

}  // namespace usdlive::server
