// Serves the WebSocket sessions of one project.
#include "transport/WebSocketTransport.h"

#include <algorithm>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/post.hpp>
#include <optional>
#include <unordered_map>
#include <utility>

#include "transport/Upgrade.h"
#include "transport/WebSocketHub.h"
#include "transport/WebSocketSession.h"
#include "transport/WhileAlive.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kLongestSweep{500};
constexpr milliseconds kStopSweep{50};

class WebSockets final : public WebSocketTransport, public WebSocketHub {
public:
    WebSockets(asio::io_context& io, WebSocketOptions options, SessionHandler& handler,
               Background background, Log& log)
        : WebSocketHub(io, options, handler, std::move(background), log), sweepTimer_(io) {
        sweepLater();
    }

    ~WebSockets() override {
        for (const auto& [id, session] : std::exchange(sessions_, {})) session->abandon();
    }

    void take(std::unique_ptr<Upgrade> upgrade) override {
        asio::post(io, whileAlive(life_, [this, upgrade = std::move(upgrade)]() mutable {
                       open(std::move(upgrade));
                   }));
    }

    Carrier carrier() const override { return Carrier::WebSocket; }
    const TransportCounters& counters() const override { return WebSocketHub::counters; }

    void send(SessionId session, SharedBytes frames) override {
        if (const auto* found = find(session)) found->get()->send(std::move(frames));
    }
    bool congested(SessionId session) override {
        const auto* found = find(session);
        return found && found->get()->congested();
    }
    void sendBeside(SessionId session, FrameSource source) override {
        if (const auto* found = find(session)) found->get()->sendBeside(std::move(source));
    }
    void close(SessionId session) override { closeFor(session, std::nullopt); }
    void close(SessionId session, const Error& why) override { closeFor(session, why); }
    void closeAll(const Error& why) override {
        for (const auto& [id, session] : copy(sessions_)) session->close(why);
    }
    void setReading(SessionId session, bool reading) override {
        if (const auto* found = find(session)) found->get()->setReading(reading);
    }

    std::string addressOf(SessionId session) const override {
        const auto* found = find(session);
        return found ? found->get()->address() : std::string();
    }

    void stop(const Error& why, milliseconds time, std::function<void()> done) override {
        stopped_ = std::move(done);
        stopDeadline_ = steady_clock::now() + time;
        closeAll(why);
        sweepLater();
        notifyStopped();
    }

    // Implements WebSocketHub.
    void flushLater(std::shared_ptr<WebSocketSession> session) override {
        toFlush_.push_back(std::move(session));
        if (toFlush_.size() > 1) return;
        asio::post(io, whileAlive(life_, [this] { flush(); }));
    }

    void finished(WebSocketSession& session) override {
        sessions_.erase(session.id());
        WebSocketHub::counters.connections = sessions_.size();
        notifyStopped();
    }

private:
    template <class Map>
    static Map copy(const Map& map) {
        return map;  // a copy, because sessions are removed while it is visited
    }

    const std::shared_ptr<WebSocketSession>* find(SessionId id) const {
        const auto entry = sessions_.find(id);
        return entry == sessions_.end() ? nullptr : &entry->second;
    }

    void closeFor(SessionId id, const std::optional<Error>& why) {
        if (const auto* found = find(id)) {
            const auto session = *found;  // it may remove itself from sessions_
            session->close(why);
        }
    }

    void open(std::unique_ptr<Upgrade> upgrade) {
        if (!upgrade->connection.descriptor || stopDeadline_) return;
        const SessionId id = ++lastSession_;
        const auto session = createWebSocketSession(*this, id, std::move(upgrade));
        sessions_.emplace(id, session);
        ++WebSocketHub::counters.accepted;
        WebSocketHub::counters.connections = sessions_.size();
        session->start();
    }

    void flush() {
        // A flush can request another one, which then happens in the next turn.
        flushing_.swap(toFlush_);
        for (const auto& session : flushing_) session->flush();
        flushing_.clear();
    }

    // One timer checks all time limits of sessions, because a timer for each write would cost more
    // than the write.
    void sweepLater() {
        const milliseconds pause =
            stopDeadline_
                ? kStopSweep
                : std::min({kLongestSweep, options.slowReaderTime / 4, options.peerTime / 8});
        sweepTimer_.expires_after(pause);
        sweepTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code error) {
            if (!error) sweep();
        }));
    }

    void sweep() {
        const TimePoint now = steady_clock::now();
        for (const auto& [id, session] : copy(sessions_)) session->sweep(now);
        if (stopDeadline_ && now >= *stopDeadline_)
            for (const auto& [id, session] : copy(sessions_)) session->cut();
        sweepLater();
    }

    void notifyStopped() {
        if (stopped_ && sessions_.empty()) asio::post(io, std::exchange(stopped_, nullptr));
    }

    Timer sweepTimer_;
    SessionId lastSession_ = sessionsOf(Carrier::WebSocket);
    std::unordered_map<SessionId, std::shared_ptr<WebSocketSession>> sessions_;
    std::vector<std::shared_ptr<WebSocketSession>> toFlush_, flushing_;
    std::optional<TimePoint> stopDeadline_;
    std::function<void()> stopped_;
};

}  // namespace

std::shared_ptr<WebSocketTransport> createWebSocketTransport(asio::io_context& io,
                                                             WebSocketOptions options,
                                                             SessionHandler& handler,
                                                             Background background, Log& log) {
    return std::make_shared<WebSockets>(io, options, handler, std::move(background), log);
}

}  // namespace usdlive::server
