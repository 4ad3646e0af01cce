// Passes bytes from one socket to another and counts them.
#include "Relay.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <stdexcept>

namespace usdlive::bench {

namespace {

constexpr int kPollMs = 20;  // how soon the end is noticed

sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
}

int newSocket() {
    const int made = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (made < 0) throw std::runtime_error("cannot create a socket");
    return made;
}

void withoutDelay(int socket) {
    const int on = 1;
    ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

/// Returns false at the end of the connection.
bool pass(int from, int to, std::atomic<std::uint64_t>& count) {
    std::array<char, 65'536> bytes{};
    const ssize_t got = ::recv(from, bytes.data(), bytes.size(), 0);
    if (got <= 0) return false;
    count += std::uint64_t(got);
    for (ssize_t sent = 0; sent < got;) {
        const ssize_t step = ::send(to, bytes.data() + sent, std::size_t(got - sent), MSG_NOSIGNAL);
        if (step <= 0) return false;
        sent += step;
    }
    return true;
}

}  // namespace

Relay::Relay(std::uint16_t serverPort) : listener_(newSocket()) {
    sockaddr_in address = loopback(0);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
        ::listen(listener_, 1) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
        ::close(listener_);
        throw std::runtime_error("cannot listen");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this, serverPort] { run(serverPort); });
}

Relay::~Relay() {
    ends_ = true;
    thread_.join();
    ::close(listener_);
}

std::string Relay::url() const { return "ws://127.0.0.1:" + std::to_string(port_); }

void Relay::run(std::uint16_t serverPort) {
    pollfd waiting{listener_, POLLIN, 0};
    while (::poll(&waiting, 1, kPollMs) <= 0)
        if (ends_) return;
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    const int server = newSocket();
    const sockaddr_in address = loopback(serverPort);
    bool isOpen =
        ::connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    withoutDelay(client);
    withoutDelay(server);
    std::array<pollfd, 2> both{pollfd{client, POLLIN, 0}, pollfd{server, POLLIN, 0}};
    while (isOpen && !ends_) {
        if (::poll(both.data(), both.size(), kPollMs) <= 0) continue;
        if (both[0].revents != 0) isOpen = pass(client, server, up_);
        if (isOpen && both[1].revents != 0) isOpen = pass(server, client, down_);
    }
    ::close(client);
    ::close(server);
}

}  // namespace usdlive::bench
