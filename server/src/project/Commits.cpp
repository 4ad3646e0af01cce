// What was executed, until it is durable and everybody has been told.
#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "ProjectImpl.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kSurelyDecoded = 8 * 1024;  // a frame within the budget, whatever it holds

}  // namespace

/// Of what was executed, the next commit; nothing when it does not fit into a frame. `mark`: of the
/// NamespaceLog before it.
std::optional<std::pair<InFlightCommit, CommitRecord>> Project::Impl::makeCommit(
    const UserName& user, const TransactionId& id, std::uint64_t gesture, Executed executed,
    std::uint64_t mark) {
    InFlightCommit made;
    CommitRecord record;
    record.revision = made.revision = executed_ + 1;
    record.id = made.id = id;
    made.user = user;
    record.namespaceChanges = namespaceChanges(made.revision, executed.edits);
    made.gesture = gesture;
    made.edits = executed.edits.size();
    made.dropped = executed.dropped.size();
    made.mark = mark;

    Commit commit{made.revision,
                  epoch_,
                  made.id,
                  user,
                  ports_.clock.wallClockMs(),
                  gesture,
                  {},
                  {},
                  std::move(executed.dropped),
                  executedHash_};
    const auto note = [&](const Value& blob) { made.blobs.push_back(blob.hash()); };
    for (const DroppedEdit& dropped : commit.dropped) forEachBlob(dropped.edit.action, note);
    commit.edits.reserve(executed.edits.size());
    for (ExecutedEdit& edit : executed.edits) {
        made.layers.insert(edit.edit.layer);
        if (touchesLayerData(edit.edit.action)) made.layerData.insert(edit.edit.layer);
        forEachBlob(edit.edit.action, note);
        commit.edits.push_back(std::move(edit.edit));
    }
    record.layers = made.layers;
    record.frame = encodeCommit(commit);
    if (!record.frame) return std::nullopt;
    record.hash = made.hash = chainHash(executedHash_, withoutLength(*record.frame));
    made.broadcast = record.frame;
    history_.executed(made.revision);
    return std::pair(std::move(made), std::move(record));
}

/// One frame, or where none can hold it all its parts one after the other (FR8). Nothing: it is too
/// large for that, too.
SharedBytes Project::Impl::encodeCommit(const Commit& commit) const {
    const std::size_t whole = std::min(options_.wholeCommitBytes, options_.maxFrameBytes);
    if (leastFrameBytes(commit.edits) <= whole) {
        Bytes frame = encodeFrame(CommitFrame{commit});
        const ByteView encoded = withoutLength(frame);
        // FR7: one that refers to the same things too often, nobody would take.
        if (encoded.size() <= whole && (encoded.size() <= kSurelyDecoded || decodeFrame(encoded)))
            return std::make_shared<const Bytes>(std::move(frame));
    }
    Bytes frames;
    constexpr std::size_t kLeastEditBytes = 32;  // FR7
    for (PartsAt at; !at.isEnd;) {
        const std::size_t before = at.edit + at.dropped;
        const Bytes part =
            encodePart(commit, at, std::min(options_.partBytes, options_.maxFrameBytes / 2));
        const std::size_t edits = at.edit + at.dropped - before;
        if (withoutLength(part).size() > options_.maxFrameBytes ||
            withoutLength(part).size() < edits * kLeastEditBytes ||
            frames.size() + part.size() > options_.maxTransactionBytes)
            return nullptr;
        appendBytes(frames, part);
    }
    if (!isInParts(frames) && !decodeFrame(withoutLength(frames))) return nullptr;
    return std::make_shared<const Bytes>(std::move(frames));
}

/// False, and nothing done, when the commit does not fit into a frame.
bool Project::Impl::commit(Session& session, Author& author, const Transaction& transaction,
                           Executed executed, std::uint64_t mark) {
    auto commit = makeCommit(session.subject.user, transaction.id, transaction.gesture,
                             std::move(executed), mark);
    if (!commit) return false;
    auto& [made, record] = *commit;
    // Its author could not read it.
    if (isInParts(*record.frame) && !session.features.contains(kPartsFeature)) return false;
    made.session = session.id;
    author.inFlight[transaction.id.sequence] = made.revision;
    author.newest = made.revision;
    append(std::move(made), std::move(record));
    return true;
}

