#include "usdlive/client/usd/Client.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <future>
#include <map>
#include <set>
#include <thread>

#include "Clocks.h"
#include "usdlive/client/transport/Connection.h"
#include "usdlive/client/transport/SystemUser.h"
#include "usdlive/client/usd/ArrayEncodings.h"
#include "usdlive/client/usd/BlobCache.h"
#include "usdlive/client/usd/LayerClaims.h"
#include "usdlive/client/usd/LayerFolders.h"
#include "usdlive/client/usd/LiveSet.h"
#include "usdlive/client/usd/LoadedLayers.h"
#include "usdlive/client/usd/LostEvents.h"
#include "usdlive/client/usd/LostWorkLayer.h"
#include "usdlive/client/usd/LostWorkStore.h"
#include "usdlive/client/usd/Placeholders.h"
#include "usdlive/client/usd/ProcessFolder.h"
#include "usdlive/client/usd/UnsentWorkStore.h"
#include "usdlive/client/usd/UsedLayers.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive {

using client::BlobCache;
using client::Connection;
using client::LayerClaims;
using client::LayerFolders;
using client::LiveLayer;
using client::LoadSet;
using client::LostWork;
using client::Session;
namespace event = client::event;
namespace fs = std::filesystem;

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// A server that cannot be reached is tried again for so long, as it may be starting; the longer
// time-out is for one that is there and does not answer.
constexpr double kRefusedMs = 1000;
constexpr std::size_t kMessagesPerTick = 4096;
// Placeholders of layers that are made before the first tick that knows them ends, and a later one.
constexpr double kFirstPlaceholdersMs = 200, kPlaceholdersMs = 1;
// Loaded layers that one tick looks at.
constexpr std::size_t kLookedAtPerTick = 100;
// A join of a connected client that hears nothing for so long is given up.
constexpr double kSilenceMs = 60'000;
// Values that are kept and no longer named are let go when there are more than so many, and twice
// as many as were named the last time.
constexpr std::size_t kKeptAtLeast = 8;
constexpr std::size_t kMaxCacheMemory = std::size_t(256) << 20;
// What a blocking call gives one tick.
constexpr double kBlockingBudgetMs = 50;

double msSince(Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Sets a flag for as long as it lives, also when a callback of the editor throws.
class Raised {
public:
    explicit Raised(bool& flag) : flag_(flag) { flag_ = true; }
    ~Raised() { flag_ = false; }
    Raised(const Raised&) = delete;
    Raised& operator=(const Raised&) = delete;

private:
    bool& flag_;
};

// Of cache folders that nobody has named, in the system's temporary folder.
constexpr const char* kCachePrefix = "usdlive-cache-";

}  // namespace

class Client::Impl final : public client::SessionHost, public client::LayerView {
public:
    Impl(std::unique_ptr<Connection> connection, Options options, ClientId id, LayerFolders folders,
         client::ProcessFolder ownCacheFolder)
        : options_(std::move(options)),
          ownCacheFolder_(std::move(ownCacheFolder)),
          folders_(std::move(folders)),
          placeholders_(folders_.cacheFolder()),
          blobs_(folders_.cacheFolder() / ".usdlive-blobs", kMaxCacheMemory, options_.cacheBytes),
          connection_(std::move(connection)),
          lost_(folders_.cacheFolder() / ".usdlive-lost"),
          session_(sessionOptions(options_, std::move(id)), *this, *this) {
        session_.showPresence({});
        if (ownCacheFolder_)
            removing_ =
                std::async(std::launch::async, [parent = folders_.cacheFolder().parent_path()] {
                    client::ProcessFolder::removeDead(parent, kCachePrefix);
                });
    }

    ~Impl() override {
        const pxr::SdfChangeBlock block;
        seal();
        session_.endGesture();
        session_.advance(kBlockingBudgetMs, steadyMs());
        while (!live_.all().empty()) leave(live_.all().begin()->first);
    }

    // --- misuse ---

    [[nodiscard]] std::optional<Error> misuse(const std::string& function, bool blocks) const {
        const auto self = std::this_thread::get_id();
        std::thread::id none;
        if (!owner_.compare_exchange_strong(none, self) && none != self)
            return Error{ErrorCode::InvalidArgument,
                         function +
                             "() was called on another thread than the one that uses this "
                             "connection. Layers belong to one thread: call it there"};
        if (blocks && ticking_)
            return Error{ErrorCode::InvalidArgument,
                         function +
                             "() waits for the server and was called by a notice handler while "
                             "tick() applies edits. Call it after tick() has returned"};
        return std::nullopt;
    }
    void require(const std::string& function) const {
        if (const auto error = misuse(function, false)) throw Client::Misuse(*error);
    }
    // A notice handler that throws would end the process.
    bool mayBlock(const std::string& function) {
        require(function);
        const auto error = misuse(function, true);
        if (error) report(*error);
        return !error;
    }

    // What the callbacks do is the editor's own.
    [[nodiscard]] bool isApplying() const { return ticking_ && !dispatching_; }

    Result<void> greet() {
        const auto start = Clock::now();
        while (!session_.isConnected()) {
            if (fatal_) return tl::unexpected(*fatal_);
            if (msSince(start) > options_.connectTimeoutMs) return tl::unexpected(notThere());
            if (lastLoss_ && !lineOpen_ && msSince(start) > kRefusedMs)
                return tl::unexpected(*lastLoss_);
            connection_->wait(milliseconds(20));
            tick(kBlockingBudgetMs);
        }
        return {};
    }

    // --- unsent work ---

    void startJournal(Connector connector) {
        const auto& state = options_.stateFolder;
        unsent_ = std::make_unique<client::UnsentWorkStore>(
            state.empty() ? fs::path()
                          : client::journalFolder(state, session_.welcome()->project,
                                                  UserName{options_.user}),
            std::move(connector), sessionOptions(options_, session_.id()), blobs_);
        if (auto found = unsentWork(); !found.empty())
            events_.push_back(event::UnsentFound{std::move(found)});
    }

