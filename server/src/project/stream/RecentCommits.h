// The newest durable commits, kept in memory for sessions that need them again.
#pragma once

#include <algorithm>
#include <deque>
#include <map>
#include <memory>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest durable commits as they are sent, for sessions that resume. Keeps at most `maxBytes`
/// of frames; older commits are read from the store. Also finds commits in parts (FR8) of any age
/// while a session is being sent them, so that all sessions share one copy.
class RecentCommits {
public:
    struct Entry {
        Revision revision = 0;
        SharedBytes frame;  ///< with its length prefix; a stub for an import (CH2)
        Hash hash;          ///< hash of the chain up to and including it
    };

    explicit RecentCommits(std::size_t maxBytes) : maxBytes_(maxBytes) {}

    /// Adds a commit. Precondition: it follows the one that was added last.
    void add(Entry entry) {
        bytes_ += entry.frame->size();
        entries_.push_back(std::move(entry));
        while (bytes_ > maxBytes_) {
            bytes_ -= entries_.front().frame->size();
            entries_.pop_front();
        }
    }

    /// Returns nullptr if the commit is not in memory.
    [[nodiscard]] const Entry* find(Revision revision) const {
        if (entries_.empty() || revision < entries_.front().revision) return nullptr;
        const Revision index = revision - entries_.front().revision;
        return index < entries_.size() ? &entries_[index] : nullptr;
    }

    /// Call it when a session is being sent this commit in parts.
    void shareInParts(Revision revision, const SharedBytes& frames) { inParts_[revision] = frames; }
    /// Returns nullptr if no session is being sent the commit.
    [[nodiscard]] SharedBytes findInParts(Revision revision) {
        const auto found = inParts_.find(revision);
        if (found == inParts_.end()) return nullptr;
        SharedBytes frames = found->second.lock();
        if (!frames) inParts_.erase(found);
        return frames;
    }

private:
    std::deque<Entry> entries_;
    std::size_t bytes_ = 0;
    std::size_t maxBytes_;
    std::map<Revision, std::weak_ptr<const Bytes>> inParts_;
};

}  // namespace usdlive::server
