// The marks of the stream that a DDS session sends.
#pragma once

#include <cstddef>
#include <optional>
#include <utility>

#include "usdlive/common/dds/Segment.h"

namespace usdlive::server {

/// The position of one session's Reply stream among the commits that are sent once for all sessions
/// (DD5, DD6). Each function is called when something is sent, and returns the mark that it gets in
/// the stream. No I/O.
class ReplyMarks {
public:
    /// Whole frames, `bytes` long.
    [[nodiscard]] dds::StreamMark frames(std::size_t bytes) {
        end_ += bytes;
        return {lastCommit_};
    }
    /// A commit that is too large to be sent to all, `bytes` long.
    [[nodiscard]] dds::StreamMark commit(std::size_t bytes, Revision revision) {
        end_ += bytes;
        const dds::StreamMark mark{lastCommit_, false, revision + 1};
        live_ = true;
        lastCommit_ = revision;
        return mark;
    }
    /// The session takes no commits from here on.
    [[nodiscard]] dds::StreamMark hold() {
        live_ = false;
        return {lastCommit_, true};
    }
    /// The session takes commits again, from `next` on. Nothing: it does already.
    [[nodiscard]] std::optional<dds::StreamMark> release(Revision next) {
        if (live_ && lastCommit_ + 1 == next) return std::nullopt;
        const dds::StreamMark mark{lastCommit_, false, next};
        live_ = true;
        lastCommit_ = next - 1;
        return mark;
    }
    /// A commit that is sent to all, and that the session takes.
    [[nodiscard]] std::optional<dds::StreamMark> commitSent(Revision revision) {
        const auto mark = release(revision);
        lastCommit_ = revision;
        return mark;
    }
    /// Returns the number of bytes that the client must have received before the commit that is
    /// being sent to all, or nothing if a commit before has that mark. To be called for sessions
    /// that do not take the commit, too: until such a client receives the hold, it takes commits,
    /// and they must not overtake what was sent before the hold.
    [[nodiscard]] std::optional<std::uint64_t> unmarked() {
        if (std::exchange(marked_, end_) == end_) return std::nullopt;
        return end_;
    }

    /// The last commit that was sent to the session, individually or to all.
    [[nodiscard]] Revision lastCommit() const { return lastCommit_; }

private:
    std::uint64_t end_ = 0;     // bytes of the stream so far
    std::uint64_t marked_ = 0;  // position in the latest mark of a commit
    Revision lastCommit_ = 0;
    bool live_ = false;
};

}  // namespace usdlive::server
