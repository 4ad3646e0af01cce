// The latest commits for DDS clients that have missed some.
#pragma once

#include <deque>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/protocol/Control.h"  // Revision

namespace usdlive::server {

/// Keeps the latest broadcast commits for clients that have missed some (DD7).
class SentCommits {
public:
    static constexpr std::size_t kCommits = 1'024;
    static constexpr std::size_t kBytes = 64 * 1024 * 1024;

    /// A client that must have received `position` bytes of its own stream before the commit.
    struct Mark {
        std::uint64_t client = 0, position = 0;
    };
    struct Sent {
        SharedBytes frame;  ///< nullptr: it was sent to each client individually
        std::vector<Mark> marks;
        [[nodiscard]] std::uint64_t positionOf(std::uint64_t client) const;
    };

    void add(Revision revision, Sent sent);
    /// Returns nullptr if the commit is not kept any more, or not yet.
    [[nodiscard]] const Sent* find(Revision revision) const;
    [[nodiscard]] Revision newest() const { return first_ + sent_.size() - 1; }

private:
    void dropFirst();

    std::deque<Sent> sent_;
    Revision first_ = 1;
    std::size_t bytes_ = 0;
};

}  // namespace usdlive::server
