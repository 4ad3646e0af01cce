// Compact frames (FR9-FR11): small transactions, commits and previews in few bytes. Names that a
// connection repeats have numbers; the author of a commit gets an acceptance instead of its edits.
#pragma once

#include <array>
#include <bitset>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <variant>
#include <vector>

#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// The feature of sessions that exchange compact frames.
inline constexpr const char* kCompactFeature = "compact";

/// FR9: larger transactions, commits and previews are sent as other frames.
inline constexpr std::size_t kMaxCompactEdits = 4096;
inline constexpr std::size_t kMaxCompactBytes = 256 * 1024;
/// FR10: how many names have numbers in one direction of a connection, and the longest of them.
inline constexpr std::uint32_t kMaxNames = 2048;
inline constexpr std::size_t kMaxNameBytes = 128;

/// A name and its number.
struct NumberedName {
    std::uint32_t number = 0;
    std::shared_ptr<const std::string> text;
};

/// An encoded compact frame, and the names that its receiver must know. It can be sent to any
/// number of sessions.
struct CompactFrame {
    SharedBytes bytes;  ///< with its length in front
    std::vector<NumberedName> names;
    std::uint64_t numbering = 0;  ///< which numbering the numbers belong to
};

/// The numbers that a sender gives to names: to those that occur a second time. It keeps at most
/// kMaxNames. When it is full and many names get no number, it starts another numbering, with the
/// same numbers for other names.
class NameNumbers {
public:
    NameNumbers();

    /// Call it before a frame is encoded.
    void beginFrame();
    /// Returns the number of a name, or nothing if the frame has to spell it.
    [[nodiscard]] std::optional<std::uint32_t> numberOf(std::string_view name);
    /// Adds to the frame the names that it uses.
    void endFrame(CompactFrame& frame);

private:
    struct Entry {
        std::shared_ptr<const std::string> text;
        std::uint64_t usedBy = 0;  ///< the newest frame that uses it
    };
    std::unordered_map<std::string_view, std::uint32_t> numbers_;  ///< views of the texts
    std::vector<Entry> names_;                                     ///< by number
    std::vector<std::size_t> seen_;  ///< hashes of names that occurred once, by the hash
    std::vector<std::uint32_t> used_;
    std::uint64_t frame_ = 0, numbering_ = 1;
    std::size_t unnumbered_ = 0;  ///< names that got no number since the numbering is full
};

/// The numbers that one receiver was told.
class KnownNames {
public:
    /// Returns the frame that the receiver needs before `frame`: the names that it does not know
    /// yet (FR10). Returns nullptr if it knows all of them.
    [[nodiscard]] SharedBytes introduce(const CompactFrame& frame);

private:
    std::bitset<kMaxNames> known_;
    std::uint64_t numbering_ = 0;
};

/// FR11: the server has committed a transaction exactly as this session has sent it. Its author
/// makes the commit from its own copy.
struct Acceptance {
    Revision revision = 0;
    Epoch epoch = 0;
    std::uint64_t sequence = 0;
    std::int64_t timeMs = 0;
    Hash previous;  ///< see beginsLike()
    Hash hashAfter;
    bool operator==(const Acceptance&) const = default;
};
/// A commit of a compact frame. Only the beginning of Commit::previous is known: see beginsLike().
struct CompactCommit {
    Commit commit;
    Hash hashAfter;
    bool operator==(const CompactCommit&) const = default;
};
/// Compares as much of a chain hash as compact frames contain.
[[nodiscard]] bool beginsLike(const Hash& beginning, const Hash& hash);

/// FR9: encode a frame. Returns nothing if it would be too large; it is then sent as another frame.
[[nodiscard]] std::optional<CompactFrame> encodeCompact(const Transaction& transaction,
                                                        NameNumbers& names);
[[nodiscard]] std::optional<CompactFrame> encodeCompact(const PreviewFrame& preview,
                                                        NameNumbers& names);
/// Precondition: the commit is neither an import nor conflated.
[[nodiscard]] std::optional<CompactFrame> encodeCompact(const CompactCommit& commit,
                                                        NameNumbers& names);
[[nodiscard]] Bytes encodeAcceptance(const Acceptance& acceptance);
/// Returns whether these edits may fit into a compact frame.
[[nodiscard]] bool mayBeCompact(const std::vector<Edit>& edits);

/// Returns whether a frame, without its length, is compact.
[[nodiscard]] bool isCompact(ByteView frame);

/// The content of a compact frame; std::monostate for one that only numbers names. A transaction
/// has no client: it is that of the session.
using CompactContent =
    std::variant<std::monostate, SubmitFrame, CompactCommit, Acceptance, PreviewFrame>;

/// Decodes the compact frames of one direction of a connection, and keeps the names that have
/// numbers.
class CompactReader {
public:
    /// Decodes and verifies a frame, without its length, as decodeFrame() does. Errors:
    /// MalformedFrame, UnknownFrame, InvalidLayerName, InvalidValue.
    [[nodiscard]] Result<CompactContent> read(ByteView frame);

private:
    std::vector<std::string> names_;  ///< by number; empty: not told
};

}  // namespace usdlive