void Project::Impl::append(InFlightCommit commit, CommitRecord record) {
    for (const LayerId& layer : commit.layers) {
        LayerEntry& entry = layers_[layer];
        entry.changed = commit.revision;
        entry.replayCost += replayCost(record.frame->size(), commit.edits);
        if (!entry.told.dirty) suspects_.insert(layer);
    }
    for (const LayerId& layer : commit.layerData) {
        suspects_.insert(layer);
        access_.noteSpecLocks(layer, docs_);
    }
    unusedBlobs_.named(commit.blobs, commit.revision);
    executed_ = commit.revision;
    executedHash_ = commit.hash;
    for (const LayerId& layer : commit.layers) takeSnapshot(layer);
    inFlight_.push_back(std::move(commit));
    ports_.history.append(std::move(record));
}

void Project::Impl::takeSnapshot(const LayerId& layer) {
    LayerEntry& entry = layers_[layer];
    const auto doc = docs_.find(layer);
    if (doc == docs_.end() || entry.takesSnapshot) return;
    if (entry.replayCost < snapshotDue(doc->second, entry.snapshotBytes, options_.leastReplay))
        return;
    const std::int64_t now = ports_.clock.wallClockMs();
    if (entry.snapshotMs && std::abs(now - *entry.snapshotMs) < options_.snapshotIntervalMs) return;
    entry.snapshotMs = now;
    entry.replayCost = 0;
    entry.takesSnapshot = true;
    readySnapshots_.push_back({layer, doc->second, executed_, executedHash_});
}

void Project::Impl::keepSnapshots() {
    while (!readySnapshots_.empty() && readySnapshots_.front().revision <= durable_) {
        const ReadySnapshot& ready = readySnapshots_.front();
        ports_.history.keepSnapshot(ready.layer, ready.doc, ready.revision, ready.hash);
        readySnapshots_.pop_front();
    }
}

void Project::Impl::snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes) {
    LayerEntry& entry = layers_[layer];
    entry.takesSnapshot = false;
    if (bytes) entry.snapshotBytes = *bytes;
}

void Project::Impl::appended(Revision upTo) {
    while (!inFlight_.empty() && inFlight_.front().revision <= upTo) {
        const InFlightCommit commit = std::move(inFlight_.front());
        inFlight_.pop_front();
        commitDurable(commit);
    }
    settle();
}

void Project::Impl::commitDurable(const InFlightCommit& commit) {
    durable_ = commit.revision;
    durableHash_ = commit.hash;
    // Not by what was executed: that may be taken back, and then nobody's base would be young
    // enough.
    if (durable_ > options_.namespaceLogRevisions)
        history_.prune(durable_ - options_.namespaceLogRevisions);
    recent_.add({commit.revision, commit.broadcast, commit.hash});
    ++counters_.commits;
    counters_.edits += commit.edits;
    counters_.dropped += commit.dropped;
    if (commit.gesture != 0) previews_.end(commit.id.client, commit.gesture);
    if (commit.reloaded) fileIs(commit.reloaded->layer, commit.reloaded->state);
    for (const LayerId& layer : commit.layerData)
        if (std::ranges::none_of(inFlight_, [&](const InFlightCommit& later) {
                return later.layerData.contains(layer);
            })) {
            const std::set<LayerId> before = mutedBy(layer);
            noteMutes(layer);
            noteLock(commit.user, layer);
            const std::set<LayerId> now = mutedBy(layer);
            for (const LayerId& one : now)
                if (!before.contains(one))
                    ports_.activity.happened(
                        {"layer muted", commit.user, one, "on " + layer.value});
            for (const LayerId& one : before)
                if (!now.contains(one))
                    ports_.activity.happened(
                        {"layer unmuted", commit.user, one, "on " + layer.value});
        }
    broadcast(commit);
    if (const auto author = authors_.find(commit.id.client); author != authors_.end()) {
        author->second.inFlight.erase(commit.id.sequence);
        if (commit.id.sequence != 0)
            author->second.committed->add(commit.id.sequence, commit.revision);
        forgetAuthor(commit.id.client);
    }
}

