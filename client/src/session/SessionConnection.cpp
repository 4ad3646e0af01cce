#include <algorithm>

#include "SessionImpl.h"

namespace usdlive::client {

namespace {

// Small frames are joined to messages of about this size.
constexpr std::size_t kMessageBytes = 256 * 1024;
constexpr std::int64_t kTellGestureEveryMs = 400;
constexpr std::int64_t kAskAgainMs = 1000;

constexpr std::string_view kPreviewValues = "previewValues";

std::string mib(std::uint64_t bytes) { return std::to_string((bytes + 1048575) >> 20) + " MiB"; }

Error largerThan(std::uint64_t most, std::uint64_t size, std::size_t edits) {
    return {ErrorCode::TransactionTooLarge,
            "what was written in one frame has " + std::to_string(edits) + " edits and " +
                mib(size) + ", and the server takes " + std::to_string(kMaxTransactionEdits) +
                " edits and " + mib(most) +
                " at once: write it in several frames, with tick() between them, or serve with a "
                "larger --max-transaction-mib"};
}

Error valueLargerThan(std::uint64_t most, std::uint64_t size) {
    return {ErrorCode::TransactionTooLarge,
            "a single value that was written has " + mib(size) + ", and the server takes " +
                mib(most) + ": write it part by part, or serve with a larger --max-frame-mib"};
}

// SE3: another server, or a store that was deleted or put back as it was before.
Error otherHistory(Epoch epoch, Epoch seen) {
    return {ErrorCode::HistoryDiverged,
            "the server has another history than this editor: its epoch is " +
                std::to_string(epoch) + ", and this editor has seen " + std::to_string(seen) +
                ". The project's .usdlive was deleted or replaced by an older one, or another "
                "server answers at this address. Put .usdlive back and start the server again, or "
                "close this connection and connect again: what was not sent is kept, and "
                "unsent_work() shows it"};
}

Error toError(const ErrorMessage& message) {
    return {errorFromName(message.code).value_or(ErrorCode::Internal),
            message.message.empty() ? message.code : message.message};
}

}  // namespace

// ---- the line

void Session::Impl::connected() {
    linked_ = true;
    forgotten_.reset();
    notResumed_.reset();
    inbox_.clear();
    Hello hello{.protocol = kProtocolVersion,
                .oldestProtocol = kOldestProtocolVersion,
                .features = options_.features,
                .client = options_.client,
                .user = options_.user,
                .application = options_.application,
                .resume = {},
                .open = {}};
    if (hasHistory_) {
        saidSince_ = isUnsettled();
        hello.resume = saidSince_ ? unsettled_->since : here();
        hello.open.emplace();
        for (const auto& [layer, opened] : layers_)
            if (opened.wanted && !opened.joining) hello.open->push_back(layer);
    }
    sendControl(hello);
}

Hello::Resume Session::Impl::here() const { return {commitEpoch_, revision_, hash_}; }

bool Session::Impl::isUnsettled() const {
    return unsettled_ && std::ranges::any_of(pending_, [&](const Pending& pending) {
               return pending.everSent && pending.transaction.id.sequence <= unsettled_->last;
           });
}

void Session::Impl::noteUnsettled() {
    std::uint64_t last = 0;
    for (const Pending& pending : pending_)
        if (pending.everSent) last = std::max(last, pending.transaction.id.sequence);
    if (last != 0) unsettled_ = {isUnsettled() ? unsettled_->since : here(), last};
}

void Session::Impl::disconnected(Error reason) {
    const bool wasLinked = std::exchange(linked_, false);
    online_ = false;
    // What has not been worked off comes again, but not what the server said at last.
    for (const Result<Received>& received : std::exchange(inbox_, {})) {
        const auto* control = received ? std::get_if<ControlMessage>(&*received) : nullptr;
        const auto* error = control ? std::get_if<ErrorMessage>(control) : nullptr;
        if (error) events_.push_back(event::ServerError{*error});
    }
    pending_.markAllUnsent();
    sending_.reset();
    if (gesture_) gesture_->disconnected();
    uploads_.disconnected();
    downloads_.disconnected();
    for (auto& [layer, opened] : layers_)
        if (opened.joining) opened.joinAnew();
    for (Peek& peek : peeks_) peek.snapshot = {};
    forgetOthers();
    for (LogReader& log : std::exchange(logs_, {})) log.done(tl::unexpected(reason));
    for (auto& [request, done] : std::exchange(asked_, {})) done(tl::unexpected(reason));
    for (const std::uint64_t request : std::exchange(requests_, {}))
        report({ErrorCode::NotConnected, "the connection was lost before the server had answered"},
               about(request));
    if (!previews_.empty()) previewsChanged();
    for (const auto& [id, preview] : std::exchange(previews_, {}))
        events_.push_back(event::PreviewChanged{id.first, id.second, true});
    if (wasLinked) events_.push_back(event::Disconnected{std::move(reason)});
}

void Session::Impl::received(ReceivedMessage message) {
    std::ranges::move(message.frames, std::back_inserter(inbox_));
}

bool Session::Impl::advance(double budgetMs, std::int64_t nowMs) {
    nowMs_ = nowMs;
    deadlineMs_ = options_.clockMs() + budgetMs;
    while (!inbox_.empty()) {
        Result<Received> received = std::move(inbox_.front());
        inbox_.pop_front();
        if (received)
            std::visit([this](auto&& part) { handle(std::move(part)); }, std::move(*received));
        else
            protocolFault(received.error());
        if (outOfTime()) break;
    }
    completeJoins();
    completePeeks();
    settle();
    sendAll();
    tellGesture();
    checkPrediction();
    return inbox_.empty() && !rebuild_ && !moreToSend_;
}

void Session::Impl::protocolFault(Error error) {
    // The host sees `closing` and ends the connection; the next one resumes.
    online_ = false;
    inbox_.clear();
    report(std::move(error), closing());
}

// ---- what arrives

void Session::Impl::handle(ControlMessage&& message) {
    std::visit([this](const auto& part) { on(part); }, message);
}

void Session::Impl::handle(PreviewFrame&& frame) {
    if (frame.author == options_.client) return;
    const std::pair id{frame.author, frame.gesture};
    const bool withdrawn = frame.edits.empty();
    if (withdrawn) {
        if (previews_.erase(id) == 0) return;
    } else {
        const auto entry = previews_.try_emplace(id).first;
        Preview& preview = entry->second;
        if (preview.slot == 0) preview.slot = ++lastSlot_;
        if (preview.waiting)
            preview.newest = std::move(frame);
        else
            present(*entry, std::move(frame));
        return;
    }
    previewsChanged();
    events_.push_back(event::PreviewChanged{id.first, id.second, withdrawn});
}

// Shows a preview, or waits for its big values. What is shown is never without them.
void Session::Impl::present(Previews::value_type& entry, PreviewFrame frame) {
    auto& [id, preview] = entry;
    preview.missing = missingOf(frame);
    if (preview.missing.empty()) {
        preview.waiting.reset();
        preview.frame = std::move(frame);
        previewsChanged();
        events_.push_back(event::PreviewChanged{id.first, id.second, false});
        return;
    }
    preview.waiting = std::move(frame);
    std::vector<Hash> toAsk;
    for (const Hash& hash : preview.missing)
        if (downloads_.want(hash, false, online_)) toAsk.push_back(hash);
    askForBlobs(toAsk);
}

// The one that waited is over. Those that came before the newest are passed over.
void Session::Impl::presentNewest(Previews::value_type& entry) {
    Preview& preview = entry.second;
    preview.waiting.reset();
    preview.missing.clear();
    if (auto newest = std::exchange(preview.newest, std::nullopt))
        present(entry, std::move(*newest));
}

// Other layers are joined than before, of which previews may name big values.
void Session::Impl::presentAgain() {
    for (auto& entry : previews_) {
        Preview& preview = entry.second;
        previewsChanged();
        auto frame = std::exchange(preview.frame, std::nullopt);
        for (auto* later : {&preview.waiting, &preview.newest})
            if (*later) frame = std::exchange(*later, std::nullopt);
        if (frame) present(entry, std::move(*frame));
    }
}

std::set<Hash> Session::Impl::missingOf(const PreviewFrame& frame) {
    std::vector<Value> blobs;
    for (const Edit& edit : frame.edits)
        if (confirmed_.contains(edit.layer)) collectBlobs(edit.action, blobs);
    std::set<Hash> missing;
    for (const Value& blob : blobs)
        if (!missing.contains(blob.hash()) && !host_.holdsBlob(blob.hash()))
            missing.insert(blob.hash());
    return missing;
}

void Session::Impl::handle(ReceivedSnapshot&& received) {
    for (auto& [layer, opened] : layers_) {
        if (!opened.joining || opened.joining->snapshot.request != received.request) continue;
        Incoming& snapshot = opened.joining->snapshot;
        snapshot.content = std::move(received.whole);
        if (!opened.wanted) return;
        editor_.arriving(layer, std::move(received.part));
        const std::uint64_t total = snapshot.opened ? snapshot.opened->specs : 0;
        events_.push_back(event::Joining{{layer, received.specs, total}});
        return;
    }
    for (Peek& peek : peeks_) {
        if (peek.snapshot.request != received.request) continue;
        peek.snapshot.content = std::move(received.whole);
        const std::uint64_t total = peek.snapshot.opened ? peek.snapshot.opened->specs : 0;
        events_.push_back(event::Progress{event::Progress::Task::Fetch, peek.layer, received.specs,
                                          total, received.request});
    }
}

void Session::Impl::handle(RefusalFrame&& frame) {
    const bool mendable =
        frame.error.code == ErrorCode::StaleBase || frame.error.code == ErrorCode::BlobNotFound;
    if (mendable && resubmit(frame.sequence)) return;
    if (auto pending = pending_.take(frame.sequence))
        lose(std::move(*pending), std::move(frame.error));
}

void Session::Impl::handle(ReceivedBlob&& blob) {
    if (!blob.whole)
        blobFailed(blob.hash, blob.whole.error());
    else if (*blob.whole)
        blobCame(blob.hash, std::move(*blob.whole));
}

void Session::Impl::blobCame(const Hash& hash, SharedBytes bytes) {
    const auto done = downloads_.arrived(hash);
    if (done.outcome != BlobDownloads::Outcome::Arrived) return;
    host_.blobArrived(hash, std::move(bytes), done.lasting);
    for (auto& entry : previews_) {
        auto& [id, preview] = entry;
        if (preview.missing.erase(hash) == 0 || !preview.missing.empty()) continue;
        preview.frame = std::move(preview.waiting);
        previewsChanged();
        events_.push_back(event::PreviewChanged{id.first, id.second, false});
        presentNewest(entry);
    }
}

void Session::Impl::blobFailed(const Hash& hash, Error error) {
    const auto done = downloads_.failed(hash, nowMs_);
    if (done.lasting && done.first) report(std::move(error), about(hash));
    if (done.outcome != BlobDownloads::Outcome::NotWanted)
        for (auto& entry : previews_)
            if (entry.second.missing.contains(hash)) presentNewest(entry);
}

void Session::Impl::askForBlobs(const std::vector<Hash>& hashes) {
    for (const Hash& hash : hashes) sendControl(RequestBlob{hash, 0});
}

void Session::Impl::handle(ReceivedCommit&& received) {
    const Commit& commit = received.commit;
    if (!logs_.empty() && logs_.front().begun) return logs_.front().each(commit);
    if (!online_ || commit.revision <= revision_ || commit.epoch < commitEpoch_) return;
    if (commit.revision - commit.conflated != revision_ + 1 || commit.previous != hash_) {
        hasHistory_ = false;
        freeze();
        return protocolFault(
            {ErrorCode::HistoryDiverged,
             "commit " + std::to_string(commit.revision) + " does not follow the one before"});
    }
    hash_ = received.hashAfter;
    commitEpoch_ = commit.epoch;
    apply(commit);
    events_.push_back(event::Committed{std::move(received.commit), false});
}

bool Session::Impl::isCaughtUp() const { return welcome_ && revision_ >= welcome_->revision; }

void Session::Impl::on(const Welcome& message) {
    if (message.epoch < epoch_) return protocolFault(otherHistory(message.epoch, epoch_));
    if (auto why = std::exchange(notResumed_, std::nullopt))
        events_.push_back(event::ServerError{*std::move(why)});
    welcome_ = message;
    epoch_ = message.epoch;
    online_ = true;
    takesPreviewValues_ = std::ranges::count(message.features, kPreviewValues) > 0;
    takesParts_ = std::ranges::count(message.features, kPartsFeature) > 0;
    layerStates_.clear();  // the server says again what is to say of them
    // The client is not at the revision that it said.
    const bool resumed = message.resumed && !std::exchange(saidSince_, false);
    if (!resumed && forgotten_) loseSent(*forgotten_);
    if (!resumed) {
        if (hasHistory_) {
            noteUnsettled();
            freeze();
        }
        revision_ = message.revision;
        hash_ = message.hash;
        commitEpoch_ = 0;
        hasHistory_ = true;
    }
    for (auto& [layer, opened] : layers_)
        if (opened.joining) ask(opened.joining->snapshot, layer, 0);
    for (Peek& peek : peeks_) ask(peek.snapshot, peek.layer, peek.revision);
    for (Missed& missed : missed_) missed.asked = false;
    readMissed();
    if (gesture_) gesture_->changed = !gesture_->pending.authored.empty();
    events_.push_back(event::Connected{message, resumed});
}

// M14: nobody knows whether what was sent and not answered is committed.
void Session::Impl::loseSent(const Error& why) {
    std::vector<std::uint64_t> sent;
    for (const Pending& pending : pending_)
        if (pending.everSent) sent.push_back(pending.transaction.id.sequence);
    for (const std::uint64_t sequence : sent) lose(*pending_.take(sequence), why);
}

void Session::Impl::on(const ProjectLayers& message) {
    if (!welcome_) return;
    welcome_->layers = message.layers;
    event::LayersChanged changed;
    for (const LayerInfo& info : message.layers) changed.layers.push_back(info.layer);
    events_.push_back(std::move(changed));
}

void Session::Impl::on(const LayerOpened& message) {
    for (auto& [layer, opened] : layers_)
        if (opened.joining && opened.joining->snapshot.request == message.request)
            opened.joining->snapshot.opened = message;
    for (Peek& peek : peeks_)
        if (peek.snapshot.request == message.request) peek.snapshot.opened = message;
}

void Session::Impl::on(const BlobStored& message) { uploads_.stored(message.hash); }

// Its commit was missed with a history that is gone: what it did is in the layers as they were
// joined again, and what was dropped of it only its commit says (M12). Otherwise its commit is on
// its way.
void Session::Impl::on(const AlreadyCommitted& message) {
    if (message.revision > revision_) return;
    auto pending = pending_.take(message.sequence);
    if (!pending) return;
    disturb();
    missed_.push_back({message.revision, std::move(*pending)});
    readMissed();
}

// A server reads a few logs at once for a client, and there may be many of these.
void Session::Impl::readMissed() {
    constexpr std::ptrdiff_t kAtOnce = 8;
    auto asked = std::ranges::count(missed_, true, &Missed::asked);
    for (std::size_t index = 0; index < missed_.size() && asked < kAtOnce; ++index) {
        if (missed_[index].asked) continue;
        missed_[index].asked = true;
        ++asked;
        readMissed(missed_[index]);
    }
}

void Session::Impl::readMissed(const Missed& missed) {
    const std::uint64_t sequence = missed.pending.transaction.id.sequence;
    const auto found = [this, sequence] {
        return std::find_if(missed_.begin(), missed_.end(), [&](const Missed& other) {
            return other.pending.transaction.id.sequence == sequence;
        });
    };
    const auto each = [this, found](const Commit& commit) {
        const auto entry = found();
        if (entry == missed_.end() || commit.id != entry->pending.transaction.id) return;
        if (!commit.dropped.empty()) reportDropped(entry->pending, commit);
        missed_.erase(entry);
        events_.push_back(event::Committed{commit, true});
        readMissed();
    };
    const auto done = [this, found](const Result<void>& read) {
        const auto entry = found();
        if (!online_ || entry == missed_.end()) return;  // asked again, or answered
        events_.push_back(
            event::Lost{{.sequence = entry->pending.transaction.id.sequence,
                         .gesture = entry->pending.transaction.gesture,
                         .reason = {read ? ErrorCode::HistoryDiverged : read.error().code,
                                    "it was committed in a history that cannot be read any more"},
                         .refused = false,
                         .edits = std::move(entry->pending.authored)}});
        missed_.erase(entry);
        readMissed();
    };
    requestLog(missed.revision, missed.revision, each, done);
}

template <class Event, class Answer>
void Session::Impl::answer(const Answer& message) {
    requests_.erase(message.request);
    events_.push_back(Event{message});
}

void Session::Impl::on(const LayersSaved& message) { answer<event::Saved>(message); }
void Session::Impl::on(const LayersReloaded& message) { answer<event::Reloaded>(message); }
void Session::Impl::on(const CheckpointCreated& message) { answer<event::CheckpointMade>(message); }
void Session::Impl::on(const Checkpoints& message) { answer<event::CheckpointsListed>(message); }

void Session::Impl::answerAsked(std::uint64_t request, Result<ControlMessage> answer) {
    if (auto asked = asked_.extract(request)) asked.mapped()(std::move(answer));
}

void Session::Impl::on(const LayerCreated& message) { answer<event::LayerMade>(message); }
void Session::Impl::on(const SkippedFiles& message) { answer<event::SkippedListed>(message); }

void Session::Impl::on(const RequestProgress& message) {
    using Task = event::Progress::Task;
    if (message.task != "import" && message.task != "save") return;
    const Task task = message.task == "save" ? Task::Save : Task::Import;
    events_.push_back(
        event::Progress{task, message.layer, message.done, message.total, message.request});
}

void Session::Impl::on(const LayerStates& message) {
    for (const LayerState& state : message.layers) layerStates_[state.layer] = state;
    events_.push_back(event::LayerStatesChanged{message.layers});
}

void Session::Impl::on(const LogBegin& message) {
    if (!logs_.empty() && logs_.front().request == message.request) logs_.front().begun = true;
}

void Session::Impl::on(const LogEnd& message) {
    if (logs_.empty() || logs_.front().request != message.request) return;
    const LogReader log = std::move(logs_.front());
    logs_.pop_front();
    log.done({});
}

void Session::Impl::on(const ErrorMessage& message) {
    const Error error = toError(message);
    if (answered(message, error)) return;
    if (error.code == ErrorCode::ClientForgotten && !online_) forgotten_ = error;
    if (error.code == ErrorCode::HistoryDiverged && !online_ && !message.closing) {
        notResumed_ = message;  // the welcome decides what is to be said
        return;
    }
    if (message.blob) {
        if (downloads_.isAsked(*message.blob)) return blobFailed(*message.blob, error);
        uploads_.refused(*message.blob, error.code, nowMs_);
    }
    events_.push_back(event::ServerError{message});
}

// Is it the answer to a request whose asker is told in another way?
bool Session::Impl::answered(const ErrorMessage& message, const Error& error) {
    if (!message.request) return false;
    for (auto entry = layers_.begin(); entry != layers_.end(); ++entry) {
        auto& joining = entry->second.joining;
        if (!joining || joining->snapshot.request != *message.request) continue;
        // The store comes back, and work of one's own may wait for this layer.
        if (joining->again && error.code == ErrorCode::StorageFailed) {
            entry->second.joinAnew();
            joining->askAtMs = nowMs_ + kAskAgainMs;
            return false;
        }
        if (entry->second.wanted) events_.push_back(event::JoinFailed{entry->first, error});
        if (frozen_) frozen_->views.erase(entry->first);
        layers_.erase(entry);
        return true;
    }
    const auto peek = std::find_if(peeks_.begin(), peeks_.end(), [&](const Peek& candidate) {
        return candidate.snapshot.request == *message.request;
    });
    if (peek != peeks_.end()) {
        const auto done = std::move(peek->done);
        peeks_.erase(peek);
        done(tl::unexpected(error), 0);
        return true;
    }
    const auto log = std::find_if(logs_.begin(), logs_.end(), [&](const LogReader& candidate) {
        return candidate.request == *message.request;
    });
    if (log != logs_.end()) {
        const auto done = std::move(log->done);
        logs_.erase(log);
        done(tl::unexpected(error));
        return true;
    }
    if (asked_.contains(*message.request)) {
        answerAsked(*message.request, tl::unexpected(error));
        return true;
    }
    requests_.erase(*message.request);
    return false;
}

// ---- what is sent

void Session::Impl::sendControl(const ControlMessage& message) {
    host_.send(std::make_shared<const Bytes>(encodeFrame(ControlFrame{encodeControl(message)})));
}

void Session::Impl::ask(Incoming& snapshot, const LayerId& layer, Revision revision) {
    snapshot = {};
    snapshot.request = ++lastRequest_;
    sendControl(OpenLayer{snapshot.request, layer, revision});
}

/// Layers that were joined before, and that the server could not read when they were asked for.
void Session::Impl::askAgain() {
    for (auto& [layer, opened] : layers_) {
        if (!opened.joining || !opened.joining->askAtMs || *opened.joining->askAtMs > nowMs_)
            continue;
        opened.joining->askAtMs.reset();
        ask(opened.joining->snapshot, layer, 0);
    }
}

void Session::Impl::sendAll() {
    moreToSend_ = false;
    if (online_) {
        askForBlobs(
            downloads_.due(nowMs_, [this](const Hash& hash) { return host_.needsBlob(hash); }));
        askAgain();
    }
    if (!online_ || !isCaughtUp() || frozen_) return;
    sendTransactions();
    uploads_.dropUnwanted();
    if (host_.takesMore()) uploads_.send(options_.uploadWindowChunks, nowMs_);
    if (const auto progress = uploads_.progress(nowMs_)) events_.push_back(*progress);
    sendPreview();
    sendPresence();
}

void Session::Impl::sendTransactions() {
    if (!sendParts()) return;
    const auto ready = [this](const Pending& pending) { return uploads_.ready(pending.blobs); };
    Bytes message;
    const auto flush = [&] {
        if (!message.empty()) host_.send(std::make_shared<const Bytes>(std::move(message)));
        message = {};
    };
    std::vector<std::pair<std::uint64_t, Error>> tooLarge;
    std::size_t count = 0;
    for (Pending* pending : pending_.sendable(ready, !dirty_)) {
        if (outOfTime(++count)) {
            moreToSend_ = true;
            break;
        }
        readdress(*pending);
        pending_.rebase(*pending, revision_);
        const Transaction& transaction = pending->transaction;
        const std::uint64_t whole =
            takesParts_ ? std::min(options_.wholeBytes, frameLimit()) : frameLimit();
        std::uint64_t size = leastFrameBytes(transaction.edits);
        Bytes frame;
        if (size <= whole) {
            frame = encodeFrame(SubmitFrame{transaction});
            size = frame.size();
        }
        if (size > transactionLimit() || transaction.edits.size() > kMaxTransactionEdits) {
            tooLarge.emplace_back(transaction.id.sequence,
                                  largerThan(transactionLimit(), size, transaction.edits.size()));
            continue;
        }
        if (frame.empty() || size > whole) {
            flush();
            pending_.markSent(*pending, size);
            sending_ = Sending{transaction.id.sequence, {}};
            if (!sendParts()) break;
            continue;
        }
        if (message.size() + frame.size() > kMessageBytes) flush();
        message.insert(message.end(), frame.begin(), frame.end());
        pending_.markSent(*pending, frame.size());
    }
    flush();
    for (auto& [sequence, error] : tooLarge) lose(*pending_.take(sequence), std::move(error));
    if (dirty_) rebuild();
}

std::uint64_t Session::Impl::frameLimit() const {
    return welcome_->maxFrameBytes > 0 ? welcome_->maxFrameBytes : kMaxFrameBytes;
}
std::uint64_t Session::Impl::transactionLimit() const {
    return takesParts_ ? welcome_->maxTransactionBytes.value_or(kMaxTransactionBytes)
                       : frameLimit();
}

// FR8. False: there is more of it to send, and nothing else goes before that.
bool Session::Impl::sendParts() {
    while (sending_) {
        Pending* pending = pending_.find(sending_->sequence);
        if (!pending) {  // refused meanwhile
            sending_.reset();
            break;
        }
        if (!host_.takesMore()) return false;
        if (outOfTime() && sending_->at.part > 0) {
            moreToSend_ = true;
            return false;
        }
        const std::size_t bytes = std::min<std::uint64_t>(options_.partBytes, frameLimit() / 2);
        Bytes part = encodePart(pending->transaction, sending_->at, bytes);
        if (part.size() > frameLimit()) {
            const std::uint64_t sequence = std::exchange(sending_, std::nullopt)->sequence;
            lose(*pending_.take(sequence), valueLargerThan(frameLimit(), part.size()));
            rebuild();
            break;
        }
        if (sending_->at.isEnd) sending_.reset();
        host_.send(std::make_shared<const Bytes>(std::move(part)));
    }
    return true;
}

void Session::Impl::sendPreview() {
    if (!gesture_ || (!gesture_->outgoing && !preparePreview()) || !sendPreviewValues()) return;
    gesture_->shown = true;
    gesture_->named = std::move(gesture_->outgoing->named);
    host_.send(std::move(gesture_->outgoing->frame));
    gesture_->outgoing.reset();
}

// B3. While a preview is on its way, all that is edited waits for the next one.
bool Session::Impl::preparePreview() {
    if (!gesture_->due(nowMs_)) return false;
    PreviewFrame preview = gesture_->preview();
    std::vector<Value> blobs;
    for (const Edit& edit : preview.edits) collectBlobs(edit.action, blobs);
    Gesture::Outgoing outgoing{std::make_shared<const Bytes>(encodeFrame(preview)), {}, 0, {}};
    gesture_->bytes = outgoing.frame->size();
    gesture_->sentMs = nowMs_;
    gesture_->changed = false;
    if (gesture_->bytes > Gesture::kMaxPreviewBytes) return false;
    std::uint64_t named = 0;
    for (const Value& blob : blobs) {
        if (uploads_.isStored(blob.hash()) || !outgoing.named.insert(blob.hash()).second) continue;
        named += blob.size();
        if (gesture_->named.contains(blob.hash())) continue;
        SharedBytes bytes = host_.localBlob(blob.hash());
        if (!bytes) continue;  // it came from the server
        gesture_->bytes += bytes->size();
        outgoing.values.push_back({blob.hash(), std::move(bytes)});
    }
    if (named > Gesture::kMaxPreviewValueBytes || (named > 0 && !takesPreviewValues_)) return false;
    gesture_->outgoing = std::move(outgoing);
    return true;
}

// False: some are still to be sent.
bool Session::Impl::sendPreviewValues() {
    auto& [frame, values, offset, named] = *gesture_->outgoing;
    std::size_t chunks = options_.uploadWindowChunks;
    while (!values.empty()) {
        if (chunks-- == 0 || !host_.takesMore()) return false;
        const auto& [hash, bytes] = values.front();
        BlobFrame part = blobPart(hash, *bytes, offset);
        part.gesture = gesture_->pending.transaction.gesture;
        host_.send(std::make_shared<const Bytes>(encodeFrame(part)));
        offset += part.rawBytes;
        if (offset < bytes->size()) continue;
        values.pop_front();
        offset = 0;
    }
    return true;
}

// An open gesture is work, too; its host hears of it from time to time.
void Session::Impl::tellGesture() {
    if (!gesture_ || !gesture_->untold || nowMs_ - gestureToldMs_ < kTellGestureEveryMs) return;
    gestureToldMs_ = nowMs_;
    gesture_->untold = false;
    tellPending(gesture_->pending);
}

void Session::Impl::withdrawPreview(std::uint64_t gesture) {
    if (gesture == 0 || !online_) return;
    host_.send(std::make_shared<const Bytes>(
        encodeFrame(PreviewFrame{options_.client, gesture, revision_, {}})));
}

}  // namespace usdlive::client
