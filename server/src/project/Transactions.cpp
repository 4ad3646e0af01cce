// What authors submit, until it is executed or refused.
#include <algorithm>
#include <unordered_map>

#include "ProjectImpl.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

// Transactions of one session that wait for a layer to load, beside one in parts; more ends the
// session.
constexpr std::size_t kMaxWaitingBytes = 256 * 1024 * 1024;
// Of transactions that come in parts, of all sessions together, as many of the largest.
constexpr std::uint64_t kMaxComing = 2;

std::string mib(std::uint64_t bytes) {
    constexpr std::uint64_t kMib = 1024 * 1024;
    return std::to_string((bytes + kMib - 1) / kMib) + " MiB";
}

Refused tooLarge(std::size_t edits, std::uint64_t bytes, std::uint64_t most) {
    return {{ErrorCode::TransactionTooLarge,
             "a transaction of " + std::to_string(edits) + " edits and " + mib(bytes) +
                 "; the server takes " + std::to_string(kMaxTransactionEdits) + " edits and " +
                 mib(most) +
                 ". Write it in several frames, with tick() between them, or serve with a larger "
                 "--max-transaction-mib"}};
}

SharedBytes shared(const Frame& frame) { return std::make_shared<const Bytes>(encodeFrame(frame)); }

/// Every address of a transaction that names a creation.
void forEachCreation(const Transaction& transaction,
                     const std::function<void(const Creation&)>& visit) {
    for (const Edit& edit : transaction.edits) {
        if (edit.address.creation) visit(*edit.address.creation);
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && move->parent.creation) visit(*move->parent.creation);
    }
}

/// Does an executed edit stand in the NamespaceLog?
bool changesNamespace(const Edit& edit) {
    if (std::holds_alternative<DeleteSpec>(edit.action)) return true;
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    return move && specpath::child(move->parent.path, specpath::last(edit.address.path).list,
                                   move->name) != edit.address.path;
}

/// Which edit of the transaction an executed one was.
std::uint32_t submittedIndex(const Executed& executed, std::size_t index) {
    auto submitted = std::uint32_t(index);
    for (const DroppedEdit& dropped : executed.dropped)
        if (dropped.index <= submitted) ++submitted;
    return submitted;
}

}  // namespace

/// FR8: what comes in parts is one transaction when its last part is here. It is decoded as it
/// comes, so that others are served between two parts.
void Project::Impl::receiveSubmit(Session& session, SubmitFrame frame, std::size_t bytes) {
    if (frame.part == 0) forgetComing(session);
    if (frame.part == 0 && !frame.more) return submit(session, std::move(frame.transaction), bytes);
    if (frame.part == 0) session.coming.emplace();
    if (!session.coming)
        return close(session, {ErrorCode::MalformedFrame, "a part of no transaction"});
    if (frame.transaction.id.client != session.client)
        return close(session, {ErrorCode::MalformedFrame, "a transaction of another client"});
    ComingTransaction& coming = *session.coming;
    if (coming.refused) return;
    coming.bytes += bytes;
    coming.edits += frame.transaction.edits.size();
    comingBytes_ += bytes;
    if (comingBytes_ > kMaxComing * options_.maxTransactionBytes)
        return close(session, {ErrorCode::TransactionTooLarge,
                               "too many large transactions are coming at once; send it again"});
    const TransactionId id = frame.transaction.id;
    const std::uint64_t gesture = frame.transaction.gesture;
    auto whole = coming.parts.add(std::move(frame));
    if (!whole) return close(session, whole.error());
    if (const auto refused = partObjection(coming)) {
        comingBytes_ -= std::exchange(coming.bytes, 0);
        coming.parts = {};
        coming.refused = true;
        return refuse(session, {id, 0, gesture, {}}, *refused);
    }
    if (!*whole) return;
    const std::size_t all = coming.bytes;
    forgetComing(session);
    submit(session, std::move(**whole), all);
}

