#pragma once

#include <map>
#include <optional>
#include <vector>

#include "usdlive/common/dds/SegmentReceiver.h"

namespace usdlive::client {

/// Makes one ordered stream of a server's Reply stream, which is this client's alone, and the
/// commits that it sends once for all (rules DD5-DD7). Without I/O; one thread.
class CommitOrder {
public:
    /// A commit that is missing so long is asked for; before, it may just be late.
    static constexpr std::chrono::milliseconds kPatience{100};
    /// Asked for at once.
    static constexpr Revision kAsked = 64;
    /// Commits that came too early are kept up to here; what is over is asked for later.
    static constexpr std::size_t kHeldCommits = 1'024;
    static constexpr std::size_t kHeldBytes = 64 * 1024 * 1024;

    explicit CommitOrder(std::size_t maxMessageBytes) : replies_(maxMessageBytes) {}

    [[nodiscard]] dds::SegmentReceiver& replies() { return replies_; }
    [[nodiscard]] std::optional<dds::TimePoint> ackDue() const { return replies_.ackDue(); }

    /// A commit, as it came. `position`: it follows so many bytes of the Reply stream.
    void commit(Revision revision, std::uint64_t position, SharedBytes frame);
    /// The server has sent commits up to this one.
    void sent(Revision revision) { sent_ = std::max(sent_, revision); }

    /// This commit was taken, and those that come now follow it.
    [[nodiscard]] bool hasReached(Revision revision) const { return live_ && next_ > revision; }

    /// What is next, in order; nothing while it is missing.
    [[nodiscard]] std::optional<dds::SegmentReceiver::Message> take(dds::TimePoint now);

    struct Range {
        Revision from = 0, to = 0;
    };
    /// Commits to ask for now; they are not told again for a while.
    [[nodiscard]] std::optional<Range> toAsk(dds::TimePoint now);
    /// When toAsk() may have something; nothing while none is missing.
    [[nodiscard]] std::optional<dds::TimePoint> deadline() const;

private:
    struct Held {
        std::uint64_t position = 0;
        SharedBytes frame;
    };

    [[nodiscard]] std::optional<dds::SegmentReceiver::Message> takeReply(dds::TimePoint now);
    [[nodiscard]] std::optional<dds::SegmentReceiver::Message> takeCommit();
    void look(dds::TimePoint now);
    [[nodiscard]] Revision lastMissing() const;
    void drop(std::map<Revision, Held>::iterator entry);

    dds::SegmentReceiver replies_;
    std::map<Revision, Held> held_;
    std::size_t heldBytes_ = 0;
    Revision next_ = 0;  ///< of the commits
    bool live_ = false;  ///< commits come by the topic
    Revision sent_ = 0;
    Revision asked_ = 0;                          ///< up to here
    Revision missing_ = 0;                        ///< `next_` at the last look
    std::optional<dds::TimePoint> missingSince_;  ///< or asked for then
};

}  // namespace usdlive::client
