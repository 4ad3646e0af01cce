// Answers requests for a project's files and for its layers as of one revision.
#include "app/ServedAssets.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <chrono>
#include <nlohmann/json.hpp>

#include "app/CompressedContents.h"
#include "app/ProjectStrand.h"  // resultOf
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using FileJson = nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr unsigned kForbiddenFile = 403, kFileNotFound = 404, kConflict = 409, kGone = 410,
                   kServerError = 500, kBusy = 503;
// The time that an answer waits for the hashes of new files. The list is sent without those that
// are missing then, and they are computed in the background.
constexpr milliseconds kHashTime{3'000};
constexpr std::uint64_t kHashedAtOnce = 64 * 1024 * 1024;  // larger files take too long
constexpr milliseconds kHashSlice{2'000};
constexpr unsigned kErrors = 400;  // and above
// The layers that are kept as they were sent, because several clients open the same ones.
constexpr const char* kBinary = "application/octet-stream";

HttpReply problem(unsigned status, const std::string& message) {
    return {"text/plain", message + "\n", status};
}

HttpReply problem(const Error& error) {
    const auto status = [&] {
        switch (error.code) {
            case ErrorCode::HistoryReplaced:
                return kGone;
            case ErrorCode::FutureRevision:
            case ErrorCode::InvalidArgument:
            case ErrorCode::LayerNotFound:
                return kFileNotFound;
            case ErrorCode::StorageFailed:
                return kBusy;
            default:
                return kServerError;
        }
    };
    return problem(status(), error.message);
}

HttpReply problem(const AssetRefusal& refusal) {
    const auto status = [&] {
        switch (refusal.reason) {
            case AssetRefusal::Reason::NotFound:
                return kFileNotFound;
            case AssetRefusal::Reason::Outside:
                return kForbiddenFile;
            case AssetRefusal::Reason::Changed:
                return kBusy;
            case AssetRefusal::Reason::Unreadable:
                return kServerError;
        }
        return kServerError;
    };
    return problem(status(), refusal.message);
}

class AssetContent final : public HttpContent {
public:
    explicit AssetContent(std::shared_ptr<const OpenedAsset> file) : file_(std::move(file)) {}
    std::uint64_t size() const override { return file_->trace().size; }
    Result<void> read(std::uint64_t offset, std::span<std::uint8_t> part) override {
        const auto read = file_->read(offset, part);
        if (!read) return fail(ErrorCode::LayerUnreadable, read.error().message);
        return {};
    }

private:
    const std::shared_ptr<const OpenedAsset> file_;
};

std::string nameOf(const LayerVersion& version) {
    return std::to_string(version.revision) + "-" + version.hash.hex();
}

std::size_t missingHashes(const std::vector<AssetFile>& files) {
    return std::size_t(
        std::ranges::count_if(files, [](const AssetFile& file) { return !file.hash; }));
}

constexpr std::int64_t kNsInMs = 1'000'000;

FileJson describe(const std::string& path, const AssetFile& file) {
    FileJson json{
        {"path", path}, {"size", file.trace.size}, {"modifiedMs", file.trace.modifiedNs / kNsInMs}};
    if (file.hash) json["hash"] = file.hash->hex();
    return json;
}

}  // namespace

ServedAssets::ServedAssets(std::string project, AssetFiles& assets, LayerFiles& layers,
                           SharedStore& store, WorkerShares& workers, const PublicText& texts,
                           Log& log)
    : project_(std::move(project)),
      layers_(layers),
      store_(store),
      workers_(workers),
      texts_(texts),
      log_(log),
      assets_(assets),
      compressed_(std::make_shared<CompressedContents>()) {}

void ServedAssets::answer(const FileRequest& request, const HttpAnswer& answer) {
    workers_.history->post([this, request, answer] {
        try {
            HttpReply made = reply(request);
            if (made.status >= kErrors) made.body = texts_(std::move(made.body));
            answer(std::move(made));
        } catch (const std::exception& fault) {
            log_.write(LogLevel::Error, "request for a file failed",
                       {{"file", request.path}, {"error", fault.what()}});
            answer(problem(kServerError, "internal error of the server"));
        }
    });
}

HttpReply ServedAssets::reply(const FileRequest& request) {
    return request.path.empty() ? list(request) : file(request);
}

/// Returns the revision that the request names, or the newest one that is durable.
Result<ServedAssets::Moment> ServedAssets::moment(const FileRequest& request) {
    return store_.use([&](CommitStore& store) -> Result<Moment> {
        Moment found{0, store.head(), store.base()};
        found.revision = request.revision.value_or(found.head.revision);
        if (request.checkpoint) {
            const auto checkpoints = store.checkpoints();
            if (!checkpoints) return tl::unexpected(checkpoints.error());
            const auto named =
                std::ranges::find(*checkpoints, *request.checkpoint, &Checkpoint::name);
            if (named == checkpoints->end())
                return fail(ErrorCode::InvalidArgument,
                            "the project has no checkpoint " + inQuotes(*request.checkpoint));
            found.revision = named->revision;
        }
        if (found.revision > found.head.revision)
            return fail(ErrorCode::FutureRevision,
                        "the newest revision is " + std::to_string(found.head.revision));
        if (found.revision < found.base.revision)
            return fail(ErrorCode::HistoryReplaced, "the oldest revision that can be read is " +
                                                        std::to_string(found.base.revision));
        return found;
    });
}

HttpReply ServedAssets::list(const FileRequest& request) {
    std::optional<Moment> at;
    if (request.layers) {
        auto found = moment(request);
        if (!found) return problem(found.error());
        at = *found;
    }
    const auto files = assets_.list(steady_clock::now() + kHashTime, kHashedAtOnce);
    if (!files) return problem(files.error());
    if (!at)
        if (auto sent = sentBefore(*files)) return *sent;
    Listing listing;
    for (const AssetFile& file : **files)
        if (at || !parseLayerId(file.path)) listing.emplace(file.path, Listed{&file});
    if (at)
        if (const auto added = addVersions(listing, *at); !added) return problem(added.error());
    if (const std::size_t missing = missingHashes(**files)) hashTheRest(missing);
    return replyFor(listing, at, *files);
}

Result<void> ServedAssets::addVersions(Listing& listing, const Moment& at) {
    return store_.use([&](CommitStore& store) -> Result<void> {
        const auto stored = store.layers();
        if (!stored) return tl::unexpected(stored.error());
        for (const LayerId& layer : *stored) {
            const auto version = store.versionAt(layer, at.revision);
            if (!version) return tl::unexpected(version.error());
            if (*version) listing[layer.value] = {nullptr, nameOf(**version)};
        }
        return {};
    });
}

/// Returns the list without layers if it was made of these files.
std::optional<HttpReply> ServedAssets::sentBefore(const AssetList& files) {
    const std::lock_guard lock(mutex_);
    if (files != listWithoutLayers_.files) return std::nullopt;
    return replyWith(listWithoutLayers_);
}

HttpReply ServedAssets::replyWith(const SentList& list) {
    HttpReply reply{"application/json", {}};
    reply.etag = list.etag;
    setContent(reply, std::make_shared<BytesContent>(list.body), list.etag);
    return reply;
}

/// Most requests are made by clients that have the list already, and the text takes most of the
/// time. It is made once for all clients.
HttpReply ServedAssets::replyFor(const Listing& listing, const std::optional<Moment>& at,
                                 const AssetList& files) {
    SentList list{etagOf(listing, at), nullptr, files};
    SentList& last = at ? listOfAll_ : listWithoutLayers_;
    {
        const std::lock_guard lock(mutex_);
        if (last.etag == list.etag) {
            last.files = files;
            return replyWith(last);
        }
    }
    const std::string text = bodyOf(listing, at);
    list.body = std::make_shared<const Bytes>(text.begin(), text.end());
    const std::lock_guard lock(mutex_);
    last = list;
    return replyWith(list);
}

std::string ServedAssets::etagOf(const Listing& listing, const std::optional<Moment>& at) const {
    Sha256 sha;
    const auto add = [&sha](const std::string& text) { sha.add(asBytes(text)); };
    const auto number = [&](auto value) { add(std::to_string(value) + " "); };
    add(project_ + "\n");
    if (at) {
        for (const std::uint64_t value :
             {std::uint64_t(at->head.epoch), at->revision, at->head.revision, at->base.revision})
            number(value);
        add("\n");
    }
    for (const auto& [path, one] : listing) {
        add(path + "\n" + one.version + "\n");
        if (!one.file) continue;
        number(one.file->trace.size);
        number(one.file->trace.modifiedNs / kNsInMs);
        if (one.file->hash) sha.add(one.file->hash->bytes);
    }
    return sha.finish().hex();
}

std::string ServedAssets::bodyOf(const Listing& listing, const std::optional<Moment>& at) const {
    FileJson entries = FileJson::array();
    for (const auto& [path, one] : listing)
        entries.push_back(one.file ? describe(path, *one.file)
                                   : FileJson{{"path", path}, {"version", one.version}});
    FileJson json{{"project", project_}, {"files", std::move(entries)}};
    if (at) {
        json["epoch"] = at->head.epoch;
        json["revision"] = at->revision;
        json["newest"] = at->head.revision;
        json["base"] = at->base.revision;
    }
    return json.dump(-1, ' ', false, FileJson::error_handler_t::replace) + "\n";
}

HttpReply ServedAssets::file(const FileRequest& request) {
    const auto id = parseLayerId(request.path);
    if (id && !request.hash) {
        const auto at = moment(request);
        if (!at) return problem(at.error());
        const auto version =
            store_.use([&](CommitStore& store) { return store.versionAt(*id, at->revision); });
        if (!version) return problem(version.error());
        if (*version) return layer(*id, **version);
    }
    const auto opened = assets_.open(request.path);
    if (!opened) return problem(opened.error());
    const std::string hash = (*opened)->hash().hex();
    if (request.hash && *request.hash != (*opened)->hash())
        return problem(kConflict,
                       inQuotes(request.path) + " has another content now: its SHA-256 is " + hash);
    HttpReply reply{kBinary, {}};
    reply.etag = hash;
    reply.headers = {{"Usdlive-Sha256", hash}};
    setContent(reply, std::make_shared<AssetContent>(*opened), hash);
    return reply;
}

HttpReply ServedAssets::layer(const LayerId& layer, const LayerVersion& version) {
    const auto found = rendered(layer, version);
    if (!found) return problem(found.error());
    HttpReply reply{kBinary, {}};
    reply.etag = nameOf(version);
    reply.headers = {{"Usdlive-Sha256", found->hash},
                     {"Usdlive-Revision", std::to_string(version.revision)}};
    // The ETag is the version, which layers of one commit have in common.
    setContent(reply, std::make_shared<BytesContent>(found->bytes), found->hash);
    return reply;
}

/// `name` identifies the content.
void ServedAssets::setContent(HttpReply& reply, std::shared_ptr<HttpContent> content,
                              const std::string& name) {
    reply.background = downloads();
    reply.compressed = [all = compressed_, name, content] { return all->of(name, *content); };
    reply.content = std::move(content);
}

Result<ServedAssets::Rendered> ServedAssets::rendered(const LayerId& layer,
                                                      const LayerVersion& version) {
    const std::pair key(layer, nameOf(version));
    {
        const std::lock_guard lock(mutex_);
        if (const Rendered* found = rendered_.find(key)) return *found;
    }
    const auto doc =
        store_.use([&](CommitStore& store) { return store.layerAt(layer, version.revision); });
    if (!doc) return tl::unexpected(doc.error());
    if (!*doc) return fail(ErrorCode::LayerNotFound, "the project has no layer " + layer.value);
    auto bytes = layers_.render(layer, **doc);
    if (!bytes) return tl::unexpected(bytes.error());
    const std::string hash = sha256(*bytes).hex();
    const Rendered made{std::make_shared<const Bytes>(std::move(*bytes)), hash};
    const std::lock_guard lock(mutex_);
    // Another request may have made it meanwhile.
    if (!rendered_.find(key)) rendered_.add(key, made, made.bytes->size());
    return made;
}

/// Computes the hashes that a list did not wait for, in slices, so that other jobs get their turn.
/// Ends when the files that are left cannot be read.
void ServedAssets::hashTheRest(std::size_t missing) {
    {
        const std::lock_guard lock(mutex_);
        if (std::exchange(isHashing_, true)) return;
    }
    workers_.history->post([this, missing] {
        const auto read = [this] { return assets_.list(steady_clock::now() + kHashSlice); };
        const auto files = resultOf(read);
        {
            const std::lock_guard lock(mutex_);
            isHashing_ = false;
        }
        const std::size_t left = files ? missingHashes(**files) : 0;
        if (left != 0 && left < missing) hashTheRest(left);
    });
}

std::function<void(std::function<void()>)> ServedAssets::downloads() const {
    return [share = std::weak_ptr(workers_.downloads)](std::function<void()> job) {
        if (const auto workers = share.lock()) workers->post(std::move(job));
    };
}

}  // namespace usdlive::server
