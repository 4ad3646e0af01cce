// Asks servers for the files of their projects.
#include "Remote.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <thread>

namespace usdlive::resolver {

using fetch::HttpAnswer;
using fetch::HttpLimits;
using fetch::HttpRequest;
using fetch::isLoopback;
using fetch::urlEncoded;
using Json = nlohmann::json;
using std::chrono::milliseconds;

namespace {

constexpr unsigned kOk = 200, kNotModified = 304, kNotFound = 404, kConflict = 409, kBusy = 503;
// A server that prepares a large layer may ask to try again.
constexpr int kBusyAttempts = 6;
constexpr milliseconds kBusyPause{500};
// The time for which a failed server is not asked again, because a stage may name a thousand files
// of it.
constexpr milliseconds kFailurePause{2'000};
// Snapshots of pins that are kept.
constexpr std::size_t kMostPins = 256;
constexpr milliseconds kAskAgain{-1};
// A snapshot that is in use is asked for again after this time.
constexpr milliseconds kLongestUse{5'000};
constexpr const char* kFollowedQuery = "?layers=no";
// The largest content whose size no list names, such as that of a layer with a history.
constexpr std::uint64_t kMostUnlistedBytes = std::uint64_t(4) << 30;
constexpr std::size_t kMostFiles = 2'000'000;                   // in one project
constexpr std::uint64_t kMostProjectsBytes = 16 * 1024 * 1024;  // a list of projects
constexpr int kOpenAttempts = 3;
constexpr std::size_t kTokenDigits = 16, kSha256Digits = 64;

std::string environment(const char* name, const std::string& otherwise = {}) {
    const char* value = std::getenv(name);
    return value && *value ? value : otherwise;
}

std::vector<std::string> allowedHosts() {
    std::vector<std::string> hosts;
    std::string text = environment("USDLIVE_RESOLVER_HOSTS") + ",";
    for (std::size_t comma; (comma = text.find(',')) != std::string::npos; text.erase(0, comma + 1))
        if (const std::string host = text.substr(0, comma); !host.empty())
            hosts.push_back(host.starts_with('[') ? fetch::hostOf(host) : host);
    return hosts;
}

HttpLimits limitsFromEnvironment() {
    HttpLimits limits;
    const std::string ms = environment("USDLIVE_RESOLVER_TIMEOUT_MS");
    if (const long count = std::strtol(ms.c_str(), nullptr, 10); count > 0)
        limits = {milliseconds(count), milliseconds(count), milliseconds(count)};
    return limits;
}

/// Returns the first line of an answer, which says why it is an error.
std::string sentenceOf(const HttpAnswer& answer) {
    constexpr std::size_t kMostShown = 300;
    std::string text = answer.body.substr(0, std::min(answer.body.find('\n'), kMostShown));
    return text.empty() ? "the server answered with the status " + std::to_string(answer.status)
                        : text;
}

std::string textIn(const Json& json, const char* name) {
    const auto found = json.find(name);
    return found != json.end() && found->is_string() ? found->get<std::string>() : std::string();
}

template <class Number>
Number numberIn(const Json& json, const char* name) {
    const auto found = json.find(name);
    return found != json.end() && found->is_number_integer() ? found->get<Number>() : Number(0);
}

thread_local std::function<bool()> stopsHere;

bool areRequestsStopped() { return stopsHere && stopsHere(); }

/// Sends the request again while the server is busy.
Fetched<HttpAnswer> patientGet(const HttpRequest& request, const HttpLimits& limits) {
    for (int left = kBusyAttempts;; --left) {
        auto answer = getFromServer(request, limits, stopsHere);
        if (!answer || answer->status != kBusy || left == 1 || areRequestsStopped()) return answer;
        std::this_thread::sleep_for(kBusyPause);
    }
}

/// True for what may be part of a resolved path.
bool isVersion(const std::string& version) {
    return !version.empty() && version.find_first_not_of("0123456789abcdef-") == std::string::npos;
}

void addFile(const Json& file, Snapshot& snapshot) {
    Entry entry{textIn(file, "version"), textIn(file, "hash"),
                numberIn<std::int64_t>(file, "modifiedMs")};
    if (snapshot.files.size() > kMostFiles) return;
    if (const auto size = file.find("size"); size != file.end() && size->is_number_unsigned())
        entry.size = size->get<std::uint64_t>();
    if (!entry.hash.empty() && !isHashToken(entry.hash)) return;
    if (!entry.version.empty() && !isVersion(entry.version)) return;
    snapshot.files.insert_or_assign(textIn(file, "path"), std::move(entry));
}

Fetched<SnapshotPtr> parseSnapshot(const HttpAnswer& answer, const std::string& pin) {
    auto snapshot = std::make_shared<Snapshot>();
    // Keeps one file at a time and the members that are used, so that a large list does not take
    // several times its size.
    bool isInFiles = false;
    const auto take = [&](int depth, Json::parse_event_t event, Json& parsed) {
        using Event = Json::parse_event_t;
        if (depth == 0) return event == Event::object_start || event == Event::object_end;
        if (depth == 1 && event == Event::key) {
            isInFiles = parsed == "files";
            return isInFiles || parsed == "project" || parsed == "revision";
        }
        if (depth == 1) return isInFiles || event == Event::value;
        if (depth == 2 && isInFiles && event == Event::object_end) addFile(parsed, *snapshot);
        if (depth == 2) return isInFiles && event == Event::object_start;
        return isInFiles && depth == 3 && (event == Event::key || event == Event::value);
    };
    const Json json = Json::parse(answer.body, take, false);
    const auto files = json.is_object() ? json.find("files") : json.end();
    if (!json.is_object() || files == json.end() || !files->is_array())
        return failed("the answer is not a list of files. Is this a usdlive server?");
    if (snapshot->files.size() > kMostFiles)
        return failed("the project has more than " + std::to_string(kMostFiles) + " files");
    snapshot->project = textIn(json, "project");
    snapshot->revision = numberIn<std::uint64_t>(json, "revision");
    snapshot->pin = pin;
    snapshot->etag = answer.etag();
    return SnapshotPtr(snapshot);
}

/// Takes a body that is no longer than the server has said.
class Bounded final : public BodySink {
public:
    Bounded(BodySink& target, std::uint64_t most) : target_(target), left_(most) {}
    std::span<char> space() override { return target_.space(); }
    std::string add(std::size_t size) override {
        if (size > left_) return "it is longer than the server has listed";
        left_ -= size;
        return target_.add(size);
    }

private:
    BodySink& target_;
    std::uint64_t left_;
};

/// The hash in the token names the history, so the key needs neither server nor project.
std::string keyOf(const std::string& path, const std::string& token) { return token + "/" + path; }

bool isRevision(const std::string& pin) {
    return !pin.empty() && pin.find_first_not_of("0123456789") == std::string::npos;
}

/// On one machine, compressing takes longer than sending.
bool takesZstd(const std::string& host) {
    const std::string chosen = environment("USDLIVE_RESOLVER_COMPRESSION");
    return chosen.empty() ? !isLoopback(host) : chosen != "0";
}

}  // namespace

std::string Entry::content() const { return version.empty() ? hash : versionToken(version); }

std::string versionToken(const std::string& version) {
    const std::size_t dash = version.find('-');
    if (dash == std::string::npos) return version;
    return version.substr(0, dash + 1 + kTokenDigits);
}

bool isHashToken(const std::string& token) {
    return token.size() == kSha256Digits &&
           token.find_first_not_of("0123456789abcdef") == std::string::npos;
}

std::string revisionOf(const std::string& token) { return token.substr(0, token.find('-')); }

StoppableRequests::StoppableRequests(std::function<bool()> isStopped) {
    stopsHere = std::move(isStopped);
}
StoppableRequests::~StoppableRequests() { stopsHere = nullptr; }

// ---- RemoteProject

RemoteProject::RemoteProject(std::string host, std::uint16_t port, std::string name,
                             std::string prefix, HttpLimits limits, HashCache& cache)
    : host_(std::move(host)),
      port_(port),
      name_(std::move(name)),
      prefix_(std::move(prefix)),
      origin_(host_ + ":" + std::to_string(port_) + prefix_),
      limits_(limits),
      takesZstd_(takesZstd(host_)),
      cache_(cache) {}

Fetched<SnapshotPtr> RemoteProject::newest(milliseconds idle) { return ask(newest_, {}, idle); }

RemoteProject::Listing RemoteProject::listingOf(const std::string& pin) {
    return {(isRevision(pin) ? "?revision=" : "?checkpoint=") + urlEncoded(pin), pin};
}

Fetched<SnapshotPtr> RemoteProject::at(const std::string& pin) {
    Asked* known = nullptr;
    {
        const std::lock_guard lock(mutex_);
        if (pinned_.size() < kMostPins || pinned_.contains(pin)) known = &pinned_[pin];
    }
    if (!known) return request(nullptr, listingOf(pin));
    // The layers of a revision never change. The other files of the list are opened by their path
    // if they have changed.
    return ask(*known, listingOf(pin), milliseconds::max());
}

Fetched<SnapshotPtr> RemoteProject::known() { return lastOf(newest_, {}); }

Fetched<SnapshotPtr> RemoteProject::follow() { return ask(followed_, {kFollowedQuery}, kAskAgain); }

Fetched<SnapshotPtr> RemoteProject::followed() { return lastOf(followed_, {kFollowedQuery}); }

Fetched<SnapshotPtr> RemoteProject::lastOf(Asked& known, const Listing& listing) {
    {
        const std::lock_guard lock(mutex_);
        if (known.snapshot) return known.snapshot;
        if (known.failure) return tl::unexpected(*known.failure);
    }
    return ask(known, listing, milliseconds::max());
}

SnapshotPtr RemoteProject::lastFollowed() const {
    const std::lock_guard lock(mutex_);
    return followed_.snapshot;
}

SnapshotPtr RemoteProject::last() const {
    const std::lock_guard lock(mutex_);
    return newest_.snapshot;
}

Fetched<SnapshotPtr> RemoteProject::ask(Asked& known, const Listing& listing, milliseconds idle) {
    const auto answerNow = [&]() -> std::optional<Fetched<SnapshotPtr>> {
        const std::lock_guard lock(mutex_);
        const auto now = Clock::now();
        const auto passed = now - known.when;
        if (known.failure && passed < kFailurePause)
            return Fetched<SnapshotPtr>(tl::unexpect, *known.failure);
        if (known.failure || !known.snapshot) return std::nullopt;
        const bool isOld = passed > idle || now - known.asked > kLongestUse;
        if (idle != milliseconds::max() && isOld) return std::nullopt;
        known.when = now;
        return Fetched<SnapshotPtr>(known.snapshot);
    };
    if (auto now = answerNow()) return *now;
    const std::lock_guard asking(asking_);
    if (auto now = answerNow()) return *now;
    SnapshotPtr before;
    {
        const std::lock_guard lock(mutex_);
        before = known.snapshot;
    }
    auto answer = request(before, listing);
    if (!answer && areRequestsStopped()) return answer;  // says nothing about the server
    const std::lock_guard lock(mutex_);
    known.when = known.asked = Clock::now();
    known.failure.reset();
    if (answer)
        known.snapshot = *answer;
    else
        known.failure = answer.error();
    return answer;
}

Fetched<SnapshotPtr> RemoteProject::request(const SnapshotPtr& known, const Listing& listing) {
    HttpRequest request = requestFor("/files" + listing.query);
    if (known) request.headers.emplace_back("If-None-Match", '"' + known->etag + '"');
    const auto answer = patientGet(request, limits_);
    if (!answer) return tl::unexpected(answer.error());
    if (known && answer->status == kNotModified) return known;
    if (answer->status != kOk) return failed(sentenceOf(*answer), answer->status);
    return parseSnapshot(*answer, listing.pin);
}

HttpRequest RemoteProject::requestFor(const std::string& target) const {
    HttpRequest request{{host_, port_}, prefix_ + target};
    request.takesZstd = takesZstd_;
    return request;
}

/// Returns the hash of what was sent. `wanted`: the ETag has to begin with it. `size`: the largest
/// size.
Fetched<std::string> RemoteProject::download(const std::string& target, const std::string& wanted,
                                             std::optional<std::uint64_t> size, BodySink& sink) {
    HttpRequest request = requestFor(target);
    Bounded bounded(sink, size.value_or(kMostUnlistedBytes));
    request.sink = &bounded;
    const auto answer = patientGet(request, limits_);
    if (!answer) return tl::unexpected(answer.error());
    if (answer->status != kOk) return failed(sentenceOf(*answer), answer->status);
    if (!answer->etag().starts_with(wanted))
        return failed("the server has another version of it now", kConflict);
    return std::string(answer->header("Usdlive-Sha256"));
}

Fetched<OpenFile> RemoteProject::openVersion(const std::string& path, const std::string& token) {
    return cache_.keyedFile(origin_, keyOf(path, token), [&](BodySink& sink) {
        return download("/files/" + urlEncoded(path) + "?revision=" + revisionOf(token), token,
                        std::nullopt, sink);
    });
}

Fetched<OpenFile> RemoteProject::open(const std::string& path, const std::string& content) {
    const bool isVersion = !content.empty() && !isHashToken(content);
    return isVersion ? openVersion(path, content) : openFile(path, content);
}

Fetched<OpenFile> RemoteProject::openKept(const std::string& path, const std::string& content) {
    auto file = isHashToken(content) ? cache_.find(origin_, content)
                                     : cache_.findKeyed(origin_, keyOf(path, content));
    if (file) return file;
    return failed("it is not in the cache, and there is no connection to the server");
}

bool RemoteProject::isReady(const std::string& path, const std::string& content) const {
    if (content.empty()) return false;
    return isHashToken(content) ? cache_.isReady(origin_, content)
                                : cache_.isKeyedReady(origin_, keyOf(path, content));
}

std::optional<std::uint64_t> RemoteProject::sizeOf(const std::string& path,
                                                   const std::string& hash) const {
    for (const SnapshotPtr& list : {last(), lastFollowed()}) {
        if (!list) continue;
        const auto found = list->files.find(path);
        if (found != list->files.end() && found->second.hash == hash) return found->second.size;
    }
    return std::nullopt;
}

Fetched<OpenFile> RemoteProject::openFile(const std::string& path, const std::string& hash) {
    std::string wanted = hash;
    Failure failure{"it changes all the time"};
    for (int left = kOpenAttempts; left > 0; --left) {
        const std::string target = "/files/" + urlEncoded(path);
        if (wanted.empty()) {
            // The server does not know the hash yet, or another file is there by now.
            const auto list = newest(kAskAgain);
            if (!list) return tl::unexpected(list.error());
            const auto found = (*list)->files.find(path);
            if (found == (*list)->files.end())
                return failed("the project has no such file any more", kNotFound);
            wanted = found->second.hash;
            if (wanted.empty())
                return cache_.keyedFile(
                    origin_,
                    path + "/" + std::to_string(found->second.modifiedMs) + "/" + host_ + prefix_,
                    [&](BodySink& sink) { return download(target, "", found->second.size, sink); });
        }
        auto file = cache_.file(origin_, wanted, [&](BodySink& sink) {
            return download(target + "?hash=" + wanted, wanted, sizeOf(path, wanted), sink);
        });
        if (file) return file;
        failure = file.error();
        if (failure.status != kConflict && failure.status != 0) return tl::unexpected(failure);
        if (failure.status == kConflict) wanted.clear();
    }
    return tl::unexpected(failure);
}

// ---- Remotes

Remotes::Remotes()
    : cache(HashCache::optionsFromEnvironment()),
      user_(environment("USDLIVE_USER", environment("USER"))),
      limits_(limitsFromEnvironment()),
      allowedHosts_(allowedHosts()) {}

Remotes& Remotes::ofProcess() {
    // Never destroyed: files may be read while the process ends.
    static auto& remotes = *new Remotes;
    return remotes;
}

void Remotes::allow(const std::string& host) {
    const std::lock_guard lock(mutex_);
    if (std::ranges::find(allowedHosts_, host) == allowedHosts_.end())
        allowedHosts_.push_back(host);
}

std::optional<Failure> Remotes::whyForbidden(const Url& url) {
    if (isLoopback(url.host)) return std::nullopt;
    const std::lock_guard lock(mutex_);
    for (const std::string& host : allowedHosts_)
        if (host == "*" || host == url.host) return std::nullopt;
    return Failure{"the host " + url.host +
                   " is not allowed. List it in the environment variable USDLIVE_RESOLVER_HOSTS to "
                   "allow it"};
}

Fetched<Located> Remotes::locate(const Url& url) {
    if (auto forbidden = whyForbidden(url)) return tl::unexpected(*forbidden);
    if (url.leadsOut()) return failed("the path leads out of the server");
    Server& server = serverOf(url);
    for (const bool again : {false, true}) {
        if (auto failure = ask(server, url, again)) return tl::unexpected(*failure);
        if (auto located = locateIn(server, url)) return *std::move(located);
    }
    return failed("the server has no project \"" + url.path.substr(0, url.path.find('/')) + "\"",
                  kNotFound);
}

Fetched<Located> Remotes::locateOnce(const Url& url) {
    Server& server = serverOf(url);
    {
        const std::lock_guard lock(server.mutex);
        if (!server.isKnown && server.failure) return tl::unexpected(*server.failure);
    }
    return locate(url);
}

Fetched<Located> Remotes::locateKnown(const Url& url) {
    if (url.leadsOut()) return failed("the path leads out of the server");
    if (auto located = locateIn(serverOf(url), url)) return *std::move(located);
    return failed("there is no connection to the server " + url.server());
}

Remotes::Server& Remotes::serverOf(const Url& url) {
    const std::lock_guard lock(mutex_);
    auto& entry = servers_[url.server()];
    if (!entry) entry = std::make_unique<Server>();
    return *entry;
}

std::optional<Located> Remotes::locateIn(Server& server, const Url& url) {
    const std::lock_guard lock(server.mutex);
    const std::string first = url.path.substr(0, url.path.find('/'));
    const bool isLiveSession = first.find("?session=") != std::string::npos;  // LV1
    if (isLiveSession && !server.projects.contains(first))
        server.projects.emplace(
            first, std::make_shared<RemoteProject>(url.host, url.port, first,
                                                   "/" + urlEncoded(first), limits_, cache));
    if (!isLiveSession && !server.hasSeveral && server.only) return Located{server.only, url.path};
    const auto found = server.projects.find(first);
    if (found == server.projects.end()) return std::nullopt;
    return Located{found->second, url.path.substr(std::min(url.path.size(), first.size() + 1))};
}

bool Remotes::refresh() {
    std::vector<ProjectPtr> projects;
    {
        const std::lock_guard lock(mutex_);
        for (const auto& [address, server] : servers_) {
            const std::lock_guard serverLock(server->mutex);
            for (const auto& [name, project] : server->projects) projects.push_back(project);
        }
    }
    bool isChanged = false;
    for (const ProjectPtr& project : projects) {
        const SnapshotPtr before = project->last();
        if (!before) continue;
        const auto now = project->newest(kAskAgain);
        isChanged = isChanged || (now && *now != before);
    }
    return isChanged;
}

/// Asks which projects the server has. `again`: there may be a new one.
std::optional<Failure> Remotes::ask(Server& server, const Url& url, bool again) {
    const auto isAnswered = [&] {
        const std::lock_guard lock(server.mutex);
        const bool isRecent = std::chrono::steady_clock::now() - server.when < kFailurePause;
        return (server.isKnown && (!again || isRecent)) || (server.failure && isRecent);
    };
    const auto answerNow = [&] {
        const std::lock_guard lock(server.mutex);
        return server.isKnown ? std::nullopt : server.failure;
    };
    if (isAnswered()) return answerNow();
    const std::lock_guard asking(server.asking);
    if (isAnswered()) return answerNow();
    HttpLimits limits = limits_;
    limits.bodyBytes = kMostProjectsBytes;
    const auto answer = getFromServer({{url.host, url.port}, "/projects"}, limits, stopsHere);
    if (!answer && areRequestsStopped()) return answer.error();
    const std::lock_guard lock(server.mutex);
    server.when = std::chrono::steady_clock::now();
    const auto refuse = [&](Failure failure) {
        server.failure = std::move(failure);
        return server.isKnown ? std::nullopt : server.failure;
    };
    if (!answer) return refuse(answer.error());
    const Json json = Json::parse(answer->body, nullptr, false);
    const auto projects = json.is_object() ? json.find("projects") : json.end();
    if (answer->status != kOk || !json.is_object() || projects == json.end() ||
        !projects->is_array())
        return refuse({"this is not a usdlive server, or an older one"});
    server.isKnown = true;
    server.failure.reset();
    const auto several = json.find("several");
    server.hasSeveral = several != json.end() && several->is_boolean() && several->get<bool>();
    for (const Json& one : *projects) {
        if (!one.is_object()) continue;
        const std::string name = textIn(one, "name");
        ProjectPtr& project = server.projects[name];
        if (!project)
            project = std::make_shared<RemoteProject>(
                url.host, url.port, name, server.hasSeveral ? "/" + urlEncoded(name) : "", limits_,
                cache);
        server.only = projects->size() == 1 ? project : nullptr;
    }
    return std::nullopt;
}

}  // namespace usdlive::resolver
