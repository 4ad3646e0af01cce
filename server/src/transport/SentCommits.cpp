// Keeps the latest broadcast commits.
#include "transport/SentCommits.h"

#include <utility>

namespace usdlive::server {

namespace {

std::size_t sizeOf(const SentCommits::Sent& sent) {
    return sent.marks.size() * sizeof(SentCommits::Mark) + (sent.frame ? sent.frame->size() : 0);
}

}  // namespace

std::uint64_t SentCommits::Sent::positionOf(std::uint64_t client) const {
    for (const Mark& mark : marks)
        if (mark.client == client) return mark.position;
    return 0;
}

void SentCommits::add(Revision revision, Sent sent) {
    // There was a gap without any client.
    if (revision != newest() + 1) {
        sent_.clear();
        bytes_ = 0;
        first_ = revision;
    }
    bytes_ += sizeOf(sent);
    sent_.push_back(std::move(sent));
    while (sent_.size() > kCommits || (bytes_ > kBytes && sent_.size() > 1)) dropFirst();
}

const SentCommits::Sent* SentCommits::find(Revision revision) const {
    if (revision < first_ || revision > newest()) return nullptr;
    return &sent_[revision - first_];
}

void SentCommits::dropFirst() {
    bytes_ -= sizeOf(sent_.front());
    sent_.pop_front();
    ++first_;
}

}  // namespace usdlive::server