std::optional<Refused> Project::Impl::partObjection(const ComingTransaction& coming) const {
    if (coming.bytes <= options_.maxTransactionBytes &&
        coming.edits <= options_.maxEditsPerTransaction)
        return std::nullopt;
    return tooLarge(coming.edits, coming.bytes, options_.maxTransactionBytes);
}

void Project::Impl::forgetComing(Session& session) {
    if (session.coming) comingBytes_ -= session.coming->bytes;
    session.coming.reset();
}

void Project::Impl::submit(Session& session, Transaction transaction, std::size_t bytes) {
    if (transaction.id.client != session.client)
        return close(session, {ErrorCode::MalformedFrame, "a transaction of another client"});
    session.transactionBytes += bytes;
    if (session.transactionBytes > kMaxWaitingBytes + options_.maxTransactionBytes)
        return close(session, {ErrorCode::TransactionTooLarge,
                               "too many transactions wait for a layer to load"});
    session.transactions.push_back({std::move(transaction), bytes, {}, {}});
    if (session.transactions.size() == 1) work(session);
}

void Project::Impl::work(Session& session) {
    while (session.isGreeted() && !session.transactions.empty()) {
        QueuedTransaction& queued = session.transactions.front();
        if (!workOff(session, queued)) return;
        // An answer may have closed the session and cleared its queue.
        if (session.transactions.empty()) return;
        session.transactionBytes -= queued.bytes;
        session.transactions.pop_front();
    }
}

/// False: it has to wait; work() is called again when what it waits for is there.
bool Project::Impl::workOff(Session& session, QueuedTransaction& queued) {
    const Transaction& transaction = queued.transaction;
    Author& author = authors_[session.client];
    if (!author.committed) {
        readClient(session.client);
        return false;
    }
    if (const auto known = committed(author, transaction.id.sequence)) {
        ++counters_.duplicates;
        const AlreadyCommitted message{transaction.id.sequence, *known};
        answer(session, {*known, shared(ControlFrame{encodeControl(message)}), true, false});
        return true;
    }
    if (const auto refused = objection(author, queued)) {
        refuse(session, transaction, *refused);
        return true;
    }
    const auto stored = blobsReady(queued);
    if (const auto* refused = std::get_if<Refused>(&stored)) {
        refuse(session, transaction, *refused);
        return true;
    }
    if (!std::get<bool>(stored)) return false;
    const auto ready = layersReady(transaction);
    if (const auto* refused = std::get_if<Refused>(&ready)) {
        refuse(session, transaction, *refused);
        return true;
    }
    if (!std::get<bool>(ready) || !creationsKnown(session, author, queued)) return false;
    if (const auto locked = access_.toTransaction(*this, session.subject, transaction)) {
        refuse(session, transaction, *locked);
        return true;
    }
    execute(session, author, queued);
    return true;
}

/// M9. Of an author whose commits are known.
std::optional<Revision> Project::Impl::committed(const Author& author, std::uint64_t sequence) {
    const auto inFlight = author.inFlight.find(sequence);
    return inFlight != author.inFlight.end() ? inFlight->second : author.committed->find(sequence);
}

std::optional<Refused> Project::Impl::objection(const Author& author,
                                                const QueuedTransaction& queued) const {
    const Transaction& transaction = queued.transaction;
    if (storeClosed_)
        return Refused{{ErrorCode::StorageFailed, "the store has failed and is not opened yet"}};
    if (transaction.edits.size() > options_.maxEditsPerTransaction ||
        expandedBytes(author, transaction) + queued.bytes > options_.maxTransactionBytes)
        return tooLarge(transaction.edits.size(), queued.bytes, options_.maxTransactionBytes);
    if (!hasSpace_) return Refused{{ErrorCode::StorageFull, "the disk of the server is full"}};
    return std::nullopt;
}

