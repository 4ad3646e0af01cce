// Joins transactions that are received in parts, and limits their memory.
#include "clients/ArrivingTransactions.h"

#include <utility>

namespace usdlive::server {

namespace {

// The limit for the incomplete transactions of all sessions, in transactions of the largest size.
constexpr std::uint64_t kMaxIncomplete = 2;

}  // namespace

Result<std::optional<ArrivingTransactions::Arrived>> ArrivingTransactions::receive(
    const Session& session, SubmitFrame frame, std::size_t bytes) {
    using Nothing = std::optional<Arrived>;
    if (frame.part == 0) forget(session.id);
    if (frame.part == 0 && !frame.more) return Arrived{std::move(frame.transaction), bytes, {}};
    if (frame.part == 0) arriving_[session.id] = {};
    const auto found = arriving_.find(session.id);
    if (found == arriving_.end())
        return fail(ErrorCode::MalformedFrame,
                    "a part that does not follow the first part of a transaction");
    if (frame.transaction.id.client != session.client)
        return fail(ErrorCode::MalformedFrame, "a transaction of another client");
    Arriving& arriving = found->second;
    if (arriving.refused) return Nothing();
    arriving.bytes += bytes;
    arriving.edits += frame.transaction.edits.size();
    bytes_ += bytes;
    if (bytes_ > kMaxIncomplete * limits_.bytes)
        return fail(ErrorCode::TransactionTooLarge,
                    "too many large transactions are being sent at the same time; send it again");
    const TransactionId id = frame.transaction.id;
    const std::uint64_t gesture = frame.transaction.gesture;
    auto whole = arriving.parts.add(std::move(frame));
    if (!whole) return tl::unexpected(whole.error());
    if (arriving.bytes > limits_.bytes || arriving.edits > limits_.edits) {
        Arrived refused{{id, 0, gesture, {}},
                        arriving.bytes,
                        transactionTooLarge(arriving.edits, arriving.bytes, limits_)};
        bytes_ -= std::exchange(arriving.bytes, 0);
        arriving.parts = {};
        arriving.refused = true;
        return refused;
    }
    if (!*whole) return Nothing();
    Arrived arrived{std::move(**whole), arriving.bytes, {}};
    forget(session.id);
    return arrived;
}

void ArrivingTransactions::forget(SessionId session) {
    const auto arriving = arriving_.extract(session);
    if (!arriving.empty()) bytes_ -= arriving.mapped().bytes;
}

void ArrivingTransactions::addNamed(std::unordered_set<Hash>& named) const {
    for (const auto& [session, arriving] : arriving_)
        for (const Edit& edit : arriving.parts.edits())
            forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
}

}  // namespace usdlive::server
