// Connects the client with the resolver plug-in.
#include "usd/places/PlainFiles.h"

#include <dlfcn.h>
#include <pxr/base/plug/plugin.h>
#include <pxr/base/plug/registry.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/ar/packageUtils.h>
#include <pxr/usd/ar/resolver.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>
#include <utility>

#include "basics/Clocks.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

constexpr std::int64_t kFilesEveryMs = 1'000;
constexpr double kFilesPart = 20;
constexpr const char* kScheme = "usdlive";
constexpr const char* kPlugin = "usdliveResolver";

// Returns the functions of the plug-in, or why there are none.
Result<const ResolverInterface*> findResolver() {
    static_cast<void>(pxr::ArGetResolver());
    const auto& schemes = pxr::ArGetRegisteredURISchemes();
    const auto plugin = pxr::PlugRegistry::GetInstance().GetPluginWithName(kPlugin);
    if (!plugin)
        return fail(ErrorCode::InvalidConfiguration,
                    "OpenUSD does not know the plug-in usdliveResolver. Name its folder in "
                    "PXR_PLUGINPATH_NAME");
    if (std::ranges::find(schemes, kScheme) == schemes.end())
        return fail(ErrorCode::InvalidConfiguration,
                    "OpenUSD resolved a path before it knew the plug-in usdliveResolver, and looks "
                    "for no plug-ins after that. Import usdlive before the first layer is opened, "
                    "or start the program with PXR_PLUGINPATH_NAME=$(python -m usdlive.plugins)");
    if (!plugin->Load())
        return fail(ErrorCode::InvalidConfiguration,
                    "OpenUSD cannot load the plug-in " + plugin->GetPath());
    void* const library = ::dlopen(plugin->GetPath().c_str(), RTLD_NOW | RTLD_NOLOAD);
    void* const function = library ? ::dlsym(library, kResolverInterface) : nullptr;
    if (!function)
        return fail(ErrorCode::InvalidConfiguration,
                    "the plug-in " + plugin->GetPath() + " belongs to another version of usdlive");
    return reinterpret_cast<ResolverInterfaceFunction>(function)();
}

bool isLayer(const std::string& path) { return parseLayerId(path).has_value(); }

}  // namespace

std::string encodedInAddress(std::string_view path) {
    return percentEncodedIf(path, [](char c) { return c == '%' || c == '@'; });
}

struct PlainFiles::State {
    /// Asks for the list, and collects the changed files. Returns false if there was no answer.
    bool ask() {
        return resolver->refresh(
                   token,
                   [](void* self, const char* path) {
                       auto& state = *static_cast<State*>(self);
                       const std::lock_guard lock(state.mutex);
                       state.found.insert(path);
                   },
                   isStopped, this) != 0;
    }
    static int isStopped(void* self) { return static_cast<State*>(self)->stops ? 1 : 0; }

    const ResolverInterface* resolver = nullptr;
    const char* token = nullptr;
    std::mutex mutex;               // guards the next members
    std::set<std::string> found;    // have changed
    std::set<std::string> late;     // have changed, and did not arrive; tried again
    std::set<std::string> missing;  // a tick needed them, and they did not arrive; tried again
    std::set<std::string> arrived;  // a tick needed them, and they are in the cache
    std::set<std::string> changed;  // have changed, and are in the cache if a layer is made of them
    std::uint64_t asked = 0, answered = 0;  // lists
    int fetching = 0;                       // tasks that fetch files
    bool isAsking = false;
    double tookMs = 0;
    std::atomic<bool> stops = false;
};

PlainFiles::PlainFiles() = default;
PlainFiles::~PlainFiles() {
    if (!state_) return;
    state_->stops = true;
    worker_.reset();
    resolver_->close(token_);
}

std::optional<std::string> PlainFiles::start(const fs::path& folder,
                                             const std::optional<ServerAddress>& web) {
    const auto refuse = [this](std::string why) {
        problem_ = Error{ErrorCode::InvalidConfiguration,
                         "files of the project that are no layers, such as textures, are not "
                         "found: " +
                             std::move(why)};
        return std::nullopt;
    };
    const auto resolver = findResolver();
    if (!resolver) return refuse(resolver.error().message);
    if (!web) return refuse("the server of this project has announced no address for HTTP");
    const std::string prefix = web->project.empty() ? "" : web->project + "/";
    const char* token =
        (*resolver)->live(web->hostAndPort().c_str(), prefix.c_str(), folder.string().c_str());
    if (!token) return refuse("the host " + web->host + " cannot be part of an address");
    resolver_ = *resolver;
    token_ = token;
    base_ =
        pxr::ArGetResolver().CreateIdentifier("usdlive://" + web->hostAndPort() + "/@~" + token +
                                              "/" + encodedInAddress(prefix) + "layer.usda");
    base_.resize(base_.rfind('/') + 1);
    state_ = std::make_shared<State>();
    state_->resolver = resolver_;
    state_->token = token_;
    worker_ = std::make_unique<Worker>();
    resolver_->connected(token_, web->hostAndPort().c_str(), 1);
    ask(steadyMs());
    return base_;
}

