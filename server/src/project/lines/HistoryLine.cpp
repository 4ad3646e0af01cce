// Orders edits: executes them, makes their commits, and keeps the commits until they are durable.
#include "project/lines/HistoryLine.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "project/CommitContent.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::server {

namespace {

// Returns the moves and deletes over which addresses are carried forward (M3).
NamespaceLog namespacesOf(const HistoryLine::Start& start) {
    NamespaceLog log;
    log.prune(start.oldestNamespace);
    log.forgetNamings(start.head.revision);
    for (const auto& [revision, layer, from, to, place] : start.namespaceChanges) {
        if (revision <= start.oldestNamespace || revision > start.head.revision) continue;
        const auto what = place ? NamespaceLog::Of::Place : NamespaceLog::Of::Spec;
        if (to)
            log.recordMove(revision, layer, from, *to, what);
        else
            log.recordDelete(revision, layer, from, what);
    }
    return log;
}

// M17: returns the first commit that the author of a delete had not seen; 0: there is none.
Revision firstUnseen(const Transaction& transaction, const std::vector<ExecutedEdit>& edits,
                     Revision revision) {
    const bool isOwn = transaction.id.sequence == 0;  // the server's, which has seen everything
    const Revision first = newestSeen(transaction) + 1;
    const auto deletes = [](const ExecutedEdit& done) {
        return std::holds_alternative<DeleteSpec>(done.edit.action) && done.applied.changed;
    };
    return !isOwn && first < revision && std::ranges::any_of(edits, deletes) ? first : 0;
}

}  // namespace

HistoryLine::HistoryLine(const Limits& limits, Start start, ports::CommitLog& log, TimeOfDay& time)
    : limits_(limits),
      log_(log),
      time_(time),
      docs_(std::move(start.docs)),
      namespaces_(namespacesOf(start)),
      epoch_(start.head.epoch),
      first_(start.head.revision),
      executed_(start.head.revision),
      executedHash_(start.head.hash),
      newestMs_(start.timeMs),
      durable_(start.head.revision),
      durableHash_(start.head.hash) {}

const LayerDoc* HistoryLine::doc(const LayerId& layer) const {
    const auto found = docs_.find(layer);
    return found == docs_.end() ? nullptr : &found->second;
}

bool HistoryLine::isLayerDataInFlight(const LayerId& layer) const {
    return std::ranges::any_of(
        inFlight_, [&](const OrderedCommit& commit) { return commit.layerData.contains(layer); });
}

// ---- ordering

/// Returns whether the commit of a transaction may be too large. A commit contains its transaction
/// with whole paths.
bool HistoryLine::mayNotFit(const Submission& submission) const {
    constexpr std::size_t kMaxPathBytes = 16 * 1024;
    const auto most = std::min<std::uint64_t>(limits_.commits.frame, limits_.commits.commit);
    return submission.bytes + (submission.transaction.edits.size() + 1) * kMaxPathBytes > most;
}

std::variant<Revision, Refused> HistoryLine::commit(const Submission& submission,
                                                    OwnCreations& creations) {
    const Transaction& transaction = submission.transaction;
    LayerDocs before;  // only if a check follows, which may undo the edits
    if (submission.check || mayNotFit(submission))
        for (const Edit& edit : transaction.edits)
            before.try_emplace(edit.layer, docs_.at(edit.layer));

    creations.seen(transaction.base);
    const std::uint64_t mark = namespaces_.mark();
    Outcome outcome = execute(docs_, namespaces_, creations, transaction, executed_ + 1);
    if (auto* refused = std::get_if<Refused>(&outcome)) return std::move(*refused);
    auto& executed = std::get<Executed>(outcome);
    auto refused = submission.check ? submission.check(executed, before) : std::nullopt;
    if (!refused) {
        auto made = make(transaction, submission.user, std::move(executed), mark);
        if (made) return append(std::move(made->first), std::move(made->second));
        refused =
            Refused{{ErrorCode::TransactionTooLarge,
                     "the commit would exceed the largest size, or one of its values that of a "
                     "frame"},
                    0};
    }
    undo(std::move(before), mark);
    creations.forget(transaction.id.sequence);
    return *std::move(refused);
}

Result<Revision> HistoryLine::commitInOrder(OwnEdits own) {
    LayerDocs before;
    for (const Edit& edit : own.edits) before.try_emplace(edit.layer, docs_.at(edit.layer));
    const std::uint64_t mark = namespaces_.mark();
    auto executed = executeInOrder(docs_, namespaces_, std::move(own.edits), executed_ + 1);
    if (!executed) return tl::unexpected(executed.error());
    const auto refused = own.check ? own.check(*executed, before) : std::nullopt;
    if (refused) {
        undo(std::move(before), mark);
        return tl::unexpected(refused->error);
    }
    Transaction transaction;
    transaction.label = labelOf(own.label);
    auto made = make(transaction, own.user, std::move(*executed), mark);
    if (!made) {
        undo(std::move(before), mark);
        return fail(ErrorCode::TransactionTooLarge, "more than one commit can hold");
    }
    auto& [commit, record] = *made;
    if (own.file)
        record.saved =
            CommitRecord::Saved{own.file->first, {commit.revision, std::move(own.file->second)}};
    return append(std::move(commit), std::move(record));
}

