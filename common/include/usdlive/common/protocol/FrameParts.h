#pragma once

// Transactions and commits that no frame can hold travel in parts (FR8): frames of their kind, each
// with some of the edits, in order.

#include <optional>

#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// The feature of sessions that know parts. Others get the layers anew instead.
inline constexpr const char* kPartsFeature = "parts";

/// A part has about so many bytes. What one holds is then below FR7's bounds, however often its
/// edits name the same things, and other messages pass between two of them.
inline constexpr std::size_t kPartBytes = 2 * 1024 * 1024;
/// A transaction has no more edits than this, in one frame or in parts.
inline constexpr std::size_t kMaxTransactionEdits = 16'000'000;
/// Neither is a transaction larger unless configured otherwise, all its parts together.
inline constexpr std::uint64_t kMaxTransactionBytes = std::uint64_t(1) << 30;

/// The bytes of names and values of an edit. Costs no copy.
[[nodiscard]] std::uint64_t leastFrameBytes(const Edit& edit);
/// What a frame with these edits has at least, about: an encoder cannot build more than 2 GiB.
[[nodiscard]] std::uint64_t leastFrameBytes(const std::vector<Edit>& edits);

/// Where the next part begins.
struct PartsAt {
    std::uint32_t part = 0;
    std::size_t edit = 0, dropped = 0;
    bool isEnd = false;  ///< there is none
};
/// Encodes the next part with its length in front, and moves `at` on. It has about `bytes`, or is
/// larger with a single edit.
[[nodiscard]] Bytes encodePart(const Transaction& transaction, PartsAt& at,
                               std::size_t bytes = kPartBytes);
[[nodiscard]] Bytes encodePart(const Commit& commit, PartsAt& at, std::size_t bytes = kPartBytes);

/// Joins the parts of one transaction as they come. The caller bounds what is joined.
class SubmitParts {
public:
    /// The whole with the last part; nothing before. MalformedFrame: it does not follow.
    [[nodiscard]] Result<std::optional<Transaction>> add(SubmitFrame part);
    [[nodiscard]] const TransactionId& id() const { return whole_.id; }
    /// Of the parts so far.
    [[nodiscard]] const std::vector<Edit>& edits() const { return whole_.edits; }

private:
    Transaction whole_;
    std::uint32_t next_ = 0;
};

/// The same of a commit, and its chain hash.
struct JoinedCommit {
    Commit commit;
    Hash hashAfter;
};
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