/// For the log. Of a layer that is loaded.
void Project::Impl::noteLock(const UserName& user, const LayerId& layer) {
    const auto doc = docs_.find(layer);
    if (doc == docs_.end()) return;
    const LayerLock now = lockOf(doc->second);
    const LayerLock before = std::exchange(layers_[layer].lock, now);
    if (now.locked == before.locked && now.holder == before.holder) return;
    if (now.locked)
        ports_.activity.happened({"layer locked", user, layer});
    else
        ports_.activity.happened(
            {"layer unlocked", user, layer,
             before.holder == user ? "" : "it was " + before.holder.value + "'s"});
}

void Project::Impl::broadcast(const InFlightCommit& commit) {
    if (isInParts(*commit.broadcast)) return broadcastInParts(commit);
    std::vector<SessionId> live;
    for (auto& [id, session] : sessions_) {
        if (session.isLive() && ports_.outbox.lags(id)) session.stream = CatchingUp{};  // FR6
        if (session.isLive()) live.push_back(id);
    }
    ports_.outbox.sendCommit(live, commit.broadcast, commit.revision);
    counters_.delivered += live.size();
    for (const SessionId id : live) {
        Session& session = *find(id);
        session.position = commit.revision;
        releaseAnswers(session);
    }
}

/// Everybody gets it as one of the past, part by part as the line takes it.
void Project::Impl::broadcastInParts(const InFlightCommit& commit) {
    newestInParts_ = commit.revision;
    large_[commit.revision] = commit.broadcast;
    ports_.outbox.sendCommit({}, commit.broadcast, commit.revision);
    for (auto& [id, session] : sessions_) {
        if (!session.isLive()) continue;
        session.ahead = ports_.outbox.holdCommits(id);
        session.stream = CatchingUp{};
        pump(session);
    }
}

/// After durable_ has moved: whoever waited for it.
void Project::Impl::settle() {
    for (auto& [id, session] : sessions_) pump(session);
    while (!readyOpens_.empty() && readyOpens_.front().revision <= durable_) {
        sendOpened(readyOpens_.front());
        readyOpens_.pop_front();
    }
    while (!readySaves_.empty() && readySaves_.front().revision <= durable_) {
        sendSave(readySaves_.front());
        readySaves_.pop_front();
    }
    while (!readyReloads_.empty() && readyReloads_.front().outcome.revision <= durable_) {
        sendReloaded(readyReloads_.front());
        readyReloads_.pop_front();
    }
    keepSnapshots();
    storeCheckpoints();
}

void Project::Impl::appendFailed(const Error& error, const CommitStore::Head& head) {
    appended(head.revision);
    if (head.revision != durable_ || head.hash != durableHash_)
        throw std::logic_error("the store's head is not a commit of this project");
    storeClosed_ = false;
    epoch_ = std::max(epoch_, head.epoch);
    const std::vector<InFlightCommit> lost(std::make_move_iterator(inFlight_.begin()),
                                           std::make_move_iterator(inFlight_.end()));
    inFlight_.clear();
    if (!lost.empty()) takeBack(error, lost);
    workAll();
}

void Project::Impl::takeBack(const Error& error, const std::vector<InFlightCommit>& lost) {
    executed_ = durable_;
    executedHash_ = durableHash_;
    history_.truncate(lost.front().mark);
    unusedBlobs_.takenBack(durable_);
    for (auto& [client, author] : authors_) author.newest = std::min(author.newest, durable_);
    for (const InFlightCommit& commit : lost) {
        ++counters_.refused;
        const auto author = authors_.find(commit.id.client);
        if (author != authors_.end()) {
            author->second.creations.forget(commit.id.sequence);
            author->second.inFlight.erase(commit.id.sequence);
            forgetAuthor(commit.id.client);
        }
        if (commit.gesture != 0 && previews_.end(commit.id.client, commit.gesture))
            withdraw(commit.id.client, commit.gesture);
    }
    for (auto& [id, session] : sessions_) {
        refuseLost(session, error, lost);
        releaseAnswers(session);
    }
    reloadLost(error, lost);
    loseCheckpoints(error);
    settle();
}

