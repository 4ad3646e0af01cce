// Puts the commits of the DDS topic in order with the session's own stream.
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "usdlive/common/dds/SegmentReceiver.h"

namespace usdlive::client {

/// Merges the Reply stream of a server, which is for this client only, with the commits that the
/// server sends once for all clients (rules DD5-DD7). No I/O; one thread.
class CommitOrder {
public:
    /// A missing commit is requested after this time, because it may only be late.
    static constexpr std::chrono::milliseconds kRequestDelay{100};
    /// The most commits in one request.
    static constexpr Revision kRequestCommits = 64;
    /// Limits for commits that arrived too early. Further ones are dropped and requested later.
    static constexpr std::size_t kHeldCommits = 1'024;
    static constexpr std::size_t kHeldBytes = 64 * 1024 * 1024;

    explicit CommitOrder(std::size_t maxMessageBytes) : replies_(maxMessageBytes) {}

    [[nodiscard]] dds::SegmentReceiver& replies() { return replies_; }
    [[nodiscard]] std::optional<dds::TimePoint> ackDue() const { return replies_.ackDue(); }

    /// Adds a received commit. `position`: the number of bytes of the Reply stream before it.
    void commit(Revision revision, std::uint64_t position, SharedBytes frame);
    /// Call when the server has sent commits up to this one.
    void sent(Revision revision) { sent_ = std::max(sent_, revision); }

    /// Returns true if this commit was taken and later ones follow from the topic.
    [[nodiscard]] bool hasReached(Revision revision) const { return live_ && next_ > revision; }

    /// Returns the next message in order, or nothing while it is missing.
    [[nodiscard]] std::optional<dds::SegmentReceiver::Message> take(dds::TimePoint now);

    struct Range {
        Revision from = 0, to = 0;
    };
    /// Returns the commits to request now. Does not return them again for a while.
    [[nodiscard]] std::optional<Range> nextRequest(dds::TimePoint now);
    /// Returns the time when nextRequest() may return something, or nothing if no commit is
    /// missing.
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
    Revision next_ = 0;  ///< next commit
    bool live_ = false;  ///< commits are taken from the topic
    Revision sent_ = 0;
    Revision requestedTo_ = 0;                    ///< requested up to this one
    Revision missing_ = 0;                        ///< value of `next_` at the last check
    std::optional<dds::TimePoint> missingSince_;  ///< or the time of the last request
};

}  // namespace usdlive::client