    [[nodiscard]] std::vector<client::UnsentWork> unsentWork() {
        std::vector<Error> damaged;
        auto found = unsent_->left(damaged);
        for (Error& error : damaged) report(std::move(error));
        return found;
    }

    Result<client::SentWork> sendUnsent(const ClientId& work, double timeoutMs) {
        std::vector<LostWork> lost;
        auto sent = unsent_->send(work, timeoutMs, lost);
        for (LostWork& one : lost) lose(std::move(one));
        return sent;
    }

    Result<pxr::SdfLayerRefPtr> unsentAsLayer(const ClientId& work, const LayerId& layer) {
        return unsent_->asLayer(work, layer, session_.confirmed(layer));
    }

    Result<void> discardUnsent(const ClientId& work) { return unsent_->discard(work); }

    std::optional<client::UnsentWork> leave(double timeoutMs) {
        if (!mayBlock("leave")) return std::nullopt;
        tick(0, Seal::Now);
        session_.endGesture();
        const bool sent = flush(timeoutMs);
        for (auto& lost : lostEvents_.waiting()) events_.push_back(std::move(lost));
        dispatch();
        if (sent) return std::nullopt;
        return unsent();
    }

    // What is pending, as it is kept now.
    [[nodiscard]] std::optional<client::UnsentWork> unsent() {
        if (auto kept = unsent_->keep()) return kept;
        if (session_.pendingTransactions() == 0) return std::nullopt;
        client::UnsentWork work;
        work.client = session_.id();
        work.transactions = session_.pendingTransactions();
        return work;
    }

    // --- layers ---

    Result<pxr::SdfLayerRefPtr> openLayer(const LayerId& id, LoadSet load) {
        if (const auto* live = find(id); live && live->isFilled() && usesLive(id, load))
            return live->layer();
        const auto made = placeholders_.make(id);
        if (!made && !isOfProject(id))
            return fail(ErrorCode::LayerNotFound, "the project has no layer " + id.value);
        if (!made) return tl::unexpected(made.error());
        failed_.erase(id);
        auto layer = pxr::SdfLayer::FindOrOpen(folders_.placeOf(id).string());
        if (!layer)
            return fail(ErrorCode::LayerUnreadable, "cannot open " + folders_.placeOf(id).string());
        if (!join(id, layer)) return tl::unexpected(liveElsewhere(id));
        auto opened = waitForJoins({id}, load);
        if (!opened && *made && !isOfProject(id)) placeholders_.remove(id);
        if (!opened) return tl::unexpected(opened.error());
        return layer;
    }

    Result<pxr::SdfLayerRefPtr> createLayer(const LayerId& id) {
        if (auto valid = parseLayerId(id.value); !valid) return tl::unexpected(valid.error());
        if (!session_.isConnected())
            return fail(
                ErrorCode::NotConnected,
                "cannot create " + id.value +
                    " without a connection: only the server knows which names are free. Try "
                    "again when it is there");
        const auto answer = answerTo(session_.createLayer(id), kSilenceMs);
        if (!answer)
            return fail(ErrorCode::NotConnected, "the server did not say in time whether " +
                                                     id.value + " was created; it may be there");
        if (!*answer) return tl::unexpected(answer->error());
        return openLayer(id, LoadSet::All);
    }

    Result<std::vector<LayerId>> attach(const fs::path& projectFolder) {
        std::error_code error;
        const auto folder = fs::canonical(projectFolder, error);
        if (error || !fs::is_directory(folder))
            return fail(ErrorCode::InvalidArgument, projectFolder.string() + " is not a folder");
        folders_.add(folder);
        std::vector<std::pair<LayerId, pxr::SdfLayerRefPtr>> found;
        for (const auto& loaded : pxr::SdfLayer::GetLoadedLayers()) {
            const auto file = live_.find(loaded) ? std::nullopt : layerOf(loaded);
            if (!file) continue;
            const auto& [id, layer] = std::pair(*file, pxr::SdfLayerRefPtr(loaded));
            if (LayerClaims::ofProcess().isLiveElsewhere(layer, this))
                return tl::unexpected(liveElsewhere(id));
            if (const auto work = workOf(layer); !work || !work->empty())
                return fail(ErrorCode::InvalidArgument,
                            id.value + " has unsaved edits; save or reload it first");
            found.emplace_back(id, layer);
        }
        std::sort(found.begin(), found.end(),
                  [](const auto& left, const auto& right) { return left.first < right.first; });
        std::vector<LayerId> ids;
        for (const auto& [id, layer] : found) {
            failed_.erase(id);
            if (!join(id, layer)) return tl::unexpected(liveElsewhere(id));
            ids.push_back(id);
        }
        if (auto joined = waitForJoins(ids, LoadSet::NoPayloads); !joined)
            return tl::unexpected(joined.error());
        return ids;
    }

    void close(const LayerId& id) {
        if (!find(id) || !mayBlock("close")) return;
        flush(options_.connectTimeoutMs);
        // The layer keeps its content: also one that has just been reloaded, and is to get it back.
        for (auto* live = find(id); live && live->isRefilling(); live = find(id)) {
            connection_->wait(milliseconds(1));
            tick(kBlockingBudgetMs);
        }
        if (!find(id)) return;
        leave(id);
        session_.closeLayer(id);
        closed_.insert(id);
    }

    // --- the frame ---

    enum class Seal { WhenEncoded, Now };
    TickResult tick(double budgetMs, Seal seal = Seal::WhenEncoded) {
        TickResult result;
        if (ticking_) return result;  // from within a notice of ours: the tick goes on after it
        work(budgetMs, result, seal);
        dispatch();
        return result;
    }

    [[nodiscard]] const std::string& user() const { return options_.user; }

