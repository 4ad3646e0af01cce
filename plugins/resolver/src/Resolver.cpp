// The ArResolver for addresses such as usdlive://localhost:7447/shot.usda.
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/pathUtils.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/ar/assetInfo.h>
#include <pxr/usd/ar/defineResolver.h>
#include <pxr/usd/ar/filesystemAsset.h>
#include <pxr/usd/ar/filesystemWritableAsset.h>
#include <pxr/usd/ar/notice.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/writableAsset.h>
#include <pxr/usd/sdf/fileFormat.h>

#include <algorithm>
#include <cstdlib>
#include <set>

#include "Context.h"
#include "LiveProjects.h"
#include "Remote.h"
#include "Url.h"

AR_NAMESPACE_OPEN_SCOPE

using usdlive::resolver::Context;
using usdlive::resolver::Entry;
using usdlive::resolver::failed;
using usdlive::resolver::Failure;
using usdlive::resolver::Fetched;
using usdlive::resolver::LiveProjectPtr;
using usdlive::resolver::LiveProjects;
using usdlive::resolver::Located;
using usdlive::resolver::Remotes;
using usdlive::resolver::Snapshot;
using usdlive::resolver::SnapshotPtr;
using usdlive::resolver::Url;

namespace {

// Outside a context the last snapshot is used until nobody has used it for this time, so that one
// composition sees one revision.
constexpr std::chrono::milliseconds kSnapshotIdle{1'000};
constexpr std::size_t kMostWarnings = 1'000;

constexpr const char* kReadOnly =
    "files at usdlive:// are read-only here. Open the layer live to edit it (open_layer() of "
    "usdlive.connect()), or put the file into the project's folder";

bool isUsdz(const std::string& path) {
    std::string ending = path.substr(path.size() - std::min<std::size_t>(path.size(), 5));
    std::ranges::transform(ending, ending.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return ending == ".usdz";
}

/// True for the files that OpenUSD opens as layers. Their resolved paths name the version, so that
/// another version is another layer.
bool isLayer(const std::string& path) {
    return usdlive::resolver::isUsdLayer(path) || isUsdz(path);
}

/// The folders in USDLIVE_SEARCH_PATH: paths relative to the project, with `:` between them.
std::vector<std::string> searchFolders() {
    std::vector<std::string> folders;
    const char* value = std::getenv("USDLIVE_SEARCH_PATH");
    std::string text = value ? std::string(value) + ":" : "";
    for (std::size_t colon; (colon = text.find(':')) != std::string::npos; text.erase(0, colon + 1))
        if (colon > 0) folders.push_back(text.substr(0, colon));
    return folders;
}

/// A file of a snapshot.
struct Found {
    Located located;
    SnapshotPtr snapshot;
    const Entry* entry = nullptr;  ///< nullptr: the project has no such file
};

}  // namespace

class UsdliveResolver final : public ArResolver {
public:
    UsdliveResolver() : searchFolders_(searchFolders()) {
        remotes_.cache.onProblem = [](const std::string& problem) {
            TF_WARN("usdlive: %s. New files stay in memory until the program ends",
                    problem.c_str());
        };
        remotes_.cache.onWrongFile = [](const std::string& hash, const std::string& origin) {
            TF_WARN(
                "usdlive: a file that %s sent is not the one with the SHA-256 %s, but may be "
                "shown here. It was removed from the cache. Reload what uses it",
                origin.c_str(), hash.c_str());
        };
    }

protected:
    std::string _CreateIdentifier(const std::string& assetPath,
                                  const ArResolvedPath& anchorAssetPath) const override {
        const auto anchor = usdlive::resolver::parseUrl(anchorAssetPath.GetPathString());
        if (usdlive::resolver::hasScheme(assetPath)) {
            const auto url = parse(assetPath);
            return url ? asNamedIn(anchorAssetPath, anchor, *url).identifier() : assetPath;
        }
        // An absolute path is on this machine.
        if (!anchor || assetPath.empty() || assetPath.front() == '/') return assetPath;
        const Url beside = usdlive::resolver::anchored(*anchor, assetPath);
        if (assetPath.starts_with("./") || assetPath.starts_with("../")) return beside.identifier();
        return searched(*anchor, beside, assetPath);
    }

    std::string _CreateIdentifierForNewAsset(const std::string& assetPath,
                                             const ArResolvedPath& anchor) const override {
        return _CreateIdentifier(assetPath, anchor);
    }

    ArResolvedPath _Resolve(const std::string& assetPath) const override {
        const auto url = parse(assetPath);
        if (!url) return {};
        if (!url->version.empty() && !url->isLive()) return ArResolvedPath(url->resolvedPath());
        const auto live = LiveProjects::ofProcess().find(*url);
        if (live && live->layerFile(*url)) return ArResolvedPath(url->resolvedPath());
        auto found = find(*url, live);
        if (live && !found && url->path.starts_with(live->prefix)) {
            live->tick->seek(live->inProject(*url));
            found = find(*url, live);
        }
        const bool isHere = found && found->entry;
        // The client knows that it exists: the list is older than the project, or did not come.
        if (!isHere && live && live->isFileLayer(*url)) live->tick->need(live->inProject(*url));
        if (isInTick(live)) {
            if (!isHere ||
                (isPackage(*url) && isAwaited(found->located, found->entry->content(), live)))
                return {};
        } else if (!found) {
            report(assetPath, found.error());
        }
        if (!isHere) return {};
        return ArResolvedPath(resolved(*url, *found).resolvedPath());
    }

    ArResolvedPath _ResolveForNewAsset(const std::string& assetPath) const override {
        const auto url = parse(assetPath);
        return url ? ArResolvedPath(url->resolvedPath()) : ArResolvedPath();
    }

    std::string _GetExtension(const std::string& assetPath) const override {
        const auto url = usdlive::resolver::parseUrl(assetPath);
        return TfGetExtension(url ? url->path : assetPath);
    }

    ArAssetInfo _GetAssetInfo(const std::string& assetPath,
                              const ArResolvedPath& resolvedPath) const override {
        ArAssetInfo info;
        const auto url =
            usdlive::resolver::parseUrl(resolvedPath ? resolvedPath.GetPathString() : assetPath);
        if (!url) return info;
        if (!url->isLive()) info.version = url->version;
        info.assetName = url->path;
        return info;
    }

    ArTimestamp _GetModificationTimestamp(const std::string& /*assetPath*/,
                                          const ArResolvedPath& resolvedPath) const override {
        const auto url = usdlive::resolver::parseUrl(resolvedPath.GetPathString());
        if (!url) return {};
        const auto live = liveOf(*url);
        if (const auto file = layerFile(*url, live))
            return ArFilesystemAsset::GetModificationTimestamp(ArResolvedPath(file->string()));
        // Sdf asks after it has read the layer, when there may be a newer one.
        if (live && live->isFileLayer(*url))
            if (const auto time = live->fileLayers->timeOf(live->inProject(*url)))
                return ArTimestamp(*time);
        if (!url->version.empty() && !url->isLive() &&
            !usdlive::resolver::isHashToken(url->version))
            return ArTimestamp(
                std::strtod(usdlive::resolver::revisionOf(url->version).c_str(), nullptr));
        const auto found = find(*url, live);
        return found && found->entry ? ArTimestamp(timeOf(*found->entry)) : ArTimestamp();
    }

    std::shared_ptr<ArAsset> _OpenAsset(const ArResolvedPath& resolvedPath) const override {
        const std::string& text = resolvedPath.GetPathString();
        const auto url = parse(text);
        if (!url) return nullptr;
        if (isAwaitedLayer(*url)) return nullptr;
        auto file = open(*url);
        if (file) return std::make_shared<ArFilesystemAsset>(file->release());
        if (const auto live = liveOf(*url); live && live->isFileLayer(*url)) {
            live->tick->need(live->inProject(*url));  // tries again
            warn(text, "cannot read", file.error());
            return nullptr;
        }
        TF_RUNTIME_ERROR("usdlive: cannot read %s: %s", text.c_str(), file.error().cause.c_str());
        return nullptr;
    }

    bool _CanWriteAssetToPath(const ArResolvedPath& resolvedPath,
                              std::string* whyNot) const override {
        if (placeOf(resolvedPath)) return true;
        if (whyNot) *whyNot = kReadOnly;
        return false;
    }

    std::shared_ptr<ArWritableAsset> _OpenAssetForWrite(const ArResolvedPath& resolvedPath,
                                                        WriteMode mode) const override {
        // The file of a live layer in the cache folder. The client saves it to the project.
        if (const auto place = placeOf(resolvedPath))
            return ArFilesystemWritableAsset::Create(ArResolvedPath(place->string()), mode);
        TF_RUNTIME_ERROR("usdlive: cannot write %s: %s", resolvedPath.GetPathString().c_str(),
                         kReadOnly);
        return nullptr;
    }

    ArResolverContext _CreateDefaultContextForAsset(const std::string& assetPath) const override {
        const auto url = usdlive::resolver::parseUrl(assetPath);
        if (!url) return {};
        Context::wrapForPython();
        const Context context(*url, remotes_.user());
        if (url->isLive()) return ArResolverContext(context);
        if (const auto located = remotes_.locate(*url); located && url->pin.empty())
            keepVersion(context, *located, *url);
        return ArResolverContext(context);
    }

    /// The text is an address, of which only the server, the project and the pin count.
    ArResolverContext _CreateContextFromString(const std::string& text) const override {
        const auto url = parse(text);
        if (!url) return {};
        Context::wrapForPython();
        return ArResolverContext(Context(*url, remotes_.user()));
    }

    void _RefreshContext(const ArResolverContext& context) override {
        const Context* const ours = context.Get<Context>();
        if (ours && ours->root().isLive()) {
            const auto live = LiveProjects::ofProcess().find(ours->root());
            if (!live || !live->isConnected) return;
            const bool isChanged = follow(ours->root(), live);
            if (ours->refresh() || isChanged) ArNotice::ResolverChanged(*ours).Send();
            return;
        }
        if (ours) {
            if (ours->refresh()) ArNotice::ResolverChanged(*ours).Send();
            return;
        }
        if (remotes_.refresh())
            ArNotice::ResolverChanged([](const ArResolverContext& other) {
                return other.Get<Context>() == nullptr;
            }).Send();
    }

    bool _IsContextDependentPath(const std::string& assetPath) const override {
        const auto url = usdlive::resolver::parseUrl(assetPath);
        return url && url->pin.empty() && url->version.empty();
    }

private:
    static std::optional<Url> parse(const std::string& text) {
        std::string why;
        auto url = usdlive::resolver::parseUrl(text, &why);
        if (!url) TF_RUNTIME_ERROR("usdlive: %s is not an address: %s", text.c_str(), why.c_str());
        return url;
    }

    /// Returns the address as a layer means it: in a live layer, every address of its server is
    /// live; in others none is, whatever was written there.
    static Url asNamedIn(const ArResolvedPath& anchorPath, const std::optional<Url>& anchor,
                         Url url) {
        if (!anchorPath) return url;
        if (url.isLive()) url.version.clear();
        if (anchor && anchor->isLive() && anchor->server() == url.server() && url.pin.empty())
            url.version = anchor->version;
        return url;
    }

    /// Returns the live project that serves the file. A package of a live project has an address
    /// with its content.
    static LiveProjectPtr liveOf(const Url& url) {
        if (url.isLive()) return LiveProjects::ofProcess().find(url);
        const bool isContent = url.pin.empty() && usdlive::resolver::isHashToken(url.version);
        return isContent ? LiveProjects::ofProcess().findAt(url) : nullptr;
    }

    static std::optional<std::filesystem::path> layerFile(const Url& url,
                                                          const LiveProjectPtr& live) {
        return live && url.isLive() ? live->layerFile(url) : std::nullopt;
    }

    /// Returns the time of a file for OpenUSD, in seconds. That of a layer with a history is its
    /// revision.
    static double timeOf(const Entry& entry) {
        constexpr double kMsInSecond = 1'000;
        if (entry.version.empty()) return double(entry.modifiedMs) / kMsInSecond;
        return std::strtod(usdlive::resolver::revisionOf(entry.version).c_str(), nullptr);
    }

    static bool isInTick(const LiveProjectPtr& live) { return live && live->tick->isRunning(); }

    /// True for files that OpenUSD reads as layers, except for USD. A dynamic payload does not read
    /// its file.
    static bool isPackage(const Url& url) {
        return !usdlive::resolver::isUsdLayer(url.path) && TfGetExtension(url.path) != "edf" &&
               SdfFileFormat::FindByExtension(url.path) != nullptr;
    }

    /// Returns whether a tick may not open the file, because it has to be fetched.
    static bool isAwaited(const Located& located, const std::string& content,
                          const LiveProjectPtr& live) {
        if (located.project->isReady(located.path, content)) {
            live->tick->found(located.path);
            return false;
        }
        if (live->tick->wasFetched(located.path, content)) return false;
        live->tick->need(located.path);
        return true;
    }

    /// Does the same for a layer that is read as a file. OpenUSD finds it all the same, so that it
    /// is one of the clips of a template.
    bool isAwaitedLayer(const Url& url) const {
        const auto live = liveOf(url);
        if (!isInTick(live) || !live->isFileLayer(url)) return false;
        const auto found = find(url, live);
        return found && found->entry && isAwaited(found->located, found->entry->content(), live);
    }

    /// Asks for the files of a live project. Returns whether some have changed.
    bool follow(const Url& url, const LiveProjectPtr& live) const {
        const auto located = locate(url, live);
        if (!located) return false;
        const SnapshotPtr before = located->project->lastFollowed();
        const auto now = located->project->follow();
        return now && *now != before;
    }

    /// Returns the file of a live layer that is written. There may be none yet. The client takes no
    /// save when its connection is closed.
    static std::optional<std::filesystem::path> placeOf(const ArResolvedPath& resolvedPath) {
        const auto url = usdlive::resolver::parseUrl(resolvedPath.GetPathString());
        const auto live = url ? LiveProjects::ofProcess().find(*url) : nullptr;
        const bool isLive = live && !live->isClosed && !live->isFileLayer(*url);
        return isLive ? live->placeOf(*url) : std::nullopt;
    }

    /// Finds a path without `./`, as OpenUSD's own resolver does: beside the anchor, beside the
    /// stage's root layer, then in the folders to search, of the project and of this machine.
    std::string searched(const Url& anchor, const Url& beside, const std::string& path) const {
        const auto live = LiveProjects::ofProcess().find(anchor);
        const auto exists = [&](const Url& url) {
            if (layerFile(url, live)) return true;
            const auto found = find(url, live);
            return found && found->entry;
        };
        if (exists(beside)) return beside.identifier();
        const Context* const context = _GetCurrentContextObject<Context>();
        if (context && context->root().server() == anchor.server()) {
            const Url there = usdlive::resolver::anchored(
                asNamedIn(ArResolvedPath(anchor.resolvedPath()), anchor, context->root()), path);
            if (exists(there)) return there.identifier();
        }
        const auto located = locate(anchor, live);
        if (!located) return beside.identifier();
        // The part of the path that names the project.
        Url root = anchor;
        root.path.resize(root.path.size() - located->path.size());
        for (const std::string& folder : searchFolders_) {
            const Url there = usdlive::resolver::anchored(root, folder + "/" + path);
            if (exists(there)) return there.identifier();
        }
        if (ArGetResolver().Resolve(path)) return path;
        return beside.identifier();
    }

    Fetched<Located> locate(const Url& url, const LiveProjectPtr& live) const {
        if (!live) return remotes_.locate(url);
        const Url there = live->atServer(url);
        return live->isConnected && !isInTick(live) ? remotes_.locateOnce(there)
                                                    : remotes_.locateKnown(there);
    }

    /// Returns the list of files that is valid for the address.
    Fetched<SnapshotPtr> listOf(const Located& located, const Url& url,
                                const LiveProjectPtr& live) const {
        const bool isFollowed = live && url.path.starts_with(live->prefix);
        // A layer without a placeholder is none that the client knows.
        const bool isInList = isFollowed && !usdlive::resolver::isUsdLayer(url.path);
        if (isInTick(live)) {
            auto last = isInList ? located.project->lastFollowed() : located.project->last();
            if (!last) return failed("its list of files is not here yet");
            return last;
        }
        if (isInList) return located.project->followed();
        if (live && !live->isConnected) return located.project->known();
        if (!url.pin.empty()) return located.project->at(url.pin);
        const Context* const context = _GetCurrentContextObject<Context>();
        if (context && !isFollowed) return context->of(located, url);
        return located.project->newest(kSnapshotIdle);
    }

    Fetched<Found> find(const Url& url, const LiveProjectPtr& live) const {
        const auto located = locate(url, live);
        if (!located) return tl::unexpected(located.error());
        const auto snapshot = listOf(*located, url, live);
        if (!snapshot) return tl::unexpected(snapshot.error());
        Found found{*located, *snapshot};
        const auto look = [&](const std::string& path) {
            const auto entry = (*snapshot)->files.find(path);
            if (entry == (*snapshot)->files.end()) return false;
            found.located.path = path;
            found.entry = &entry->second;
            return true;
        };
        // The address of a server with one project may name the project all the same.
        const std::string name = located->project->name() + "/";
        if (!look(located->path) && located->path.starts_with(name))
            (void)look(located->path.substr(name.size()));
        return found;
    }

    static Url resolved(Url url, const Found& found) {
        // The path of a live file stays, so that it is found beside its layers. A layer of the
        // project may be opened live later.
        if (url.isLive() && !isUsdz(url.path)) return url;
        // Without the name of the only project, if the address has it.
        if (!found.located.project->hasPrefix()) url.path = found.located.path;
        if (!isLayer(url.path)) return url;
        url.version = found.entry->content();
        return url;
    }

    Fetched<usdlive::resolver::OpenFile> open(const Url& url) const {
        const auto live = liveOf(url);
        if (const auto file = layerFile(url, live)) {
            usdlive::resolver::OpenFile opened(std::fopen(file->c_str(), "rb"), &std::fclose);
            if (opened) return opened;
            return failed("cannot read " + file->string());
        }
        if (!url.version.empty() && !url.isLive()) {
            const auto located = locate(url, live);
            if (!located) return tl::unexpected(located.error());
            if (live && !live->isConnected)
                return located->project->openKept(located->path, url.version);
            return located->project->open(located->path, url.version);
        }
        const auto found = find(url, live);
        if (!found) return tl::unexpected(found.error());
        if (!found->entry) return failed("the project has no such file");
        const std::string content = found->entry->content();
        if (live && live->isFileLayer(url))
            live->fileLayers->opened(live->inProject(url), content, timeOf(*found->entry));
        const auto& [project, path] = found->located;
        if (live && !live->isConnected) return project->openKept(path, content);
        return project->open(path, content);
    }

    /// Makes the context use the snapshot that the stage's root layer was opened from, although
    /// there may be a newer one.
    static void keepVersion(const Context& context, const Located& located, const Url& url) {
        if (url.version.empty()) return;
        const SnapshotPtr last = located.project->last();
        const auto entry = last ? last->files.find(located.path) : decltype(last->files.end())();
        if (!last || entry == last->files.end()) return;
        if (entry->second.content() == url.version) return context.set(located.project, last);
        if (usdlive::resolver::isHashToken(url.version)) return;
        if (const auto then = located.project->at(usdlive::resolver::revisionOf(url.version)))
            context.set(located.project, *then);
    }

    /// An error for a layer, which is then part of what the caller says. A value that names a
    /// texture can still be read, and a live stage stays open, so that is a warning.
    void report(const std::string& assetPath, const Failure& failure) const {
        const auto url = usdlive::resolver::parseUrl(assetPath);
        if (url && isLayer(url->path) && !url->isLive())
            return TF_RUNTIME_ERROR("usdlive: cannot open %s: %s", assetPath.c_str(),
                                    failure.cause.c_str());
        warn(assetPath, "cannot find", failure);
    }

    void warn(const std::string& assetPath, const char* what, const Failure& failure) const {
        const std::lock_guard lock(mutex_);
        if (warned_.size() < kMostWarnings && warned_.insert(assetPath + failure.cause).second)
            TF_WARN("usdlive: %s %s: %s", what, assetPath.c_str(), failure.cause.c_str());
    }

    const std::vector<std::string> searchFolders_;
    Remotes& remotes_ = Remotes::ofProcess();
    mutable std::mutex mutex_;  // guards the next member
    mutable std::set<std::string> warned_;
};

AR_DEFINE_RESOLVER(UsdliveResolver, ArResolver);

AR_NAMESPACE_CLOSE_SCOPE
