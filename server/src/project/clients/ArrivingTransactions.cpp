// Joins transactions that are received in parts.
#include "project/clients/ArrivingTransactions.h"

#include <utility>

namespace usdlive::server {

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
    const TransactionId id = frame.transaction.id;
    const std::uint64_t gesture = frame.transaction.gesture;
    auto whole = arriving.parts.add(std::move(frame));
    if (!whole) return tl::unexpected(whole.error());
    if (arriving.bytes > limits_.bytes || arriving.edits > limits_.edits) {
        Arrived refused{{id, 0, gesture, {}},
                        arriving.bytes,
                        transactionTooLarge(arriving.edits, arriving.bytes, limits_)};
        arriving.bytes = 0;
        arriving.parts = {};
        arriving.refused = true;
        return refused;
    }
    if (!*whole) return Nothing();
    Arrived arrived{std::move(**whole), arriving.bytes, {}};
    forget(session.id);
    return arrived;
}

std::size_t ArrivingTransactions::bytes(SessionId session) const {
    const auto arriving = arriving_.find(session);
    return arriving == arriving_.end() ? 0 : arriving->second.bytes;
}

void ArrivingTransactions::addNamed(std::unordered_set<Hash>& named) const {
    for (const auto& [session, arriving] : arriving_)
        for (const Edit& edit : arriving.parts.edits())
            forEachBlob(edit.action, [&](const Value& blob) { named.insert(blob.hash()); });
}

}  // namespace usdlive::server
