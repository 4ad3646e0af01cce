// Keeps the projects that are live in this process.
#include "LiveProjects.h"

#include <algorithm>
#include <cctype>
#include <system_error>
#include <utility>

namespace usdlive::resolver {

namespace fs = std::filesystem;

bool isUsdLayer(const std::string& path) {
    std::string ending = path.substr(path.size() - std::min<std::size_t>(path.size(), 5));
    std::ranges::transform(ending, ending.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return ending.ends_with(".usd") || ending == ".usda" || ending == ".usdc";
}

std::optional<fs::path> LiveProject::placeOf(const Url& url) const {
    if (url.leadsOut() || !url.path.starts_with(prefix) || !isUsdLayer(url.path))
        return std::nullopt;
    const std::string name = url.path.substr(prefix.size());
    // The folder has hidden files of the client beside the placeholders (LN1).
    constexpr std::string_view kHidden = ".usdlive";
    if (name.starts_with(kHidden) || name.find("/" + std::string(kHidden)) != std::string::npos)
        return std::nullopt;
    return folder / name;
}

bool LiveProject::isFileLayer(const Url& url) const {
    return url.path.starts_with(prefix) && fileLayers->contains(inProject(url));
}

std::optional<fs::path> LiveProject::layerFile(const Url& url) const {
    auto place = isFileLayer(url) ? std::nullopt : placeOf(url);
    std::error_code ignored;
    if (place && !fs::is_regular_file(*place, ignored)) place.reset();
    return place;
}

Url LiveProject::atServer(Url url) const {
    url.host = host;
    url.port = port;
    return url;
}

std::set<std::string> Tick::end() {
    isRunning_ = false;
    const std::lock_guard lock(mutex_);
    return std::exchange(needed_, {});
}

void Tick::fetched(const std::string& path, const std::string& content, bool isKept) {
    const std::lock_guard lock(mutex_);
    ++times_[path];
    if (isKept)
        fetched_.erase(path);
    else
        fetched_[path] = content;
}

bool Tick::wasFetched(const std::string& path, const std::string& content) const {
    const std::lock_guard lock(mutex_);
    const auto found = fetched_.find(path);
    return found != fetched_.end() && found->second == content;
}

void Tick::found(const std::string& path) {
    const std::lock_guard lock(mutex_);
    times_.erase(path);
}

void Tick::need(const std::string& path) {
    constexpr int kMostTimes = 3;
    const std::lock_guard lock(mutex_);
    const auto times = times_.find(path);
    if (times == times_.end() || times->second < kMostTimes) needed_.insert(path);
}

void Tick::seek(const std::string& path) {
    const std::lock_guard lock(mutex_);
    sought_.insert(path);
}

std::set<std::string> Tick::takeSought() {
    const std::lock_guard lock(mutex_);
    return std::exchange(sought_, {});
}

void FileLayers::set(const std::string& path, bool isFile) {
    const std::lock_guard lock(mutex_);
    if (isFile)
        layers_.try_emplace(path);
    else
        layers_.erase(path);
}

bool FileLayers::contains(const std::string& path) const {
    const std::lock_guard lock(mutex_);
    return layers_.contains(path);
}

bool FileLayers::isEmpty() const {
    const std::lock_guard lock(mutex_);
    return layers_.empty();
}

void FileLayers::opened(const std::string& path, const std::string& content, double seconds) {
    const std::lock_guard lock(mutex_);
    if (const auto known = layers_.find(path); known != layers_.end())
        known->second = {content, seconds};
}

std::optional<double> FileLayers::timeOf(const std::string& path) const {
    const std::lock_guard lock(mutex_);
    const auto known = layers_.find(path);
    if (known == layers_.end() || known->second.content.empty()) return std::nullopt;
    return known->second.seconds;
}

std::vector<std::string> FileLayers::changedIn(const Snapshot& now) {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> changed;
    for (auto& [path, opened] : layers_) {
        const auto entry = now.files.find(path);
        if (opened.content.empty() || entry == now.files.end()) continue;
        auto present = entry->second.content();
        if (present.empty() || present == opened.content) continue;
        opened.content = std::move(present);
        changed.push_back(path);
    }
    return changed;
}

LiveProjects& LiveProjects::ofProcess() {
    // Never destroyed: layers may be read while the process ends.
    static auto& projects = *new LiveProjects;
    return projects;
}

const char* LiveProjects::add(const std::string& server, const std::string& prefix,
                              const std::string& folder) {
    const auto url = parseUrl("usdlive://" + server + "/");
    if (!url) return nullptr;
    const std::lock_guard lock(mutex_);
    for (auto& [token, known] : projects_)
        if (known->hasServerOf(*url) && known->prefix == prefix && known->folder == folder) {
            LiveProject opened = *known;
            opened.isClosed = false;
            opened.tick = std::make_shared<Tick>();
            opened.fileLayers = std::make_shared<FileLayers>();
            known = std::make_shared<const LiveProject>(std::move(opened));
            return token.c_str();
        }
    const std::string token =
        std::string(kLiveToken) +
        (projects_.empty() ? std::string() : std::to_string(projects_.size() + 1));
    LiveProject project{url->host, url->port, url->host, url->port, prefix, folder};
    return projects_.emplace(token, std::make_shared<const LiveProject>(std::move(project)))
        .first->first.c_str();
}

template <class Change>
void LiveProjects::change(const std::string& token, Change change) {
    const std::lock_guard lock(mutex_);
    const auto found = projects_.find(token);
    if (found == projects_.end()) return;
    LiveProject changed = *found->second;
    change(changed);
    found->second = std::make_shared<const LiveProject>(std::move(changed));
}

void LiveProjects::setConnected(const std::string& token, const std::string& server,
                                bool isConnected) {
    change(token, [&](LiveProject& project) {
        project.isConnected = isConnected;
        if (const auto url = parseUrl("usdlive://" + server + "/")) {
            project.host = url->host;
            project.port = url->port;
        }
    });
}

void LiveProjects::close(const std::string& token) {
    change(token, [](LiveProject& project) {
        project.isConnected = false;
        project.isClosed = true;
    });
}

LiveProjectPtr LiveProjects::find(const Url& url) const {
    if (!url.isLive()) return nullptr;
    auto found = findToken(url.version);
    return found && found->hasServerOf(url) ? found : nullptr;
}

LiveProjectPtr LiveProjects::findToken(const std::string& token) const {
    const std::lock_guard lock(mutex_);
    const auto found = projects_.find(token);
    return found == projects_.end() ? nullptr : found->second;
}

LiveProjectPtr LiveProjects::findAt(const Url& url) const {
    const std::lock_guard lock(mutex_);
    LiveProjectPtr any;
    for (const auto& [token, project] : projects_) {
        if (project->isClosed || !project->hasServerOf(url) ||
            !url.path.starts_with(project->prefix))
            continue;
        if (project->isConnected) return project;
        any = project;
    }
    return any;
}

}  // namespace usdlive::resolver
