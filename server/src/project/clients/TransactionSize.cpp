// Measures transactions, and refuses those that are too large.
#include "project/clients/TransactionSize.h"

#include <string>
#include <unordered_map>

namespace usdlive::server {

namespace {

std::string mib(std::uint64_t bytes) {
    constexpr std::uint64_t kMib = 1024 * 1024;
    return std::to_string((bytes + kMib - 1) / kMib) + " MiB";
}

}  // namespace

Refused transactionTooLarge(std::size_t edits, std::uint64_t bytes,
                            const TransactionLimits& limits) {
    return {{ErrorCode::TransactionTooLarge,
             "a transaction of " + std::to_string(edits) + " edits and " + mib(bytes) +
                 "; the server takes " + std::to_string(kMaxTransactionEdits) + " edits and " +
                 mib(limits.bytes) +
                 ". Write it in several frames, with tick() between them, or serve with a larger "
                 "--max-transaction-mib"}};
}

std::size_t expandedBytes(const OwnCreations& creations, const Transaction& transaction) {
    // By index of the edit: length of the created spec's path.
    std::unordered_map<std::uint32_t, std::size_t> own;
    const auto lengthOf = [&](const Creation& creation) -> std::size_t {
        if (creation.sequence == transaction.id.sequence) {
            const auto found = own.find(creation.edit);
            return found == own.end() ? 0 : found->second;
        }
        const auto* entry = creations.find(creation);
        return entry ? entry->path.size() : 0;
    };
    std::size_t expanded = 0;
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const Edit& edit = transaction.edits[index];
        const std::size_t base = edit.address.creation ? lengthOf(*edit.address.creation) : 0;
        expanded += base;
        if (std::holds_alternative<CreateSpec>(edit.action) || concernsPlace(edit.action))
            own[std::uint32_t(index)] = base + edit.address.path.size();
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && move->parent.creation) expanded += lengthOf(*move->parent.creation);
        for (const Address& name : edit.names)
            expanded += name.path.size() + (name.creation ? lengthOf(*name.creation) : 0);
    }
    return expanded;
}

}  // namespace usdlive::server
