// Finds, opens and removes the projects of the process, and reports their state over HTTP.
#include "usdlive/server/app/Projects.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/server/transport/FileRequest.h"

namespace usdlive::server {

namespace asio = boost::asio;
namespace fs = std::filesystem;

namespace {

using Json = nlohmann::json;
using std::chrono::milliseconds;
using State = ServedProject::State;

constexpr std::string_view kSessions = "/live", kFiles = "/files";
constexpr const char* kJson = "application/json";
constexpr unsigned kBadRequest = 400, kNotFound = 404, kUnavailable = 503;
// Projects that have not answered after this time are reported as busy.
constexpr milliseconds kReportTime{1'000};
// The pause between searches for new folders.
constexpr milliseconds kFolderPause{1'000};
// A folder is removed after it was missing this often in a row, because a network drive may be
// unavailable for a moment.
constexpr unsigned kMissing = 3;
constexpr std::size_t kMostNamed = 20;

std::string text(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

struct FilesPath {
    std::string_view project;  ///< percent-encoded
    std::string_view rest;     ///< empty, or begins with a slash
};
/// Splits `/NAME/files...`. Returns nothing for any other path.
std::optional<FilesPath> splitFilesPath(std::string_view path) {
    const std::size_t slash = path.find('/', 1);
    if (slash == std::string_view::npos || !path.substr(slash).starts_with(kFiles))
        return std::nullopt;
    const FilesPath split{path.substr(1, slash - 1), path.substr(slash + kFiles.size())};
    if (!split.rest.empty() && !split.rest.starts_with('/')) return std::nullopt;
    return split;
}

/// Returns the name of the project in `folder`: the folder's own name.
std::string nameOf(const fs::path& folder) {
    std::error_code error;
    const fs::path real = fs::canonical(folder, error);
    return (error ? fs::absolute(folder).lexically_normal() : real).filename().string();
}

/// Returns every folder in `parent` that is not hidden, or nothing if `parent` cannot be read now.
std::optional<std::map<std::string, fs::path>> foldersIn(const fs::path& parent) {
    std::map<std::string, fs::path> found;
    std::error_code error;
    for (fs::directory_iterator entry(parent, error), end; !error && entry != end;
         entry.increment(error)) {
        std::error_code ignored;
        std::string name = entry->path().filename().string();
        if (!name.starts_with('.') && entry->is_directory(ignored))
            found.emplace(std::move(name), entry->path());
    }
    if (error) return std::nullopt;
    return found;
}

}  // namespace

Projects::Projects(asio::io_context& io, const ServerOptions& options, Workers& workers,
                   MakeLog makeLog, Log& log)
    : io_(io),
      options_(options),
      workers_(workers),
      makeLog_(std::move(makeLog)),
      log_(log),
      folderTimer_(io),
      startTimer_(io) {}

Projects::~Projects() = default;

bool Projects::areSeveral() const {
    return options_.folders.size() > 1 || !options_.projectsFolder.empty();
}

std::vector<const ServedProject*> Projects::all() const {
    std::vector<const ServedProject*> all;
    for (const auto& [name, entry] : projects_) all.push_back(entry.project.get());
    return all;
}

std::string Projects::urlOf(const std::string& base, const ServedProject& project) const {
    return areSeveral() ? base + "/" + percentEncoded(project.name()) : base;
}

// ---- opening and stopping

Result<void> Projects::open(std::function<void()> opened) {
    std::map<std::string, fs::path> named, found;
    if (!options_.projectsFolder.empty()) {
        auto folders = foldersIn(options_.projectsFolder);
        if (!folders)
            return fail(ErrorCode::InvalidConfiguration,
                        options_.projectsFolder.string() + " is not a folder that can be read");
        found = std::move(*folders);
    }
    for (const fs::path& folder : options_.folders) {
        const std::string name = nameOf(folder);
        const auto other = named.find(name);
        if (other != named.end() || found.contains(name))
            return fail(ErrorCode::InvalidConfiguration,
                        "two projects would have the name " + name + ": " +
                            (other != named.end() ? other->second : found[name]).string() +
                            " and " + folder.string() + ". Rename one of the folders");
        named.emplace(name, folder);
    }
    opened_ = std::move(opened);
    for (const auto& [name, folder] : found) add(name, folder);
    for (const auto& [name, folder] : named) {
        add(name, folder);
        projects_[name].isNamed = true;
    }
    for (auto& [name, entry] : projects_) entry.project->start();
    asio::post(io_, [this] { checkOpened(); });
    return {};
}

void Projects::add(const std::string& name, const fs::path& folder) {
    projects_[name].project = std::make_unique<ServedProject>(
        name, folder, options_, workers_, makeLog_(areSeveral() ? name : ""),
        [this, name] { asio::post(io_, [this, name] { changed(name); }); });
}

void Projects::startIn(milliseconds pause) {
    startTimer_.expires_after(pause);
    startTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error || stopped_) return;
        for (auto& [name, entry] : projects_) entry.project->start();
    });
}

void Projects::changed(const std::string& name) {
    const auto found = projects_.find(name);
    if (found == projects_.end()) return;
    Entry& entry = found->second;
    const ServedProject::Status status = entry.project->status();
    const bool isResult = status.state == State::Failed || status.state == State::Serving;
    const bool isNews =
        isResult && !opened_ && std::exchange(entry.told, status.state) != status.state;
    if (isNews && status.state == State::Failed)
        log_.write(LogLevel::Error, "project cannot be opened",
                   {{"project", name}, {"error", status.error->message}});
    if (isNews && status.state == State::Serving)
        log_.write(LogLevel::Info, "project opened", {{"project", name}});
    if (entry.project->lacksThreads()) startIn(ServedProject::kRetryPause);
    if (status.state == State::Stopped) projects_.erase(found);
    checkOpened();
    if (projects_.empty() && stopped_) std::exchange(stopped_, nullptr)();
}

void Projects::checkOpened() {
    const bool isOpening = std::ranges::any_of(projects_, [](const auto& one) {
        return one.second.project->status().state == State::Opening;
    });
    if (!opened_ || isOpening) return;
    // The caller of open() reads all states now, also one whose changed() has not run yet.
    for (auto& [name, entry] : projects_) entry.told = entry.project->status().state;
    std::exchange(opened_, nullptr)();
}

void Projects::announce(const std::string& url, const HttpServer& http,
                        std::function<void(Result<void>)> announced) {
    url_ = url;
    http_ = &http;
    const auto left = std::make_shared<std::size_t>(1);
    const auto result = std::make_shared<Result<void>>();
    using Done = std::function<void(Result<void>)>;
    const Done done = [this, left, result, announced](const Result<void>& one) {
        asio::post(io_, [left, result, announced, one] {
            if (!one && *result) *result = one;
            if (--*left == 0) announced(*result);
        });
    };
    for (auto& [name, entry] : projects_) {
        const bool isServed = entry.project->status().state == State::Serving;
        if (isServed) ++*left;
        entry.project->announce(urlOf(url, *entry.project),
                                isServed ? done : Done([](const auto&) {}));
    }
    done({});
    if (!options_.projectsFolder.empty()) lookForFoldersIn(kFolderPause);
}

void Projects::stop(std::function<void()> done) {
    folderTimer_.cancel();
    startTimer_.cancel();
    stopped_ = std::move(done);
    for (const auto& [name, entry] : projects_) entry.project->stop();
    if (projects_.empty()) asio::post(io_, std::exchange(stopped_, nullptr));
}

// ---- added and removed folders

void Projects::lookForFoldersIn(milliseconds pause) {
    folderTimer_.expires_after(pause);
    folderTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error || stopped_) return;
        if (const auto found = foldersIn(options_.projectsFolder)) foldersFound(*found);
        lookForFoldersIn(kFolderPause);
    });
}

