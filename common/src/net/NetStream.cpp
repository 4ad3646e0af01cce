// Reads and writes a TCP connection, plain or through OpenSSL.
#include "usdlive/common/net/NetStream.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/asio/error.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/error.hpp>
#include <cerrno>
#include <cstring>
#include <span>

namespace usdlive {

namespace {

namespace asio = boost::asio;
using boost::system::error_code;

// The plain bytes of one record of TLS.
constexpr std::size_t kRecordBytes = 16 * 1024;
// One call transfers at most about this much, so that other connections have their turn.
constexpr std::size_t kMostBytesPerTurn = 256 * 1024;
// The part of what a peer sends after the goodbye that is read at once.
constexpr std::size_t kScratchBytes = 2048;

// ---- OpenSSL reads and writes the descriptor that its BIO points to. OpenSSL's own BIO for
// sockets would raise SIGPIPE in programs that do not ignore it, and would block.

int descriptorOf(BIO* bio) { return *static_cast<const int*>(BIO_get_data(bio)); }

bool isTemporary(int error) { return error == EAGAIN || error == EWOULDBLOCK || error == EINTR; }

int writeBytes(BIO* bio, const char* bytes, int count) {
    BIO_clear_retry_flags(bio);
    const ssize_t sent =
        ::send(descriptorOf(bio), bytes, std::size_t(count), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && isTemporary(errno)) BIO_set_retry_write(bio);
    return int(sent);
}

int readBytes(BIO* bio, char* bytes, int count) {
    BIO_clear_retry_flags(bio);
    const ssize_t received = ::recv(descriptorOf(bio), bytes, std::size_t(count), MSG_DONTWAIT);
    if (received < 0 && isTemporary(errno)) BIO_set_retry_read(bio);
    return int(received);
}

long control(BIO* /*bio*/, int command, long /*number*/, void* /*pointer*/) {
    return command == BIO_CTRL_FLUSH ? 1 : 0;
}

struct FreeMethod {
    void operator()(BIO_METHOD* method) const { BIO_meth_free(method); }
};

BIO* createBio(const int& descriptor) {
    static const std::unique_ptr<BIO_METHOD, FreeMethod> method = [] {
        std::unique_ptr<BIO_METHOD, FreeMethod> made(
            BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "usdlive socket"));
        if (!made) throw std::bad_alloc();
        BIO_meth_set_write(made.get(), writeBytes);
        BIO_meth_set_read(made.get(), readBytes);
        BIO_meth_set_ctrl(made.get(), control);
        return made;
    }();
    BIO* bio = BIO_new(method.get());
    if (!bio) throw std::bad_alloc();
    BIO_set_data(bio, const_cast<int*>(&descriptor));
    BIO_set_init(bio, 1);
    return bio;
}

/// A step of OpenSSL: done, failed, or to be repeated when the socket can be read or written.
struct Step {
    enum class Next { Done, WaitToRead, WaitToWrite } next = Next::Done;
    error_code error;
};

/// Returns the next step after a call of OpenSSL that returned `result`. errno is that of the call.
Step stepAfter(ssl_st* tls, int result) {
    const int systemError = errno;
    switch (SSL_get_error(tls, result)) {
        case SSL_ERROR_NONE:
            return {};
        case SSL_ERROR_WANT_READ:
            return {Step::Next::WaitToRead, {}};
        case SSL_ERROR_WANT_WRITE:
            return {Step::Next::WaitToWrite, {}};
        case SSL_ERROR_ZERO_RETURN:
            return {Step::Next::Done, asio::error::eof};
        case SSL_ERROR_SYSCALL:
            if (systemError != 0)
                return {Step::Next::Done,
                        error_code(systemError, boost::system::system_category())};
            return {Step::Next::Done, asio::error::connection_reset};
        default: {
            const unsigned long code = ERR_peek_error();
            if (ERR_GET_REASON(code) == SSL_R_UNEXPECTED_EOF_WHILE_READING)
                return {Step::Next::Done, asio::error::connection_reset};
            return {Step::Next::Done, error_code(int(code), asio::error::get_ssl_category())};
        }
    }
}

/// Copies the first bytes of the buffers from `offset` on. Returns them without copying if the
/// first buffer has enough.
std::span<const std::uint8_t> record(const NetBuffers<asio::const_buffer>& buffers,
                                     std::size_t offset,
                                     std::array<std::uint8_t, kRecordBytes>& space) {
    std::size_t size = 0;
    for (asio::const_buffer buffer : buffers) {
        const std::size_t skipped = std::min(offset, buffer.size());
        offset -= skipped;
        buffer += skipped;
        if (buffer.size() == 0) continue;
        const auto* bytes = static_cast<const std::uint8_t*>(buffer.data());
        if (size == 0 && buffer.size() >= kRecordBytes) return {bytes, kRecordBytes};
        const std::size_t count = std::min(buffer.size(), kRecordBytes - size);
        std::memcpy(space.data() + size, bytes, count);
        size += count;
        if (size == kRecordBytes) break;
    }
    return {space.data(), size};
}

template <class Buffer>
std::size_t totalBytes(const NetBuffers<Buffer>& buffers) {
    std::size_t total = 0;
    for (const Buffer& buffer : buffers) total += buffer.size();
    return total;
}

}  // namespace

