// Sends commits of the past: whole, in parts or conflated (CF1).
#include <algorithm>
#include <iterator>
#include <utility>

#include "project/CommitContent.h"
#include "project/stream/Catchup.h"
#include "usdlive/common/layer/Conflation.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kRunCommits = 256;       // most commits that are sent together
constexpr std::size_t kRunBytes = 512 * 1024;  // approximate size of commits that are sent together

/// CF1: merges commits into one, or returns nothing if each register was written only once.
/// Precondition: the commits follow one another, and the session is not the author of any of them.
std::optional<Bytes> conflatedFrame(std::vector<CommitFrame>& frames, const Hash& hashAfter) {
    std::vector<Edit> edits;
    for (CommitFrame& frame : frames)
        std::ranges::copy(frame.commit.edits, std::back_inserter(edits));
    const std::size_t all = edits.size();
    edits = conflated(std::move(edits));
    if (edits.size() == all) return std::nullopt;
    const Commit& last = frames.back().commit;
    CommitFrame made;
    made.commit.revision = last.revision;
    made.commit.epoch = last.epoch;
    made.commit.timeMs = last.timeMs;
    made.commit.previous = frames.front().commit.previous;
    made.commit.conflated = frames.size() - 1;
    made.commit.edits = std::move(edits);
    made.hashAfter = hashAfter;
    return encodeFrame(made);
}

}  // namespace

/// Returns false if the next commit is not in memory any more.
bool Catchup::sendRecent(Stream& stream, Revision last) {
    std::vector<StoredCommit> run;
    std::size_t bytes = 0;
    for (Revision next = stream.next();
         next <= last && run.size() < kRunCommits && bytes < kRunBytes; ++next) {
        const auto* recent = recent_.find(next);
        const SharedBytes inParts = recent ? nullptr : recent_.findInParts(next);
        if (inParts && run.empty()) {
            sendPast(stream, inParts);
            return true;
        }
        if (!recent) break;
        run.push_back({recent->revision, recent->frame, recent->hash});
        bytes += recent->frame->size();
    }
    if (!run.empty()) sendRun(stream, run);
    return !run.empty();
}

/// Sends commits of the past in order. For a session that fell behind, leaves out values that were
/// overwritten later (CF1).
void Catchup::sendRun(Stream& stream, const std::vector<StoredCommit>& commits) {
    std::vector<CommitFrame> run;              // commits that may be merged into one
    const auto flush = [&](std::size_t end) {  // the last commit of the run is the one before `end`
        const auto frame =
            run.size() > 1 ? conflatedFrame(run, commits[end - 1].hash) : std::nullopt;
        std::size_t first = end - std::exchange(run, {}).size();
        if (frame) {
            stream.position = commits[end - 1].revision - 1;
            return sendPast(stream, std::make_shared<const Bytes>(*frame));
        }
        for (; first < end && stream.canSend(); ++first) sendPast(stream, commits[first].frame);
    };
    for (std::size_t index = 0; index < commits.size() && stream.canSend(); ++index) {
        auto frame = conflatable(stream, commits[index]);
        if (!frame) {
            flush(index);
            if (stream.canSend()) sendPast(stream, commits[index].frame);
            continue;
        }
        run.push_back(std::move(*frame));
        // The client starts here, or with a layer at this revision: later commits apply to that
        // state.
        const Revision revision = commits[index].revision;
        if (revision == stream.greetedAt || stream.opened.contains(revision)) flush(index + 1);
    }
    if (stream.canSend()) flush(commits.size());
}

/// Returns the commit if it may be conflated. Otherwise it is sent unchanged: because the session
/// is its author, because it does more than its edits, or because the session may already have it
/// but not its neighbours.
std::optional<CommitFrame> Catchup::conflatable(const Stream& stream, const StoredCommit& stored) {
    if (!std::holds_alternative<CatchingUp>(stream.state) || stream.isAhead || !stream.conflates ||
        isInParts(*stored.frame))
        return std::nullopt;
    auto frame = decodeFrame(withoutLength(*stored.frame));
    auto* found = frame ? std::get_if<CommitFrame>(&*frame) : nullptr;
    if (!found || found->commit.imported || found->commit.gesture != 0 ||
        found->commit.firstUnseen != 0 || found->commit.id.client == stream.client)
        return std::nullopt;
    return std::move(*found);
}

void Catchup::sendPast(Stream& stream, const SharedBytes& frame) {
    if (!isInParts(*frame)) {
        outbox_->send(stream.id, frame);
        return commitSent(stream);
    }
    recent_.shareInParts(stream.next(), frame);
    stream.sending = SendingParts{frame};
}

/// Sends the next part of a commit in parts.
void Catchup::sendPart(Stream& stream) {
    SendingParts& sending = *stream.sending;
    outbox_->send(stream.id,
                  std::make_shared<const Bytes>(nextPart(*sending.frame, sending.offset)));
    if (sending.offset < sending.frame->size()) return;
    stream.sending.reset();
    commitSent(stream);
}

/// Advances the position after a commit was sent completely.
void Catchup::commitSent(Stream& stream) {
    ++counters_->delivered;
    if (auto* log = std::get_if<SendingLog>(&stream.state)) {
        ++log->next;
        return;
    }
    stream.moveTo(stream.position + 1);
    releaseAnswers(stream);
}

}  // namespace usdlive::server
