// One client's session over a WebSocket.
#include "transport/WebSocketSession.h"

#include <algorithm>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <utility>
#include <vector>

#include "transport/SendQueue.h"
#include "usdlive/common/protocol/CheckedControl.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/transport/BulkWindow.h"
#include "usdlive/common/transport/PeerLife.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A message contains the queued frames up to this size. A single larger frame makes a larger
// message.
constexpr std::size_t kMessageBytes = 1024 * 1024;
// Larger messages are sent in fragments, so that pings and pongs can pass between them.
constexpr std::size_t kFragmentBytes = 256 * 1024;
// Above this size a message gets more time than slowReaderTime, for example a commit of 64 MiB on a
// slow line.
constexpr std::size_t kThinLineBytesPerSecond = 256 * 1024;
// A reader on a slower line stays as long as its system takes this much in slowReaderTime.
constexpr std::size_t kLeastProgress = 8 * 1024;
// The system takes at most 16 buffers per call. Small buffers of longer messages are joined first.
constexpr std::size_t kManyBuffers = 15;
constexpr std::size_t kSmallFrameBytes = 1024;
// The limits of the read buffer. It grows with the data of the client and shrinks again.
constexpr std::size_t kLeastReadBytes = 4 * 1024;
constexpr std::size_t kMostReadBytes = 1024 * 1024;

// The limit of a message that shows a token: one of an issuer has some KiB.
constexpr std::size_t kMostTokenBytes = 64 * 1024;

websocket::close_code closeCode(const std::optional<Error>& why) {
    if (!why) return websocket::close_code::normal;
    switch (why->code) {
        case ErrorCode::FrameTooLarge:
            return websocket::close_code::too_big;
        case ErrorCode::TextFrame:
            return websocket::close_code::unknown_data;
        case ErrorCode::ShuttingDown:
            return websocket::close_code::going_away;
        case ErrorCode::Internal:
            return websocket::close_code::internal_error;
        default:
            return websocket::close_code::policy_error;
    }
}

/// A sequence of buffers that is copied as two pointers, because Beast copies it often.
struct BufferList {
    using value_type = asio::const_buffer;
    using const_iterator = const asio::const_buffer*;
    const_iterator first = nullptr, last = nullptr;
    [[nodiscard]] const_iterator begin() const { return first; }
    [[nodiscard]] const_iterator end() const { return last; }
};

/// The message that is being sent.
class Batch {
public:
    void fill(SendQueue& queue) {
        queue.take(kMessageBytes, parts_);
        bytes_ = 0;
        for (const SharedBytes& part : parts_) bytes_ += part->size();
        buffers_.clear();
        joined_.clear();
        if (parts_.size() <= kManyBuffers)
            for (const SharedBytes& part : parts_) buffers_.push_back(asio::buffer(*part));
        else
            join();
    }
    void clear() {
        parts_.clear();
        bytes_ = 0;
    }
    [[nodiscard]] BufferList buffers() const {
        return {buffers_.data(), buffers_.data() + buffers_.size()};
    }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }
    [[nodiscard]] std::size_t frames() const { return parts_.size(); }

private:
    void join() {
        std::size_t small = 0;
        for (const SharedBytes& part : parts_)
            if (part->size() < kSmallFrameBytes) small += part->size();
        joined_.reserve(small);  // so that nothing is reallocated below
        std::size_t begin = 0;
        const auto endRun = [&] {
            if (begin != joined_.size())
                buffers_.emplace_back(joined_.data() + begin, joined_.size() - begin);
            begin = joined_.size();
        };
        for (const SharedBytes& part : parts_) {
            if (part->size() < kSmallFrameBytes) {
                joined_.insert(joined_.end(), part->begin(), part->end());
            } else {
                endRun();
                buffers_.push_back(asio::buffer(*part));
            }
        }
        endRun();
    }

    std::vector<SharedBytes> parts_;
    std::vector<asio::const_buffer> buffers_;
    Bytes joined_;
    std::size_t bytes_ = 0;
};

