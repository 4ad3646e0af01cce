// Receives transactions from sessions, executes them in order, and answers them.
#include "project/clients/Submissions.h"

#include <algorithm>
#include <utility>

#include "project/SharedFrame.h"
#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::server {

namespace {

/// Returns the limits for what sessions have sent and what is not ordered yet: of each one, and of
/// all of a user, two of the largest transactions and small ones, so that it can send the next one;
/// of all together, one more.
Budget<SessionId>::Limits receivedLimits(const TransactionLimits& limits) {
    const std::size_t small = limits.bytes / 4;
    const std::size_t each = 2 * limits.bytes + small;
    return {.each = each, .group = each, .all = each + limits.bytes};
}

const std::string kResends = "resends";

/// Returns the index of the submitted edit that became this executed edit.
std::uint32_t submittedIndex(const Executed& executed, std::size_t index) {
    auto submitted = std::uint32_t(index);
    for (const DroppedEdit& dropped : executed.dropped)
        if (dropped.index <= submitted) ++submitted;
    return submitted;
}

}  // namespace

Submissions::Submissions(const TransactionLimits& limits, const Parts& parts,
                         ProjectCounters& counters)
    : limits_(limits),
      line_(parts.line),
      store_(parts.store),
      sessions_(parts.sessions),
      authors_(parts.authors),
      prerequisites_(parts.prerequisites),
      catchup_(parts.catchup),
      gestures_(parts.gestures),
      access_(parts.access),
      activity_(parts.activity),
      counters_(counters),
      arriving_(limits),
      received_(receivedLimits(limits)) {}

// ---- receiving

void Submissions::receive(Session& session, SubmitFrame frame, std::size_t bytes) {
    auto arrived = arriving_.receive(session, std::move(frame), bytes);
    if (!arrived) return sessions_->close(session, arrived.error());
    if (!*arrived) return static_cast<void>(fits(session));
    auto& [transaction, all, refused] = **arrived;
    if (refused)
        refuse(session, transaction, *refused);
    else
        add(session, std::move(transaction), all);
}

void Submissions::add(Session& session, Transaction transaction, std::size_t bytes) {
    if (transaction.id.client != session.client)
        return sessions_->close(session,
                                {ErrorCode::MalformedFrame, "a transaction of another client"});
    Queue& queue = queues_[session.id];
    queue.bytes += bytes;
    if (!fits(session)) return;
    queue.transactions.push_back({std::move(transaction), bytes, {}, {}});
    if (queue.transactions.size() == 1) work(session.id);
}

void Submissions::workAll() {
    for (const auto& [id, queue] : queues_) work(id);
}

void Submissions::work(SessionId id) {
    const auto found = queues_.find(id);
    if (found == queues_.end()) return;
    Queue& queue = found->second;
    while (!queue.transactions.empty()) {
        const Session* session = sessions_->greeted(id);
        if (!session) return;
        QueuedTransaction& queued = queue.transactions.front();
        if (!handle(*session, queued)) return;
        // An answer may have closed the session and cleared its queue.
        if (queue.transactions.empty()) return;
        queue.bytes -= queued.bytes;
        queue.transactions.pop_front();
        measure(*session);
    }
}

/// Returns false if the session was closed because its transactions take too much (SE22). Another
/// one may be closed instead of it.
bool Submissions::fits(const Session& session) {
    measure(session);
    const auto over = received_.givesWay(session.id);
    if (!over) return true;
    sessions_->close(*sessions_->find(*over),
                     {ErrorCode::TransactionTooLarge,
                      "too many large transactions of this session wait for a layer to load or for "
                      "their last part; send them again"});
    return *over != session.id;
}

void Submissions::measure(const Session& session) {
    const auto queue = queues_.find(session.id);
    received_.set(session.id,
                  arriving_.bytes(session.id) + (queue == queues_.end() ? 0 : queue->second.bytes),
                  session.share);
}

void Submissions::creationsRead(SessionId id, std::uint64_t sequence,
                                const Result<std::vector<StoredCommit>>& commits) {
    const Session* session = sessions_->find(id);
    if (!session) return;
    if (commits)
        prerequisites_->addCreations(authors_->of(session->client), sequence, commits->front());
    work(id);
}

// ---- one transaction

/// Returns false if the transaction has to wait. work() is called again when the missing data has
/// arrived.
bool Submissions::handle(const Session& session, QueuedTransaction& queued) {
    const Transaction& transaction = queued.transaction;
    Author& author = authors_->of(session.client);
    if (!author.committed) {
        authors_->read(session.client);
        return false;
    }
    if (const auto known = author.revisionOf(transaction.id.sequence)) {
        ++counters_->duplicates;
        const AlreadyCommitted message{transaction.id.sequence, *known};
        catchup_->answer(session.id, {*known, sharedFrame(message), true, false});
        return true;
    }
    if (const auto refused = heldBack(session.id, transaction.id.sequence)) {
        refuse(session, transaction, *refused);
        return true;
    }
    if (const auto refused = objection(author, queued)) {
        refuse(session, transaction, *refused);
        return true;
    }
    const auto ready = prerequisites_->check(session.id, author, queued);
    if (const auto* refused = std::get_if<Refused>(&ready)) {
        refuse(session, transaction, *refused);
        return true;
    }
    if (!std::get<bool>(ready)) return false;
    if (const auto locked = access_->toTransaction(session.subject, transaction)) {
        refuse(session, transaction, *locked);
        return true;
    }
    execute(session, author, queued);
    return true;
}