    Result<void> setLocked(const LayerId& id, bool locked) {
        auto* live = find(id);
        if (!live || !live->isFilled())
            return fail(ErrorCode::LayerNotOpen, id.value + " is not open here");
        const auto& layer = live->layer();
        const auto& field = pxr::SdfFieldKeys->CustomLayerData;
        if (layer
                ->GetFieldDictValueByKey(pxr::SdfPath::AbsoluteRootPath(), field,
                                         pxr::TfToken("omni_layer:locked"))
                .IsHolding<pxr::VtDictionary>())
            return fail(ErrorCode::InvalidArgument,
                        id.value +
                            " is the root layer of a stage, in which Kit keeps what is "
                            "locked: it cannot be locked itself");
        LayerLock lock;
        if (locked) lock = {true, {options_.user}, wallClockMs()};
        authorOfRoot(*live, [&] { return lockEdits(*session_.view(id), lock); });
        return {};
    }

    Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted) {
        auto* live = find(root);
        if (!live || !live->isFilled())
            return fail(ErrorCode::LayerNotOpen, root.value + " is not open here");
        if (root == layer)
            return fail(ErrorCode::InvalidArgument, "a root layer is not muted on its own stages");
        authorOfRoot(*live,
                     [&] { return globalMuteEdits(root, *session_.view(root), layer, muted); });
        return {};
    }

    std::set<LayerId> globallyMuted(const LayerId& root) const {
        const LayerDoc* doc = session_.view(root);
        return doc ? usdlive::globallyMuted(root, *doc) : std::set<LayerId>();
    }

    /// Makes edits of the pseudo-root, after what was written before.
    template <class MakeEdits>
    void authorOfRoot(LiveLayer& live, MakeEdits makeEdits) {
        const pxr::SdfChangeBlock block;
        seal();
        std::vector<client::AuthoredEdit> edits;
        for (EditAction& action : makeEdits()) {
            live.apply("/", action);
            edits.push_back({live.id(), "/", std::move(action)});
        }
        session_.author(std::move(edits));
    }

    bool flush(double timeoutMs) {
        if (!mayBlock("flush")) return false;
        const auto start = Clock::now();
        for (;;) {
            tick(kBlockingBudgetMs);
            if (!hasWrites() && session_.pendingTransactions() == 0) return true;
            if (msSince(start) > timeoutMs) return false;
            connection_->wait(milliseconds(5));
        }
    }

    std::uint64_t save(std::vector<LayerId> layers, bool force) {
        // What was written before is saved, too.
        TickResult ticked;
        if (!ticking_) work(0, ticked, Seal::Now);
        saveWritten();
        return session_.save(std::move(layers), force);
    }

    Result<LayersSaved> saveAndWait(std::vector<LayerId> layers, bool force, double timeoutMs) {
        if (const auto error = misuse("saveAndWait", true)) return tl::unexpected(*error);
        const auto start = Clock::now();
        if (!flush(timeoutMs)) return tl::unexpected(notConfirmed(timeoutMs));
        const double left = std::max(timeoutMs - msSince(start), 0.0);
        const auto answer = answerTo(save(std::move(layers), force), left);
        if (!answer)
            return fail(ErrorCode::NotConnected,
                        "the server did not say in time that it has "
                        "saved; it may still do it");
        return answer->map(
            [](const client::Event& one) { return std::get<event::Saved>(one).outcome; });
    }

    /// Ticks until the server has answered the request; nothing: not in time. Event handlers run
    /// meanwhile, and may ask and wait themselves.
    std::optional<Result<client::Event>> answerTo(std::uint64_t request, double timeoutMs) {
        awaited_[request] = std::nullopt;
        const auto start = Clock::now();
        do {
            tick(kBlockingBudgetMs);
            if (!awaited_.at(request)) connection_->wait(milliseconds(5));
        } while (!awaited_.at(request) && msSince(start) < timeoutMs);
        return std::move(awaited_.extract(request).mapped());
    }
    [[nodiscard]] Error notConfirmed(double timeoutMs) const {
        return {ErrorCode::NotConnected,
                std::to_string(session_.pendingTransactions()) +
                    " transactions were not confirmed within " +
                    std::to_string(std::int64_t(timeoutMs)) + " ms" +
                    (session_.isConnected() ? "" : ": there is no connection to the server")};
    }

    // --- SessionHost ---

    void send(SharedBytes frames) override { connection_->send(std::move(frames)); }
    [[nodiscard]] std::size_t pendingTransactions() const {
        return session_.pendingTransactions() + (holdsBack_ ? 1 : 0);
    }

    bool takesMore() override { return connection_->queuedBytes() < client::kMaxQueuedBytes; }
    SharedBytes localBlob(const Hash& hash) override { return blobs_.blob(hash); }
    void pending(const client::PendingWork& work) override {
        if (unsent_) unsent_->pending(work);
    }
    void answered(std::uint64_t sequence) override {
        if (unsent_) unsent_->answered(sequence);
    }
    void discard(std::shared_ptr<void> garbage) override {
        worker_.post([garbage = std::move(garbage)]() mutable { garbage.reset(); });
    }
    bool holdsBlob(const Hash& hash) override { return blobs_.holds(hash); }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) override {
        if (lasting)
            blobs_.cacheBlob(hash, std::move(bytes));
        else
            blobs_.holdBlob(hash, std::move(bytes));
        arrivedBlobs_.push_back(hash);
    }
    bool needsBlob(const Hash& hash) override {
        return std::ranges::any_of(live_.all(),
                                   [&](const auto& one) { return one.second->waitsFor(hash); });
    }

    // --- LayerView ---

    void arriving(const LayerId& id, std::shared_ptr<const client::SnapshotPart> part) override {
        if (auto* live = find(id)) live->arriving(std::move(part));
    }
    void arrived(const LayerId& id, const LayerDoc& snapshot) override {
        if (auto* live = find(id)) live->arrived(snapshot);
    }
    void reset(const LayerId& id, const LayerDoc& doc) override {
        if (auto* live = find(id)) live->reset(doc);
    }
    void apply(const LayerId& id, const std::string& path, const EditAction& action) override {
        if (auto* live = find(id)) live->apply(path, action);
    }

    // --- what Client asks for directly ---

    [[nodiscard]] std::vector<LayerId> layers() const { return projectLayers_; }
    [[nodiscard]] std::uint64_t lostWorkCount() const { return lost_.size(); }
    [[nodiscard]] Result<LostWork> lostWork(std::uint64_t index) const { return lost_.at(index); }
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::uint64_t index,
                                                              const LayerId& id) {
        const auto work = lost_.at(index);
        if (!work) return tl::unexpected(work.error());
        const auto doc = client::lostWorkDoc(*work, id, session_.confirmed(id), blobs_);
        return usd::makeLayer(doc, blobs_, "usda");
    }
    [[nodiscard]] std::optional<LayerId> layerId(const pxr::SdfLayerHandle& layer) const {
        const auto* live = live_.find(layer);
        return live ? std::optional(live->id()) : std::nullopt;
    }
    [[nodiscard]] const fs::path& cacheFolder() const { return folders_.cacheFolder(); }
    [[nodiscard]] Session& session() { return session_; }
    [[nodiscard]] const Session& session() const { return session_; }
    void setEventHandler(EventHandler handler) { handler_ = std::move(handler); }