Revision HistoryLine::commitImport(Import import) {
    OrderedCommit made;
    CommitRecord record;
    record.revision = made.revision = executed_ + 1;
    made.imported = import.layer;
    record.saved = CommitRecord::Saved{import.layer, {made.revision, std::move(import.file)}};
    record.layers = made.layers = {import.layer};
    made.edits = import.frame.edits;
    made.blobs = std::move(import.blobs);
    made.mark = namespaces_.mark();

    CommitFrame stub;
    stub.commit = {made.revision, epoch_, {}, {},           commitTimeMs(), 0,
                   import.layer,  {},     {}, executedHash_};
    stampCommit(import.frame.bytes, stub.commit);
    record.hash = made.hash = chainHash(executedHash_, withoutLength(import.frame.bytes));
    record.frame = std::make_shared<const Bytes>(std::move(import.frame.bytes));
    stub.hashAfter = made.hash;
    made.broadcast = std::make_shared<const Bytes>(encodeFrame(stub));
    return append(std::move(made), std::move(record));
}

/// Makes the next commit from the executed edits of a transaction, or of an empty one for own
/// edits. Returns nothing if it is too large. `mark` is the position in the NamespaceLog before it.
std::optional<HistoryLine::Made> HistoryLine::make(const Transaction& transaction,
                                                   const UserName& user, Executed executed,
                                                   std::uint64_t mark) {
    OrderedCommit made;
    CommitRecord record;
    record.revision = made.revision = executed_ + 1;
    record.id = made.id = transaction.id;
    made.user = user;
    record.namespaceChanges = namespaceChanges(made.revision, executed.edits);
    made.gesture = transaction.gesture;
    made.edits = executed.edits.size();
    made.dropped = executed.dropped.size();
    made.mark = mark;

    Commit commit{made.revision,
                  epoch_,
                  made.id,
                  user,
                  commitTimeMs(),
                  transaction.gesture,
                  {},
                  {},
                  std::move(executed.dropped),
                  executedHash_};
    commit.firstUnseen = firstUnseen(transaction, executed.edits, made.revision);
    commit.label = transaction.label;
    const auto addBlob = [&](const Value& blob) { made.blobs.push_back(blob.hash()); };
    for (const DroppedEdit& dropped : commit.dropped) forEachBlob(dropped.edit.action, addBlob);
    commit.edits.reserve(executed.edits.size());
    for (ExecutedEdit& edit : executed.edits) {
        made.layers.insert(edit.edit.layer);
        if (touchesLayerData(edit.edit.action)) made.layerData.insert(edit.edit.layer);
        forEachBlob(edit.edit.action, addBlob);
        commit.edits.push_back(std::move(edit.edit));
    }
    record.layers = made.layers;
    record.frame = encodeCommitFrames(commit, limits_.commits);
    if (!record.frame) return std::nullopt;
    record.hash = made.hash = chainHash(executedHash_, withoutLength(*record.frame));
    made.broadcast = record.frame;
    if (commit.dropped.empty() && commit.edits == transaction.edits)
        made.acceptance = Acceptance{made.revision, epoch_,        made.id.sequence,
                                     commit.timeMs, executedHash_, made.hash};
    if (commit.firstUnseen == 0 && commit.label.empty() && mayBeCompact(commit.edits) &&
        !isInParts(*record.frame))
        made.content =
            std::make_shared<const CompactCommit>(CompactCommit{std::move(commit), made.hash});
    return std::pair(std::move(made), std::move(record));
}

/// CH6: the times of commits never fall.
std::int64_t HistoryLine::commitTimeMs() {
    newestMs_ = std::max(newestMs_, time_->nowMs());
    return newestMs_;
}

Revision HistoryLine::append(OrderedCommit commit, CommitRecord record) {
    executed_ = commit.revision;
    executedHash_ = commit.hash;
    commit.frameBytes = record.frame->size();
    inFlight_.push_back(std::move(commit));
    listeners_.notify(&LineListener::ordered, inFlight_.back());
    log_->append(std::move(record));
    return executed_;
}

void HistoryLine::undo(LayerDocs before, std::uint64_t mark) {
    for (auto& [layer, doc] : before) docs_[layer] = std::move(doc);
    namespaces_.truncate(mark);
}

// ---- answers of the log

void HistoryLine::appended(Revision upTo) {
    while (!inFlight_.empty() && inFlight_.front().revision <= upTo) {
        const OrderedCommit commit = std::move(inFlight_.front());
        inFlight_.pop_front();
        durable_ = commit.revision;
        durableHash_ = commit.hash;
        // Depends on durable commits only: if executed commits were rolled back, every base would
        // be too old.
        if (durable_ > limits_.namespaceRevisions)
            namespaces_.prune(durable_ - limits_.namespaceRevisions);
        listeners_.notify(&LineListener::durable, commit);
    }
    listeners_.notify(&LineListener::becameDurable, durable_);
}

void HistoryLine::appendFailed(const Error& error, const CommitStore::Head& head) {
    appended(head.revision);
    if (head.revision != durable_ || head.hash != durableHash_)
        throw std::logic_error("the store's head is not a commit of this project");
    epoch_ = std::max(epoch_, head.epoch);
    if (!inFlight_.empty()) rollBack(error);
}

void HistoryLine::rollBack(const Error& error) {
    LostCommits lost;
    lost.commits.assign(std::make_move_iterator(inFlight_.begin()),
                        std::make_move_iterator(inFlight_.end()));
    inFlight_.clear();
    for (const OrderedCommit& commit : lost.commits) {
        lost.changed.insert(commit.layers.begin(), commit.layers.end());
        if (commit.imported) lost.imported.insert(*commit.imported);
    }
    executed_ = durable_;
    executedHash_ = durableHash_;
    namespaces_.truncate(lost.commits.front().mark);
    for (const LayerId& layer : lost.changed) docs_.erase(layer);
    listeners_.notify(&LineListener::rolledBack, error, lost);
    listeners_.notify(&LineListener::becameDurable, durable_);
}

}  // namespace usdlive::server