/// Are all big values stored that it names? False while the store is asked.
std::variant<bool, Refused> Project::Impl::blobsReady(QueuedTransaction& queued) {
    std::unordered_set<Hash> checked;
    std::vector<Hash> sought;
    bool isSought = false;
    const std::vector<Edit>& edits = queued.transaction.edits;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        std::optional<Refused> refused;
        const auto check = [&](const Value& blob) {
            const Hash hash = blob.hash();
            if (refused || !checked.insert(hash).second) return;
            if (blob.size() > options_.maxBlobBytes) {
                refused = Refused{{ErrorCode::BlobTooLarge,
                                   "a value of " + std::to_string(blob.size()) + " bytes"}};
            } else if (knownBlobs_.has(hash)) {
                return;
            } else if (queued.soughtBlobs.insert(hash).second) {
                sought.push_back(hash);
            } else if (knownBlobs_.isAsked(hash)) {
                isSought = true;
            } else {
                refused = Refused{
                    {ErrorCode::BlobNotFound, "the value " + hash.hex() + " was not uploaded"}};
            }
        };
        forEachBlob(edits[index].action, check);
        if (!refused) continue;
        refused->edit = std::uint32_t(index);
        return *refused;
    }
    isSought = isSought || !sought.empty();
    if (!sought.empty()) findBlobs(std::move(sought));
    return !isSought;
}

/// By how much addresses that follow a created spec grow when they are written out: a small
/// transaction may name a long path very often.
std::size_t Project::Impl::expandedBytes(const Author& author,
                                         const Transaction& transaction) const {
    std::unordered_map<std::uint32_t, std::size_t>
        own;  // by edit: bytes of the created spec's path
    const auto lengthOf = [&](const Creation& creation) -> std::size_t {
        if (creation.sequence == transaction.id.sequence) {
            const auto found = own.find(creation.edit);
            return found == own.end() ? 0 : found->second;
        }
        const auto* entry = author.creations.find(creation);
        return entry ? entry->path.size() : 0;
    };
    std::size_t expanded = 0;
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const Edit& edit = transaction.edits[index];
        const std::size_t base = edit.address.creation ? lengthOf(*edit.address.creation) : 0;
        expanded += base;
        if (std::holds_alternative<CreateSpec>(edit.action))
            own[std::uint32_t(index)] = base + edit.address.path.size();
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && move->parent.creation) expanded += lengthOf(*move->parent.creation);
    }
    return expanded;
}

/// Begins to load what is not there yet; false while it is under way.
std::variant<bool, Refused> Project::Impl::layersReady(const Transaction& transaction) {
    bool ready = true;
    const LayerId* previous = nullptr;
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const LayerId& layer = transaction.edits[index].layer;
        if (previous && *previous == layer) continue;
        previous = &layer;
        const auto found = layers_.find(layer);
        if (found == layers_.end())
            return Refused{{ErrorCode::LayerNotFound, "the project has no layer " + layer.value},
                           std::uint32_t(index)};
        if (const auto* failed = std::get_if<LoadFailed>(&found->second.state))
            return Refused{failed->error, std::uint32_t(index)};
        if (std::holds_alternative<NotLoaded>(found->second.state)) load(layer);
        ready = ready && std::holds_alternative<Loaded>(found->second.state);
    }
    return ready;
}

/// M3: after a restart, or when its author was away, the store is asked what an earlier transaction
/// created. False while that is under way.
bool Project::Impl::creationsKnown(Session& session, Author& author, QueuedTransaction& queued) {
    bool known = true;
    forEachCreation(queued.transaction, [&](const Creation& creation) {
        const std::uint64_t sequence = creation.sequence;
        if (sequence == queued.transaction.id.sequence || author.creations.find(creation)) return;
        if (author.inFlight.contains(sequence) || !queued.lookedUp.insert(sequence).second) return;
        const auto revision = author.committed->find(sequence);
        if (!revision || *revision <= oldest_) return;  // M4: as if it had not been created
        known = false;
        requestRead(session, {ReadPurpose::Creations, *revision, *revision, sequence});
    });
    return known;
}