/// SE21: a transaction that is executed after an earlier one of its author was refused could lack
/// what that one creates, and would be overwritten when that one is sent again.
std::optional<Refused> Submissions::heldBack(SessionId session, std::uint64_t sequence) {
    auto& held = queues_[session].held;
    if (held && held->sequences.contains(sequence)) held.reset();
    return held ? std::optional(Refused{held->reason}) : std::nullopt;
}

void Submissions::hold(const Session& session, std::uint64_t sequence, const Error& reason) {
    // A client has at most 1,000 transactions on their way.
    constexpr std::size_t kMost = 4'096;
    if (!errorPasses(reason.code) || !session.features.contains(kResends)) return;
    auto& held = queues_[session.id].held;
    if (!held) held.emplace(Held{reason, {}});
    if (held->sequences.size() < kMost) held->sequences.insert(sequence);
}

std::optional<Refused> Submissions::objection(const Author& author,
                                              const QueuedTransaction& queued) const {
    const Transaction& transaction = queued.transaction;
    if (const auto error = store_->whyClosed()) return Refused{*error};
    if (transaction.edits.size() > limits_.edits ||
        expandedBytes(author.creations, transaction) + queued.bytes > limits_.bytes)
        return transactionTooLarge(transaction.edits.size(), queued.bytes, limits_);
    if (const auto error = store_->whyNotWritable()) return Refused{*error};
    return std::nullopt;
}

void Submissions::execute(const Session& session, Author& author, const QueuedTransaction& queued) {
    const Transaction& transaction = queued.transaction;
    HistoryLine::Submission submission{transaction, queued.bytes, session.subject.user};
    if (access_->dependsOnEffects(session.subject, transaction.edits))
        submission.check = [&](const Executed& executed,
                               const LayerDocs& before) -> std::optional<Refused> {
            auto locked = access_->toEdits(session.subject, executed.edits, before);
            if (!locked) return std::nullopt;
            return Refused{std::move(locked->second), submittedIndex(executed, locked->first)};
        };
    const auto outcome = line_->commit(submission, author.creations);
    if (const auto* refused = std::get_if<Refused>(&outcome))
        return refuse(session, transaction, *refused);
    const Revision revision = std::get<Revision>(outcome);
    author.inFlight[transaction.id.sequence] = revision;
    author.newest = revision;
    inFlight_.push_back({revision, transaction.id.sequence, session.id});
    catchup_->submitted(session.id, revision);
}

/// Refuses a transaction (M6). Also withdraws the preview of its gesture from other sessions.
void Submissions::refuse(const Session& session, const Transaction& transaction,
                         const Refused& refused) {
    ++counters_->refused;
    const LayerId layer =
        refused.edit < transaction.edits.size() ? transaction.edits[refused.edit].layer : LayerId{};
    if (!queues_[session.id].held)
        activity_->record({"edits refused", session.subject.user, layer, refused.error.message});
    hold(session, transaction.id.sequence, refused.error);
    gestures_->refused(session.client, transaction.gesture);
    // A resumed session must have all commits up to its welcome first: they may be its own.
    const Revision after =
        std::max(authors_->of(session.client).newest, catchup_->greetedAt(session.id));
    catchup_->answer(session.id,
                     {after, sharedFrame(RefusalFrame{transaction.id.sequence, refused.edit,
                                                      sessions_->shown(refused.error)})});
    // Editors never send such a transaction, so the session is closed.
    if (refused.error.code != ErrorCode::InvalidPath) return;
    const ErrorMessage message{
        std::string(errorName(refused.error.code)), refused.error.message, true, {}, {}};
    catchup_->answer(session.id, {after, sharedFrame(message), false, true});
}

// ---- for other parts

bool Submissions::isWaiting(SessionId session) const {
    const auto found = queues_.find(session);
    return found != queues_.end() && !found->second.transactions.empty();
}

bool Submissions::needs(const LayerId& layer) const {
    return std::ranges::any_of(queues_, [&](const auto& one) {
        return std::ranges::any_of(one.second.transactions, [&](const auto& queued) {
            return std::ranges::any_of(queued.transaction.edits,
                                       [&](const Edit& edit) { return edit.layer == layer; });
        });
    });
}

void Submissions::addNamed(std::unordered_set<Hash>& named) const {
    for (const auto& [session, queue] : queues_)
        for (const QueuedTransaction& queued : queue.transactions)
            for (const Edit& edit : queued.transaction.edits)
                forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
    arriving_.addNamed(named);
}

// ---- the line and the sessions

void Submissions::becameDurable(Revision upTo) {
    while (!inFlight_.empty() && inFlight_.front().revision <= upTo) inFlight_.pop_front();
}

/// SE5: refuses the transactions whose commits were lost.
void Submissions::rolledBack(const Error& error, const LostCommits& lost) {
    counters_->refused += lost.commits.size();
    const auto refused = catchup_->refuse({inFlight_.begin(), inFlight_.end()}, error);
    inFlight_.clear();
    for (const auto& [id, sequences] : refused)
        if (const Session* session = sessions_->greeted(id))
            for (const std::uint64_t sequence : sequences) hold(*session, sequence, error);
}

void Submissions::closing(SessionId session) {
    arriving_.forget(session);
    const auto found = queues_.find(session);
    if (found != queues_.end()) found->second.transactions.clear();
    received_.giveBackAll(session);
}

void Submissions::left(const Session& session) {
    arriving_.forget(session.id);
    queues_.erase(session.id);
    received_.giveBackAll(session.id);
}

}  // namespace usdlive::server
