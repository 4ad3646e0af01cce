// Finds, opens and removes the projects of the process and their live sessions.
#include "app/Projects.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <set>
#include <utility>

#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive::server {

namespace asio = boost::asio;
namespace fs = std::filesystem;

namespace {

using std::chrono::milliseconds;
using State = ServedProject::State;

// The pause between searches for new folders.
constexpr milliseconds kFolderPause{1'000};
// A folder is removed after it was missing this often in a row, because a network drive may be
// unavailable for a moment.
constexpr unsigned kMissing = 3;

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
                   AuditLog& audit, MakeLog makeLog, Log& log)
    : io_(io),
      options_(options),
      workers_(workers),
      audit_(audit),
      makeLog_(std::move(makeLog)),
      log_(log),
      folderTimer_(io),
      startTimer_(io) {}

Projects::~Projects() = default;

bool Projects::areSeveral() const {
    return options_.folders.size() > 1 || !options_.projectsFolder.empty();
}

std::vector<ServedProject*> Projects::all() const {
    std::vector<ServedProject*> all;
    for (const auto& [name, entry] : projects_) all.push_back(entry.project.get());
    return all;
}

std::vector<ServedProject*> Projects::mainLines() const {
    std::vector<ServedProject*> lines = all();
    std::erase_if(lines, [](const ServedProject* one) { return one->place().isLiveSession(); });
    return lines;
}

ServedProject* Projects::find(const std::string& name) const {
    const auto found = projects_.find(name);
    return found == projects_.end() ? nullptr : found->second.project.get();
}

std::string Projects::urlOf(const std::string& base, const ServedProject& project) const {
    const ProjectPlace& place = project.place();
    std::string url = areSeveral() ? base + "/" + percentEncoded(place.project) : base;
    if (place.isLiveSession()) url += "?session=" + percentEncoded(place.liveSession);
    return url;
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
    for (const auto& [name, folder] : found) addProject(name, folder);
    for (const auto& [name, folder] : named) {
        addProject(name, folder);
        projects_[name].isNamed = true;
    }
    for (auto& [name, entry] : projects_) entry.project->start();
    asio::post(io_, [this] { checkOpened(); });
    return {};
}

void Projects::addProject(const std::string& name, const fs::path& folder) {
    add({name, folder});
    const LiveSessionFolder sessions(folder);
    sessions.removeUnfinished();
    for (const LiveSessionRecord& one : sessions.list())
        if (!one.isEnded) add({name, folder, one.name});
}

void Projects::add(const ProjectPlace& place) {
    const std::string name = place.name();
    const bool isNamedInLog = areSeveral() || place.isLiveSession();
    projects_[name].project = std::make_unique<ServedProject>(
        place, options_, workers_, audit_, makeLog_(isNamedInLog ? name : ""),
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
        isResult && !opened_ && std::exchange(entry.reported, status.state) != status.state;
    if (isNews && status.state == State::Failed)
        log_.write(LogLevel::Error, "project cannot be opened",
                   {{"project", name}, {"error", status.error->message}});
    if (isNews && status.state == State::Serving)
        log_.write(LogLevel::Info, "project opened", {{"project", name}});
    if (entry.project->lacksThreads()) startIn(ServedProject::kRetryPause);
    if (isResult && entry.opened)
        std::exchange(entry.opened, nullptr)(
            status.error ? Result<void>(tl::unexpected(*status.error)) : Result<void>());
    if (status.state == State::Stopped) {
        const auto closed = std::move(entry.closed);
        const auto opened = std::move(entry.opened);
        projects_.erase(found);
        if (opened) opened(fail(ErrorCode::ShuttingDown, "it was stopped"));
        if (closed) closed();
    }
    checkOpened();
    if (projects_.empty() && stopped_) std::exchange(stopped_, nullptr)();
}

void Projects::checkOpened() {
    const bool isOpening = std::ranges::any_of(projects_, [](const auto& one) {
        return one.second.project->status().state == State::Opening;
    });
    if (!opened_ || isOpening) return;
    // The caller of open() reads all states now, also one whose changed() has not run yet.
    for (auto& [name, entry] : projects_) entry.reported = entry.project->status().state;
    std::exchange(opened_, nullptr)();
}

void Projects::announce(const std::string& url, std::function<void(Result<void>)> announced) {
    url_ = url;
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

// ---- live sessions

void Projects::openLiveSession(const ServedProject& project, const std::string& liveSession,
                               std::function<void(Result<void>)> opened) {
    ProjectPlace place = project.place();
    place.liveSession = liveSession;
    const std::string name = place.name();
    if (stopped_ || projects_.contains(name))
        return opened(fail(ErrorCode::ShuttingDown, "it is being closed; try again"));
    add(place);
    projects_[name].opened = std::move(opened);
    startLate(name);
}

void Projects::closeLiveSession(const std::string& name, std::function<void()> closed) {
    const auto found = projects_.find(name);
    if (found == projects_.end()) return closed();
    found->second.closed = std::move(closed);
    found->second.project->stop();
}

void Projects::startLate(const std::string& name) {
    ServedProject& project = *projects_[name].project;
    if (!url_.empty())
        project.announce(urlOf(url_, project), [this, name](const Result<void>& done) {
            if (!done)
                log_.write(LogLevel::Error, "project is not served over DDS",
                           {{"project", name}, {"error", done.error().message}});
        });
    project.start();
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

/// Stops a project with its live sessions.
void Projects::stopProject(const std::string& project) {
    for (const auto& [name, entry] : projects_)
        if (entry.project->place().project == project) entry.project->stop();
}

void Projects::foldersFound(const std::map<std::string, fs::path>& found) {
    for (auto& [name, entry] : projects_) {
        if (entry.isNamed || entry.project->place().isLiveSession()) continue;
        entry.missing = found.contains(name) ? 0 : entry.missing + 1;
        if (entry.missing == kMissing) {
            log_.write(LogLevel::Info, "project removed", {{"project", name}});
            stopProject(name);
        }
    }
    for (const auto& [name, folder] : found) {
        if (projects_.contains(name)) continue;
        addProject(name, folder);
        for (const auto& [added, entry] : projects_)
            if (entry.project->place().project == name) startLate(added);
    }
}

}  // namespace usdlive::server
