// The real Session with a simulated editor.
#include "SimClient.h"

#include <algorithm>
#include <sstream>

#include "session/OwnRights.h"
#include "unit/common/layer/SpecLockEdits.h"
#include "usdlive/common/core/ClientSecret.h"
#include "usdlive/common/core/ErrorPasses.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"

namespace usdlive::simulation {

using namespace client;

namespace {

// Edits of places can be left out (M15).
std::size_t ofSpecs(const std::vector<client::AuthoredEdit>& edits) {
    return std::size_t(
        std::ranges::count_if(edits, [](const auto& edit) { return !concernsPlace(edit.action); }));
}

std::string textOf(const AuthoredEdit& edit) {
    const char* const kinds[] = {"create", "delete", "move", "place", "set", "erase"};
    std::string text = std::string(kinds[edit.action.index()]) + " " + edit.path;
    if (const auto* move = std::get_if<MoveSpec>(&edit.action))
        text += " to " + destination(edit.path, *move);
    if (const auto* place = std::get_if<PlaceSpec>(&edit.action))
        text += " before " + place->before;
    if (const auto* set = std::get_if<SetField>(&edit.action))
        text += " " + set->field + " part " + std::to_string(set->part.index());
    if (const auto* erase = std::get_if<EraseField>(&edit.action))
        text += " " + erase->field + " part " + std::to_string(erase->part.index());
    return text;
}

// Returns the lines that differ between two texts, with the lines around them.
std::string textDifference(const std::string& left, const std::string& right) {
    const auto lines = [](const std::string& text) {
        std::istringstream stream(text);
        std::vector<std::string> all;
        for (std::string line; std::getline(stream, line);) all.push_back(line);
        return all;
    };
    const auto before = lines(left), after = lines(right);
    const std::size_t most = std::min(before.size(), after.size());
    std::size_t head = 0, tail = 0;
    while (head < most && before[head] == after[head]) ++head;
    while (tail < most - head && before[before.size() - 1 - tail] == after[after.size() - 1 - tail])
        ++tail;
    std::string text;
    for (std::size_t index = 0; index < head; ++index)
        if (!before[index].starts_with(' ')) text += "  " + before[index] + "\n";
    for (std::size_t index = head; index + tail < before.size(); ++index)
        text += "- " + before[index] + "\n";
    for (std::size_t index = head; index + tail < after.size(); ++index)
        text += "+ " + after[index] + "\n";
    return text;
}

}  // namespace

SimClient::SimClient(std::size_t number, const SimStyle& style, SimClock& clock, SimRandom& random,
                     SimNetwork& network, SimServer& server)
    : number_(number),
      style_(style),
      clock_(clock),
      random_(random),
      network_(network),
      server_(server),
      undos_(number * 7'919 + style.undoPercent),
      script_(random, lastValue_, style.namespacePercent > 0),
      namespace_(random, lastValue_),
      lastValue_(number * 1'000'000),
      session_(options(), *this, *this) {}

Session::Options SimClient::options() {
    Session::Options options;
    options.client = {"client" + std::to_string(number_)};
    if (number_ % 2 == 0) {  // ID5
        options.secret = sha256(asBytes(options.client.value));
        options.client = clientIdOf(*options.secret);
    }
    options.user = user();
    options.application = "simulation";
    options.uploadWindowChunks = 1 + random_.below(3);
    options.checksPrediction = style_.checksPrediction;
    options.clockMs = [this] { return fakeMs_ += 0.5; };
    if (style_.smallBudgets) options.leastAtOnce = 1;
    if (number_ % 3 == 2) std::erase(options.features, kCompactFeature);  // an earlier version
    if (style_.inParts) {
        options.wholeBytes = 500;
        options.partBytes = 300;
    }
    return options;
}

// ---- the connection

void SimClient::start() {
    const LayerId& first = random_.pick(style_.layers);
    session_.openLayer(first);
    opened_.insert(first);
    connect();
    clock_.in(random_.between(0, 20'000), [this] { tick(); });
}

void SimClient::connectLater() {
    clock_.in(random_.between(5'000, 400'000), [this] { connect(); });
}

void SimClient::connect() {
    if (link_ != 0) return;
    if (!server_.isRunning()) {
        session_.disconnected({ErrorCode::NotConnected, "the server does not answer"});
        return connectLater();
    }
    auto link = std::make_shared<server::SessionId>();
    auto begun = reader_ ? reader_->takeBegun() : MessageReader::BegunBlobs();
    reader_.emplace(std::move(begun));
    *link = link_ =
        network_.open({[this, link](SharedBytes message) {
                           if (*link != link_) return;
                           receive(*message);
                       },
                       [this, link] {
                           if (*link != link_) return;
                           link_ = 0;
                           session_.disconnected(
                               {ErrorCode::NotConnected, "the connection is lost"}, unconfirmed());
                           connectLater();
                       }});
    clock_.in(random_.between(100, 5'000), [this, link] {
        if (*link != link_) return;
        server_.connected(*link, user());
        session_.connected();
    });
}

/// The number may be too small: the server then does not have what an upload continues after. Uses
/// no random number, so that the seeds that failed once still produce the same run.
std::size_t SimClient::unconfirmed() const { return connections * 104'729 % 900'000; }
void SimClient::receive(ByteView message) {
    ReceivedMessage read = reader_->read(message);
    commitsAccepted += std::uint64_t(std::ranges::count_if(read.frames, [](const auto& frame) {
        return frame && std::holds_alternative<Acceptance>(*frame);
    }));
    session_.received(std::move(read));
}

void SimClient::send(SharedBytes frames) {
    require(link_ != 0, "a session sends without a connection");
    network_.sendToServer(link_, std::move(frames));
}

// ---- an editor's frame

void SimClient::tick() {
    if (!settling_) {
        if (random_.chance(style_.openPercent)) openAndClose();
        if (random_.chancePerMille(style_.requestPerMille)) makeRequests();
        editSomething();
        if (style_.namespacePercent > 0 && random_.chance(style_.namespacePercent)) editNamespace();
        if (random_.chancePerMille(style_.lockPerMille) && !session_.inGesture()) lockSomething();
        if (random_.chancePerMille(style_.awayPerMille)) editAway();
        if (style_.undoPercent > 0 && undos_.chance(style_.undoPercent)) undoSomething();
        if (style_.slidesOffline && (link_ == 0 || random_.chance(3))) slideOffline();
        if (link_ != 0 && random_.chancePerMille(style_.cutPerMille))
            network_.cut(link_, random_.chance(40));
    }
    const double budget =
        style_.smallBudgets && !settling_ ? double(random_.below(4)) : 1'000'000.0;
    noteTold();
    session_.advance(budget, clock_.nowMs());
    handleEvents();
    checkTold();
    compareEditor();
    clock_.in(random_.between(5'000, settling_ ? 60'000 : 30'000), [this] { tick(); });
}

void SimClient::editSomething() {
    if (session_.inGesture()) {
        if (random_.chance(80)) authorRandom(1 + random_.below(2));
        if (random_.chance(style_.bigValues ? 4 : 15)) session_.endGesture();
        return;
    }
    if (random_.chance(style_.gesturePercent))
        session_.beginGesture();
    else if (random_.chance(style_.editPercent))
        authorRandom(1 + random_.below(random_.chance(20) ? 8 : 3));
}

void SimClient::editNamespace() {
    const std::vector<LayerId> layers = joinedLayers();
    if (layers.empty() || session_.inGesture()) return;
    NamespaceEdits::Docs docs;
    for (const LayerId& layer : layers) docs.emplace(layer, editor_.at(layer));
    auto edits = random_.chance(40) ? namespace_.move(docs) : namespace_.write(docs, session_);
    for (auto& [layer, doc] : docs) editor_.at(layer) = std::move(doc);
    author(std::move(edits));
}

void SimClient::editAway() {
    if (session_.inGesture() || session_.pendingTransactions() > 100) return;
    if (link_ != 0) network_.cut(link_, random_.chance(40));
    for (auto frames = random_.chance(20) ? random_.below(3'000) : random_.below(300); frames > 0;
         --frames)
        authorRandom(1);
}

void SimClient::slideOffline() {
    const std::vector<LayerId> layers = joinedLayers();
    if (layers.empty() || session_.inGesture()) return;
    const LayerId& layer = random_.pick(layers);
    for (auto frames = random_.below(30); frames > 0; --frames) {
        LayerDoc& doc = editor_.at(layer);
        std::vector<AuthoredEdit> edits;
        for (AuthoredEdit& edit : script_.slide(layer, doc, blobs_, style_.bigValues))
            if (doc.apply(edit.path, edit.action)) edits.push_back(std::move(edit));
        author(std::move(edits));
    }
}

void SimClient::authorRandom(std::size_t count) {
    std::vector<AuthoredEdit> edits;
    for (std::size_t step = 0; step < count; ++step) {
        const std::vector<LayerId> layers = joinedLayers();
        if (layers.empty()) return;
        const LayerId& layer = random_.pick(layers);
        LayerDoc& doc = editor_.at(layer);
        const bool slide = session_.inGesture() && random_.chance(80);
        auto next = slide ? script_.slide(layer, doc, blobs_, style_.bigValues)
                          : script_.edits(layer, doc, blobs_, style_.bigValues);
        for (AuthoredEdit& edit : next) {
            const auto applied = doc.apply(edit.path, edit.action);
            const bool forbidden = !applied && applied.error().code == ErrorCode::ForbiddenValue;
            if (!applied && !forbidden) break;
            edits.push_back(std::move(edit));
        }
    }
    author(std::move(edits));
}

// Any number of undos and as many redos, with nothing between, restore all layers.
void SimClient::undoSomething() {
    if (session_.inGesture()) return;
    const auto count = 1 + undos_.below(undos_.chance(20) ? 12 : 3);
    const auto dumps = [this] {
        std::map<LayerId, std::string> all;
        for (const LayerId& layer : joinedLayers()) all[layer] = session_.view(layer)->dump();
        return all;
    };
    keptText_.clear();
    switch (undos_.below(4)) {
        case 0:
            for (auto left = count; left > 0; --left) undo(true);
            break;
        case 1:
        case 2:
            for (auto left = count; left > 0; --left) undo(false);
            break;
        default: {
            undo(false);  // completes the view, which may not show all commits yet
            undo(true);
            keptText_.clear();
            const auto before = dumps();
            const std::size_t steps = session_.undoLabels().undo.size();
            const auto undone = std::min<std::size_t>(count, steps);
            for (auto left = undone; left > 0; --left) undo(false);
            for (auto left = undone; left > 0; --left) undo(true);
            const auto after = dumps();
            for (const auto& [layer, text] : before)
                if (after.at(layer) != text)
                    throw SimFailure("client" + std::to_string(number_) +
                                     ": undos and as many redos leave another " + layer.value +
                                     "\n" + textDifference(text, after.at(layer)) + keptText_);
            require(session_.undoLabels().undo.size() == steps,
                    "undos and as many redos leave another number of steps");
        }
    }
}

// It never changes a register whose last writer is somebody else. Compared only if the view has
// nothing but commits.
void SimClient::undo(bool redo) {
    LayerDocs before, after;
    bool isConfirmed = session_.pendingTransactions() == 0;
    for (const LayerId& layer : joinedLayers()) {
        const LayerDoc* confirmed = session_.confirmed(layer);
        before.emplace(layer, *session_.view(layer));
        isConfirmed = isConfirmed && confirmed && *confirmed == before.at(layer);
    }
    undoing_.emplace();
    const auto result = redo ? session_.redo() : session_.undo();
    require(result.has_value(), "an undo is refused");
    const auto edits = *std::exchange(undoing_, std::nullopt);
    compareEditor();
    keptText_ += redo ? "redo\n" : "undo\n";
    for (const AuthoredEdit& edit : edits) keptText_ += "  " + textOf(edit) + "\n";
    for (const KeptByUndo& one : result->kept)
        keptText_ += "  kept " + one.path + " " + one.field + ": " + one.reason + "\n";
    if (!result->done) return;
    ++(redo ? redos : undos);
    kept += result->kept.size();
    for (const KeptByUndo& one : result->kept)
        if (!one.author.value.empty()) ++keptOfOthers;
    if (!isConfirmed) return;
    ++undosChecked;
    for (const auto& [layer, doc] : before) after.emplace(layer, *session_.view(layer));
    const std::string wrong = others_.changed(before, after, edits);
    require(wrong.empty(),
            "client" + std::to_string(number_) + " has undone what others wrote: " + wrong);
}

/// Takes a lock in its own name or ends one; ending somebody else's lock is refused.
void SimClient::lockSomething() {
    const std::vector<LayerId> layers = joinedLayers();
    if (layers.empty()) return;
    const LayerId& layer = random_.pick(layers);
    LayerDoc& doc = editor_.at(layer);
    const UserName self = user();
    std::vector<EditAction> actions;
    if (random_.chance(50)) {
        LayerLock lock;
        if (!lockOf(doc).locked) lock = {true, self, 1'000};
        actions = lockEdits(lock);
    } else if (const SpecLocks locks = specLocksOf(doc); !locks.empty() && random_.chance(60)) {
        actions = {specUnlockEdit(locks.begin()->first)};
    } else if (const auto prims = doc.children("/", ChildList::Prims); !prims.empty()) {
        actions = {specLockEdit("/" + random_.pick(prims), self)};
    }
    std::vector<AuthoredEdit> edits;
    for (EditAction& action : actions)
        if (doc.apply("/", action)) edits.push_back({layer, "/", std::move(action)});
    author(std::move(edits));
}

std::vector<LayerId> SimClient::joinedLayers() const {
    std::vector<LayerId> layers;
    for (const auto& [layer, doc] : editor_)
        if (session_.isJoined(layer)) layers.push_back(layer);
    return layers;
}

void SimClient::author(std::vector<AuthoredEdit> edits) {
    if (edits.empty()) return;
    if (!session_.inGesture()) {
        authoredEdits += ofSpecs(edits);
        ++transactions;
    }
    session_.author(std::move(edits));
    if (style_.checksPrediction) compareEditor();
}

void SimClient::openAndClose() {
    const LayerId& layer = random_.pick(style_.layers);
    if (opened_.contains(layer)) {
        if (!random_.chance(30)) return;
        session_.closeLayer(layer);
        opened_.erase(layer);
        editor_.erase(layer);
    } else if (random_.chance(10)) {
        session_.openLayer({"broken.usda"});
    } else {
        if (layer == style_.newLayer) request(CreateLayer{.layer = layer});
        session_.openLayer(layer);
        opened_.insert(layer);
    }
}

void SimClient::makeRequests() {
    const LayerId layer = random_.pick(style_.layers);
    switch (random_.below(6)) {
        case 0: {
            const Revision revision = random_.below(session_.revision() + 1);
            session_.peek(layer, revision, [this, layer](Result<LayerDoc> doc, Revision at) {
                if (doc) peeked.push_back({layer, at, doc->dump()});
            });
            break;
        }
        case 1:
            request(SaveLayers{});
            break;
        case 2:
            // A reload replaces the keys of prims by those in the file.
            if (style_.namespacePercent == 0) request(ReloadLayers{.layers = {layer}});
            break;
        case 3:
            naming_[request(CreateCheckpoint{
                .name = "at " + std::to_string(random_.below(1'000))})] = session_.revision();
            break;
        case 4:
            request(ListCheckpoints{});
            break;
        default: {
            auto next = std::make_shared<Revision>(0);  // the oldest revision
            session_.requestLog(
                0, 0,
                [next](const Commit& commit) {
                    if (*next == 0) *next = commit.revision;
                    require(commit.revision == (*next)++, "the log has a gap");
                },
                [](const Result<void>&) {});
        }
    }
}

void SimClient::stopEditing(bool all) {
    settling_ = true;
    session_.endGesture();
    if (!all) return;
    for (const LayerId& layer : style_.layers) {
        session_.openLayer(layer);
        opened_.insert(layer);
    }
}

bool SimClient::isQuiet() const {
    return session_.isConnected() && !leaving_ &&
           std::ranges::all_of(requests_, [](const auto& entry) { return entry.second; }) &&
           session_.pendingTransactions() == 0 && askedFor_.empty() &&
           session_.revision() == server_.store().head().revision &&
           std::all_of(opened_.begin(), opened_.end(), [this](const LayerId& layer) {
               // A layer that is joined again is shown meanwhile, but not confirmed.
               return session_.isJoined(layer) && session_.confirmed(layer) &&
                      editor_.contains(layer);
           });
}

std::string SimClient::describe() const {
    return "client" + std::to_string(number_) + ": connected " +
           std::to_string(session_.isConnected()) + " revision " +
           std::to_string(session_.revision()) + " pending " +
           std::to_string(session_.pendingTransactions()) + " joined " +
           std::to_string(
               std::count_if(opened_.begin(), opened_.end(),
                             [this](const LayerId& layer) { return session_.isJoined(layer); })) +
           "/" + std::to_string(opened_.size()) + " big values not come " +
           std::to_string(askedFor_.size());
}

// ---- events from the session

void SimClient::reset(const LayerId& layer, const LayerDoc& doc) {
    require(opened_.contains(layer), "the session shows a layer that is not open");
    editor_.insert_or_assign(layer, doc);
    forEachBlob(doc, [this](const Value& blob) { need(blob.hash()); });
}

void SimClient::apply(const LayerId& layer, const std::string& path, const EditAction& action) {
    const auto doc = editor_.find(layer);
    require(doc != editor_.end(), "the session shows an edit of a layer that it does not show");
    const auto applied = doc->second.apply(path, action);
    if (!applied)
        throw SimFailure("an edit does not apply to the layer that the editor shows: " +
                         applied.error().message);
    forEachBlob(action, [&](const Value& blob) { need(blob.hash()); });
    if (undoing_) undoing_->push_back({layer, path, action});
}

SharedBytes SimClient::localBlob(const Hash& hash) {
    const auto found = blobs_.find(hash);
    return found == blobs_.end() ? nullptr : found->second;
}

void SimClient::blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) {
    require(sha256(*bytes) == hash, "a big value arrived with a wrong hash");
    if (!lasting) ++previewedBlobs;
    blobs_[hash] = std::move(bytes);
    askedFor_.erase(hash);
}

bool SimClient::needsBlob(const Hash& hash) {
    bool needed = false;
    for (const auto& [layer, doc] : editor_)
        forEachBlob(doc, [&](const Value& blob) { needed = needed || blob.hash() == hash; });
    if (!needed) askedFor_.erase(hash);
    return needed;
}

// Requests a big value, like an editor that cannot show a field without it.
void SimClient::need(const Hash& hash) {
    if (!blobs_.contains(hash) && askedFor_.insert(hash).second) session_.requestBlob(hash);
}

void SimClient::handleEvents() {
    for (const Event& event : session_.takeEvents())
        std::visit(
            [this](const auto& one) {
                if constexpr (requires { one.answer.request; }) requestEnded(one.answer.request);
                on(one);
            },
            event);
}

void SimClient::on(const event::Committed& event) {
    if (event.commit.id.client == session_.id()) namespace_.committed(event.commit);
    if (event.commit.id.client == session_.id() && event.commit.id.sequence != 0)
        require(acknowledged_.insert(event.commit.id.sequence).second,
                "an author receives the same acknowledgement twice");
    if (event.missed) return;
    hasMoved_ = true;
    require(lastSeen_ == 0 || event.commit.revision - event.commit.conflated == lastSeen_ + 1,
            "commits have a gap");
    lastSeen_ = event.commit.revision;
    commitsTogether += event.commit.conflated;
    others_.committed(event.commit, event.commit.id.client == session_.id());
    ++commitsSeen;
}
void SimClient::on(const event::Connected& event) {
    ++connections;
    if (event.leftHistory)
        leaving_ = !told_.empty();
    else if (!leaving_)
        require(server_.serves(event.welcome, toldRevision_, std::exchange(told_, {})),
                "an editor joins a history that lacks what it was told is committed");
    if (event.resumed) return;
    lastSeen_ = event.welcome.revision;
    ++rejoins;
    hasSentByPath = hasSentByPath || session_.pendingTransactions() > 0;
}
void SimClient::on(const event::Joined& event) {
    left_ = left_ || (leaving_ && told_.contains(event.layer));
    others_.forget(event.layer);
}
void SimClient::on(const event::Lost& event) {
    require(!event.work.edits.empty(), "lost work was reported without its edits");
    if (event.work.sequence == 0 && event.work.reason.code == ErrorCode::HistoryDiverged) {
        regained_ = event.work.edits;
        hasMoved_ = false;
        regained += event.work.edits.size();
        return;
    }
    if (event.work.reason.code == ErrorCode::DeletedUnseen) {  // it was committed before (M17)
        require(acknowledged_.contains(event.work.sequence),
                "work that was not acknowledged is said to be deleted");
        return;
    }
    lost_.insert(event.work.sequence);
    require(!errorPasses(event.work.reason.code),
            "work is lost for a reason that passes: " + event.work.reason.message);
    if (event.work.reason.code == ErrorCode::Forbidden) ++forbidden;
    if (event.work.reason.code == ErrorCode::ClientForgotten) uncertain.insert(event.work.sequence);
    namespace_.lost(event.work);
    if (event.work.gesture != 0) return;
    const bool isCommitted = event.work.reason.code == ErrorCode::HistoryReplaced;
    (isCommitted ? uncertainEdits : lostEdits) += ofSpecs(event.work.edits);
}
std::uint64_t SimClient::request(AnyRequest request) {
    const std::uint64_t number = session_.request(std::move(request));
    requests_[number] = false;
    return number;
}
// Others are those of the session itself: layers that it reads again.
void SimClient::requestEnded(std::uint64_t number) {
    const auto found = requests_.find(number);
    if (found == requests_.end()) return;
    require(!std::exchange(found->second, true), "a request ended twice");
}
void SimClient::on(const event::CheckpointMade& event) {
    const auto asked = naming_.extract(event.answer.request);
    require(!asked.empty(), "a checkpoint was created twice, or without a request");
    require(event.answer.checkpoint.revision >= asked.mapped(),
            "a checkpoint lacks commits that its author had received");
    checkpoints.push_back(event.answer.checkpoint);
}
void SimClient::on(const event::CheckpointsListed& event) {
    for (const Checkpoint& own : checkpoints)
        require(server_.disk.forgot || std::ranges::count(event.answer.checkpoints, own) == 1,
                "a checkpoint is lost");
}
void SimClient::on(const event::ServerError& event) {
    if (event.message.request) requestEnded(*event.message.request);
    if (event.message.closing && link_ != 0) network_.cut(link_, false);
    require(event.message.code != "malformedFrame" && event.message.code != "malformedControl" &&
                event.message.code != "internal" && event.message.code != "invalidPath",
            "the server says " + event.message.code + ": " + event.message.message);
    for (const char* fault : {"diverged and is fetched", "does not follow the one before"})
        require(event.message.message.find(fault) == std::string::npos, event.message.message);
}
void SimClient::on(const event::JoinFailed& event) {
    if (event.layer.value == "broken.usda") return;
    opened_.erase(event.layer);
    editor_.erase(event.layer);
}

void SimClient::on(const event::LayerMade& event) {
    require(session_.projectLayers().contains(event.answer.layer),
            "a layer was created, but the project does not list it");
}

// ---- another history

void SimClient::pending(const PendingWork& work) {
    madeFor.try_emplace(work.sequence, work.store);
    if (undoing_ && !editsOf.contains(work.sequence)) {
        authoredEdits += ofSpecs(work.edits);
        ++transactions;
    }
    editsOf[work.sequence] = work.edits.size();
}

/// While the session is not connected, its confirmed layers are what the editor was told is
/// committed. If the session has stopped, the person decides after some time.
void SimClient::noteTold() {
    if (session_.isConnected()) return;
    if (!leaving_) {
        told_.clear();
        toldRevision_ = session_.revision();
        for (const LayerId& layer : opened_)
            if (const LayerDoc* doc = session_.confirmed(layer)) told_.emplace(layer, *doc);
    }
    if (!session_.otherHistory() || std::exchange(deciding_, true)) return;
    clock_.in(std::int64_t(settling_ ? 20'000 : 250'000 * number_), [this] {
        deciding_ = false;
        if (session_.joinOtherHistory()) ++joinsOfOther;
    });
}

/// ID4: the joined history and the lost work together have everything of the one before. The lost
/// work is reported as soon as all layers have been joined; the editor gets them later if its time
/// for a tick is short.
void SimClient::checkTold() {
    const auto regained = std::exchange(regained_, {});
    std::erase_if(told_, [this](const auto& one) { return !opened_.contains(one.first); });
    if (!leaving_) return;
    const std::string lacking = differenceFromTold(regained);
    hasAll_ = hasAll_ || lacking.empty();
    if (regained.empty() && !std::exchange(left_, false) && !told_.empty()) return;
    // Commits that followed in the same tick may have changed what was joined.
    if (!hasAll_ && !hasMoved_) throw SimFailure(lacking);
    leaving_ = hasAll_ = left_ = false;
    told_.clear();
}

std::string SimClient::differenceFromTold(const std::vector<client::AuthoredEdit>& regained) const {
    for (const auto& [layer, doc] : told_) {
        const LayerDoc* now = session_.confirmed(layer);
        LayerDoc all = now ? *now : LayerDoc();
        for (const AuthoredEdit& edit : regained)
            if (edit.layer == layer)
                require(all.apply(edit.path, edit.action).has_value(),
                        "lost work of another history does not apply");
        if (all.dump() != doc.dump())
            return "client" + std::to_string(number_) + ": what the other history lacks of " +
                   layer.value + " is not lost work\n" + textDifference(doc.dump(), all.dump());
    }
    return {};
}

// ---- rules that must hold

/// M12: every transaction was acknowledged or is lost work.
void SimClient::checkAnswered() const {
    for (const auto& [sequence, store] : madeFor)
        require(acknowledged_.contains(sequence) || lost_.contains(sequence),
                "transaction " + std::to_string(sequence) + " of client" + std::to_string(number_) +
                    " has disappeared");
}

void SimClient::compareEditor() const {
    for (const auto& [layer, doc] : editor_) {
        if (!session_.isJoined(layer)) continue;
        const LayerDoc* view = session_.view(layer);
        if (!view || *view == doc) continue;
        throw SimFailure("client" + std::to_string(number_) + " shows a different " + layer.value +
                         " (-) than its session's view (+)\n" +
                         textDifference(doc.dump(), view->dump()));
    }
}

/// AC8: it knows what it may do.
void SimClient::checkRights() const {
    const OwnRights& rights = session_.rights();
    require(rights.role() == server_.roleOf(user()), "a client does not know its role");
    for (const LayerId& layer : style_.layers) {
        for (std::size_t kind = 0; kind < kOpinionKindNames.size(); ++kind)
            require(rights.decide(layer, "/", OpinionKind(kind)).isAllowed ==
                        server_.rules()
                            .decide({user(), rights.role(), layer, "/", OpinionKind(kind)})
                            .isAllowed,
                    "a client does not know what it may write");
        for (std::size_t action = 0; action < kProjectActionNames.size(); ++action)
            require(rights.decide(ProjectAction(action), layer).isAllowed ==
                        server_.rules()
                            .decide(AccessRules::ActionQuestion{user(), rights.role(),
                                                                ProjectAction(action), layer})
                            .isAllowed,
                    "a client does not know which actions it may do");
    }
}

void SimClient::check(const std::map<LayerId, std::string>& truth) const {
    checkAnswered();
    checkRights();
    for (const LayerId& layer : opened_) {
        const std::string name = "client" + std::to_string(number_) + " " + layer.value;
        const std::string expected = truth.contains(layer) ? truth.at(layer) : LayerDoc().dump();
        const auto differs = [&](const char* what, const std::string& text) {
            if (text != expected)
                throw SimFailure(name + ": " + what + " (+) differs from the stored layer (-)\n" +
                                 textDifference(expected, text));
        };
        differs("confirmed", session_.confirmed(layer)->dump());
        differs("view", session_.view(layer)->dump());
        differs("editor", editor_.at(layer).dump());
        forEachBlob(editor_.at(layer), [&](const Value& blob) {
            require(blobs_.contains(blob.hash()), name + " lacks a big value that it shows");
        });
    }
}

}  // namespace usdlive::simulation
