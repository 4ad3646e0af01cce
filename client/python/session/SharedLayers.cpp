// A connection to a project and its layers, for an editor that reads and writes them elsewhere.
#include "SharedLayers.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <utility>

#include "basics/Clocks.h"
#include "link/Destination.h"
#include "session/RootEdits.h"
#include "transport/Connection.h"
#include "usdlive/common/core/ClientSecret.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/layer/MatchedSpecs.h"
#include "work/SparseLayer.h"

namespace usdlive::client {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSharedCacheMemory = std::size_t(256) << 20;
constexpr const char* kSharedCachePrefix = "usdlive-cache-";
// The budget of a step while a call waits for the server, and its longest wait.
constexpr double kStepBudgetMs = 50, kStepMs = 5;
constexpr double kUnreachableMs = 1000;

Session::Options optionsFor(const SharedLayers::Settings& settings, const Hash& secret) {
    Session::Options options;
    options.secret = secret;
    options.client = clientIdOf(secret);
    options.user = UserName{settings.user};
    options.application = settings.application;
    return options;
}

}  // namespace

SharedLayers::SharedLayers(Settings settings, ProcessFolder folder, fs::path cache,
                           std::unique_ptr<Connection> connection, const Hash& secret)
    : settings_(std::move(settings)),
      ownFolder_(std::move(folder)),
      folder_(std::move(cache)),
      blobs_(folder_ / ".usdlive-blobs", kSharedCacheMemory, settings_.cacheBytes),
      lost_(folder_ / ".usdlive-lost", events_),
      unsent_(folderOfState({}, settings_.cacheFolder), optionsFor(settings_, secret), blobs_,
              events_),
      link_(std::make_unique<ServerLink>(std::move(connection))),
      session_(std::make_unique<Session>(optionsFor(settings_, secret), *this, *this)),
      history_(*session_,
               {[this] { return step(); }, [this] { return link_->notThere(*session_); }}),
      uploads_(*session_, *this) {
    events_.setHandler([this](const Event& event) { taken_.push_back(event); });
    static_cast<void>(session_->showPresence({}));
    if (ownFolder_)
        // If the system refuses a thread, a later client removes them.
        removing_ = std::async(std::launch::async | std::launch::deferred,
                               [parent = folder_.parent_path()] {
                                   ProcessFolder::removeDead(parent, kSharedCachePrefix);
                               });
}

Result<std::unique_ptr<SharedLayers>> SharedLayers::connect(const std::string& url,
                                                            Settings settings) try {
    auto destination = destinationOf(url, settings.user, settings.token);
    if (!destination) return tl::unexpected(destination.error());
    settings.user = destination->user.value;
    if (auto checked = checkNames(destination->user, settings.application); !checked)
        return tl::unexpected(checked.error());
    auto connection = createConnection(destination->address);
    if (!connection) return tl::unexpected(connection.error());
    ProcessFolder own;
    fs::path cache = settings.cacheFolder;
    if (cache.empty()) {
        const fs::path temporary = fs::temp_directory_path();
        own = ProcessFolder::make(temporary, kSharedCachePrefix);
        if (!own)
            return fail(ErrorCode::InvalidArgument, "cannot create a folder in " +
                                                        temporary.string() +
                                                        ". Name a cache folder, or set TMPDIR");
        cache = own.path();
    }
    std::unique_ptr<SharedLayers> made(new SharedLayers(std::move(settings), std::move(own),
                                                        std::move(cache), std::move(*connection),
                                                        newClientSecret()));
    if (auto greeted = made->greet(); !greeted) return tl::unexpected(greeted.error());
    made->unsent_.start([address = destination->address] { return createConnection(address); },
                        *made->session_->welcome());
    return made;
} catch (const ThreadRefused& refused) {
    return fail(ErrorCode::NotConnected, std::string("cannot connect: ") + refused.what());
}

Result<void> SharedLayers::greet() {
    const Stopwatch watch;
    while (!session_->isConnected()) {
        if (link_->refused()) return tl::unexpected(*link_->refused());
        if (watch.ms() > settings_.timeoutMs) return tl::unexpected(link_->notThere(*session_));
        if (link_->lastLoss() && !link_->isOpen() && watch.ms() > kUnreachableMs)
            return tl::unexpected(*link_->lastLoss());
        link_->connection().wait(std::chrono::milliseconds(20));
        advance(kStepBudgetMs);
        static_cast<void>(takeEvents());
    }
    return {};
}