private:
    // Asks the session for a big value that a layer wants and that is not here.
    class Source final : public usd::BlobSource {
    public:
        explicit Source(Impl& impl) : impl_(impl) {}
        SharedBytes blob(const Hash& hash) override {
            auto bytes = impl_.blobs_.blob(hash);
            if (!bytes) impl_.missingBlobs_.insert(hash);
            return bytes;
        }

    private:
        Impl& impl_;
    };

    static Session::Options sessionOptions(const Options& options, ClientId id) {
        Session::Options session;
        session.client = std::move(id);
        session.user = UserName{options.user};
        session.application = options.application;
        return session;
    }

    [[nodiscard]] Error notThere() const {
        return lastLoss_.value_or(Error{ErrorCode::NotConnected, "the server did not answer"});
    }

    [[nodiscard]] LiveLayer* find(const LayerId& id) { return live_.find(id); }
    [[nodiscard]] bool isOfProject(const LayerId& id) const {
        return std::ranges::binary_search(projectLayers_, id);
    }

    // --- joining ---

    // False: the layer is live through another connection of this process.
    bool join(const LayerId& id, const pxr::SdfLayerRefPtr& layer) {
        if (find(id)) return true;
        if (!LayerClaims::ofProcess().claim(layer, this)) {
            failed_[id] = liveElsewhere(id);
            return false;
        }
        closed_.erase(id);
        keepEarlyWork(id, layer);
        live_.add(std::make_unique<LiveLayer>(
            id, layer,
            LiveLayer::Surroundings{source_, blobs_, encodings_, worker_,
                                    [this, id] { return session_.view(id); },
                                    [this](Error error) { report(std::move(error)); },
                                    [this, id] { live_.wake(id); }}));
        followLock(id);
        session_.openLayer(id);
        return true;
    }

    // While somebody else's lock stands, the layer says so itself: `permissionToEdit` is false.
    void followLock(const LayerId& id) {
        auto* live = find(id);
        if (!live || !session_.welcome()) return;
        const auto& states = session_.layerStates();
        const auto state = states.find(id);
        const bool locked = state != states.end() && state->second.locked;
        live->setLockedByOther(locked && state->second.holder.value != options_.user &&
                               !session_.welcome()->administrator.value_or(false));
    }

    static Error liveElsewhere(const LayerId& id) {
        return {ErrorCode::InvalidArgument,
                id.value +
                    " is already live through another connection of this process. Use that one, "
                    "or open a copy with another cache folder"};
    }

    // The layer stops being live; it keeps its content. A copy: the caller's id may be the one that
    // is removed here.
    void leave(LayerId id) {
        const LiveLayer* live = find(id);
        if (!live) return;
        const pxr::SdfLayerRefPtr layer = live->layer();
        const LayerDoc* view = live->isFilled() ? session_.view(id) : nullptr;
        auto left = view ? std::optional(*view) : std::nullopt;
        live_.remove(id);
        usesLive_.erase(id);
        LayerClaims::ofProcess().release(layer, this, std::move(left));
    }

    // What was written into a layer that is not live, and is not in its file.
    [[nodiscard]] Result<std::vector<std::pair<std::string, EditAction>>> workOf(
        const pxr::SdfLayerRefPtr& layer) {
        if (!layer->IsDirty()) return {};
        const auto written = usd::readLayer(layer, blobs_);
        if (!written) return tl::unexpected(written.error());
        return difference(LayerClaims::ofProcess().left(layer).value_or(LayerDoc()), *written);
    }

    // Written before the layer was live, and about to be replaced (M12).
    void keepEarlyWork(const LayerId& id, const pxr::SdfLayerRefPtr& layer) {
        auto written = workOf(layer);
        LostWork work;
        work.refused = true;
        work.reason = {
            ErrorCode::LayerNotOpen,
            id.value + " was edited before it was live; its content is the project's now"};
        if (!written) return keepUnreadable(id, layer, written.error());
        for (auto& [path, action] : *written) work.edits.push_back({id, path, std::move(action)});
        if (!work.edits.empty()) lose(std::move(work));
    }

    // Work that cannot be edits is kept as a file.
    void keepUnreadable(const LayerId& id, const pxr::SdfLayerRefPtr& layer, const Error& reason) {
        LostWork work;
        work.refused = true;
        const fs::path file = lost_.fileFor(id);
        const bool kept = layer->Export(file.string());
        work.reason = {reason.code,
                       id.value +
                           " was edited before it was live and cannot be read: " + reason.message +
                           (kept ? ". What it held is in " + file.string()
                                 : ". What it held could not be written to " + file.string())};
        lose(std::move(work));
    }

    // Until these and the layers they use, all the way down, are filled, with their big values.
    Result<void> waitForJoins(std::vector<LayerId> ids, LoadSet load) {
        const std::vector<LayerId> asked = ids;
        std::set<LayerId> seen(ids.begin(), ids.end());
        auto heard = Clock::now();
        auto connected = Clock::now();
        while (!ids.empty() || !awaitedBlobs_.empty()) {
            const TickResult ticked = tick(kBlockingBudgetMs);
            for (const auto& id : asked)
                if (const auto failure = failed_.find(id); failure != failed_.end())
                    return tl::unexpected(failure->second);
            std::vector<LayerId> waiting;
            for (const auto& id : ids) {
                auto* live = find(id);
                if (live && !live->isFilled()) waiting.push_back(id);
                if (!live || !live->isFilled()) continue;
                for (auto& used : joinUsed(*live, load))
                    if (seen.insert(used).second) waiting.push_back(std::move(used));
            }
            const bool advanced = waiting != ids;
            ids = std::move(waiting);
            if (session_.isConnected()) connected = Clock::now();
            if (advanced || ticked.more ||
                connection_->wait(milliseconds(ticked.filling ? 1 : 10)) || ticked.filling)
                heard = Clock::now();
            if (msSince(connected) > options_.connectTimeoutMs) return tl::unexpected(notThere());
            if (msSince(heard) > kSilenceMs)
                return fail(ErrorCode::NotConnected, "the server does not answer any more");
        }
        return {};
    }

    // The layers of the project that this one names, opened; those that are on their way here.
    std::vector<LayerId> joinUsed(LiveLayer& live, LoadSet load) {
        std::vector<LayerId> joining;
        usesLive_[live.id()] = load;
        for (const auto& [path, id] : usedBy(live, load)) {
            if (const auto made = placeholders_.make(id); !made) report(made.error());
            if (!find(id) && !failed_.contains(id) && !closed_.contains(id))
                if (auto used = pxr::SdfLayer::FindOrOpen(path); used && !join(id, used))
                    events_.push_back(event::JoinFailed{id, liveElsewhere(id)});
            if (find(id)) joining.push_back(id);
        }
        return joining;
    }

    // Those that are in the project, with their files.
    [[nodiscard]] std::vector<std::pair<std::string, LayerId>> usedBy(const LiveLayer& live,
                                                                      LoadSet load) const {
        std::vector<std::pair<std::string, LayerId>> used;
        if (!live.namesLayers()) return used;
        for (const auto& asset : client::usedAssets(live.layer(), load)) {
            auto path = pxr::SdfComputeAssetPathRelativeToLayer(live.layer(), asset);
            auto id = folders_.layerAt(fs::path(path).lexically_normal().string());
            if (id && isOfProject(*id)) used.emplace_back(std::move(path), std::move(*id));
        }
        return used;
    }

    // Have the layers that it uses been joined with it?
    [[nodiscard]] bool usesLive(const LayerId& id, LoadSet load) const {
        const auto found = usesLive_.find(id);
        return load == LoadSet::NoPayloads ||
               (found != usesLive_.end() && found->second == LoadSet::All);
    }

    // Layers that the editor's composition has opened meanwhile become live.
    void adoptLoaded(double budgetMs) {
        const auto start = Clock::now();
        bool just = false;
        for (LiveLayer* live : live_.active()) just = live->takeUsesChanged() || just;
        if (!session_.welcome()) return;
        loaded_.look(just, live_.known(), background_);
        for (std::size_t looked = 0; looked < kLookedAtPerTick; ++looked) {
            const auto layer = loaded_.next();
            if (!layer) return;
            const auto id = live_.find(layer) ? std::nullopt : layerOf(layer);
            if (!id || failed_.contains(*id) || closed_.contains(*id) ||
                LayerClaims::ofProcess().isLiveElsewhere(layer, this))
                continue;
            static_cast<void>(join(*id, layer));
            if (msSince(start) >= budgetMs) return;
        }
    }

    // The layer of the project whose file this is, unless that is live.
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) {
        // One with file format arguments is another view of its file, never the file itself.
        if (!layer || layer->IsAnonymous() || !layer->GetFileFormatArguments().empty())
            return std::nullopt;
        auto id = folders_.layerAt(layer->GetRealPath());
        return id && isOfProject(*id) && !find(*id) ? id : std::nullopt;
    }

    void setProjectLayers(std::vector<LayerId> layers) {
        std::ranges::sort(layers);
        std::vector<LayerId> added;
        std::ranges::set_difference(layers, projectLayers_, std::back_inserter(added));
        placeholders_.add(std::move(added),
                          projectLayers_.empty() ? kFirstPlaceholdersMs : kPlaceholdersMs,
                          background_);
        projectLayers_ = std::move(layers);
        // What failed may be there now.
        failed_.clear();
    }

    // Composition opens the layers that others name when the change block ends.
    void makeNamedPlaceholders() {
        if (placeholders_.isComplete()) return;
        for (const LiveLayer* live : live_.active()) {
            if (!live->usesChanged()) continue;
            for (const auto& [path, id] : usedBy(*live, LoadSet::All))
                if (const auto made = placeholders_.make(id); !made) report(made.error());
        }
    }

    // --- parts of a tick ---

    void work(double budgetMs, TickResult& result, Seal seal) {
        const Raised ticking(ticking_);
        const auto start = Clock::now();
        const auto left = [&] { return std::max(budgetMs - msSince(start), 0.1); };
        adoptLoaded(left());
        std::vector<client::Event> heard;
        {
            const pxr::SdfChangeBlock block;
            holdsBack_ = seal != Seal::Now && !bigArraysAreReady();
            if (!holdsBack_) {
                this->seal();
                hearConnection();
                result.more = !session_.advance(left(), steadyMs());
                if (session_.pendingTransactions() == 0) saveWritten();
                bringBlobs();
            } else {
                result.more = true;  // until then nobody else's edits may come into the layers
            }
            result.filling = fillLayers(left());
            heard = session_.takeEvents();
            // A new layer and the edit that names it may come in one tick: composition opens it
            // when the block ends.
            for (const client::Event& one : heard)
                if (const auto* changed = std::get_if<event::LayersChanged>(&one))
                    setProjectLayers(changed->layers);
            makeNamedPlaceholders();
        }
        takeEvents(std::move(heard), result);
        for (auto& lost : lostEvents_.due(steadyMs())) events_.push_back(std::move(lost));
        if (unsent_)
            if (auto error = unsent_->takeError()) report(std::move(*error));
        if (auto error = placeholders_.takeError()) report(std::move(*error));
        releaseBlobs();
    }

    // B7: values that pending work no longer names, as those on the way of a drag. Lost work is to
    // be had with its values (M12).
    void releaseBlobs() {
        const bool idle = session_.pendingTransactions() == 0 && !session_.inGesture();
        const std::size_t kept = blobs_.kept();
        if (kept <= (idle ? lostBlobs_.size() : std::max(kKeptAtLeast, 2 * stillKept_))) return;
        auto named = session_.namedBlobs();
        named.insert(lostBlobs_.begin(), lostBlobs_.end());
        if (unsent_) named.merge(unsent_->neededBlobs());
        blobs_.keepOnly(named, committedBlobs_);
        committedBlobs_.clear();
        stillKept_ = blobs_.kept();
    }

    static void addBlobs(const EditAction& action, std::set<Hash>& hashes) {
        forEachBlob(action, [&](const Value& blob) { hashes.insert(blob.hash()); });
    }

    // Layers that the editor has written itself. Their files would count as changed behind the
    // server, and lack what others have edited: the server writes them again.
    void saveWritten() {
        if (!session_.isConnected()) return;
        std::vector<LayerId> written;
        for (LiveLayer* live : live_.active())
            if (live->takeSaved()) written.push_back(live->id());
        if (!written.empty()) session_.save(std::move(written), true);
    }

    [[nodiscard]] bool hasWrites() {
        return std::ranges::any_of(live_.active(), &LiveLayer::hasWrites);
    }

    // Arrays that take a part of a frame to encode are encoded beside it.
    [[nodiscard]] bool bigArraysAreReady() {
        std::vector<pxr::VtValue> arrays;
        for (const LiveLayer* live : live_.active()) live->appendBigArrays(arrays);
        return encodings_.areReady(std::move(arrays), steadyMs());
    }

    // All that was written in one frame is one transaction, over all layers.
    void seal() {
        std::vector<client::AuthoredEdit> edits;
        for (LiveLayer* live : live_.active()) {
            auto sealed = live->seal();
            std::move(sealed.edits.begin(), sealed.edits.end(), std::back_inserter(edits));
            for (auto& write : sealed.lost) {
                LostWork work;
                work.reason = std::move(write.reason);
                work.edits = std::move(write.edits);
                lose(std::move(work));
            }
        }
        encodings_.clear();
        if (!edits.empty()) session_.author(std::move(edits));
    }

    void hearConnection() {
        for (auto& happening : connection_->poll(kMessagesPerTick))
            std::visit([this](auto& one) { hear(one); }, happening);
    }
    void hear(Connection::Opened&) {
        lineOpen_ = true;
        session_.connected();
    }
    void hear(Connection::Message& message) {
        if (lineOpen_)
            session_.received(std::get<client::ReceivedMessage>(std::move(message.content)));
    }
    void hear(Connection::Lost& lost) {
        lastLoss_ = lost.reason;
        if (std::exchange(lineOpen_, false)) session_.disconnected(std::move(lost.reason));
    }

    void hangUp(Error reason) {
        if (!std::exchange(lineOpen_, false)) return;
        connection_->reset();
        lastLoss_ = reason;
        session_.disconnected(std::move(reason));
    }

    void bringBlobs() {
        for (const auto& hash : std::exchange(arrivedBlobs_, {})) {
            awaitedBlobs_.erase(hash);
            for (const auto& [id, live] : live_.all()) live->blobArrived(hash);
        }
        requestMissing();
    }
    void requestMissing() {
        for (const auto& hash : std::exchange(missingBlobs_, {}))
            if (awaitedBlobs_.insert(hash).second) session_.requestBlob(hash);
    }

    // How many are not made yet, or have to wait for the next tick.
    std::size_t fillLayers(double budgetMs) {
        const auto start = Clock::now();
        std::size_t filling = 0;
        for (LiveLayer* live : live_.active()) {
            if (live->isFilling() && msSince(start) < budgetMs) live->fill();
            filling += live->isFilling() ? 1 : 0;
        }
        requestMissing();
        return filling;
    }

    // --- events ---

    void report(Error error) {
        ErrorMessage message;
        message.code = errorName(error.code);
        message.message = std::move(error.message);
        events_.push_back(event::ServerError{std::move(message)});
    }

    void lose(LostWork work) {
        for (const auto& edit : work.edits) addBlobs(edit.action, lostBlobs_);
        if (const auto kept = lost_.add(work); !kept) report(kept.error());
        if (auto told = lostEvents_.add({std::move(work), lost_.size() - 1}, steadyMs()))
            events_.push_back(std::move(*told));
    }

    void takeEvents(std::vector<client::Event> heard, TickResult& result) {
        for (auto& one : heard) {
            if (std::holds_alternative<event::Committed>(one)) ++result.applied;
            if (note(one)) events_.push_back(std::move(one));
        }
        // A layer is joined when the editor has all of it.
        for (auto joined = joined_.begin(); joined != joined_.end();) {
            const auto* live = find(joined->layer);
            if (live && !live->isFilled()) {
                ++joined;
                continue;
            }
            if (live) events_.push_back(std::move(*joined));
            joined = joined_.erase(joined);
        }
    }

    // False: not for the editor, or not yet.
    bool note(client::Event& one) {
        if (const auto* connected = std::get_if<event::Connected>(&one)) {
            refusal_.reset();
            std::vector<LayerId> layers;
            for (const LayerInfo& info : connected->welcome.layers) layers.push_back(info.layer);
            setProjectLayers(std::move(layers));
            for (const auto& entry : live_.all()) followLock(entry.first);
        } else if (const auto* states = std::get_if<event::LayerStatesChanged>(&one)) {
            for (const LayerState& state : states->layers) followLock(state.layer);
        } else if (const auto* changed = std::get_if<event::LayersChanged>(&one)) {
            setProjectLayers(changed->layers);
        } else if (const auto* committed = std::get_if<event::Committed>(&one)) {
            if (committed->commit.id.client == session_.id())
                for (const Edit& edit : committed->commit.edits)
                    addBlobs(edit.action, committedBlobs_);
        } else if (auto* joined = std::get_if<event::Joined>(&one)) {
            joined_.push_back(std::move(*joined));
            return false;
        } else if (const auto* failed = std::get_if<event::JoinFailed>(&one)) {
            failed_[failed->layer] = failed->reason;
            leave(failed->layer);
        } else if (auto* lost = std::get_if<event::Lost>(&one)) {
            lose(std::move(lost->work));
            return false;
        } else if (const auto* saved = std::get_if<event::Saved>(&one)) {
            noteAnswer(saved->outcome.request, one);
        } else if (const auto* made = std::get_if<event::LayerMade>(&one)) {
            noteAnswer(made->answer.request, one);
        } else if (const auto* error = std::get_if<event::ServerError>(&one)) {
            if (error->message.request)
                noteAnswer(*error->message.request, tl::unexpected(toError(error->message)));
            if (error->message.blob) awaitedBlobs_.erase(*error->message.blob);
            if (error->message.closing) {
                const bool again = refusal_ && refusal_->message == error->message.message;
                refusal_ = error->message;
                lastWords(error->message);
                if (again) return false;  // every attempt to connect ends so: it was told
            }
        }
        return true;
    }

    void noteAnswer(std::uint64_t request, Result<client::Event> answer) {
        if (const auto found = awaited_.find(request); found != awaited_.end())
            found->second = std::move(answer);
    }

    static Error toError(const ErrorMessage& message) {
        return {errorFromName(message.code).value_or(ErrorCode::Internal), message.message};
    }

    // Of the server, or of the session that saw nonsense: either way this connection is over.
    void lastWords(const ErrorMessage& message) {
        Error error = toError(message);
        if (!session_.welcome()) fatal_ = error;
        hangUp(std::move(error));
    }

    // The handler may call anything of the client, also what ticks.
    void dispatch() {
        if (dispatching_) return;
        const Raised dispatching(dispatching_);
        while (!events_.empty()) {
            const client::Event one = std::move(events_.front());
            events_.pop_front();
            if (const auto handler = handler_) handler(one);
        }
    }

    const Options options_;
    const client::ProcessFolder ownCacheFolder_;  // when the editor has not named one
    std::future<void> removing_;                  // those of editors that were killed
    LayerFolders folders_;
    client::Placeholders placeholders_;
    BlobCache blobs_;
    client::Worker worker_;   // makes what the layers hold
    client::Worker encoder_;  // encodes what the editor has written
    client::ArrayEncodings encodings_{blobs_, encoder_};
    Source source_{*this};
    const std::unique_ptr<Connection> connection_;
    client::LostWorkStore lost_;
    client::LostEvents lostEvents_;
    std::unique_ptr<client::UnsentWorkStore> unsent_;  // once the project is known
    Session session_;
    client::LiveSet live_;
    client::LoadedLayers loaded_;
    std::map<LayerId, LoadSet> usesLive_;  // of joined layers, which of those they use were joined

    std::vector<LayerId> projectLayers_;  // sorted
    std::map<LayerId, Error> failed_;     // not tried again by itself until the next welcome
    std::set<LayerId> closed_;            // closed by the editor: not adopted again by itself
    client::Worker background_;           // looks for loaded layers and makes placeholders

    std::set<Hash> missingBlobs_;  // noticed within a tick, to be asked for at its end
    std::set<Hash> awaitedBlobs_;  // asked for
    std::vector<Hash> arrivedBlobs_;

    std::set<Hash> lostBlobs_;       // that lost work names
    std::set<Hash> committedBlobs_;  // of one's own, since some were let go
    std::size_t stillKept_ = 0;      // then

    bool lineOpen_ = false;  // as far as heard
    std::optional<Error> lastLoss_;
    std::optional<ErrorMessage> refusal_;  // why the server, or the session, ended the last line
    std::optional<Error> fatal_;           // the server does not want this client at all

    std::vector<event::Joined> joined_;
    std::deque<client::Event> events_;
    EventHandler handler_;
    /// Of requests that somebody waits for; several, when a handler asks while its caller waits.
    std::map<std::uint64_t, std::optional<Result<client::Event>>> awaited_;
    bool ticking_ = false;
    bool holdsBack_ = false;  // what was written waits for its arrays
    bool dispatching_ = false;
    mutable std::atomic<std::thread::id> owner_{};  // the first that used it
};