struct NetStream::State : std::enable_shared_from_this<State> {
    using Wait = asio::socket_base::wait_type;

    explicit State(NetSocket socket) : socket(std::move(socket)) {}

    void encrypt(TlsState state) {
        descriptor = socket.is_open() ? socket.native_handle() : -1;
        BIO* bio = createBio(descriptor);
        SSL_set_bio(state.get(), bio, bio);
        tls = std::move(state);
    }

    void close() {
        descriptor = -1;  // its number may soon be that of another file
        error_code ignored;
        socket.close(ignored);
    }

    /// Repeats `attempt`, a function that returns a Step and changes `bytes`, until it is done. The
    /// handler is not called by the caller's function.
    template <class Attempt>
    void run(Attempt attempt, NetHandler handler, std::size_t bytes = 0, bool isCaller = true) {
        errno = 0;
        ERR_clear_error();
        const Step step = attempt(bytes);
        if (step.next == Step::Next::Done) {
            if (!isCaller) return handler(step.error, bytes);
            return asio::post(socket.get_executor(),
                              [handler = std::move(handler), error = step.error, bytes]() mutable {
                                  handler(error, bytes);
                              });
        }
        socket.async_wait(step.next == Step::Next::WaitToRead ? Wait::wait_read : Wait::wait_write,
                          [self = shared_from_this(), attempt = std::move(attempt),
                           handler = std::move(handler), bytes](error_code error) mutable {
                              if (error) return handler(error, 0);
                              self->run(std::move(attempt), std::move(handler), bytes, false);
                          });
    }

    Step readSome(const NetBuffers<asio::mutable_buffer>& into, std::size_t& bytes) {
        for (const asio::mutable_buffer& buffer : into) {
            auto* place = static_cast<std::uint8_t*>(buffer.data());
            for (std::size_t room = std::min(buffer.size(), kMostBytesPerTurn); room > 0;) {
                std::size_t count = 0;
                const int result = SSL_read_ex(tls.get(), place, room, &count);
                if (result != 1) {
                    const Step step = stepAfter(tls.get(), result);
                    return bytes > 0 ? Step{} : step;  // OpenSSL repeats an error
                }
                bytes += count;
                place += count;
                room -= count;
                if (SSL_has_pending(tls.get()) == 0) return {};
            }
            if (bytes > 0) return {};
        }
        return {};
    }

    /// Writes records until all bytes are sent. A record that the system did not take is repeated
    /// by the next call, with the same bytes.
    Step writeAll(const NetBuffers<asio::const_buffer>& from, std::size_t& bytes) {
        std::array<std::uint8_t, kRecordBytes> space;
        while (bytes < kMostBytesPerTurn) {
            const auto plain = record(from, bytes, space);
            if (plain.empty()) return {};
            std::size_t count = 0;
            const int result = SSL_write_ex(tls.get(), plain.data(), plain.size(), &count);
            if (result != 1) return stepAfter(tls.get(), result);
            bytes += count;
        }
        return {};
    }