bool SharedLayers::advance(double budgetMs) {
    link_->receive(*session_);
    const bool done = session_->advance(budgetMs, steadyMs());
    followUploads();
    if (session_->pendingTransactions() == 0 && captured_.empty() &&
        blobs_.kept() > lost_.blobs().size()) {
        auto needed = session_->namedBlobs();
        needed.insert(lost_.blobs().begin(), lost_.blobs().end());
        needed.merge(unsent_.neededBlobs());
        blobs_.keepOnly(needed, std::exchange(committed_, {}));
    }
    return !done;
}

void SharedLayers::followUploads() {
    uploads_.advance();
    if (auto progress = uploads_.progress(steadyMs())) events_.push(*progress);
    for (auto& ended : uploads_.takeEnded())
        if (auto event = uploads_.report(std::move(ended))) events_.push(*std::move(event));
}

Result<void> SharedLayers::upload(const fs::path& file, const std::string& path, bool overwrite) {
    const auto number = uploads_.add(file, path, overwrite);
    return uploads_.finish(number, path, [this] {
        advance(kStepBudgetMs);
        collectEvents();
        return wait(1);
    });
}

bool SharedLayers::step() {
    const bool heard = wait(kStepMs);
    advance(kStepBudgetMs);
    collectEvents();
    return heard;
}

void SharedLayers::collectEvents() {
    for (Event& event : session_->takeEvents())
        if (note(event)) events_.push(std::move(event));
}

std::vector<Event> SharedLayers::takeEvents() {
    collectEvents();
    lost_.reportDue(steadyMs());
    unsent_.reportErrors();
    events_.dispatch();
    return std::exchange(taken_, {});
}

std::optional<UnsentWork> SharedLayers::leave() {
    lost_.reportAll();
    return unsent_.keep(*session_);
}

bool SharedLayers::note(Event& event) {
    if (uploads_.note(event)) return false;
    if (const auto* connected = std::get_if<event::Connected>(&event)) {
        link_->welcomed(connected->welcome);
        unsent_.welcomed(connected->welcome);
    } else if (const auto* committed = std::get_if<event::Committed>(&event)) {
        if (committed->commit.id.client == session_->id())
            for (const Edit& edit : committed->commit.edits)
                forEachBlob(edit.action,
                            [&](const Value& blob) { committed_.insert(blob.hash()); });
    } else if (const auto* error = std::get_if<event::ServerError>(&event)) {
        if (error->message.blob) awaited_.erase(*error->message.blob);
        if (error->message.closing) return link_->closing(error->message, *session_);
    } else if (auto* lost = std::get_if<event::Lost>(&event)) {
        lost_.add(std::move(lost->work));
        return false;
    }
    return true;
}

void SharedLayers::open(const LayerId& layer) {
    if (layers_.contains(layer)) return;
    layers_[layer];
    session_->openLayer(layer);
}

void SharedLayers::close(const LayerId& layer) {
    if (layers_.erase(layer) == 0) return;
    std::erase_if(captured_, [&](const AuthoredEdit& edit) { return edit.layer == layer; });
    session_->closeLayer(layer);
}

// --- what the editor wrote

std::vector<LayerChanges::Refused> SharedLayers::capture(
    const LayerId& layer, const std::vector<SeenSpec>& seen,
    const std::function<bool(std::string_view, std::string_view, const Bytes&)>& keeps) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !found->second.shown || found->second.isReplaced) return {};
    Layer& own = found->second;
    auto changes = compareLayer(layer, *own.shown, seen, keeps, blobs_, blobs_);
    std::move(changes.edits.begin(), changes.edits.end(), std::back_inserter(captured_));
    own.shown = std::move(changes.after);
    // The editor's layer has more than `shown` then.
    if (!changes.refused.empty()) own.isReplaced = true;
    return std::move(changes.refused);
}

void SharedLayers::lose(const LayerId& layer, const std::string& path, const std::string& field,
                        Error reason, const std::string& text) {
    LostWork work;
    work.reason = std::move(reason);
    const std::string data = path == "/" ? "customLayerData" : "customData";
    work.edits.push_back({layer, path,
                          SetField{data, DictionaryKey{{"lost", field.empty() ? "spec" : field}},
                                   stringValue(text), ValueType::None}});
    lost_.add(std::move(work));
}

