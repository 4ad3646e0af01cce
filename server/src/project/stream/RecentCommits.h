// Durable commits that are kept in memory to be sent again.
#pragma once

#include <algorithm>
#include <deque>
#include <map>
#include <memory>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest durable commits as they are broadcast, for sessions that resume. Holds at most
/// `maxBytes` of frames; older ones are read from the store. Beside them it finds commits in parts
/// (FR8), however old, while some session is being sent them: one copy serves all.
class RecentCommits {
public:
    struct Entry {
        Revision revision = 0;
        SharedBytes frame;  ///< with its length prefix; a stub for an import (CH2)
        Hash hash;          ///< chain hash after it
    };

    explicit RecentCommits(std::size_t maxBytes) : maxBytes_(maxBytes) {}

    /// Precondition: follows the one added last.
    void add(Entry entry) {
        bytes_ += entry.frame->size();
        entries_.push_back(std::move(entry));
        while (bytes_ > maxBytes_) {
            bytes_ -= entries_.front().frame->size();
            entries_.pop_front();
        }
    }

    /// nullptr when it is not held.
    [[nodiscard]] const Entry* find(Revision revision) const {
        if (entries_.empty() || revision < entries_.front().revision) return nullptr;
        const Revision index = revision - entries_.front().revision;
        return index < entries_.size() ? &entries_[index] : nullptr;
    }

    /// A session is being sent this commit in parts.
    void shareInParts(Revision revision, const SharedBytes& frames) {
        newestInParts_ = std::max(newestInParts_, revision);
        inParts_[revision] = frames;
    }
    /// nullptr when no session is being sent it.
    [[nodiscard]] SharedBytes findInParts(Revision revision) {
        const auto found = inParts_.find(revision);
        if (found == inParts_.end()) return nullptr;
        SharedBytes frames = found->second.lock();
        if (!frames) inParts_.erase(found);
        return frames;
    }
    /// The newest commit in parts that this process has sent: a client that cannot read it cannot
    /// resume before it.
    [[nodiscard]] Revision newestInParts() const { return newestInParts_; }

private:
    std::deque<Entry> entries_;
    std::size_t bytes_ = 0;
    std::size_t maxBytes_;
    std::map<Revision, std::weak_ptr<const Bytes>> inParts_;
    Revision newestInParts_ = 0;
};

}  // namespace usdlive::server