void Projects::foldersFound(const std::map<std::string, fs::path>& found) {
    for (auto& [name, entry] : projects_) {
        if (entry.isNamed) continue;
        entry.missing = found.contains(name) ? 0 : entry.missing + 1;
        if (entry.missing == kMissing) {
            log_.write(LogLevel::Info, "project removed", {{"project", name}});
            entry.project->stop();
        }
    }
    for (const auto& [name, folder] : found) {
        if (projects_.contains(name)) continue;
        add(name, folder);
        Entry& entry = projects_[name];
        entry.project->announce(
            urlOf(url_, *entry.project), [this, name](const Result<void>& done) {
                if (!done)
                    log_.write(LogLevel::Error, "project is not served over DDS",
                               {{"project", name}, {"error", done.error().message}});
            });
        entry.project->start();
    }
}

// ---- HTTP

HttpRoute Projects::route(const HttpTarget& target) {
    const std::string_view path = target.path;
    const auto page = [this](HttpReply (Projects::*make)(const Reports&) const) {
        return HttpPage([this, make](const HttpAnswer& answer) {
            gather(
                [this, make, answer](const Reports& reports) { answer((this->*make)(reports)); });
        });
    };
    if (path == "/") return page(&Projects::welcome);
    if (path == "/healthz") return page(&Projects::health);
    if (path == "/metrics") return page(&Projects::metrics);
    if (path == "/projects") return page(&Projects::list);
    if (path == kSessions) {
        if (projects_.size() == 1) return sessionsOf(*projects_.begin()->second.project);
        return notHere("the address names no project");
    }
    if (path.ends_with(kSessions)) {
        const auto name = percentDecoded(path.substr(1, path.size() - kSessions.size() - 1));
        const auto found = name ? projects_.find(*name) : projects_.end();
        if (found == projects_.end())
            return notHere("there is no project \"" + name.value_or("") + "\" here");
        return sessionsOf(*found->second.project);
    }
    if (const auto files = splitFilesPath(path)) {
        const auto name = percentDecoded(files->project);
        const auto found = name ? projects_.find(*name) : projects_.end();
        if (found != projects_.end())
            return filesOf(*found->second.project, {files->rest, target.query});
    }
    if (path.starts_with(kFiles)) {
        const std::string_view rest = path.substr(kFiles.size());
        if (rest.empty() || rest.starts_with('/')) {
            if (projects_.size() == 1)
                return filesOf(*projects_.begin()->second.project, {rest, target.query});
            return notHere("the address names no project");
        }
    }
    return HttpReply{"text/plain", "there is nothing here\n", kNotFound};
}