void SharedLayers::submit() {
    if (captured_.empty()) return;
    std::set<LayerId> written;
    for (const AuthoredEdit& edit : captured_) written.insert(edit.layer);
    session_->author(std::exchange(captured_, {}));
    for (const LayerId& id : written) {
        Layer& own = layers_.at(id);
        own.isBehind = true;
        // The session gives new specs ids of its own.
        const LayerDoc* view = session_->view(id);
        if (view && *view == *own.shown)
            own.shown = *view;
        else
            own.hasOwnIds = true;
    }
}

Result<void> SharedLayers::setLocked(const LayerId& layer, bool locked) {
    if (auto open = checkOpen(layer); !open) return open;
    return authorAtRoot(layer, lockEdits(*session_, layer, locked, wallClockMs()));
}

Result<void> SharedLayers::setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted) {
    if (auto open = checkOpen(root); !open) return open;
    return authorAtRoot(root, muteEdits(*session_, root, layer, muted));
}

Result<void> SharedLayers::checkOpen(const LayerId& layer) const {
    const auto found = layers_.find(layer);
    if (found != layers_.end() && found->second.shown && session_->view(layer)) return {};
    return fail(ErrorCode::LayerNotOpen, layer.value + " is not open here");
}

Result<void> SharedLayers::authorAtRoot(const LayerId& layer,
                                        Result<std::vector<EditAction>> actions) {
    if (!actions) return tl::unexpected(actions.error());
    std::vector<AuthoredEdit> edits;
    for (EditAction& action : *actions) edits.push_back({layer, "/", std::move(action)});
    if (edits.empty()) return {};
    session_->author(std::move(edits));
    layers_.at(layer).isBehind = true;
    return {};
}

// --- what the editor gets

void SharedLayers::blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) {
    if (lasting)
        blobs_.cacheBlob(hash, std::move(bytes));
    else
        blobs_.holdBlob(hash, std::move(bytes));
    awaited_.erase(hash);
    for (auto& [id, layer] : layers_) layer.late.insert(hash);
}

void SharedLayers::reset(const LayerId& layer, const LayerDoc&) {
    const auto found = layers_.find(layer);
    if (found == layers_.end()) return;
    found->second.isReplaced = true;
    found->second.isBehind = true;
}

void SharedLayers::apply(const LayerId& layer, const std::string&, const EditAction&) {
    if (const auto found = layers_.find(layer); found != layers_.end())
        found->second.isBehind = true;
}

std::optional<Bytes> SharedLayers::inlineOrAsk(const FieldValue& value) {
    std::vector<Hash> missing;
    auto bytes = encodedInline(value, blobs_, missing);
    for (const Hash& hash : missing)
        if (awaited_.insert(hash).second) session_->requestBlob(hash);
    return bytes;
}

std::vector<LayerChange> SharedLayers::takeChanges(const LayerId& layer) {
    std::vector<LayerChange> changes;
    const auto found = layers_.find(layer);
    const LayerDoc* view = session_->view(layer);
    if (found == layers_.end() || !view || !session_->isJoined(layer)) return changes;
    Layer& own = found->second;
    if (!own.shown || own.isReplaced) {
        own.shown = *view;
        own.isReplaced = own.isBehind = own.hasOwnIds = false;
        own.late.clear();
        changes.push_back({LayerChange::Replaced{}});
        return changes;
    }
    if (std::exchange(own.isBehind, false)) {
        // Equal ids would mean different specs. The new ids are only valid for this view.
        if (std::exchange(own.hasOwnIds, false)) own.shown = matchedSpecs(*view, *own.shown);
        // A field may be changed in many parts; the editor gets it once, with all of them.
        for (auto& [path, action] : difference(*own.shown, *view)) {
            static_cast<void>(own.shown->apply(path, action));
            const auto* set = std::get_if<SetField>(&action);
            const auto* erase = std::get_if<EraseField>(&action);
            if (!set && !erase) {
                changes.push_back({LayerChange::Namespace{path, std::move(action)}});
                continue;
            }
            const std::string& field = set ? set->field : erase->field;
            const FieldValue* value = own.shown->field(path, field);
            auto bytes = value ? inlineOrAsk(*value) : std::nullopt;
            if (value && !bytes) continue;  // follows when it is here
            auto* last =
                changes.empty() ? nullptr : std::get_if<LayerChange::Field>(&changes.back().what);
            if (last && last->path == path && last->field == field)
                last->value = std::move(bytes);
            else
                changes.push_back({LayerChange::Field{path, field, std::move(bytes)}});
        }
        own.shown = *view;
    }
    addLateFields(own, changes);
    return changes;
}

