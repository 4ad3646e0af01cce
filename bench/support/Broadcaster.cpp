// The broadcaster of bare Beast that the benchmarks compare the server with.
#include "Broadcaster.h"

#include <fcntl.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstring>
#include <deque>
#include <fstream>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>

namespace usdlive::bench {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using Message = std::shared_ptr<const std::vector<char>>;

constexpr std::string_view kVerb = "--broadcaster";

class Peer;

struct Room {
    asio::io_context io{1};
    std::size_t frameBytes = 0;
    bool joins = false;
    int log = -1;
    std::set<std::shared_ptr<Peer>> peers;

    void store(const Message& message) const {
        if (log < 0) return;
        if (::write(log, message->data(), message->size()) != ssize_t(message->size()) ||
            ::fdatasync(log) != 0)
            throw std::runtime_error("the broadcaster cannot write its log");
    }
};

class Peer : public std::enable_shared_from_this<Peer> {
public:
    Peer(Room& room, tcp::socket socket) : room_(room), stream_(std::move(socket)) {
        beast::get_lowest_layer(stream_).set_option(tcp::no_delay(true));
        stream_.binary(true);
        stream_.auto_fragment(false);
    }

    void start() {
        stream_.async_accept([self = shared_from_this()](beast::error_code error) {
            if (error) return;
            self->room_.peers.insert(self);
            self->read();
        });
    }

    void send(const Message& message) {
        queue_.push_back(message);
        if (writing_) return;
        if (!room_.joins) return write();
        writing_ = true;
        asio::post(room_.io, [self = shared_from_this()] { self->write(); });
    }

private:
    void read() {
        stream_.async_read(buffer_,
                           [self = shared_from_this()](beast::error_code error, std::size_t) {
                               if (error)
                                   self->room_.peers.erase(self);
                               else
                                   self->onRead();
                           });
    }

    void onRead() {
        const auto data = buffer_.cdata();
        const auto* begin = static_cast<const char*>(data.data());
        RelayHead head{};
        for (std::size_t at = 0; at + sizeof head <= data.size(); at += 4 + head.length) {
            std::memcpy(&head, begin + at, sizeof head);
            auto message = std::make_shared<std::vector<char>>(room_.frameBytes);
            RelayHead answer = head;
            answer.length = static_cast<std::uint32_t>(room_.frameBytes - 4);
            std::memcpy(message->data(), &answer, sizeof answer);
            room_.store(message);
            for (const auto& peer : room_.peers) peer->send(message);
        }
        buffer_.consume(buffer_.size());
        read();
    }

    void write() {
        writing_ = true;
        const auto done = [self = shared_from_this()](beast::error_code error, std::size_t) {
            self->writing_ = false;
            self->sent_.reset();
            if (!error && !self->queue_.empty()) self->write();
        };
        if (room_.joins) {
            joined_.clear();
            for (const Message& message : queue_)
                joined_.insert(joined_.end(), message->begin(), message->end());
            queue_.clear();
            stream_.async_write(asio::buffer(joined_), done);
        } else {
            sent_ = std::move(queue_.front());
            queue_.pop_front();
            stream_.async_write(asio::buffer(*sent_), done);
        }
    }

    Room& room_;
    beast::websocket::stream<tcp::socket, false> stream_;
    beast::flat_buffer buffer_;
    std::deque<Message> queue_;
    Message sent_;
    std::vector<char> joined_;
    bool writing_ = false;
};

void accept(Room& room, tcp::acceptor& acceptor) {
    acceptor.async_accept([&](beast::error_code error, tcp::socket socket) {
        if (!error) std::make_shared<Peer>(room, std::move(socket))->start();
        accept(room, acceptor);
    });
}

}  // namespace

std::vector<std::string> broadcasterCommand(const BroadcasterOptions& options) {
    return {"/proc/self/exe",          std::string(kVerb),
            options.portFile,          std::to_string(options.frameBytes),
            options.joins ? "1" : "0", options.log};
}

bool isBroadcaster(int argc, char** argv) { return argc == 6 && argv[1] == kVerb; }

int runBroadcaster(int, char** argv) {
    Room room;
    room.frameBytes = std::max<std::size_t>(std::stoul(argv[3]), sizeof(RelayHead));
    room.joins = argv[4][0] == '1';
    if (*argv[5]) room.log = ::open(argv[5], O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    tcp::acceptor acceptor(room.io, {asio::ip::make_address("127.0.0.1"), 0});
    accept(room, acceptor);
    std::ofstream(argv[2]) << acceptor.local_endpoint().port() << '\n';
    room.io.run();
    return 0;
}

}  // namespace usdlive::bench
