// How large a transaction may be.
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

/// By how much addresses that follow a created spec grow when they are written out: a small
/// transaction may name a long path very often. `creations`: of its author.
[[nodiscard]] std::size_t expandedBytes(const OwnCreations& creations,
                                        const Transaction& transaction);

}  // namespace usdlive::server
