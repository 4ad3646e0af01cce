// Tests NetStream: plain and encrypted bytes, the way to another thread, and how connections end.
#include "usdlive/common/net/NetStream.h"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <numeric>
#include <random>
#include <vector>

using namespace usdlive;
namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

namespace {

/// Returns settings with a certificate for a server.
TlsContext serverContext() {
    TlsContext context = createTlsContext();
    const PrivateKey key(EVP_EC_gen("P-256"));
    const Certificate certificate(X509_new());
    X509_gmtime_adj(X509_getm_notBefore(certificate.get()), -60);
    X509_gmtime_adj(X509_getm_notAfter(certificate.get()), 3600);
    X509_set_pubkey(certificate.get(), key.get());
    X509_sign(certificate.get(), key.get(), EVP_sha256());
    SSL_CTX_use_certificate(context.get(), certificate.get());
    SSL_CTX_use_PrivateKey(context.get(), key.get());
    return context;
}

/// Two ends of one connection. The parameter is true if it is encrypted.
class NetStreamTest : public testing::TestWithParam<bool> {
protected:
    NetStreamTest() {
        asio::basic_socket_acceptor<tcp, NetExecutor> acceptor(
            io_, {asio::ip::address_v4::loopback(), 0});
        client_.socket().connect(acceptor.local_endpoint());
        server_ = NetStream(NetSocket(acceptor.accept()));
        if (GetParam()) encrypt();
    }

    void encrypt() {
        const TlsContext settings = createTlsContext(), certified = serverContext();
        TlsState here(SSL_new(settings.get())), there(SSL_new(certified.get()));
        SSL_set_connect_state(here.get());
        SSL_set_accept_state(there.get());
        client_.encrypt(std::move(here));
        server_.encrypt(std::move(there));
        int done = 0;
        const auto handler = [&done](error_code error) {
            EXPECT_FALSE(error) << error.message();
            ++done;
        };
        client_.async_handshake(handler);
        server_.async_handshake(handler);
        run();
        ASSERT_EQ(done, 2);
    }

    /// Runs until no operation is left.
    void run() {
        io_.restart();
        io_.run_for(std::chrono::seconds(20));
    }

    /// Returns the error of the next read.
    error_code readError(NetStream& stream) {
        error_code found;
        char byte = 0;
        stream.async_read_some(asio::buffer(&byte, 1),
                               [&](error_code error, std::size_t) { found = error; });
        run();
        return found;
    }

    asio::io_context io_{1}, other_{1};
    NetStream client_{io_}, server_{io_};
};

std::vector<std::uint8_t> numbers(std::size_t count) {
    std::vector<std::uint8_t> bytes(count);
    std::minstd_rand random(unsigned(count + 1));
    for (auto& byte : bytes) byte = std::uint8_t(random());
    return bytes;
}

TEST_P(NetStreamTest, BytesPassBothWaysWhateverTheirBuffers) {
    std::minstd_rand random(1);
    for (int round = 0; round < 20; ++round) {
        const auto sent = numbers(random() % 400'000), back = numbers(random() % 100'000);
        std::vector<asio::const_buffer> parts;
        for (std::size_t begin = 0; begin < sent.size();) {
            const std::size_t size = std::min<std::size_t>(random() % (round % 2 ? 100'000 : 3'000),
                                                           sent.size() - begin);
            parts.push_back(asio::buffer(sent.data() + begin, size));
            begin += size;
        }
        std::vector<std::uint8_t> received(sent.size()), receivedBack(back.size());
        int done = 0;
        const auto handler = [&done](error_code error, std::size_t) {
            EXPECT_FALSE(error) << error.message();
            ++done;
        };
        asio::async_write(client_, parts, handler);
        asio::async_write(server_, asio::buffer(back), handler);
        asio::async_read(server_, asio::buffer(received), handler);
        asio::async_read(client_, asio::buffer(receivedBack), handler);
        run();
        ASSERT_EQ(done, 4);
        ASSERT_EQ(received, sent);
        ASSERT_EQ(receivedBack, back);
    }
}

TEST_P(NetStreamTest, AReleasedConnectionKeepsWhatWasReceived) {
    const auto sent = numbers(50'000);
    std::vector<std::uint8_t> received(sent.size());
    asio::async_write(client_, asio::buffer(sent), [](error_code, std::size_t) {});
    asio::async_read(server_, asio::buffer(received.data(), 7), [](error_code, std::size_t) {});
    run();
    NetStream::Released released = server_.release();
    EXPECT_FALSE(server_.socket().is_open());
    EXPECT_EQ(bool(released.tls), GetParam());
    NetStream moved(other_, std::move(released));
    EXPECT_EQ(moved.isEncrypted(), GetParam());
    asio::async_read(moved, asio::buffer(received.data() + 7, received.size() - 7),
                     [](error_code error, std::size_t) { EXPECT_FALSE(error) << error.message(); });
    other_.run_for(std::chrono::seconds(20));
    EXPECT_EQ(received, sent);
}

TEST_P(NetStreamTest, AGoodbyeReadsAsTheEnd) {
    client_.shutdownSend();
    EXPECT_EQ(readError(server_), asio::error::eof);
}

TEST_P(NetStreamTest, AnEncryptedConnectionThatIsCutDoesNotReadAsTheEnd) {
    client_.socket().shutdown(NetSocket::shutdown_send);
    EXPECT_EQ(readError(server_), GetParam() ? error_code(asio::error::connection_reset)
                                             : error_code(asio::error::eof));
}

TEST_P(NetStreamTest, ClosingEndsTheRunningOperations) {
    error_code read;
    char byte = 0;
    server_.async_read_some(asio::buffer(&byte, 1),
                            [&](error_code error, std::size_t) { read = error; });
    server_.close();
    run();
    EXPECT_EQ(read, asio::error::operation_aborted);
    EXPECT_TRUE(readError(server_)) << "also later ones";
}

TEST_P(NetStreamTest, BothEndsCloseAfterATeardown) {
    int closed = 0;
    const auto handler = [&closed](error_code error) {
        EXPECT_FALSE(error) << error.message();
        ++closed;
    };
    async_teardown(boost::beast::role_type::server, server_, handler);
    async_teardown(boost::beast::role_type::client, client_, handler);
    run();
    EXPECT_EQ(closed, 2);
    EXPECT_FALSE(server_.socket().is_open());
    EXPECT_FALSE(client_.socket().is_open());
}

INSTANTIATE_TEST_SUITE_P(PlainAndEncrypted, NetStreamTest, testing::Bool());

}  // namespace