HttpRoute Projects::filesOf(ServedProject& project, const HttpTarget& target) {
    auto request = parseFileRequest(target.path, target.query);
    if (!request) return HttpReply{"text/plain", request.error().message + "\n", kBadRequest};
    if (project.status().state != State::Serving) return unavailable(project);
    return HttpPage([&project, request = std::move(*request)](const HttpAnswer& answer) {
        project.answerFile(request, answer);
    });
}

HttpRoute Projects::sessionsOf(ServedProject& project) {
    if (WebSocketTransport* sessions = project.sessions()) return sessions;
    return unavailable(project);
}

HttpReply Projects::unavailable(const ServedProject& project) {
    const ServedProject::Status status = project.status();
    const std::string why = status.error
                                ? "cannot be opened: " + project.texts()(*status.error).message
                            : status.state == State::Opening ? "is being opened"
                                                             : "is being closed";
    return HttpReply{"text/plain", "the project \"" + project.name() + "\" " + why + "\n",
                     kUnavailable};
}

HttpReply Projects::notHere(const std::string& what) const {
    std::string names;
    std::size_t named = 0;
    for (const auto& [name, entry] : projects_) {
        if (named++ == kMostNamed) {
            names += ", ...";
            break;
        }
        names += (names.empty() ? "" : ", ") + name;
    }
    return {"text/plain",
            what + (names.empty() ? "; the server has none yet" : "; the server has " + names) +
                ". Connect to ws://HOST:PORT/PROJECT\n",
            kNotFound};
}