void SharedLayers::addLateFields(Layer& layer, std::vector<LayerChange>& changes) {
    const auto late = std::exchange(layer.late, {});
    if (late.empty()) return;
    layer.shown->visit([&](const LayerDoc::SpecView& spec) {
        for (const auto& [name, value] : *spec.fields) {
            bool isLate = false;
            forEachBlob(value, [&](const Value& blob) { isLate |= late.contains(blob.hash()); });
            if (!isLate) continue;
            if (auto bytes = inlineOrAsk(value))
                changes.push_back(
                    {LayerChange::Field{std::string(spec.path), name, std::move(bytes)}});
        }
    });
}

std::optional<Bytes> SharedLayers::held(const LayerId& layer, const std::string& path,
                                        const std::string& field) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !found->second.shown) return std::nullopt;
    const FieldValue* value = found->second.shown->field(path, field);
    return value ? inlineOrAsk(*value) : std::nullopt;
}

void SharedLayers::content(const LayerId& layer, const Visit& visit) {
    const auto found = layers_.find(layer);
    if (found == layers_.end() || !found->second.shown) return;
    visitContent(
        *found->second.shown, [this](const FieldValue& value) { return inlineOrAsk(value); },
        visit);
}

void SharedLayers::content(const LayerDoc& past, const Visit& visit) {
    visitContent(past, [this](const FieldValue& value) { return inlineOrAsk(value); }, visit);
}

Result<LayerDoc> SharedLayers::past(const LayerId& layer, Revision revision) {
    auto content = history_.readLayer(layer, revision);
    if (!content) return tl::unexpected(content.error());
    std::set<Hash> missing;
    forEachBlob(content->doc, [&](const Value& blob) {
        if (!blobs_.holds(blob.hash())) missing.insert(blob.hash());
    });
    for (const Hash& hash : missing)
        if (awaited_.insert(hash).second) session_->requestBlob(hash);
    const auto isAwaited = [this](const Hash& hash) { return awaited_.contains(hash); };
    const auto isOver = [&] {
        return !session_->isConnected() || std::ranges::none_of(missing, isAwaited);
    };
    if (auto waited = history_.waitUntil(isOver); !waited) return tl::unexpected(waited.error());
    if (std::ranges::any_of(missing, isAwaited)) return tl::unexpected(link_->notThere(*session_));
    const auto isHere = [this](const Hash& hash) { return blobs_.holds(hash); };
    if (!std::ranges::all_of(missing, isHere))
        return fail(ErrorCode::BlobNotFound, "the server does not have a big value of " +
                                                 layer.value + " at revision " +
                                                 std::to_string(revision));
    return std::move(content->doc);
}

// --- lost and unsent edits

Result<void> SharedLayers::lostContent(std::uint64_t index, const LayerId& layer,
                                       const NameOfType& nameOfType, const Visit& visit) {
    const auto work = lost_.at(index);
    if (!work) return tl::unexpected(work.error());
    visitSparse(*work, layer, nameOfType, blobs_, visit);
    return {};
}

Result<void> SharedLayers::unsentContent(const ClientId& work, const LayerId& layer,
                                         const NameOfType& nameOfType, const Visit& visit) {
    const auto left = unsent_.edits(work);
    if (!left) return tl::unexpected(left.error());
    visitSparse(left->work, layer, nameOfType, *left->blobs, visit);
    return {};
}

void SharedLayers::visitSparse(const LostWork& work, const LayerId& layer,
                               const NameOfType& nameOfType, BlobSource& blobs,
                               const Visit& visit) {
    const auto encoded = [&blobs](const FieldValue& value) {
        std::vector<Hash> missing;
        return encodedInline(value, blobs, missing);
    };
    const LayerDoc doc =
        sparseLayer(work, layer, session_->confirmed(layer), [&](const Value& value) {
            const auto bytes = encoded(FieldValue(value));
            return bytes ? nameOfType(*bytes) : std::string();
        });
    visitContent(doc, encoded, visit);
}

void SharedLayers::visitContent(
    const LayerDoc& doc, const std::function<std::optional<Bytes>(const FieldValue&)>& encoded,
    const Visit& visit) {
    doc.visit([&](const LayerDoc::SpecView& spec) {
        std::vector<std::pair<std::string, Bytes>> fields;
        for (const auto& [name, value] : *spec.fields)
            if (auto bytes = encoded(value)) fields.emplace_back(name, std::move(*bytes));
        visit(spec, fields);
    });
}

}  // namespace usdlive::client
