// Keeps the projects that are live in this process.
#include "LiveProjects.h"

#include <algorithm>
#include <cctype>
#include <system_error>

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

std::optional<fs::path> LiveProject::layerFile(const Url& url) const {
    auto place = placeOf(url);
    std::error_code ignored;
    if (place && !fs::is_regular_file(*place, ignored)) place.reset();
    return place;
}

Url LiveProject::atServer(Url url) const {
    url.host = host;
    url.port = port;
    return url;
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

void LiveProjects::setConnected(const std::string& token, const std::string& server,
                                bool isConnected) {
    const auto url = parseUrl("usdlive://" + server + "/");
    const std::lock_guard lock(mutex_);
    const auto found = projects_.find(token);
    if (found == projects_.end()) return;
    LiveProject now = *found->second;
    now.isConnected = isConnected;
    if (url) {
        now.host = url->host;
        now.port = url->port;
    }
    found->second = std::make_shared<const LiveProject>(std::move(now));
}

void LiveProjects::close(const std::string& token) {
    const std::lock_guard lock(mutex_);
    const auto found = projects_.find(token);
    if (found == projects_.end()) return;
    LiveProject closed = *found->second;
    closed.isConnected = false;
    closed.isClosed = true;
    found->second = std::make_shared<const LiveProject>(std::move(closed));
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
