// A TCP connection, plain or encrypted with TLS, as one stream type for Asio and Beast.
#pragma once

#include <array>
#include <boost/asio/associated_executor.hpp>
#include <boost/asio/async_result.hpp>
#include <boost/asio/basic_stream_socket.hpp>
#include <boost/asio/bind_executor.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/recycling_allocator.hpp>
#include <boost/beast/core/role.hpp>
#include <memory>
#include <optional>
#include <utility>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/net/Tls.h"

namespace usdlive {

using NetExecutor = boost::asio::io_context::executor_type;
using NetSocket = boost::asio::basic_stream_socket<boost::asio::ip::tcp, NetExecutor>;

/// A completion handler of any type for `void(error_code, std::size_t)`. It is called at most once,
/// on its own executor. Asio's operations are compiled once for this type, and not for each
/// handler.
class NetHandler {
public:
    template <class Handler>
    NetHandler(Handler handler, const NetExecutor& executor)
        : any_(Typed<Handler>::create(std::move(handler), executor)) {}

    void operator()(boost::system::error_code error, std::size_t bytes) {
        any_.release()->call(error, bytes);
    }

private:
    struct Any {
        virtual void call(boost::system::error_code error, std::size_t bytes) = 0;
        virtual void destroy() = 0;

    protected:
        ~Any() = default;
    };
    struct Destroy {
        void operator()(Any* any) const { any->destroy(); }
    };
    using Owned = std::unique_ptr<Any, Destroy>;

    template <class Handler>
    struct Typed final : Any {
        using Memory = boost::asio::recycling_allocator<Typed>;

        Typed(Handler handler, const NetExecutor& executor)
            : handler(std::move(handler)), executor(executor) {}

        static Owned create(Handler handler, const NetExecutor& executor) {
            Typed* place = Memory().allocate(1);
            return Owned(new (place) Typed(std::move(handler), executor));
        }
        void call(boost::system::error_code error, std::size_t bytes) override {
            // The memory is free before the call, which may start the next operation.
            auto own = boost::asio::get_associated_executor(handler, executor);
            Handler moved = std::move(handler);
            destroy();
            boost::asio::dispatch(own, [moved = std::move(moved), error, bytes]() mutable {
                std::move(moved)(error, bytes);
            });
        }
        void destroy() override {
            this->~Typed();
            Memory().deallocate(this, 1);
        }

        Handler handler;
        NetExecutor executor;
    };

    Owned any_;
};

/// A sequence of buffers. Has as many as the system takes in one call; a longer sequence is cut
/// off, which is allowed because an operation may transfer a part only.
template <class Buffer>
class NetBuffers {
public:
    using value_type = Buffer;
    using const_iterator = const Buffer*;

    template <class Sequence>
    explicit NetBuffers(const Sequence& sequence) {
        const auto end = boost::asio::buffer_sequence_end(sequence);
        for (auto one = boost::asio::buffer_sequence_begin(sequence);
             one != end && count_ < buffers_.size(); ++one)
            if (const Buffer buffer(*one); buffer.size() > 0) buffers_[count_++] = buffer;
    }
    [[nodiscard]] const_iterator begin() const { return buffers_.data(); }
    [[nodiscard]] const_iterator end() const { return buffers_.data() + count_; }

private:
    std::array<Buffer, 16> buffers_;
    std::size_t count_ = 0;
};

/// A connection that Asio's and Beast's algorithms read and write. Before encrypt() everything
/// passes as it is; after it, the handshake has to be the next operation.
///
/// Belongs to the one thread that runs the io_context. At most one read and one write may be
/// running at the same time. Operations do not support cancellation slots; close() ends them. A
/// connection that ends without TLS's goodbye reads as connection_reset, so that nobody takes a
/// part of a content for the whole.
class NetStream {
public:
    using executor_type = NetExecutor;

    /// A connection that belongs to no io_context, on its way to another thread.
    struct Released {
        Descriptor descriptor;
        boost::asio::ip::tcp protocol = boost::asio::ip::tcp::v4();
        TlsState tls;  ///< nullptr: plain
    };

