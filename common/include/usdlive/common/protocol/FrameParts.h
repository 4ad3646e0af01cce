// Splits transactions and commits that are too large for a frame into parts (FR8), and joins them:
// frames of the same kind, each with some of the edits, in order.
#pragma once

#include <optional>

#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// The feature of both ends that know parts. All of protocol version 2 do, and name it.
inline constexpr const char* kPartsFeature = "parts";

/// The approximate size of a part in bytes. Such a part is within the bounds of FR7 however often
/// its edits name the same things, and other messages can be sent between two parts.
inline constexpr std::size_t kPartBytes = 2 * 1024 * 1024;
/// The most edits of a transaction, in one frame or in parts.
inline constexpr std::size_t kMaxTransactionEdits = 16'000'000;
/// The largest transaction unless configured otherwise: all its parts together, in bytes.
inline constexpr std::uint64_t kMaxTransactionBytes = std::uint64_t(1) << 30;

/// Returns the bytes of the names and values of an edit. Copies nothing.
[[nodiscard]] std::uint64_t leastFrameBytes(const Edit& edit);
/// Estimates the least size of a frame with these edits. An encoder cannot build more than 2 GiB.
[[nodiscard]] std::uint64_t leastFrameBytes(const std::vector<Edit>& edits);

/// The beginning of the next part.
struct PartsAt {
    std::uint32_t part = 0;
    std::size_t edit = 0, dropped = 0;
    bool isEnd = false;  ///< there is no next part
};
/// Encodes the next part with its length in front, and advances `at`. The part has about `bytes`,
/// or more if it is a single edit.
[[nodiscard]] Bytes encodePart(const Transaction& transaction, PartsAt& at,
                               std::size_t bytes = kPartBytes);
[[nodiscard]] Bytes encodePart(const Commit& commit, PartsAt& at, std::size_t bytes = kPartBytes);

/// Joins the parts of one transaction as they arrive. The caller bounds their size.
class SubmitParts {
public:
    /// Returns the transaction with the last part, and nothing before. MalformedFrame: the part
    /// does not follow the one before.
    [[nodiscard]] Result<std::optional<Transaction>> add(SubmitFrame part);
    [[nodiscard]] const TransactionId& id() const { return whole_.id; }
    /// The edits of the parts so far.
    [[nodiscard]] const std::vector<Edit>& edits() const { return whole_.edits; }

private:
    Transaction whole_;
    std::uint32_t next_ = 0;
};

/// A commit that came in parts, and its chain hash.
struct JoinedCommit {
    Commit commit;
    Hash hashAfter;
};
/// Joins the parts of one commit as they arrive.
class CommitParts {
public:
    /// `encoded`: the part's frame without its length.
    [[nodiscard]] Result<std::optional<JoinedCommit>> add(CommitFrame part, ByteView encoded);

private:
    Commit whole_;
    Sha256 hash_;
    std::uint32_t next_ = 0;
};

}  // namespace usdlive