void Project::Impl::learnCreations(Author& author, std::uint64_t sequence,
                                   const StoredCommit& stored) {
    const auto decoded = decodeCommit(stored);
    if (!decoded) return;
    const Commit& commit = *decoded;
    std::uint64_t mark = history_.markBefore(commit.revision);
    auto dropped = commit.dropped.begin();
    std::uint32_t index = 0;  // of the edit in the transaction
    for (const Edit& edit : commit.edits) {
        for (; dropped != commit.dropped.end() && dropped->index == index; ++dropped) ++index;
        if (changesNamespace(edit)) ++mark;
        if (std::holds_alternative<CreateSpec>(edit.action))
            author.creations.record({sequence, index}, {edit.layer, edit.address.path, mark},
                                    commit.revision);
        ++index;
    }
}

void Project::Impl::execute(Session& session, Author& author, const QueuedTransaction& queued) {
    // A commit repeats its transaction with every path written out. Where that might be larger than
    // a commit may be, or a locked spec might be among them, the layers are kept as they are until
    // it is known.
    constexpr std::size_t kMaxPathBytes = 16 * 1024;
    const Transaction& transaction = queued.transaction;
    LayerDocs before;
    std::uint64_t most =
        std::min<std::uint64_t>(options_.maxFrameBytes, options_.maxTransactionBytes);
    if (!session.features.contains(kPartsFeature))
        most = std::min<std::uint64_t>(most, options_.wholeCommitBytes);
    const bool mayNotFit = queued.bytes + (transaction.edits.size() + 1) * kMaxPathBytes > most;
    const bool mindsLocks = access_.dependsOnEffects(transaction.edits);
    if (mayNotFit || mindsLocks)
        for (const Edit& edit : transaction.edits)
            before.try_emplace(edit.layer, docs_.at(edit.layer));

    author.creations.seen(transaction.base);
    const std::uint64_t mark = history_.log().mark();
    Outcome outcome =
        usdlive::execute(docs_, history_.log(), author.creations, transaction, executed_ + 1);
    if (const auto* refused = std::get_if<Refused>(&outcome))
        return refuse(session, transaction, *refused);
    auto& executed = std::get<Executed>(outcome);
    Refused why{{ErrorCode::TransactionTooLarge,
                 "the commit would be larger than one may be, or one of its values than a frame"},
                0};
    const auto locked =
        mindsLocks ? access_.toEdits(*this, session.subject, executed.edits, before) : std::nullopt;
    if (locked)
        why = {locked->second, submittedIndex(executed, locked->first)};
    else if (commit(session, author, transaction, std::move(executed), mark))
        return;

    for (auto& [layer, doc] : before) docs_[layer] = std::move(doc);
    history_.truncate(mark);
    author.creations.forget(transaction.id.sequence);
    refuse(session, transaction, why);
}

/// M6. The preview its gesture left with others goes, too.
void Project::Impl::refuse(Session& session, const Transaction& transaction,
                           const Refused& refused) {
    ++counters_.refused;
    const LayerId layer =
        refused.edit < transaction.edits.size() ? transaction.edits[refused.edit].layer : LayerId{};
    ports_.activity.happened({"edits refused", session.subject.user, layer, refused.error.message});
    if (transaction.gesture != 0 && previews_.end(session.client, transaction.gesture))
        withdraw(session.client, transaction.gesture);
    // Of a session that resumes all commits up to its welcome may be its author's.
    const Revision after = std::max(authors_[session.client].newest, session.greetedAt);
    answer(session,
           {after, shared(RefusalFrame{transaction.id.sequence, refused.edit, refused.error})});
    // Such a transaction never came from an editor.
    if (refused.error.code != ErrorCode::InvalidPath) return;
    const ErrorMessage message{
        std::string(errorName(refused.error.code)), refused.error.message, true, {}, {}};
    answer(session, {after, shared(ControlFrame{encodeControl(message)}), false, true});
}

void Project::Impl::answer(Session& session, Answer answer) {
    session.answers.push_back(std::move(answer));
    releaseAnswers(session);
}

}  // namespace usdlive::server
