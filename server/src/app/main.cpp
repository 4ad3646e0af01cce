// usdlive-server: builds the server from its parts.

#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <fstream>
#include <iostream>

#include "app/AccessCommands.h"
#include "app/AccessControl.h"
#include "app/AuditCommand.h"
#include "app/AuditLog.h"
#include "app/BackupCommand.h"
#include "app/HttpRoutes.h"
#include "app/Options.h"
#include "app/PageProcess.h"
#include "app/Projects.h"
#include "app/RunningServer.h"
#include "app/SpdLog.h"
#include "app/TlsOptions.h"
#include "app/Workers.h"
#include "storage/RocksCommitStore.h"
#include "transport/HttpServer.h"
#include "usdlive/common/core/StandardDescriptors.h"
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/net/KnownServers.h"

// jemalloc reads this. Freed memory is returned to the system within a second, also while the
// server is idle. Otherwise the memory of an import or a save is still held when its result needs
// the same amount again.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0";
}

namespace {

using namespace usdlive;
using namespace usdlive::server;
namespace asio = boost::asio;

constexpr int kStartError = 1;
constexpr std::chrono::hours kWarningPause{1};
// A stop that takes longer, because a file system does not respond, is aborted. Nothing
// acknowledged is lost by that.
constexpr unsigned kStopSeconds = 10;

/// Writes the file atomically, because other programs wait for it.
Result<void> writePortFile(const std::filesystem::path& path, std::uint16_t port) {
    const std::filesystem::path draft = path.string() + ".new";
    std::ofstream file(draft);
    file << port << '\n';
    file.close();
    std::error_code error;
    if (file) std::filesystem::rename(draft, path, error);
    if (!file || error)
        return fail(ErrorCode::InvalidConfiguration, "cannot write " + path.string());
    return {};
}

/// Lets the process open as many files and connections as the system allows it.
void raiseLimitOfDescriptors() {
    rlimit limit{};
    if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
    limit.rlim_cur = limit.rlim_max;
    (void)::setrlimit(RLIMIT_NOFILE, &limit);
}

/// Returns the names under which the server answers (HO1).
std::vector<std::string> hostNames(const ServerOptions& options) {
    const auto host = hostOf(options.host);
    const bool isLoopbackOnly =
        host && (*host == "localhost" || *host == "::1" || host->starts_with("127."));
    std::vector<std::string> names = namesOfThisMachine(isLoopbackOnly);
    names.push_back(options.host);
    names.insert(names.end(), options.allowedHosts.begin(), options.allowedHosts.end());
    return names;
}

HttpServerOptions httpOptions(const ServerOptions& options, const ServerTls* tls) {
    HttpServerOptions http;
    http.host = options.host;
    http.port = options.port;
    http.seats.members = options.maxSessions;
    http.seats.guests = options.maxGuests;
    http.headerTime = std::chrono::seconds(options.guestSeconds);
    http.hosts = HostNames(hostNames(options));
    http.tls = tls;
    http.allowedOrigins = options.allowedOrigins;
    return http;
}

std::string counted(std::size_t count, const std::string& what) {
    return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

/// Returns the folder whose `.usdlive` has the accounts of this server.
std::filesystem::path accountsFolder(const ServerOptions& options) {
    return options.projectsFolder.empty() ? options.folders.front() : options.projectsFolder;
}

/// Describes one project for the output at the start.
std::string describe(const ServedProject::Status& status) {
    if (status.error) return "cannot be opened: " + status.error->message;
    std::string text = counted(status.layers, "layer");
    if (status.skippedFiles > 0)
        text += "; " + counted(status.skippedFiles, "file") +
                (status.skippedFiles == 1 ? " is" : " are") +
                " skipped, `usdlive ls --skipped` says why";
    return text;
}

/// Says where the page is, for somebody who opens the server's address in a browser.
std::string pageHint(const ServerOptions& options) {
    if (!options.page)
        return "the live stage in a browser: usdlive serve DIR --page, or usdlive page URL\n";
    if (options.pagePort == 0) return "the address is in the output of the server\n";
    const std::string host =
        options.host.find(':') == std::string::npos ? options.host : "[" + options.host + "]";
    return (options.tls.empty() ? "http://" : "https://") + host + ":" +
           std::to_string(options.pagePort) + "/\n";
}

std::string joined(const std::vector<std::string>& texts) {
    std::string all;
    for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
    return all;
}

/// Prints the addresses and projects when the server is ready.
void announce(const ServerOptions& options, const Projects& projects,
              const std::vector<std::string>& urls) {
    const auto all = projects.mainLines();
    if (!projects.areSeveral()) {
        const auto status = all.front()->status();
        std::cout << "serving " << options.folders.front().string() << " (" << describe(status)
                  << ") at " << joined(urls) << std::endl;
        if (status.layers == 0)
            std::cout
                << "It contains no .usd, .usda or .usdc file yet. Put one there; it is served "
                   "within a second."
                << std::endl;
        return;
    }
    std::cout << "serving " << counted(all.size(), "project") << " at " << joined(urls) << "\n";
    for (const ServedProject* project : all)
        std::cout << "  " << projects.urlOf(urls.front(), *project) << "  "
                  << describe(project->status()) << "\n";
    if (!options.projectsFolder.empty())
        std::cout << "A new folder in " << options.projectsFolder.string()
                  << " is served within a second.\n";
    std::cout << std::flush;
}

/// Runs the server until a signal stops it.
class Server {
public:
    explicit Server(const ServerOptions& options)
        : options_(options),
          log_(createSpdLog(options.logLevel, options.logFormat)),
          workers_(*log_),
          audit_(accountsFolder(options), workers_, *log_),
          projects_(
              io_, options, workers_, audit_,
              [&](const std::string& project) {
                  return createSpdLog(options.logLevel, options.logFormat, project);
              },
              *log_),
          liveSessions_(io_, projects_, workers_, audit_, *log_),
          access_(io_, accountsFolder(options), options.issuer, workers_, audit_, *log_),
          routes_(io_, projects_, liveSessions_, access_, pageHint(options)),
          signals_(io_, SIGINT, SIGTERM),
          hangups_(io_) {}

    int run() {
        if (options_.dds)
            dds::setDomainLog([this](bool isError, std::string_view message) {
                log_->write(isError ? LogLevel::Error : LogLevel::Warning, "DDS",
                            {{"says", message}});
            });
        if (const auto started = access_.start(); !started) {
            fail(started.error());
            return code_;
        }
        if (const auto opened = projects_.open([this] { listen(); }); !opened) fail(opened.error());
        signals_.async_wait([this](const boost::system::error_code& error, int) {
            if (error) return;
            log_->write(LogLevel::Info, "stopping");
            stop();
        });
        io_.run();
        dds::setDomainLog(nullptr);
        if (code_ == 0) log_->write(LogLevel::Info, "stopped");
        return code_;
    }

private:
    void fail(const Error& error) {
        if (code_ == 0) std::cerr << "usdlive-server: " << error.message << std::endl;
        code_ = kStartError;
        stop();
    }

    void stop() {
        if (std::exchange(isStopping_, true)) return;
        ::alarm(kStopSeconds);
        page_.stop();
        if (http_) http_->stop();
        access_.stop();
        projects_.stop([this] { io_.stop(); });
    }

    /// Called when each project is served or has failed.
    void listen() {
        if (isStopping_) return;
        const auto all = projects_.mainLines();
        const auto failed = std::ranges::count_if(
            all, [](const ServedProject* project) { return project->status().error.has_value(); });
        if (!all.empty() && std::size_t(failed) == all.size())
            return fail(*all.front()->status().error);
        if (const auto safe = checkSafety(); !safe) return fail(safe.error());
        auto tls = loadTls(options_, hostNames(options_));
        if (!tls) return fail(tls.error());
        tls_ = std::move(*tls);
        auto http = createHttpServer(
            io_, httpOptions(options_, tls_.get()),
            [this](const HttpTarget& target) { return routes_.route(target); }, *log_);
        if (!http) return fail(http.error());
        http_ = std::move(*http);
        const std::string url = urls().front();
        routes_.announce(url, *http_);
        access_.serve(http_->port(), url, tls_ ? tls_->fingerprint() : "",
                      [this](const std::shared_ptr<const Accounts>& accounts,
                             const std::function<void()>& done) { spread(accounts, done); });
        projects_.announce(url, [this](const Result<void>& announced) {
            if (!announced) return fail(announced.error());
            ready();
        });
    }

    /// Returns an error if others could read and edit without a sign-in, or listen.
    Result<void> checkSafety() const {
        if (options_.insecure) return {};
        const auto refuse = [](const std::string& what, const std::string& how) {
            return usdlive::fail(ErrorCode::InvalidConfiguration,
                                 what + ". " + how +
                                     ", or start with --insecure if the network "
                                     "itself keeps everybody else out");
        };
        if (options_.dds && access_.isRequired() && options_.ddsSecurity.empty())
            return refuse("DDS does not ask users to sign in",
                          "Set up DDS Security (--dds-security DIR)");
        if (isLoopbackHost(options_.host)) return {};
        if (!access_.isRequired())
            return refuse("whoever reaches " + options_.host + " could edit without signing in",
                          "Add a user first (usdlive user add NAME --at HOST:PORT DIR), or let an "
                          "issuer sign users in (--oidc-issuer URL)");
        if (options_.tls.empty())
            return refuse("on the way to " + options_.host + ", tokens and edits could be read",
                          "Add --tls auto");
        return {};
    }

    /// Says every hour what --insecure leaves open.
    void warnOfOpenDoors() {
        if (!options_.insecure || http_->isLoopback()) return;
        log_->write(LogLevel::Warning,
                    access_.isRequired()
                        ? "--insecure: whoever listens on the network can read edits and tokens"
                        : "--insecure: everybody who can reach this address can read and edit",
                    {{"host", options_.host}});
        warningTimer_.expires_after(kWarningPause);
        warningTimer_.async_wait([this](const boost::system::error_code& error) {
            if (!error) warnOfOpenDoors();
        });
    }

    /// Passes the accounts to all projects.
    void spread(const std::shared_ptr<const Accounts>& accounts,
                const std::function<void()>& done) {
        const auto all = projects_.all();
        const auto left = std::make_shared<std::atomic<std::size_t>>(all.size() + 1);
        const auto one = [left, done] {
            if (--*left == 0) done();
        };
        for (ServedProject* project : all) project->rolesChanged(accounts, one);
        one();
    }

    void ready() {
        warnOfOpenDoors();
        if (!options_.portFile.empty())
            if (const auto written = writePortFile(options_.portFile, http_->port()); !written)
                return fail(written.error());
        announce(options_, projects_, urls());
        if (options_.page) page_.start(options_, http_->port());
        if (!tls_) return;
        if (!tls_->fingerprint().empty())
            std::cout << "fingerprint " << tls_->fingerprint() << std::endl;
        hangups_.add(SIGHUP);
        reloadAtHangup();
    }

    std::vector<std::string> urls() const {
        return reachableUrls(options_.host, http_->port(), tls_ != nullptr);
    }

    /// Lets an administrator replace the certificate without ending sessions.
    void reloadAtHangup() {
        hangups_.async_wait([this](const boost::system::error_code& error, int) {
            if (error) return;
            if (const auto reloaded = tls_->reload(); !reloaded)
                log_->write(LogLevel::Error, "the certificate was not replaced",
                            {{"error", reloaded.error().message}});
            else
                log_->write(LogLevel::Info, "certificate reloaded",
                            {{"fingerprint", tls_->fingerprint()}});
            reloadAtHangup();
        });
    }

    const ServerOptions& options_;
    const std::unique_ptr<Log> log_;
    Workers workers_;
    AuditLog audit_;
    asio::io_context io_{1};
    // Keeps io_ running, because stopping projects call back from their threads.
    const asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
    Projects projects_;
    LiveSessions liveSessions_;
    AccessControl access_;
    HttpRoutes routes_;
    std::unique_ptr<ServerTls> tls_;  // nullptr: not encrypted
    std::unique_ptr<HttpServer> http_;
    PageProcess page_{io_, *log_};
    asio::signal_set signals_, hangups_;
    asio::steady_timer warningTimer_{io_};
    int code_ = 0;
    bool isStopping_ = false;
};

}  // namespace

int main(int argc, char** argv) {
    reserveStandardDescriptors();
    ::signal(SIGPIPE, SIG_IGN);
    ::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error, as on a full disk
    raiseLimitOfDescriptors();
    if (argc > 0 && std::string_view(argv[0]) == kAccountCommands)
        return runAccountCommand(argc, argv);
    if (argc > 0 && std::string_view(argv[0]) == kAuditCommand) return runAuditCommand(argc, argv);
    if (const auto code = runAccessCommand(argc, argv)) return *code;
    if (argc > 0 && std::string_view(argv[0]) == kBackupCommand)
        return runBackupCommand(argc, argv);
    const auto options = parseOptions(argc, argv);
    if (const int* code = std::get_if<int>(&options)) return *code;
    try {
        const auto storeThreads = startStoreThreads();
        return Server(std::get<ServerOptions>(options)).run();
    } catch (const std::exception& fault) {
        // One write, so that a line of another thread does not divide it.
        std::cerr << "usdlive-server: " + std::string(fault.what()) + "\n";
        return kStartError;
    }
}