Client::Client() = default;
Client::~Client() = default;

Result<std::unique_ptr<Client>> Client::connect(const std::string& url, Options options) {
    const auto address = client::parseServerAddress(url);
    if (!address) return tl::unexpected(address.error());
    return connectBy([address = *address] { return client::createConnection(address); },
                     std::move(options));
}

Result<std::unique_ptr<Client>> Client::connectBy(std::unique_ptr<Connection> connection,
                                                  Options options) {
    return make(std::move(connection), {}, std::move(options));
}

Result<std::unique_ptr<Client>> Client::connectBy(Connector connector, Options options) {
    auto connection = connector();
    if (!connection) return tl::unexpected(connection.error());
    if (options.stateFolder.empty() && !options.cacheFolder.empty())
        options.stateFolder = options.cacheFolder / ".usdlive-unsent";
    if (options.stateFolder.empty()) options.stateFolder = client::stateFolder();
    return make(std::move(*connection), std::move(connector), std::move(options));
}

Result<std::unique_ptr<Client>> Client::make(std::unique_ptr<Connection> connection,
                                             Connector connector, Options options) {
    if (options.user.empty()) options.user = client::systemUser().value;
    auto id = client::newClientId();
    client::ProcessFolder own;
    if (options.cacheFolder.empty()) {
        const fs::path temporary = fs::temp_directory_path();
        own = client::ProcessFolder::make(temporary, kCachePrefix);
        if (!own)
            return fail(ErrorCode::InvalidArgument, "cannot make a folder in " +
                                                        temporary.string() +
                                                        ". Name a cache folder, or set TMPDIR");
        options.cacheFolder = own.path();
    }
    auto folders = LayerFolders::create(options.cacheFolder);
    if (!folders) return tl::unexpected(folders.error());

    std::unique_ptr<Client> made(new Client);
    made->impl_ = std::make_unique<Impl>(std::move(connection), std::move(options), std::move(id),
                                         std::move(*folders), std::move(own));
    if (auto greeted = made->impl_->greet(); !greeted) return tl::unexpected(greeted.error());
    made->impl_->startJournal(std::move(connector));
    return made;
}