void Projects::gather(std::function<void(const Reports&)> done) {
    struct Gathered {
        std::map<std::string, ServedProject::Report> reports;
        std::size_t missing = 0;
        std::function<void(const Reports&)> done;
        asio::steady_timer timer;

        void end() {
            if (!done) return;
            timer.cancel();
            const Reports all(reports.begin(), reports.end());
            std::exchange(done, nullptr)(all);
        }
    };
    auto all = std::make_shared<Gathered>(
        Gathered{{}, projects_.size(), std::move(done), asio::steady_timer(io_, kReportTime)});
    for (const auto& [name, entry] : projects_) {
        all->reports[name].status = "busy";
        entry.project->report([this, all, name = name](ServedProject::Report report) {
            asio::post(io_, [all, name, report = std::move(report)]() mutable {
                all->reports[name] = std::move(report);
                if (--all->missing == 0) all->end();
            });
        });
    }
    if (projects_.empty()) return all->end();
    all->timer.async_wait([all](const boost::system::error_code& error) {
        if (!error) all->end();
    });
}

/// Answers somebody who opens the address in a browser.
HttpReply Projects::welcome(const Reports& reports) const {
    const auto urlOf = [this](const std::string& name) {
        return areSeveral() ? url_ + "/" + percentEncoded(name) : url_;
    };
    std::string page = "usdlive " USDLIVE_VERSION
                       ": people edit OpenUSD stages of this server together, at the same time.\n"
                       "\nProjects\n";
    std::size_t named = 0;
    for (const auto& [name, report] : reports) {
        if (named++ == kMostNamed) {
            page += "  and " + std::to_string(reports.size() - kMostNamed) + " more: /projects\n";
            break;
        }
        page += "  " + urlOf(name) + "  " + report.status + ", revision " +
                std::to_string(report.revision) + ", sessions " + std::to_string(report.sessions) +
                "\n";
    }
    if (reports.empty()) page += "  none yet\n";
    const std::string url = reports.empty() ? url_ : urlOf(reports.front().first);
    return {"text/plain; charset=utf-8",
            page + "\nConnect\n  shell:    usdlive ls " + url + "\n  Python:   usdlive.connect(\"" +
                url + "\", user=\"ada\")\n  OpenUSD:  Usd.Stage.Open(\"usdlive" +
                url.substr(url.find(':')) + "/LAYER.usda\"), to read\n" +
                "\nOther pages\n  /projects  /files  /healthz  /metrics\n"};
}

HttpReply Projects::health(const Reports& reports) const {
    Json projects = Json::object();
    bool isWell = true;
    for (const auto& [name, report] : reports) {
        if (!areSeveral())
            return {kJson, text({{"status", report.status},
                                 {"project", name},
                                 {"revision", report.revision}})};
        isWell = isWell && report.status == "ok";
        projects[name] = report.status;
    }
    return {kJson, text({{"status", isWell ? "ok" : "degraded"}, {"projects", projects}})};
}

HttpReply Projects::list(const Reports& reports) const {
    Json all = Json::array();
    for (const auto& [name, report] : reports) {
        Json one{{"name", name},
                 {"path", areSeveral() ? "/" + percentEncoded(name) : ""},
                 {"status", report.status},
                 {"revision", report.revision},
                 {"sessions", report.sessions}};
        if (!report.reason.empty()) one["reason"] = report.reason;
        all.push_back(std::move(one));
    }
    return {kJson, text({{"projects", all}, {"several", areSeveral()}})};
}

HttpReply Projects::metrics(const Reports& reports) const {
    MetricsOfProjects all;
    for (const auto& [name, report] : reports)
        if (report.metrics) all.emplace_back(areSeveral() ? name : "", report.metrics);
    return {"text/plain; version=0.0.4",
            metricsPage(http_ ? http_->counters() : HttpCounters(), all)};
}

}  // namespace usdlive::server