/// SE5: the refusals of what was lost take their place among the answers that waited for it. A
/// session that has not submitted it, nor again, hears nothing: when it does, that is executed like
/// any other.
void Project::Impl::refuseLost(Session& session, const Error& error,
                               const std::vector<InFlightCommit>& lost) {
    std::deque<Answer> waiting = std::move(session.answers);
    session.answers.clear();
    const auto keepUntil = [&](Revision revision) {
        for (; !waiting.empty() && waiting.front().after < revision; waiting.pop_front()) {
            Answer& answer = waiting.front();
            if (answer.repeats && answer.after > durable_) continue;  // refused below
            answer.after = std::min(answer.after, durable_);
            session.answers.push_back(std::move(answer));
        }
    };
    std::set<Revision> repeated;
    for (const Answer& answer : waiting)
        if (answer.repeats) repeated.insert(answer.after);
    for (const InFlightCommit& commit : lost) {
        if (commit.id.sequence == 0) continue;  // an import or a reload: nobody waits for it so
        if (commit.session != session.id && !repeated.contains(commit.revision)) continue;
        keepUntil(commit.revision);
        const RefusalFrame refusal{commit.id.sequence, 0, error};
        session.answers.push_back(
            {durable_, std::make_shared<const Bytes>(encodeFrame(refusal)), false, false});
    }
    keepUntil(~Revision(0));
}

/// The layers the lost commits had changed stand at what the store holds again.
void Project::Impl::reloadLost(const Error& error, const std::vector<InFlightCommit>& lost) {
    std::set<LayerId> changed, imported;
    for (const InFlightCommit& commit : lost) {
        changed.insert(commit.layers.begin(), commit.layers.end());
        if (commit.imported) imported.insert(*commit.imported);
    }
    for (const LayerId& layer : changed) {
        docs_.erase(layer);
        access_.noteSpecLocks(layer, docs_);
        layers_[layer].state = NotLoaded{};
        layers_[layer].changed = std::min(layers_[layer].changed, durable_);
    }
    std::erase_if(readySnapshots_, [this](const auto& one) {
        if (one.revision <= durable_) return false;
        layers_[one.layer].takesSnapshot = false;
        layers_[one.layer].snapshotMs.reset();
        return true;
    });
    std::deque<ReadyOpen> opens = std::move(readyOpens_);
    readyOpens_.clear();
    for (ReadyOpen& ready : opens) {
        ready.revision = std::min(ready.revision, durable_);
        if (!changed.contains(ready.layer)) {
            readyOpens_.push_back(std::move(ready));
        } else if (!imported.contains(ready.layer)) {
            layers_[ready.layer].opens.push_back(ready.open);
        } else if (Session* session = find(ready.open.session)) {
            sendError(*session, error, ready.open.request);
        }
    }
    for (ReadySave& ready : readySaves_) saves_.push_back(std::move(ready.save));
    readySaves_.clear();
    for (ReloadRequest& ready : readyReloads_) reloads_.push_back(std::move(ready));
    readyReloads_.clear();
    for (ReloadRequest& reload : reloads_) {
        std::erase_if(reload.unchanged, [&](auto& one) { return changed.contains(one.first); });
        std::erase_if(reload.outcome.reloaded, [&](const LayerId& layer) {
            return changed.contains(layer) && reload.waiting.insert(layer).second;
        });
    }
    for (const LayerId& layer : changed)
        if (!imported.contains(layer)) load(layer);
    continueSaves();
    continueReloads();
}

}  // namespace usdlive::server
