// Starts the gateway with posix_spawn(), because fork() would copy the locks of other threads.
#include "app/PageProcess.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <utility>

#include "app/RunningServer.h"

extern char** environ;

namespace usdlive::server {

namespace {

using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr seconds kFirstDelay{1}, kLongestDelay{60};

std::string programBeside() {
    std::error_code ignored;
    const auto self = std::filesystem::read_symlink("/proc/self/exe", ignored);
    return (self.parent_path() / "usdlive").string();
}

/// Returns the address at which this machine reaches a server that listens at `host`.
std::string ownAddress(const std::string& host) {
    if (host == "0.0.0.0" || host == "::") return "127.0.0.1";
    return host.find(':') == std::string::npos ? host : "[" + host + "]";
}

}  // namespace

PageProcess::PageProcess(boost::asio::io_context& io, Log& log)
    : ends_(io), pause_(io), log_(log) {}

PageProcess::~PageProcess() { stop(); }

void PageProcess::start(const ServerOptions& options, std::uint16_t port) {
    const bool isEncrypted = !options.tls.empty();
    // An own certificate is one for the addresses of this machine; another one has names.
    const bool isOwn = isEncrypted && options.tls.front() == kOwnCertificate;
    const std::string url = isEncrypted && !isOwn
                                ? reachableUrls(options.host, port, true).front()
                                : (isEncrypted ? "wss://" : "ws://") + ownAddress(options.host) +
                                      ":" + std::to_string(port);
    words_ = {programBeside(), "page",       url,      "--with-parent",
              "--host",        options.host, "--port", std::to_string(options.pagePort)};
    const auto add = [this](const std::vector<std::string>& more) {
        words_.insert(words_.end(), more.begin(), more.end());
    };
    for (const std::string& host : options.allowedHosts) add({"--allow-host", host});
    if (options.insecure) add({"--insecure"});
    if (isOwn) {
        const auto folder = options.folders.front() / ".usdlive" / "tls";
        const std::string certificate = (folder / "certificate.pem").string();
        add({"--ca", certificate, "--tls", certificate, (folder / "key.pem").string()});
    } else if (isEncrypted) {
        add({"--tls", options.tls.front(), options.tls.back()});
    }
    ends_.add(SIGCHLD);
    waitForEnd();
    launch();
}

void PageProcess::stop() {
    isStopping_ = true;
    boost::system::error_code ignored;
    ends_.cancel(ignored);
    pause_.cancel();
    if (input_ >= 0) ::close(std::exchange(input_, -1));
    // Not waited for: it may be asking this server, whose thread this is.
    if (process_ > 0) ::kill(std::exchange(process_, -1), SIGTERM);
}

void PageProcess::launch() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) {
        log_.write(LogLevel::Error, "the page cannot be started",
                   {{"error", std::strerror(errno)}});
        return;
    }
    std::vector<char*> words;
    for (std::string& word : words_) words.push_back(word.data());
    words.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
    // The server ignores these signals, and a program would inherit that.
    posix_spawnattr_t attributes;
    ::posix_spawnattr_init(&attributes);
    sigset_t usual;
    ::sigemptyset(&usual);
    ::posix_spawnattr_setsigmask(&attributes, &usual);
    ::sigaddset(&usual, SIGPIPE);
    ::sigaddset(&usual, SIGXFSZ);
    ::posix_spawnattr_setsigdefault(&attributes, &usual);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
    started_ = steady_clock::now();
    const int failed =
        ::posix_spawn(&process_, words.front(), &actions, &attributes, words.data(), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    ::posix_spawnattr_destroy(&attributes);
    ::close(ends[0]);
    input_ = ends[1];
    if (failed == 0) return;
    process_ = -1;
    ::close(std::exchange(input_, -1));
    log_.write(LogLevel::Error, "the page cannot be started",
               {{"program", words_.front()}, {"error", std::strerror(failed)}});
}

void PageProcess::waitForEnd() {
    ends_.async_wait([this](const boost::system::error_code& error, int) {
        if (error || isStopping_) return;
        waitForEnd();
        int status = 0;
        if (process_ <= 0 || ::waitpid(process_, &status, WNOHANG) != process_) return;
        process_ = -1;
        ::close(std::exchange(input_, -1));
        delay_ = steady_clock::now() - started_ > kLongestDelay
                     ? kFirstDelay
                     : std::min(delay_ * 2, kLongestDelay);
        log_.write(LogLevel::Error, "the page has ended and is started again",
                   {{"seconds", std::int64_t(delay_.count())}});
        pause_.expires_after(delay_);
        pause_.async_wait([this](const boost::system::error_code& cancelled) {
            if (!cancelled && !isStopping_) launch();
        });
    });
}

}  // namespace usdlive::server
