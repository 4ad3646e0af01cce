// The real Session with a simulated editor, as a machine of the model.
#include "ModelClient.h"

#include <bit>

#include "session/SessionImpl.h"
#include "simulation/SimClock.h"
#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::model {

using namespace client;
using simulation::require;

static void digest(Digest& out, const AuthoredEdit& part) {
    const auto& [layer, path, action] = part;
    out(layer, path, action);
}
static void digest(Digest& out, const Touched& part) {
    const auto& [layer, path] = part;
    out(layer, path);
}
static void digest(Digest& out, const Expectation& part) {
    const auto& [touched, names, complete, refused] = part;
    out(touched, names, complete, refused);
}
static void digest(Digest& out, const Pending& part) {
    const auto& [transaction, authored, expectation, blobs, sent, everSent, changedSince, sentBytes,
                 attempts, carried, places, placesOf] = part;
    out(transaction, authored, expectation, blobs, sent, everSent, changedSince,
        sent ? sentBytes : std::size_t(0), attempts, carried, places, placesOf);
}
static void digest(Digest& out, const Prediction::Moves::Move& part) {
    const auto& [from, to, edit] = part;
    out(from, to, edit);
}
static void digest(Digest& out, const Prediction::Moves::Created& part) {
    const auto& [path, time, edit] = part;
    out(path, time, edit);
}
static void digest(Digest& out, const Prediction::Moves& part) {
    out(part.moves_, part.created_);  // the indices follow from them
}
static void digest(Digest& out, const Prediction::LayerNotes& part) {
    const auto& [created, fields, structural, moves, editsPlaces] = part;
    out(created, fields, structural, moves, editsPlaces);
}
static void digest(Digest& out, const Prediction& part) {
    out(part.docs_, part.openedAt_, part.names_, part.creations_, part.notes_);
}
static void digest(Digest& out, const Incoming& part) {
    const auto& [request, opened, content] = part;
    // The content of a snapshot follows from its revision.
    out(request, opened ? encodeControl(*opened) : "", content.has_value());
}
static void digest(Digest& out, const JoiningLayer& part) {
    const auto& [snapshot, later, again] = part;
    out(snapshot, later, again);
}
static void digest(Digest& out, const OpenedLayer& part) {
    const auto& [wanted, joining] = part;
    out(wanted, joining);
}
static void digest(Digest& out, const ReceivedCommit& part) {
    out(encodeFrame(CommitFrame{part.commit}), part.hashAfter);
}
static void digest(Digest& out, const Acceptance& part) { out(encodeAcceptance(part)); }
static void digest(Digest& out, const RefusalFrame& part) { out(encodeFrame(part)); }
static void digest(Digest& out, const PreviewFrame& part) { out(encodeFrame(part)); }
static void digest(Digest& out, const ReceivedBlob& blob) {
    if (!blob.whole) return out(blob.hash, blob.whole.error());
    out(blob.hash, *blob.whole != nullptr);
}
static void digest(Digest& out, const ReceivedSnapshot& part) {
    out(part.request, part.specs, part.whole);
}
static void digest(Digest& out, const Received& part) {
    std::visit([&](const auto& frame) { digest(out, frame); }, part);
}
static void digest(Digest& out, const Result<Received>& part) {
    require(part.has_value(), "a server's frame cannot be read");
    digest(out, *part);
}

static void digest(Digest& out, const MissedWork::Work& part) {
    const auto& [revision, pending, asked] = part;
    out(revision, pending, asked);
}
static void digest(Digest& out, const Requests::LogReader& part) { out(part.request, part.begun); }

static void digest(Digest& out, const HistoryPoint& part) {
    const auto& unanswered = part.unanswered_;
    out(part.isKnown_, part.revision_, part.hash_, part.store_, part.epoch_, part.commitEpoch_,
        part.diverged_, part.forgotten_.has_value(), part.other_.has_value(),
        part.accepted_.has_value(), unanswered ? unanswered->since : Revision(0),
        unanswered ? unanswered->last : std::uint64_t(0));
}
static void digest(Digest& out, const EditorView& part) {
    out(part.frozen_, part.prediction_, part.outdated_, part.resets_);
}