    /// Reads until the peer has closed.
    void drain(NetHandler handler, bool shutsDown) {
        socket.async_read_some(asio::buffer(scratch),
                               [self = shared_from_this(), handler = std::move(handler), shutsDown](
                                   error_code error, std::size_t) mutable {
                                   if (!error) return self->drain(std::move(handler), shutsDown);
                                   if (shutsDown) self->shutdownSend();
                                   self->close();
                                   handler(error == asio::error::eof ? error_code() : error, 0);
                               });
    }

    void shutdownSend() {
        if (tls && descriptor >= 0 && SSL_is_init_finished(tls.get()) != 0) {
            ERR_clear_error();
            (void)SSL_shutdown(tls.get());  // lost if the system's buffer is full
        }
        error_code ignored;
        socket.shutdown(NetSocket::shutdown_send, ignored);
    }

    NetSocket socket;
    TlsState tls;
    int descriptor = -1;  // the one of the socket; OpenSSL's BIO points to it
    std::array<std::uint8_t, kScratchBytes> scratch;
};

NetStream::NetStream(asio::io_context& io) : NetStream(NetSocket(io)) {}
NetStream::NetStream(NetSocket socket) : state_(std::make_shared<State>(std::move(socket))) {}
NetStream::NetStream(asio::io_context& io, Released released) : NetStream(NetSocket(io)) {
    error_code error;
    if (released.descriptor)
        state_->socket.assign(released.protocol, released.descriptor.get(), error);
    if (!released.descriptor || error) return;
    (void)released.descriptor.release();
    if (released.tls) state_->encrypt(std::move(released.tls));
}
NetStream::NetStream(NetStream&&) noexcept = default;
NetStream& NetStream::operator=(NetStream&& other) noexcept {
    if (state_ && state_ != other.state_) state_->close();
    state_ = std::move(other.state_);
    return *this;
}
NetStream::~NetStream() {
    if (state_) state_->close();
}

NetStream::Released NetStream::release() {
    Released released;
    released.tls = std::move(state_->tls);
    state_->descriptor = -1;
    error_code error;
    const auto local = state_->socket.local_endpoint(error);
    if (error) return released;
    released.protocol = local.protocol();
    const int descriptor = state_->socket.release(error);
    if (!error) released.descriptor = Descriptor(descriptor);
    return released;
}

NetStream::executor_type NetStream::get_executor() const noexcept {
    // Asio's functions are const, but not noexcept.
    return const_cast<State&>(*state_).socket.get_executor();
}
NetSocket& NetStream::socket() { return state_->socket; }
const NetSocket& NetStream::socket() const { return state_->socket; }
bool NetStream::isEncrypted() const { return state_->tls != nullptr; }
void NetStream::encrypt(TlsState tls) { state_->encrypt(std::move(tls)); }

void NetStream::handshake(NetHandler handler) {
    state_->run(
        [state = state_.get()](std::size_t& /*bytes*/) {
            return stepAfter(state->tls.get(), SSL_do_handshake(state->tls.get()));
        },
        std::move(handler));
}

void NetStream::read(const NetBuffers<asio::mutable_buffer>& into, NetHandler handler) {
    if (state_->tls && totalBytes(into) > 0)
        return state_->run([state = state_.get(),
                            into](std::size_t& bytes) { return state->readSome(into, bytes); },
                           std::move(handler));
    state_->socket.async_read_some(
        into, [handler = std::move(handler)](error_code error, std::size_t bytes) mutable {
            handler(error, bytes);
        });
}

void NetStream::write(const NetBuffers<asio::const_buffer>& from, NetHandler handler) {
    if (state_->tls)
        return state_->run([state = state_.get(),
                            from](std::size_t& bytes) { return state->writeAll(from, bytes); },
                           std::move(handler));
    state_->socket.async_write_some(
        from, [handler = std::move(handler)](error_code error, std::size_t bytes) mutable {
            handler(error, bytes);
        });
}

void NetStream::shutdownSend() { state_->shutdownSend(); }

void NetStream::close() { state_->close(); }

void NetStream::tearDown(boost::beast::role_type role, NetHandler handler) {
    // The server says that it sends no more, and the client answers with the same.
    const bool isServer = role == boost::beast::role_type::server;
    if (isServer) state_->shutdownSend();
    state_->drain(std::move(handler), !isServer);
}

}  // namespace usdlive
