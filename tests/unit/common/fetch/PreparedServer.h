// A server on loopback that sends prepared bytes.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/fetch/Http.h"

namespace usdlive::fetch {

/// A server on loopback. Answers the requests of each connection with prepared bytes, one text for
/// each, and then closes it. An answer without text is none: the connection stays open.
class Prepared {
public:
    using Answers = std::vector<std::string>;

    explicit Prepared(std::vector<Answers> connections, std::size_t piece = std::string::npos)
        : connections_(std::move(connections)),
          piece_(piece),
          socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in place{};
        place.sin_family = AF_INET;
        place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof place;
        EXPECT_EQ(::bind(socket_.get(), reinterpret_cast<sockaddr*>(&place), size), 0);
        EXPECT_EQ(::listen(socket_.get(), 8), 0);
        ::getsockname(socket_.get(), reinterpret_cast<sockaddr*>(&place), &size);
        origin = {"127.0.0.1", ntohs(place.sin_port)};
        thread_ = startThread("test server", [this] { work(); });
    }
    ~Prepared() {
        ::shutdown(socket_.get(), SHUT_RDWR);
        const std::lock_guard lock(mutex_);
        for (const int one : open_) ::shutdown(one, SHUT_RDWR);
        isEnding_ = true;
    }

    /// The requests so far.
    std::vector<std::string> requests() {
        const std::lock_guard lock(mutex_);
        return requests_;
    }
    HttpRequest request(const std::string& target = "/") const { return {origin, target}; }

    Origin origin;

private:
    /// Joins the thread after everything else has ended.
    struct Joined {
        std::thread thread;
        Joined& operator=(std::thread other) {
            thread = std::move(other);
            return *this;
        }
        ~Joined() { thread.join(); }
    };

    void work() {
        for (const Answers& answers : connections_) {
            const Descriptor line(::accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC));
            if (!line) return;
            {
                const std::lock_guard lock(mutex_);
                if (isEnding_) return;
                open_ = {line.get()};
            }
            for (const std::string& answer : answers)
                if (!serve(line.get(), answer)) break;
            const std::lock_guard lock(mutex_);
            open_.clear();
        }
    }

    /// Returns the size of a request with its body, or one more byte than there are yet.
    static std::size_t wholeSize(const std::string& request) {
        constexpr std::string_view kLength = "Content-Length: ";
        const auto end = request.find("\r\n\r\n");
        if (end == std::string::npos) return request.size() + 1;
        const auto length = request.find(kLength);
        return end + 4 + (length < end ? std::stoul(request.substr(length + kLength.size())) : 0);
    }

    bool serve(int line, const std::string& answer) {
        std::string request;
        std::array<char, 4096> part{};
        while (request.size() < wholeSize(request)) {
            const ssize_t count = ::recv(line, part.data(), part.size(), 0);
            if (count <= 0) return false;
            request.append(part.data(), std::size_t(count));
        }
        {
            const std::lock_guard lock(mutex_);
            requests_.push_back(request);
        }
        if (answer.empty()) return ::recv(line, part.data(), part.size(), 0) > 0;
        for (std::size_t at = 0; at < answer.size();) {
            const std::size_t size = std::min(piece_, answer.size() - at);
            if (::send(line, answer.data() + at, size, MSG_NOSIGNAL) <= 0) return false;
            at += size;
            if (piece_ != std::string::npos)
                std::this_thread::sleep_for(std::chrono::microseconds(100));
        }
        return true;
    }

    const std::vector<Answers> connections_;
    const std::size_t piece_;
    Joined thread_;
    const Descriptor socket_;
    std::mutex mutex_;  // guards the next members
    std::vector<std::string> requests_;
    std::vector<int> open_;
    bool isEnding_ = false;
};

inline std::string ok(const std::string& body, const std::string& headers = "") {
    return "HTTP/1.1 200 OK\r\n" + headers + "Content-Length: " + std::to_string(body.size()) +
           "\r\n\r\n" + body;
}

}  // namespace usdlive::fetch
