// The gateway of the page, as a process beside the server.
#pragma once

#include <sys/types.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "app/Options.h"
#include "transport/Log.h"

namespace usdlive::server {

/// Runs `usdlive page` of this installation, and starts it again when it ends by itself. It ends
/// with this process, also if that is killed. All calls are made on the thread of `io`.
class PageProcess {
public:
    /// `log` must outlive this object.
    PageProcess(boost::asio::io_context& io, Log& log);
    ~PageProcess();
    PageProcess(const PageProcess&) = delete;
    PageProcess& operator=(const PageProcess&) = delete;

    /// Starts it for the server of this process, which listens at `port`. It prints its address
    /// when it is ready.
    void start(const ServerOptions& options, std::uint16_t port);
    /// Tells it to end, and does not wait for that.
    void stop();

private:
    void launch();
    void waitForEnd();

    boost::asio::signal_set ends_;
    boost::asio::steady_timer pause_;
    Log& log_;
    std::vector<std::string> words_;
    pid_t process_ = -1;
    int input_ = -1;  // its standard input, which tells it that this process lives
    bool isStopping_ = false;
    std::chrono::steady_clock::time_point started_;
    std::chrono::seconds delay_{1};
};

}  // namespace usdlive::server