std::vector<LayerId> Client::layers() const { return impl_->layers(); }
Result<pxr::SdfLayerRefPtr> Client::openLayer(const LayerId& layer, client::LoadSet load) {
    if (const auto error = impl_->misuse("openLayer", true)) return tl::unexpected(*error);
    return impl_->openLayer(layer, load);
}
Result<pxr::SdfLayerRefPtr> Client::createLayer(const LayerId& layer) {
    if (const auto error = impl_->misuse("createLayer", true)) return tl::unexpected(*error);
    return impl_->createLayer(layer);
}
Result<std::vector<LayerId>> Client::attach(const fs::path& projectFolder) {
    if (const auto error = impl_->misuse("attach", true)) return tl::unexpected(*error);
    return impl_->attach(projectFolder);
}
void Client::close(const LayerId& layer) { impl_->close(layer); }
Client::TickResult Client::tick(double budgetMs) {
    impl_->require("tick");
    return impl_->tick(budgetMs);
}
void Client::beginGesture() {
    impl_->require("beginGesture");
    // What was written before is not part of it.
    impl_->tick(0, Impl::Seal::Now);
    impl_->session().beginGesture();
}
void Client::endGesture() {
    impl_->require("endGesture");
    impl_->tick(0, Impl::Seal::Now);
    impl_->session().endGesture();
}
std::uint64_t Client::save(std::vector<LayerId> layers, bool force) {
    impl_->require("save");
    return impl_->save(std::move(layers), force);
}
Result<LayersSaved> Client::saveAndWait(std::vector<LayerId> layers, bool force, double timeoutMs) {
    return impl_->saveAndWait(std::move(layers), force, timeoutMs);
}
std::uint64_t Client::reload(std::vector<LayerId> layers) {
    return impl_->session().reload(std::move(layers));
}
std::uint64_t Client::createCheckpoint(std::string name) {
    return impl_->session().createCheckpoint(std::move(name));
}
std::uint64_t Client::listCheckpoints() { return impl_->session().listCheckpoints(); }
Result<void> Client::setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted) {
    if (const auto error = impl_->misuse("setGloballyMuted", true)) return tl::unexpected(*error);
    return impl_->setGloballyMuted(root, layer, muted);
}
std::set<LayerId> Client::globallyMuted(const LayerId& root) const {
    return impl_->globallyMuted(root);
}
Result<void> Client::setLocked(const LayerId& layer, bool locked) {
    if (const auto error = impl_->misuse("setLocked", true)) return tl::unexpected(*error);
    return impl_->setLocked(layer, locked);
}
const std::map<LayerId, LayerState>& Client::layerStates() const {
    return impl_->session().layerStates();
}
void Client::showPresence(Presence presence) { impl_->session().showPresence(std::move(presence)); }
void Client::hidePresence() { impl_->session().hidePresence(); }
const std::map<ClientId, Presence>& Client::presences() const {
    return impl_->session().presences();
}
bool Client::flush(double timeoutMs) { return impl_->flush(timeoutMs); }
void Client::setEventHandler(EventHandler handler) { impl_->setEventHandler(std::move(handler)); }
std::uint64_t Client::lostWorkCount() const { return impl_->lostWorkCount(); }
Result<LostWork> Client::lostWork(std::uint64_t index) const { return impl_->lostWork(index); }
Result<pxr::SdfLayerRefPtr> Client::lostWorkAsLayer(std::uint64_t index,
                                                    const LayerId& layer) const {
    if (const auto error = impl_->misuse("lostWorkAsLayer", false)) return tl::unexpected(*error);
    return impl_->lostWorkAsLayer(index, layer);
}
bool Client::isApplying() const { return impl_->isApplying(); }
std::optional<client::UnsentWork> Client::leave(double timeoutMs) {
    return impl_->leave(timeoutMs);
}
std::vector<client::UnsentWork> Client::unsentWork() { return impl_->unsentWork(); }
Result<client::SentWork> Client::sendUnsent(const ClientId& id, double timeoutMs) {
    if (const auto error = impl_->misuse("sendUnsent", true)) return tl::unexpected(*error);
    return impl_->sendUnsent(id, timeoutMs);
}
Result<pxr::SdfLayerRefPtr> Client::unsentAsLayer(const ClientId& id, const LayerId& layer) {
    if (const auto error = impl_->misuse("unsentAsLayer", false)) return tl::unexpected(*error);
    return impl_->unsentAsLayer(id, layer);
}
Result<void> Client::discardUnsent(const ClientId& id) { return impl_->discardUnsent(id); }
std::optional<Error> Client::misuse(const std::string& function, bool blocks) const {
    return impl_->misuse(function, blocks);
}
bool Client::isConnected() const { return impl_->session().isConnected(); }
Revision Client::revision() const { return impl_->session().revision(); }
std::size_t Client::pendingTransactions() const { return impl_->pendingTransactions(); }
ClientId Client::id() const { return impl_->session().id(); }
const std::string& Client::user() const { return impl_->user(); }
fs::path Client::cacheFolder() const { return impl_->cacheFolder(); }
std::optional<LayerId> Client::layerId(const pxr::SdfLayerHandle& layer) const {
    return impl_->layerId(layer);
}
Session& Client::session() { return impl_->session(); }

}  // namespace usdlive