void PlainFiles::follow(bool isConnected, const Connection& connection, std::int64_t nowMs) {
    if (isConnected != isConnected_ || (isConnected && nowMs >= dueAtMs_)) {
        if (!isConnected_) retryAtMs_ = 0;
        isConnected_ = isConnected;
        // The server may have another port when it is back.
        const auto web = isConnected ? connection.web() : std::nullopt;
        resolver_->connected(token_, web ? web->hostAndPort().c_str() : "", isConnected ? 1 : 0);
        if (isConnected) {
            ask(nowMs);
            fetchNeeded({});
        }
    }
    fetchUsed();
}

void PlainFiles::ask(std::int64_t nowMs) {
    const std::lock_guard lock(state_->mutex);
    if (state_->isAsking) {
        if (wanted_ <= state_->asked) dueAtMs_ = nowMs + kFilesEveryMs;
        return;
    }
    state_->isAsking = true;
    ++state_->asked;
    state_->found.merge(state_->late);
    dueAtMs_ = nowMs + std::max(kFilesEveryMs, std::int64_t(state_->tookMs * kFilesPart));
    worker_->post([state = state_] {
        const Stopwatch watch;
        const bool isAnswered = state->ask();
        const std::lock_guard end(state->mutex);
        state->isAsking = false;
        state->answered = state->asked;
        // Waiting for an answer costs nobody anything.
        state->tookMs = isAnswered ? watch.ms() : 0;
    });
}

std::uint64_t PlainFiles::askSoon() {
    const std::lock_guard lock(state_->mutex);
    dueAtMs_ = 0;
    return wanted_ = state_->asked + 1;  // one that was asked for before may be too old
}

bool PlainFiles::isReported(std::uint64_t list) const {
    if (!isConnected_) return true;
    const std::lock_guard lock(state_->mutex);
    return state_->answered >= list && state_->found.empty() && state_->changed.empty() &&
           state_->fetching == 0;
}

std::optional<std::string> PlainFiles::fileAt(const std::string& identifier) const {
    std::string path = pxr::SdfLayer::SplitIdentifier(identifier).first;
    if (pxr::ArIsPackageRelativePath(path)) path = pxr::ArSplitPackageRelativePathOuter(path).first;
    if (!isStarted() || !path.starts_with(base_)) return std::nullopt;
    return percentDecoded(std::string_view(path).substr(base_.size()));
}

void PlainFiles::readAsFile(const std::string& path, bool isFile) {
    resolver_->readAsFile(token_, path.c_str(), isFile ? 1 : 0);
}

bool PlainFiles::mayWait() const {
    return isStarted() && isConnected_ && ticks_ == 0 && steadyMs() >= mayWaitAtMs_;
}

pxr::SdfLayerRefPtr PlainFiles::openWithContent(const std::string& path,
                                                const std::string& identifier) {
    constexpr double kTooLongMs = 1'000;
    constexpr std::int64_t kPauseMs = 30'000;
    const Stopwatch watch;
    pxr::TfErrorMark errors;  // the stage reports that it cannot compose the layer
    readAsFile(path, true);
    auto layer = pxr::SdfLayer::FindOrOpen(identifier);
    readAsFile(path, false);
    errors.Clear();
    if (!layer && watch.ms() > kTooLongMs) mayWaitAtMs_ = steadyMs() + kPauseMs;
    return layer;
}

PlainFiles::Tick::Tick(PlainFiles& files) : files_(files) {
    if (files_.ticks_++ == 0 && files_.isStarted()) files_.resolver_->beginTick(files_.token_);
}

PlainFiles::Tick::~Tick() {
    if (--files_.ticks_ > 0 || !files_.isStarted()) return;
    std::set<std::string> needed;
    files_.resolver_->endTick(
        files_.token_,
        [](void* paths, const char* path) {
            static_cast<std::set<std::string>*>(paths)->insert(path);
        },
        &needed);
    if (!needed.empty()) files_.fetchNeeded(std::move(needed));
}

