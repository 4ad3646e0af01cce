// The limits for the size of a transaction.
#pragma once

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

struct TransactionLimits {
    std::size_t edits = kMaxTransactionEdits;
    std::uint64_t bytes = kMaxTransactionBytes;
};

[[nodiscard]] Refused transactionTooLarge(std::size_t edits, std::uint64_t bytes,
                                          const TransactionLimits& limits);

/// Returns how many bytes the transaction grows when addresses that name a created spec are
/// replaced by whole paths. A small transaction may name a long path very often. `creations` are
/// those of its author.
[[nodiscard]] std::size_t expandedBytes(const OwnCreations& creations,
                                        const Transaction& transaction);

}  // namespace usdlive::server