// Left out: parts that the model does not use (gestures and previews, big values, peeks, saves, a
// prediction that is not finished within a tick), parts that follow from the rest of the pending
// work, the events, which are taken at once, and the parts of the welcome that are always the same.
static void digest(Digest& out, const Session::Impl& part) {
    const auto& welcome = part.channel_.welcome();
    const auto& held = part.submissions_.held_;
    out(welcome.has_value(), welcome ? welcome->revision : Revision(0), part.point_,
        part.pending_.pending_, part.pending_.lastSequence_, part.channel_.isOnline(), part.linked_,
        part.inbox_, part.requests_.last_, part.confirmed_, part.log_, part.creations_,
        part.opened_.layers_, part.opened_.askAgainAt_.size(), part.view_, part.missed_.works_,
        part.requests_.logs_, held.has_value(), held && held->tried,
        part.abandoned_ ? part.abandoned_->docs : LayerDocs{});
}

ModelClient::ModelClient(const Scenario& scenario, std::size_t number, Messages& messages)
    : scenario_(scenario),
      number_(number),
      messages_(messages),
      session_({.client = {number == 0 ? "ada" : "bob"},
                .user = {number == 0 ? "ada" : "bob"},
                .application = "model",
                .features = {"history", "log", "previews", "resends"},
                .clockMs = [] { return 0.0; },
                .checksPrediction = true},
               *this, *this) {
    session_.openLayer(kLayer);
}

std::vector<Output> ModelClient::apply(Input input) {
    switch (input.kind) {
        case Input::Connect:
            reader_.emplace();
            session_.connected();
            break;
        case Input::Disconnect:
            session_.disconnected({ErrorCode::NotConnected, "the line is cut"});
            break;
        case Input::Receive:
            session_.received(reader_->read(*messages_[input.argument]));
            break;
        case Input::Write:
            write();
            break;
        case Input::Toggle:
            toggle();
            break;
        default:
            break;
    }
    if (input.kind == Input::Tick || !scenario_.ownTicks) tick();
    checkEditor();
    return std::exchange(outputs_, {});
}

void ModelClient::digest(Digest& out) const {
    out(editor_, wanted_, written_, authored_, lost_, acknowledged_, notified_, told_, leaving_);
    out(*session_.impl_);
}

ModelClient::Summary ModelClient::summary() const {
    const LayerDoc* confirmed = session_.confirmed(kLayer);
    return {.online = session_.isConnected(),
            .joined = session_.isJoined(kLayer),
            .wanted = wanted_,
            .hasHistory = session_.impl_->point_.isKnown_,
            .upToDate = session_.pendingTransactions() == 0 &&
                        (!wanted_ || (confirmed && *confirmed == editor_)),
            .revision = session_.revision(),
            .holds = session_.impl_->submissions_.held_.has_value(),
            .hash = session_.impl_->point_.hash_,
            .confirmed = confirmed ? sha256(asBytes(confirmed->dump())) : Hash{},
            .written = written_,
            .authored = authored_,
            .pending = pendingLabels(),
            .lost = lost_,
            .acknowledged = acknowledged_};
}

Labels ModelClient::pendingLabels() const {
    Labels labels = 0;
    const auto add = [&](const Pending& pending) {
        for (const AuthoredEdit& edit : pending.authored)
            if (const auto label = labelOf(edit.action)) labels |= 1u << *label;
    };
    for (const Pending& pending : session_.impl_->pending_) add(pending);
    session_.impl_->missed_.forEach(add);
    return labels;
}

// ---- actions of the editor

void ModelClient::write() {
    const auto& script = scenario_.scripts[number_];
    if (written_ == script.size() || !session_.isJoined(kLayer) ||
        session_.impl_->view_.resets_.contains(kLayer))
        return;
    auto edits = script[written_](editor_, Label(number_ * 16 + written_));
    if (edits.empty()) return;
    ++written_;
    for (const AuthoredEdit& edit : edits) {
        require(editor_.apply(edit.path, edit.action).has_value(), "the script does not apply");
        if (const auto label = labelOf(edit.action)) authored_ |= 1u << *label;
    }
    const Labels before = pendingLabels();
    const std::uint64_t writtenAgain = session_.writtenAgain();
    session_.author(std::move(edits));
    // SE15: labels that these edits replaced are never committed; they count as lost.
    const Labels replaced = before & ~pendingLabels();
    require(std::popcount(replaced) <= int(session_.writtenAgain() - writtenAgain),
            "a pending edit disappeared and was not written again");
    lost_ |= replaced;
}

void ModelClient::toggle() {
    wanted_ = !wanted_;
    if (wanted_)
        session_.openLayer(kLayer);
    else
        session_.closeLayer(kLayer);
}

