// The functions for a client library in the same process.
#include <pxr/usd/ar/notice.h>
#include <pxr/usd/ar/resolverContext.h>

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "Context.h"
#include "LiveProjects.h"
#include "Remote.h"
#include "usdlive/common/core/ResolverInterface.h"

namespace usdlive::resolver {

namespace {

using Changed = void (*)(void*, const char*);
using IsStopped = int (*)(void*);

/// Asks for a list also if another one was asked for just now.
constexpr std::chrono::milliseconds kAskAlways{-1};
/// The time after which a list is asked for again.
constexpr std::chrono::milliseconds kSameList{1'000};

/// The lists whose files were reported last, by token.
class Reported {
public:
    SnapshotPtr exchange(const std::string& token, SnapshotPtr now) {
        const std::lock_guard lock(mutex_);
        std::swap(last_[token], now);
        return now;
    }
    /// Returns whether it is time to ask for the list with layers. Every edit changes it.
    bool isLayersDue(const std::string& token) {
        const std::lock_guard lock(mutex_);
        auto& due = layersDue_[token];
        const auto now = std::chrono::steady_clock::now();
        if (now < due) return false;
        due = now + kLayersEvery;
        return true;
    }
    /// Until there is a first list, files are not found. With it, all of them are new.
    void failed(const std::string& token) {
        const std::lock_guard lock(mutex_);
        if (auto& last = last_[token]; !last) last = std::make_shared<Snapshot>();
    }
    void forget(const std::string& token) {
        const std::lock_guard lock(mutex_);
        last_.erase(token);
        layersDue_.erase(token);
    }

private:
    static constexpr std::chrono::seconds kLayersEvery{2};

    std::mutex mutex_;  // guards the next members
    std::map<std::string, SnapshotPtr> last_;
    std::map<std::string, std::chrono::steady_clock::time_point> layersDue_;
};

Reported& reported() {
    static auto& all = *new Reported;
    return all;
}

bool isSame(const Entry& a, const Entry& b) {
    if (!a.hash.empty() && !b.hash.empty()) return a.hash == b.hash;
    return a.modifiedMs == b.modifiedMs;  // the server has not computed one of the hashes yet
}

/// Returns the files that are not the same in both, except for layers, which are live.
std::vector<std::string> changedFiles(const Snapshot& before, const Snapshot& now) {
    std::vector<std::string> changed;
    for (const auto& [path, entry] : now.files) {
        if (isUsdLayer(path)) continue;
        const auto old = before.files.find(path);
        if (old == before.files.end() || !isSame(old->second, entry)) changed.push_back(path);
    }
    for (const auto& [path, entry] : before.files)
        if (!isUsdLayer(path) && !now.files.contains(path)) changed.push_back(path);
    return changed;
}

/// Calls `changed` for the layers that are read as files and have changed.
void reportLayers(const LiveProject& live, RemoteProject& project, Changed changed, void* context) {
    if (live.fileLayers->isEmpty()) return;
    const auto now = project.newest(kAskAlways);
    if (!now) return;
    for (const std::string& path : live.fileLayers->changedIn(**now))
        changed(context, path.c_str());
}

const char* live(const char* server, const char* prefix, const char* folder) {
    return LiveProjects::ofProcess().add(server, prefix, folder);
}

void connected(const char* token, const char* server, int isConnected) {
    LiveProjects::ofProcess().setConnected(token, server, isConnected != 0);
    if (const auto project = LiveProjects::ofProcess().findToken(token))
        Remotes::ofProcess().allow(project->host);
}

Fetched<Located> locate(const LiveProject& live, const std::string& path) {
    Url url = live.atServer({});
    url.path = live.prefix + path;
    return Remotes::ofProcess().locate(url);
}

void readAsFile(const char* token, const char* path, int isFile) {
    if (const auto live = LiveProjects::ofProcess().findToken(token))
        live->fileLayers->set(path, isFile != 0);
}

int refresh(const char* token, Changed changed, IsStopped isStopped, void* context) {
    const StoppableRequests requests([&] { return isStopped(context) != 0; });
    const auto live = LiveProjects::ofProcess().findToken(token);
    if (!live) return 0;
    const auto located = locate(*live, "");
    const auto now =
        located ? located->project->follow() : Fetched<SnapshotPtr>(tl::unexpect, located.error());
    if (!now) {
        reported().failed(token);
        return 0;
    }
    if (reported().isLayersDue(token)) reportLayers(*live, *located->project, changed, context);
    for (const std::string& path : live->tick->takeSought())
        if (!isUsdLayer(path) && (*now)->files.contains(path)) changed(context, path.c_str());
    const SnapshotPtr before = reported().exchange(token, *now);
    if (!before || before == *now) return 1;
    for (const std::string& path : changedFiles(*before, **now)) changed(context, path.c_str());
    return 1;
}

/// Returns whether the file is here with this content.
bool fetchFile(const LiveProject& live, RemoteProject& project, const std::string& path,
               const Entry& entry) {
    const std::string content = entry.content();
    const auto file = project.open(path, content);
    if (file) live.tick->fetched(path, content, project.isReady(path, content));
    return bool(file);
}

/// Returns false if the layer did not arrive, or is not in the list yet.
bool fetchLayer(const LiveProject& live, RemoteProject& project, const std::string& path) {
    if (!live.fileLayers->contains(path)) return true;
    // Many layers may be fetched one after the other.
    for (const std::chrono::milliseconds idle : {kSameList, kAskAlways}) {
        const auto files = project.newest(idle);
        if (!files) return false;
        const auto entry = (*files)->files.find(path);
        if (entry != (*files)->files.end()) return fetchFile(live, project, path, entry->second);
    }
    return false;
}

int fetch(const char* token, const char* path, IsStopped isStopped, void* context) {
    const StoppableRequests requests([&] { return isStopped(context) != 0; });
    const auto live = LiveProjects::ofProcess().findToken(token);
    const auto located = live ? locate(*live, path) : Fetched<Located>(tl::unexpect, Failure{});
    if (!located) return 0;
    if (isUsdLayer(path)) return fetchLayer(*live, *located->project, path) ? 1 : 0;
    const SnapshotPtr files = located->project->lastFollowed();
    if (!files) return 0;
    const auto entry = files->files.find(path);
    if (entry == files->files.end()) return 1;
    return fetchFile(*live, *located->project, path, entry->second) ? 1 : 0;
}

void beginTick(const char* token) {
    if (const auto live = LiveProjects::ofProcess().findToken(token)) live->tick->begin();
}

void endTick(const char* token, void (*needed)(void*, const char*), void* context) {
    const auto live = LiveProjects::ofProcess().findToken(token);
    if (!live) return;
    for (const std::string& path : live->tick->end()) needed(context, path.c_str());
}

void close(const char* token) {
    LiveProjects::ofProcess().close(token);
    reported().forget(token);
}

void notify(const char* token) {
    const std::string live = token;
    pxr::ArNotice::ResolverChanged([live](const pxr::ArResolverContext& other) {
        const Context* const ours = other.Get<Context>();
        return ours && ours->root().version == live;
    }).Send();
}

}  // namespace

}  // namespace usdlive::resolver

extern "C" __attribute__((visibility("default"))) const usdlive::ResolverInterface*
usdliveResolverInterface3() {
    static const usdlive::ResolverInterface functions{
        usdlive::resolver::live,    usdlive::resolver::connected, usdlive::resolver::readAsFile,
        usdlive::resolver::refresh, usdlive::resolver::fetch,     usdlive::resolver::beginTick,
        usdlive::resolver::endTick, usdlive::resolver::notify,    usdlive::resolver::close};
    return &functions;
}