    /// Not connected; use socket() for that.
    explicit NetStream(boost::asio::io_context& io);
    explicit NetStream(NetSocket socket);
    /// Takes over a connection that another io_context has released. Without a descriptor, or if
    /// the system refuses, the stream is closed.
    NetStream(boost::asio::io_context& io, Released released);
    NetStream(NetStream&&) noexcept;
    NetStream& operator=(NetStream&&) noexcept;
    /// Closes the connection. Running operations end with operation_aborted.
    ~NetStream();

    /// Releases the connection, which must have no running operation, and closes this stream. What
    /// was received and not read yet goes with it.
    [[nodiscard]] Released release();

    [[nodiscard]] executor_type get_executor() const noexcept;
    /// The socket below. Its bytes are encrypted, if the stream is.
    [[nodiscard]] NetSocket& socket();
    [[nodiscard]] const NetSocket& socket() const;
    [[nodiscard]] bool isEncrypted() const;

    /// Encrypts the connection from now on. `tls` has its role and settings.
    void encrypt(TlsState tls);
    /// Runs TLS's handshake. The handler is `void(error_code)`. No time limit: close() ends it.
    template <class Token>
    auto async_handshake(Token&& token) {
        return boost::asio::async_initiate<Token, void(boost::system::error_code)>(
            [this](auto handler) {
                const auto executor = boost::asio::get_associated_executor(handler, get_executor());
                handshake(NetHandler(
                    boost::asio::bind_executor(
                        executor, [handler = std::move(handler)](
                                      boost::system::error_code error,
                                      std::size_t) mutable { std::move(handler)(error); }),
                    get_executor()));
            },
            token);
    }

    template <class Sequence, class Token>
    auto async_read_some(const Sequence& buffers, Token&& token) {
        return boost::asio::async_initiate<Token, void(boost::system::error_code, std::size_t)>(
            [this](auto handler, const NetBuffers<boost::asio::mutable_buffer>& into) {
                read(into, NetHandler(std::move(handler), get_executor()));
            },
            token, NetBuffers<boost::asio::mutable_buffer>(buffers));
    }
    template <class Sequence, class Token>
    auto async_write_some(const Sequence& buffers, Token&& token) {
        return boost::asio::async_initiate<Token, void(boost::system::error_code, std::size_t)>(
            [this](auto handler, const NetBuffers<boost::asio::const_buffer>& from) {
                write(from, NetHandler(std::move(handler), get_executor()));
            },
            token, NetBuffers<boost::asio::const_buffer>(buffers));
    }

    /// Says goodbye: the peer reads the end of the stream, and can still send.
    void shutdownSend();
    /// Ends the connection and all operations at once.
    void close();
    /// Says goodbye, reads until the peer has, and closes. See async_teardown().
    void tearDown(boost::beast::role_type role, NetHandler handler);

private:
    struct State;
    void handshake(NetHandler handler);
    void read(const NetBuffers<boost::asio::mutable_buffer>& into, NetHandler handler);
    void write(const NetBuffers<boost::asio::const_buffer>& from, NetHandler handler);

    // Operations share it, so that it outlives the stream while one of them ends.
    std::shared_ptr<State> state_;
};

// Beast finds these three by the type of the stream.

inline void beast_close_socket(NetStream& stream) { stream.close(); }

/// Ends a WebSocket's connection. Blocks, so it only closes.
inline void teardown(boost::beast::role_type /*role*/, NetStream& stream,
                     boost::system::error_code& error) {
    error = {};
    stream.close();
}

template <class Handler>
void async_teardown(boost::beast::role_type role, NetStream& stream, Handler&& handler) {
    const auto executor = boost::asio::get_associated_executor(handler, stream.get_executor());
    stream.tearDown(
        role, NetHandler(boost::asio::bind_executor(
                             executor, [handler = std::forward<Handler>(handler)](
                                           boost::system::error_code error,
                                           std::size_t) mutable { std::move(handler)(error); }),
                         stream.get_executor()));
}

}  // namespace usdlive