void ModelClient::tick() {
    constexpr std::int64_t kLaterMs = 10'000;  // so that no pause lasts beyond a tick
    const LayerDoc* confirmed = session_.confirmed(kLayer);
    if (session_.otherHistory() && !leaving_)
        told_ = confirmed ? std::optional(*confirmed) : std::nullopt;
    session_.advance(1e9, nowMs_ += kLaterMs);
    for (const Event& event : session_.takeEvents())
        std::visit([this](const auto& one) { on(one); }, event);
    checkTold();
    if (!session_.otherHistory() || !std::exchange(stopped_, false)) return;
    // ID4: the person decides at once, so that a search does not connect for ever.
    require(session_.joinOtherHistory().has_value(), "the other history cannot be joined");
    session_.disconnected({ErrorCode::HistoryDiverged, "the session has stopped"});
    outputs_.push_back({.closes = true});
}

// ID4: the joined history and the lost work together have everything of the one before.
void ModelClient::checkTold() {
    const auto regained = std::exchange(regained_, {});
    if (!wanted_) told_.reset();
    if (!leaving_ || (told_ && !std::exchange(left_, false))) return;
    leaving_ = false;
    if (!told_) return;
    LayerDoc all = *session_.confirmed(kLayer);
    for (const AuthoredEdit& edit : regained)
        require(all.apply(edit.path, edit.action).has_value(),
                "lost work of another history does not apply");
    require(all.dump() == told_->dump(), "what the other history lacks is not lost work");
    told_.reset();
}

// ---- events from the session

void ModelClient::send(SharedBytes frames) {
    outputs_.push_back({.message = messages_.number(frames)});
}

void ModelClient::reset(const LayerId&, const LayerDoc& doc) {
    require(wanted_, "the session shows a closed layer");
    editor_ = doc;
}

void ModelClient::apply(const LayerId&, const std::string& path, const EditAction& action) {
    const auto applied = editor_.apply(path, action);
    require(applied.has_value(), "an edit does not apply to the layer that the editor shows");
}

void ModelClient::on(const event::Lost& event) {
    require(!event.work.edits.empty(), "lost work was reported without its edits");
    require(!errorPasses(event.work.reason.code), "work is lost for a reason that passes");
    if (scenario_.flaw == Flaw::Hides) return;
    if (event.work.sequence == 0 && event.work.reason.code == ErrorCode::HistoryDiverged) {
        regained_ = event.work.edits;
        return;
    }
    if (event.work.reason.code == ErrorCode::DeletedUnseen) return;  // it was committed (M17)
    for (const AuthoredEdit& edit : event.work.edits) {
        const auto label = labelOf(edit.action);
        if (!label) continue;
        require(!(lost_ & 1u << *label), "work is lost twice");
        lost_ |= 1u << *label;
    }
}

void ModelClient::on(const event::Committed& event) {
    require(notified_ == 0 || event.commit.revision == notified_ + 1,
            "the received commits have a gap");
    notified_ = event.commit.revision;
    if (event.commit.id.client != session_.id()) return;
    const auto add = [this](const EditAction& action) {
        if (const auto label = labelOf(action)) acknowledged_ |= 1u << *label;
    };
    for (const Edit& edit : event.commit.edits) add(edit.action);
    for (const DroppedEdit& dropped : event.commit.dropped) add(dropped.edit.action);
}

void ModelClient::on(const event::Connected& event) {
    if (event.resumed) return told_.reset();
    notified_ = event.welcome.revision;
    leaving_ = event.leftHistory && told_.has_value();
}

void ModelClient::on(const event::Joined&) { left_ = leaving_; }

void ModelClient::on(const event::ServerError& event) {
    stopped_ = event.message.closing && session_.otherHistory();
    require(!event.message.closing || stopped_,
            "the session ends: " + event.message.code + " " + event.message.message);
    require(event.message.message.find("diverged and is fetched") == std::string::npos,
            event.message.message);
}

// The editor requests the layer again.
void ModelClient::on(const event::JoinFailed&) { session_.openLayer(kLayer); }

// ---- rules that hold in each state of one client

// M7, M6: the editor shows the session's view; without pending work this is the confirmed layer.
void ModelClient::checkEditor() const {
    const LayerDoc* view = session_.view(kLayer);
    if (!view || (scenario_.ownTicks && session_.impl_->view_.resets_.contains(kLayer))) return;
    require(*view == editor_, "the editor's layer differs from the session's view");
    const LayerDoc* confirmed = session_.confirmed(kLayer);
    if (confirmed && session_.pendingTransactions() == 0 && !session_.impl_->view_.outdated_)
        require(*confirmed == *view,
                "nothing is pending, but the view differs from the confirmed layer");
}

}  // namespace usdlive::model
