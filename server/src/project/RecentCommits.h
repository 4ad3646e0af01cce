#pragma once

#include <deque>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest durable commits as they are broadcast, for sessions that resume. Holds at most
/// `maxBytes` of frames; older ones are read from the store.
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

private:
    std::deque<Entry> entries_;
    std::size_t bytes_ = 0;
    std::size_t maxBytes_;
};

}  // namespace usdlive::server
