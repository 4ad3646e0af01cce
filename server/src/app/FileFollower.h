// Follows a file that other programs change.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "app/Workers.h"

namespace usdlive::server {

/// Reads a file again whenever its stamp is another one. A worker looks at it, because a disk that
/// does not answer must not stop the thread that accepts connections, or a project. `File` is a
/// value with stamp() and read(), such as AccountsFile. Belongs to the thread that runs `io`.
template <class File>
class FileFollower {
public:
    using Read = decltype(std::declval<const File&>().read());
    /// Receives the stamp, and what was read after it.
    using Changed = std::function<void(const std::string& stamp, Read read)>;

    /// `gone`: called when a file that was there cannot be found any more; may be empty. A file
    /// that comes back unchanged is read again only with it. `io` must outlive this object.
    FileFollower(boost::asio::io_context& io, std::shared_ptr<WorkerShare> workers, File file,
                 std::chrono::milliseconds pause, Changed changed, std::function<void()> gone = {})
        : io_(io),
          workers_(std::move(workers)),
          file_(std::move(file)),
          pause_(pause),
          changed_(std::move(changed)),
          gone_(std::move(gone)),
          timer_(io) {}

    /// `known`: the stamp of the content that is not to be read again; nothing: read it.
    void start(std::optional<std::string> known) {
        stamp_ = std::move(known);
        lookSoon();
    }
    /// Nothing is called afterwards.
    void stop() {
        timer_.cancel();
        life_.reset();
    }

private:
    void lookSoon() {
        timer_.expires_after(pause_);
        timer_.async_wait([this](const boost::system::error_code& error) {
            if (!error && life_) look();
        });
    }
    void look() {
        workers_->post(
            [this, io = &io_, weak = std::weak_ptr(life_), file = file_, before = stamp_] {
                auto stamp = file.stamp();
                std::optional<Read> read;
                if (stamp && stamp != before) read = file.read();
                boost::asio::post(
                    *io, [this, weak, stamp = std::move(stamp), read = std::move(read)]() mutable {
                        if (!weak.expired()) looked(std::move(stamp), std::move(read));
                    });
            });
    }
    void looked(std::optional<std::string> stamp, std::optional<Read> read) {
        if (stamp) {
            stamp_ = std::move(stamp);
        } else if (gone_ && stamp_) {
            stamp_.reset();
            gone_();
        }
        if (read) changed_(*stamp_, std::move(*read));
        if (life_) lookSoon();
    }

    boost::asio::io_context& io_;
    const std::shared_ptr<WorkerShare> workers_;
    const File file_;
    const std::chrono::milliseconds pause_;
    const Changed changed_;
    const std::function<void()> gone_;
    boost::asio::steady_timer timer_;
    std::optional<std::string> stamp_;
    std::shared_ptr<int> life_ = std::make_shared<int>();
};

}  // namespace usdlive::server