/// Returns the token that the first message of a session shows.
Result<std::string> shownToken(ByteView message) {
    const auto wrong = fail(ErrorCode::SignInRequired,
                            "the first message of this session has to be showToken, with a token");
    const auto frames = splitMessage(message, kMostTokenBytes);
    if (!frames || frames->size() != 1) return wrong;
    const auto frame = decodeFrame(frames->front());
    const auto* control = frame ? std::get_if<ControlFrame>(&*frame) : nullptr;
    if (!control || !checkClientControl(control->json)) return wrong;
    const auto content = decodeControl(control->json);
    const auto* shown = content ? std::get_if<ShowToken>(&*content) : nullptr;
    if (!shown) return wrong;
    return shown->token;
}

class BeastSession final : public WebSocketSession,
                           public std::enable_shared_from_this<BeastSession> {
public:
    BeastSession(WebSocketHub& hub, SessionId id, std::unique_ptr<Upgrade> upgrade)
        : WebSocketSession(hub, id, hub.options.slowReaderBytes, State::Opening),
          hub_(hub),
          upgrade_(std::move(upgrade)),
          stream_(NetStream(hub.io, std::move(upgrade_->connection))),
          life_(hub.options.peerTime, steady_clock::now()) {
        // Without these options a small commit waits for the acknowledgement of the previous one,
        // or behind megabytes of a snapshot in the system's buffer.
        beast::error_code ignored;
        socket().set_option(asio::ip::tcp::no_delay(true), ignored);
        limitUnsent(socket().native_handle(), kFragmentBytes);

        websocket::stream_base::timeout timeout;
        timeout.handshake_timeout = hub.options.handshakeTime;
        timeout.idle_timeout = websocket::stream_base::none();  // sweep() looks for life
        timeout.keep_alive_pings = false;
        stream_.set_option(timeout);
        stream_.control_callback([this](websocket::frame_type type, beast::string_view payload) {
            onControlFrame(type, {payload.data(), payload.size()});
        });
        stream_.read_message_max(0);  // onRead() counts, so that it can report the error
        stream_.auto_fragment(true);
        stream_.write_buffer_bytes(kFragmentBytes);
        stream_.binary(true);
    }

    void start() override {
        beast::error_code ignored;
        address_ = socket().remote_endpoint(ignored).address().to_string(ignored);
        upgrade_->seat->giveWayBy([io = &hub_.io, weak = weak_from_this()] {
            asio::post(*io, [weak] {
                const auto self = weak.lock();
                if (self && !self->hasSpoken()) self->end("gave way", LogLevel::Info);
            });
        });
        hub_.log.write(LogLevel::Info, "session opened", {{"session", id()}, {"from", address_}});
        if (upgrade_->showsToken)
            stream_.set_option(
                websocket::stream_base::decorator([](websocket::response_type& response) {
                    response.set(beast::http::field::sec_websocket_protocol,
                                 beast::string_view(kShowsToken.data(), kShowsToken.size()));
                }));
        stream_.async_accept(
            upgrade_->request,
            [self = shared_from_this()](beast::error_code error) { self->onAccepted(error); });
    }

    const std::string& address() const override { return address_; }

    void setReading(bool reading) override {
        reading_ = reading;
        if (!reading || !std::exchange(readPaused_, false)) return;
        received_ = steady_clock::now();
        read();
    }

    void flush() override {
        flushing_ = false;
        if (state() == State::Closed || writing_) return;
        if (!queue_.empty()) return write();
        if (state() == State::Closing) goodbye();
    }

    void sweep(TimePoint now) override {
        if (!isOpen()) {
            sweepGoodbye(now);
            return;
        }
        const auto sent = sendProgress(socket().native_handle());
        if (sent && sent->acknowledged >= progress_ + kLeastProgress) {
            progress_ = sent->acknowledged;
            writeDeadline_ = std::max(writeDeadline_, now + hub_.options.slowReaderTime);
        }
        if (writing_ && now >= writeDeadline_)
            return endSlowReader("the client did not read for too long");
        if (readPaused_) life_.received(received_ = now);  // it is not its fault
        if (buffer_.size() > 0 && now - received_ >= hub_.options.messageTime)
            return close(Error{ErrorCode::MalformedFrame, "the rest of a message did not arrive"});
        if (sweepGreeting(now)) return;
        switch (life_.check(sent, now)) {
            case PeerLife::Verdict::Alive:
                return;
            case PeerLife::Verdict::SendPing:
                return ping();
            case PeerLife::Verdict::Lost:
                end("the client answered nothing for too long", LogLevel::Info);
        }
    }

    void abandon() override {
        endSilently();
        closeSocket();
        upgrade_->seat.reset();
    }

private:
    NetSocket& socket() { return stream_.next_layer().socket(); }

    // Implements SessionCore.
    std::size_t waitingBytes() const override { return queue_.bytes() + batch_.bytes(); }
    std::size_t besideBytes() const override { return window_.partBytes(); }
    void queueBeside(SharedBytes frame) override {
        if (!std::exchange(isMeasured_, true)) ping();  // the line without a queue
        window_.queued(frame->size());
        waitingBulk_ += frame->size();
        queue(std::move(frame));
    }
    void queue(SharedBytes frames) override {
        hub_.counters.queuedBytes += frames->size();
        queue_.push(std::move(frames));
        if (!writing_ && !std::exchange(flushing_, true)) hub_.flushLater(shared_from_this());
    }
    void dropQueue() override {
        hub_.counters.queuedBytes -= queue_.bytes();
        queue_.clear();
    }
    void beginGoodbye(const std::optional<Error>& why) override {
        closeCode_ = closeCode(why);
        hub_.flushLater(shared_from_this());
    }
    void finish() override {
        hub_.counters.queuedBytes -= waitingBytes();
        queue_.clear();
        closeSocket();
        upgrade_->seat.reset();
        hub_.finished(*this);
    }
    Result<void> spoke() override {
        if (upgrade_->seat->admit()) return {};
        return fail(ErrorCode::TooManySessions,
                    "the projects of this server have as many sessions as it may have");
    }
    void closeSocket() { stream_.next_layer().close(); }

    void onAccepted(beast::error_code error) {
        if (state() != State::Opening) return;
        if (error) return end(error.message(), LogLevel::Info);
        upgrade_->seat->moved(steady_clock::now());
        if (upgrade_->showsToken)
            openUnproved();
        else
            open(upgrade_->user);
        read();
    }

    /// AC13. Nothing more is read until it is known whose session it is.
    void prove(ByteView message) override {
        const auto token = shownToken(message);
        if (!token) return close(token.error());
        setReading(false);
        upgrade_->showsToken(*token,
                             [io = &hub_.io, weak = weak_from_this()](Result<SignedIn> found) {
                                 asio::post(*io, [weak, found = std::move(found)] {
                                     const auto self = weak.lock();
                                     if (!self || !self->isOpen()) return;
                                     if (!found) return self->close(found.error());
                                     self->proved(*found);
                                     self->setReading(true);
                                 });
                             });
    }

    void onControlFrame(websocket::frame_type type, std::string_view payload) {
        life_.received(steady_clock::now());
        if (type != websocket::frame_type::pong || !isOpen()) return;
        const auto mark = markOf(payload);
        if (!mark) return;
        window_.acknowledged(*mark, steady_clock::now());
        if (window_.wantsMark()) ping();
        sources().produce();
    }

    /// The pong to a ping says that the client has received everything that was sent before the
    /// ping (TL1).
    void ping() {
        pingsAgain_ = isPinging_;
        if (std::exchange(isPinging_, true)) return;
        const std::string payload = pingPayload(window_.mark(steady_clock::now()));
        stream_.async_ping(
            {payload.data(), payload.size()}, [self = shared_from_this()](beast::error_code error) {
                self->isPinging_ = false;
                if (error || !self->isOpen()) return;
                self->life_.pingWritten(sendProgress(self->socket().native_handle()));
                if (self->pingsAgain_) self->ping();
            });
    }

    void read() {
        if (!isOpen()) return;
        if (!reading_) {
            readPaused_ = true;
            return;
        }
        // Grows with the received bytes, not with the announced size, so that a client cannot cause
        // large allocations.
        const std::size_t size = std::clamp(buffer_.size(), kLeastReadBytes, kMostReadBytes);
        stream_.async_read_some(
            buffer_, size, [self = shared_from_this()](beast::error_code error, std::size_t bytes) {
                self->onRead(error, bytes);
            });
    }

    void onRead(beast::error_code error, std::size_t bytes) {
        if (state() == State::Closed) return;
        if (error) return end(error.message(), LogLevel::Info);
        life_.received(steady_clock::now());
        hub_.counters.bytesIn += bytes;
        if (!isOpen()) return;
        if (hub_.options.takesText)
            stream_.text(stream_.got_text());  // answer in the same mode
        else if (stream_.got_text())
            return close(Error{ErrorCode::TextFrame, std::string(errorText(ErrorCode::TextFrame))});
        received_ = steady_clock::now();
        std::size_t most = hub_.options.maxMessageBytes;
        if (!hasSpoken()) most = std::min(most, hub_.options.maxHelloBytes);
        if (buffer_.size() > most)
            return close(Error{ErrorCode::FrameTooLarge,
                               (hasSpoken() ? "a message may have at most "
                                            : "the first message may have at most ") +
                                   std::to_string(most) + " bytes"});
        if (stream_.is_message_done()) {
            const auto data = buffer_.data();
            deliver({static_cast<const std::uint8_t*>(data.data()), data.size()});
            buffer_.clear();
            if (buffer_.capacity() > kMostReadBytes) buffer_.shrink_to_fit();
        } else if (!hasSpoken()) {
            upgrade_->seat->moved(received_);
            upgrade_->seat->holds(buffer_.size());
        }
        read();
    }

    void write() {
        batch_.fill(queue_);
        if (queue_.empty()) batchBulk_ = std::exchange(waitingBulk_, 0);
        writing_ = true;
        const std::size_t more = std::max(batch_.bytes(), kMessageBytes) - kMessageBytes;
        writeDeadline_ = steady_clock::now() + hub_.options.slowReaderTime +
                         milliseconds(more * 1000 / kThinLineBytesPerSecond);
        stream_.async_write(batch_.buffers(),
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                                self->onWritten(error);
                            });
    }

    void onWritten(beast::error_code error) {
        writing_ = false;
        if (state() == State::Closed) return;
        if (error) return end(error.message(), LogLevel::Info);
        ++hub_.counters.messagesOut;
        hub_.counters.framesOut += batch_.frames();
        hub_.counters.bytesOut += batch_.bytes();
        hub_.counters.queuedBytes -= batch_.bytes();
        window_.sent(std::exchange(batchBulk_, 0));
        batch_.clear();
        if (isOpen() && window_.wantsMark()) ping();
        left();
        flush();
    }

    void goodbye() {
        if (std::exchange(saidGoodbye_, true)) return;
        stream_.async_close(closeCode_, [self = shared_from_this()](beast::error_code) {
            self->end("closed", LogLevel::Debug);
        });
    }

    WebSocketHub& hub_;
    const std::unique_ptr<Upgrade> upgrade_;  // its seat is nullptr after the end
    websocket::stream<NetStream, false> stream_;

    beast::flat_buffer buffer_;
    std::string address_;
    TimePoint received_;  // when bytes of a message arrived last
    bool reading_ = true;
    bool readPaused_ = false;  // a read would be running if reading_ were true

    SendQueue queue_;
    Batch batch_;
    bool writing_ = false;   // batch_ is being sent
    bool flushing_ = false;  // flush() is requested and has not run yet
    TimePoint writeDeadline_;
    std::uint64_t progress_ = 0;  // acknowledged bytes when writeDeadline_ was last moved
    BulkWindow window_;           // counts the frames of sources
    bool isMeasured_ = false;
    std::size_t waitingBulk_ = 0, batchBulk_ = 0;  // bytes of them in queue_ and in batch_
    PeerLife life_;
    bool isPinging_ = false, pingsAgain_ = false;
    websocket::close_code closeCode_ = websocket::close_code::normal;
    bool saidGoodbye_ = false;
};

}  // namespace

std::shared_ptr<WebSocketSession> createWebSocketSession(WebSocketHub& hub, SessionId id,
                                                         std::unique_ptr<Upgrade> upgrade) {
    return std::make_shared<BeastSession>(hub, id, std::move(upgrade));
}

}  // namespace usdlive::server
