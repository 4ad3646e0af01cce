// Implements the tick of a Client, which drives its parts.
#include "usd/editor/ClientImpl.h"

#include <pxr/usd/sdf/changeBlock.h>

#include <algorithm>
#include <utility>
#include <variant>

#include "basics/Clocks.h"
#include "basics/Raised.h"
#include "usd/assets/DynamicPayloads.h"
#include "usd/content/OthersWrites.h"
#include "usd/live/LostWorkLayer.h"
#include "usdlive/common/core/ClientSecret.h"

namespace usdlive {

using client::LiveLayer;
using client::Raised;
namespace event = client::event;
namespace fs = std::filesystem;

namespace {

// The names of cache folders in the system's temporary folder.
constexpr const char* kCachePrefix = "usdlive-cache-";
// The budget of the last tick of a client.
constexpr double kLastBudgetMs = 50;

// Returns the new layers of the project if the event tells them.
const std::vector<LayerId>* newLayers(const client::Event& event) {
    if (const auto* changed = std::get_if<event::LayersChanged>(&event)) return &changed->added;
    const auto* connected = std::get_if<event::Connected>(&event);
    return connected ? &connected->newLayers : nullptr;
}

}  // namespace

Result<ClientFolders> ClientFolders::create(const fs::path& folder) {
    ClientFolders folders;
    folders.background = std::make_unique<client::Worker>();
    if (folder.empty()) {
        const fs::path temporary = fs::temp_directory_path();
        folders.own = client::ProcessFolder::make(temporary, kCachePrefix);
        if (!folders.own)
            return fail(ErrorCode::InvalidArgument, "cannot create a folder in " +
                                                        temporary.string() +
                                                        ". Name a cache folder, or set TMPDIR");
    }
    auto cache = client::CacheFolderPlaces::create(folders.own ? folders.own.path() : folder,
                                                   *folders.background);
    if (!cache) return tl::unexpected(cache.error());
    folders.cache = std::move(*cache);
    return folders;
}

Client::Impl::Impl(std::unique_ptr<client::Connection> connection, Options options,
                   const Hash& secret, ClientFolders folders)
    : options_(std::move(options)),
      secret_(secret),
      ownFolder_(std::move(folders.own)),
      background_(std::move(folders.background)),
      cache_(*folders.cache),
      places_(std::move(folders.cache)),
      lost_(cache_.folder() / ".usdlive-lost", events_),
      values_(cache_.folder() / ".usdlive-blobs", options_.cacheBytes),
      frame_(values_.cache(), encoder_, lost_),
      line_(std::move(connection)),
      unsent_(options_.stateFolder, sessionOptions(options_, secret_), values_.cache(), events_),
      session_(sessionOptions(options_, secret_), *this, *this),
      history_(session_, {[this] { return step(); }, [this] { return line_.notThere(session_); }}),
      layers_({session_, places_, files_, events_, lost_, values_, frame_.sink(), filler_,
               *background_}),
      opens_(layers_, values_, events_),
      locks_(layers_.live(), frame_, session_),
      late_(layers_.live(), places_, files_, *background_),
      uploads_(session_, *this) {
    static_cast<void>(session_.showPresence({}));
    if (ownFolder_)
        // If the system refuses a thread, a later client removes them.
        removing_ = std::async(std::launch::async | std::launch::deferred,
                               [parent = cache_.folder().parent_path()] {
                                   client::ProcessFolder::removeDead(parent, kCachePrefix);
                               });
}

Client::Impl::~Impl() {
    closePasts();
    {
        const pxr::SdfChangeBlock block;
        frame_.seal(layers_.live(), session_);
        session_.endGesture();
        advance(kLastBudgetMs);
    }
    applyApart();
    const pxr::SdfChangeBlock block;
    layers_.leaveAll();
}

void Client::Impl::closePasts() {
    for (const auto& one : pasts_)
        if (const auto past = one.lock()) past->close();
}

client::Session::Options Client::Impl::sessionOptions(const Options& options, const Hash& secret) {
    client::Session::Options session;
    session.client = clientIdOf(secret);
    session.secret = secret;
    session.user = UserName{options.user};
    session.application = options.application;
    return session;
}

// --- checks of the caller

std::optional<Error> Client::Impl::misuse(std::string_view function, bool blocks) const {
    if (auto elsewhere = thread_.claim(function)) return elsewhere;
    if (blocks && ticking_)
        return Error{ErrorCode::InvalidArgument,
                     std::string(function) +
                         "() waits for the server and was called by a notice handler while tick() "
                         "applies edits. Call it after tick() has returned"};
    return std::nullopt;
}

void Client::Impl::require(std::string_view function) const {
    if (const auto error = misuse(function, false)) throw Misuse(*error);
}

bool Client::Impl::mayBlock(std::string_view function) {
    require(function);
    const auto error = misuse(function, true);
    if (error) events_.report(*error);
    return !error;
}

// --- the frame

Client::TickResult Client::Impl::tick(double budgetMs, Seal seal) {
    TickResult result;
    if (ticking_) return result;  // called by a notice handler: the outer tick continues
    work(budgetMs, result, seal);
    events_.dispatch();
    return result;
}

void Client::Impl::work(double budgetMs, TickResult& result, Seal seal) {
    const Raised ticking(ticking_);
    const Stopwatch watch;
    const client::PlainFiles::Tick neverWaits(files_);
    const client::DynamicPayloadTick payloads;
    const auto left = [&] { return std::max(budgetMs - watch.ms(), 0.1); };
    layers_.adoptLoaded(left());
    result.more = opens_.start(left());
    std::vector<client::Event> happened;
    {
        const pxr::SdfChangeBlock block;
        result.more = !exchange(left(), seal) || result.more;
        result.filling = layers_.fill(left());
        layers_.views().follow();
        late_.add(layers_.takeFilledClips());
        values_.requestMissing(session_);
        happened = session_.takeEvents();
        // A new layer and the edit that names it may arrive in one tick. Composition opens the
        // layer at the end of the block.
        for (const client::Event& one : happened)
            if (const auto* added = newLayers(one)) {
                layers_.projectChanged(*added);
                late_.add(*added);
            }
        layers_.makeNamedFindable();
        late_.compose();
    }
    applyApart();
    late_.composeClips();
    payloads.composeArrived();
    takeEvents(std::move(happened), result);
    result.more = opens_.advance(left()) || result.more;
    for (auto& outside : frame_.takeOutside()) events_.push(std::move(outside));
    followFiles();
    followUploads();
    lost_.reportDue(steadyMs());
    unsent_.reportErrors();
    if (auto error = places_.takeError()) events_.report(std::move(*error));
    values_.release(session_, lost_.blobs(), [&] { return unsent_.neededBlobs(); });
}

// A notice handler may leave a layer at the end of a block.
void Client::Impl::applyApart() {
    std::vector<LayerId> layers;
    for (const LiveLayer* live : layers_.live().active())
        if (live->hasApart()) layers.push_back(live->id());
    for (const LayerId& id : layers)
        for (LiveLayer* live = layers_.find(id); live && live->hasApart();
             live = layers_.find(id)) {
            const pxr::SdfChangeBlock block;
            live->applyApart();
            layers_.makeNamedFindable();
        }
    for (bool more = true; more;) {
        const pxr::SdfChangeBlock block;
        more = layers_.views().applyApart();
    }
}

void Client::Impl::useAddresses() {
    if (auto base = files_.start(cache_.folder(), line_.connection().web()))
        cache_.useAddresses(std::move(*base));
}

void Client::Impl::followFiles() {
    if (!files_.isStarted()) return;
    files_.follow(session_.isConnected(), line_.connection(), steadyMs());
    auto changes = files_.takeChanges();
    if (changes.isEmpty()) return;
    const auto isLive = [this](const auto& layer) { return layers_.idOf(layer).has_value(); };
    late_.add(files_.reload(changes.changed, isLive));
    late_.add(changes.arrived);
    if (!changes.changed.empty()) events_.push(event::FilesChanged{std::move(changes.changed)});
}

// An upload ends when this process can resolve the file, too.
void Client::Impl::followUploads() {
    uploads_.advance();
    if (auto progress = uploads_.progress(steadyMs())) events_.push(*progress);
    for (auto& ended : uploads_.takeEnded()) {
        const bool isShown = ended.outcome && files_.isStarted();
        uploaded_.emplace_back(std::move(ended), isShown ? files_.askSoon() : 0);
    }
    std::erase_if(uploaded_, [this](auto& one) {
        auto& [ended, list] = one;
        if (list != 0 && !files_.isReported(list)) return false;
        if (auto event = uploads_.report(std::move(ended))) events_.push(*std::move(event));
        return true;
    });
}

template <class Function>
auto Client::Impl::withEdits(const Function& function) {
    struct Ending {
        std::optional<usd::SdfLayerStore::Block>& edits;
        ~Ending() { edits.reset(); }
    } const ending{edits_};
    edits_.emplace();
    return function();
}

// Sends the editor's writes and applies received edits. Returns false if there is more to do.
bool Client::Impl::exchange(double budgetMs, Seal seal) {
    auto& live = layers_.live();
    if (seal == Seal::Now)
        frame_.seal(live, session_);
    else if (!frame_.sealWhenEncoded(live, session_))
        return false;
    if (takesBack_) {
        const auto undoOrRedo = std::exchange(takesBack_, nullptr);
        withEdits([&] { takenBack_ = (session_.*undoOrRedo)(); });
    }
    line_.receive(session_);
    const bool done = advance(budgetMs);
    if (session_.pendingTransactions() == 0) saveAgain(live, cache_, session_);
    values_.deliver(live);
    values_.requestMissing(session_);
    return done;
}

bool Client::Impl::advance(double budgetMs) {
    return withEdits([&] { return session_.advance(budgetMs, steadyMs()); });
}

// Within a tick, so that the layers get the edits as they get those of others.
Result<client::UndoResult> Client::Impl::takeBack(TakeBack undoOrRedo) {
    takesBack_ = undoOrRedo;
    tick(0, Seal::Now);
    return *std::exchange(takenBack_, std::nullopt);
}

// Earlier writes do not belong to a group that begins, but to one that ends.
void Client::Impl::setUndoGroup(const std::string* label) {
    if (!ticking_) frame_.seal(layers_.live(), session_);
    if (label)
        session_.beginUndoGroup(*label);
    else
        session_.endUndoGroup();
}

void Client::Impl::setGesture(bool begins) {
    if (!begins && gestures_ == 0) return;
    gestures_ += begins ? 1 : -1;
    if (gestures_ != (begins ? 1 : 0)) return;  // inside another gesture
    // Earlier writes do not belong to a gesture that begins, but to one that ends.
    tick(0, Seal::Now);
    if (begins)
        session_.beginGesture();
    else
        session_.endGesture();
}

std::uint64_t Client::Impl::save(std::vector<LayerId> layers, bool force) {
    // Earlier writes are saved, too.
    TickResult ticked;
    if (!ticking_) work(0, ticked, Seal::Now);
    saveAgain(layers_.live(), cache_, session_);
    const auto forced = force ? std::optional(true) : std::nullopt;
    return session_.request(SaveLayers{.layers = std::move(layers), .force = forced});
}

// --- events

void Client::Impl::takeEvents(std::vector<client::Event> happened, TickResult& result) {
    for (auto& one : happened) {
        if (std::holds_alternative<event::Committed>(one)) ++result.applied;
        if (note(one)) events_.push(std::move(one));
    }
    reportJoined();
}

// Reports a layer as joined when the editor has its whole content.
void Client::Impl::reportJoined() {
    std::erase_if(joined_, [&](event::Joined& joined) {
        const auto* live = layers_.find(joined.layer);
        if (live && !live->isFilled()) return false;
        if (live) events_.push(joined);
        return true;
    });
}

bool Client::Impl::note(client::Event& one) {
    if (uploads_.note(one)) return false;
    std::visit(
        [&](const auto& each) {
            if constexpr (requires { each.answer.request; })
                if (answers_.isAwaited(each.answer.request))
                    answers_.add(each.answer.request, client::Event(each));
        },
        one);
    if (const auto* connected = std::get_if<event::Connected>(&one)) {
        line_.welcomed(connected->welcome);
        if (connected->leftHistory) closePasts();  // they show the one that was left
        unsent_.welcomed(connected->welcome);
        layers_.followLocks();
    } else if (const auto* states = std::get_if<event::LayerStatesChanged>(&one)) {
        for (const LayerState& state : states->layers) layers_.followLock(state.layer);
    } else if (std::holds_alternative<event::RightsChanged>(one)) {
        layers_.followLocks();
    } else if (const auto* committed = std::get_if<event::Committed>(&one)) {
        if (committed->commit.id.client == session_.id()) values_.committed(committed->commit);
    } else if (auto* joined = std::get_if<event::Joined>(&one)) {
        joined_.push_back(std::move(*joined));
        return false;
    } else if (const auto* failed = std::get_if<event::JoinFailed>(&one)) {
        opens_.failed(failed->layer, failed->reason);
        return layers_.failed(failed->layer, failed->reason);
    } else if (auto* lost = std::get_if<event::Lost>(&one)) {
        lost_.add(std::move(lost->work));
        return false;
    } else if (const auto* error = std::get_if<event::ServerError>(&one)) {
        return noteError(error->message);
    }
    return true;
}

bool Client::Impl::noteError(const ErrorMessage& message) {
    if (message.request) answers_.add(*message.request, tl::unexpected(toError(message)));
    if (message.blob) {
        values_.failed(*message.blob);
        for (const auto& one : pasts_)
            if (const auto past = one.lock(); past && past->layers())
                past->layers()->blobFailed(*message.blob, toError(message));
    }
    return !message.closing || line_.closing(message, session_);
}

// --- layers

pxr::SdfLayerRefPtr Client::Impl::layer(const LayerId& id) const {
    const auto* live = layers_.find(id);
    return live && live->isFilled() ? live->layer() : pxr::SdfLayerRefPtr();
}

std::optional<LayerId> Client::Impl::layerId(const pxr::SdfLayerHandle& layer) const {
    return layers_.idOf(layer);
}

// --- lost and unsent edits

Result<pxr::SdfLayerRefPtr> Client::Impl::lostWorkAsLayer(std::uint64_t index, const LayerId& id) {
    const auto work = lost_.at(index);
    if (!work) return tl::unexpected(work.error());
    return client::lostWorkLayer(*work, id, session_.confirmed(id), values_.cache());
}

Result<pxr::SdfLayerRefPtr> Client::Impl::unsentAsLayer(const ClientId& work,
                                                        const LayerId& layer) {
    const auto left = unsent_.edits(work);
    if (!left) return tl::unexpected(left.error());
    return client::lostWorkLayer(left->work, layer, session_.confirmed(layer), *left->blobs);
}

// --- SessionHost and LayerView

bool Client::Impl::needsBlob(const Hash& hash) {
    for (const auto& one : pasts_)
        if (const auto past = one.lock(); past && past->layers() && past->layers()->needs(hash))
            return true;
    return std::ranges::any_of(layers_.live().all(),
                               [&](const auto& one) { return one.second->waitsFor(hash); });
}

void Client::Impl::pending(const client::PendingWork& work) { unsent_.pending(work); }

void Client::Impl::answered(std::uint64_t sequence) { unsent_.answered(sequence); }

void Client::Impl::discard(std::shared_ptr<void> garbage) {
    filler_.post([garbage = std::move(garbage)]() mutable { garbage.reset(); });
}

void Client::Impl::arriving(const LayerId& id, std::shared_ptr<const client::SnapshotPart> part) {
    if (LiveLayer* live = layers_.find(id)) live->arriving(std::move(part));
}

void Client::Impl::arrived(const LayerId& id, const LayerDoc& snapshot) {
    if (LiveLayer* live = layers_.find(id)) live->arrived(snapshot);
}

void Client::Impl::reset(const LayerId& id, const LayerDoc& doc) {
    LiveLayer* const live = layers_.find(id);
    if (!live) return;
    live->reset(doc);
    if (const auto writes = content::OthersWrites::find(live->layer()))
        writes->missed(session_.revision());
}

void Client::Impl::apply(const LayerId& id, const std::string& path, const EditAction& action) {
    LiveLayer* const live = layers_.find(id);
    if (!live) return;
    if (edits_) return live->apply(path, action, *edits_);
    usd::SdfLayerStore::Block block;
    live->apply(path, action, block);
}

// Calls `note` with each edit of a layer for which writes of others are noted.
template <class Note>
void Client::Impl::noteWrites(const Commit& commit, const Note& note) {
    const LayerId* layer = nullptr;  // layer of the edit before
    std::shared_ptr<content::OthersWrites> writes;
    for (const Edit& edit : commit.edits) {
        if (!layer || *layer != edit.layer) {
            layer = &edit.layer;
            const LiveLayer* live = layers_.find(*layer);
            writes = live ? content::OthersWrites::find(live->layer()) : nullptr;
        }
        if (writes) note(*writes, edit);
    }
}

void Client::Impl::othersCommitted(const Commit& commit) {
    noteWrites(commit, [&](content::OthersWrites& writes, const Edit& edit) {
        writes.note(edit, commit.revision);
    });
}

void Client::Impl::ownCommitted(const Commit& commit, Revision base) {
    noteWrites(commit, [&](content::OthersWrites& writes, const Edit& edit) {
        writes.noteOwn(edit, base);
    });
}

}  // namespace usdlive