// Also fetches the files that did not arrive the last time, in pauses that get longer.
void PlainFiles::fetchNeeded(std::set<std::string> files) {
    constexpr std::int64_t kFirstPauseMs = 1'000, kLongestPauseMs = 60'000;
    const std::int64_t now = steadyMs();
    {
        const std::lock_guard lock(state_->mutex);
        if (state_->missing.empty()) {
            pauseMs_ = 0;
        } else if (now >= retryAtMs_) {
            files.merge(std::exchange(state_->missing, {}));
            pauseMs_ = std::clamp(2 * pauseMs_, kFirstPauseMs, kLongestPauseMs);
            retryAtMs_ = now + pauseMs_;
        }
        if (files.empty()) return;
        ++state_->fetching;
    }
    fetchNext(state_, *worker_, {files.begin(), files.end()});
}

/// Fetches the last file, and posts a task for the others, so that requests for the list come in
/// between.
void PlainFiles::fetchNext(const std::shared_ptr<State>& state, Worker& worker,
                           std::vector<std::string> files) {
    worker.post([state, &worker, files = std::move(files)]() mutable {
        std::string file = std::move(files.back());
        files.pop_back();
        const bool isHere =
            state->resolver->fetch(state->token, file.c_str(), State::isStopped, state.get()) != 0;
        const std::lock_guard lock(state->mutex);
        (isHere ? state->arrived : state->missing).insert(std::move(file));
        if (files.empty())
            --state->fetching;
        else
            fetchNext(state, worker, std::move(files));
    });
}

// A tick must not wait until a package has arrived that a stage uses.
void PlainFiles::fetchUsed() {
    std::set<std::string> found;
    {
        const std::lock_guard lock(state_->mutex);
        found.swap(state_->found);
        if (found.empty()) return;
        ++state_->fetching;
    }
    std::vector<std::string> used;
    for (const auto& layer : pxr::SdfLayer::GetLoadedLayers())
        if (const auto file = layer ? fileAt(layer->GetIdentifier()) : std::nullopt)
            if (found.contains(*file)) used.push_back(*file);
    worker_->post([state = state_, found = std::move(found), used = std::move(used)]() mutable {
        std::set<std::string> late;
        for (const std::string& file : used)
            if (!state->resolver->fetch(state->token, file.c_str(), State::isStopped, state.get()))
                late.insert(found.extract(file));
        const std::lock_guard lock(state->mutex);
        state->changed.merge(found);
        state->late.merge(late);
        --state->fetching;
    });
}

PlainFiles::Changes PlainFiles::takeChanges() {
    const std::lock_guard lock(state_->mutex);
    const auto changed = std::exchange(state_->changed, {});
    const auto arrived = std::exchange(state_->arrived, {});
    return {{changed.begin(), changed.end()}, {arrived.begin(), arrived.end()}};
}

std::vector<std::string> PlainFiles::reload(
    const std::vector<std::string>& files,
    const std::function<bool(const pxr::SdfLayerHandle&)>& isLive) const {
    std::set<pxr::SdfLayerHandle> changed, changedClips;
    std::set<std::string> unused(files.begin(), files.end());
    const auto isChanged = [&](const std::string& identifier) {
        const auto file = fileAt(identifier);
        return file && std::ranges::binary_search(files, *file);
    };
    for (const auto& layer : pxr::SdfLayer::GetLoadedLayers()) {
        if (!layer) continue;
        // The content of some layers depends on other files, such as a table of placements.
        if (std::ranges::any_of(layer->GetExternalAssetDependencies(), isChanged) && !isLive(layer))
            changed.insert(layer);
        const auto file = fileAt(layer->GetIdentifier());
        if (!file || !std::ranges::binary_search(files, *file)) continue;
        unused.erase(*file);
        if (!layer->IsDirty() && !isLive(layer))
            (isLayer(*file) ? changedClips : changed).insert(layer);
    }
    if (!changed.empty()) pxr::SdfLayer::ReloadLayers(changed);
    // Their times are those of the content that is loaded.
    if (!changedClips.empty()) pxr::SdfLayer::ReloadLayers(changedClips, /* force = */ true);
    // The content of a layer changes no asset path.
    if (!std::ranges::all_of(files, isLayer)) resolver_->notify(token_);
    return {unused.begin(), unused.end()};
}

}  // namespace usdlive::client
