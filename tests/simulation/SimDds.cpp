// A session over DDS with a bad network between its ends.
#include "SimDds.h"

#include <algorithm>
#include <utility>

namespace usdlive::simulation {

namespace {

constexpr std::int64_t kKeepAliveUs = 2'000'000;
constexpr std::size_t kCongestedBytes = 4'000;

std::int64_t usOf(dds::TimePoint time) {
    return std::chrono::duration_cast<std::chrono::microseconds>(time.time_since_epoch()).count();
}

}  // namespace

void SimDds::sample(std::function<void()> arrives) {
    const auto deliver = [&](std::int64_t delayUs) {
        clock_.in(delayUs, [weak = weak_from_this(), arrives] {
            if (const auto self = weak.lock(); self && !self->ended_) arrives();
        });
    };
    if (random_.chance(lossPercent_)) return;
    deliver(random_.between(50, 5'000));
    if (random_.chance(5)) deliver(random_.between(1'000, 200'000));
}

// ---- the server's end

void SimDds::push(SharedBytes frames, dds::StreamMark mark) {
    replies_.push(std::move(frames), mark);
    wakeServer();
}

void SimDds::send(SharedBytes frames) {
    const dds::StreamMark mark = marks_.frames(frames->size());
    push(std::move(frames), mark);
}

void SimDds::commitSent(Revision revision) {
    if (const auto mark = marks_.commitSent(revision)) push(nullptr, *mark);
}

std::optional<server::SentCommits::Mark> SimDds::mark() {
    const auto position = marks_.unmarked();
    if (!position) return std::nullopt;
    return server::SentCommits::Mark{name_, *position};
}

void SimDds::sendCommit(SharedBytes frame, Revision revision) {
    const dds::StreamMark mark = marks_.commit(frame->size(), revision);
    push(std::move(frame), mark);
}

void SimDds::holdCommits() { push(nullptr, marks_.hold()); }

void SimDds::releaseCommits(Revision next) {
    if (const auto mark = marks_.release(next)) push(nullptr, *mark);
}

bool SimDds::congested() {
    congested_ = replies_.queuedBytes() > kCongestedBytes;
    return congested_;
}

void SimDds::close() {
    replies_.pushEnd();
    wakeServer();
}

void SimDds::wakeServer(std::optional<dds::TimePoint> at) {
    const std::int64_t dueUs = std::max(at ? usOf(*at) : clock_.nowUs(), clock_.nowUs());
    if (serverWakesUs_ > clock_.nowUs() && serverWakesUs_ <= dueUs) return;
    serverWakesUs_ = dueUs;
    clock_.at(dueUs, [weak = weak_from_this()] {
        if (const auto self = weak.lock(); self && !self->ended_) self->serverWorks();
    });
}

void SimDds::serverWorks() {
    while (const auto message = submits_.take(now())) {
        if (message->bytes) ends_.toServer(message->bytes);
        if (ended_) return;
    }
    const auto due = replies_.take(now());
    for (const dds::Segment& segment : due) reply(segment);
    const bool ackDue = submits_.ackDue() && *submits_.ackDue() <= now();
    if (due.empty() && (ackDue || clock_.nowUs() >= serverSpokeUs_ + kKeepAliveUs)) reply({});
    if (congested_ && replies_.queuedBytes() <= kCongestedBytes) {
        congested_ = false;
        ends_.drained();
    }
    if (ended_) return;
    std::optional<dds::TimePoint> next =
        dds::TimePoint{} + std::chrono::microseconds(serverSpokeUs_ + kKeepAliveUs);
    for (const auto& deadline : {replies_.deadline(), submits_.ackDue()})
        if (deadline) next = std::min(*next, *deadline);
    wakeServer(std::max(*next, now() + std::chrono::microseconds(1)));
}

void SimDds::reply(const dds::Segment& segment) {
    serverSpokeUs_ = clock_.nowUs();
    submits_.ackSent();
    sample([this, segment, acknowledged = submits_.taken(),
            sent = segment.sequence != 0 ? segment.mark.afterCommit : marks_.lastCommit()] {
        out_.acknowledged(acknowledged, now());
        order_.sent(sent);
        if (segment.sequence != 0) order_.replies().received(segment, now());
        wakeClient();
    });
}

void SimDds::resend(client::CommitOrder::Range asked) {
    if (asked.from > commits_.newest()) return;
    if (!commits_.find(asked.from)) return ends_.missedMuch();
    for (Revision revision = asked.from; revision <= asked.to; ++revision) {
        const auto* sent = commits_.find(revision);
        if (!sent) return;
        if (sent->frame) broadcast(revision, sent->positionOf(name_), sent->frame);
    }
}

// ---- the client's end

void SimDds::sendToServer(SharedBytes frames) {
    out_.push(std::move(frames));
    wakeClient();
}

void SimDds::broadcast(Revision revision, std::uint64_t position, const SharedBytes& frame) {
    sample([this, revision, position, frame] {
        order_.commit(revision, position, frame);
        wakeClient();
    });
}

void SimDds::wakeClient(std::optional<dds::TimePoint> at) {
    const std::int64_t dueUs = std::max(at ? usOf(*at) : clock_.nowUs(), clock_.nowUs());
    if (clientWakesUs_ > clock_.nowUs() && clientWakesUs_ <= dueUs) return;
    clientWakesUs_ = dueUs;
    clock_.at(dueUs, [weak = weak_from_this()] {
        if (const auto self = weak.lock(); self && !self->ended_) self->clientWorks();
    });
}

void SimDds::clientWorks() {
    while (const auto message = order_.take(now())) {
        if (message->bytes) ends_.toClient(message->bytes);
        if (ended_) return;
        if (message->end) return ends_.goodbye();
    }
    const auto due = out_.take(now());
    for (const dds::Segment& segment : due) submit(segment, std::nullopt);
    const auto missing = order_.nextRequest(now());
    const bool ackDue = order_.ackDue() && *order_.ackDue() <= now();
    if (missing || ackDue) submit({}, missing);
    std::optional<dds::TimePoint> next;
    for (const auto& deadline : {out_.deadline(), order_.deadline(), order_.ackDue()})
        if (deadline) next = next ? std::min(*next, *deadline) : *deadline;
    if (next) wakeClient(std::max(*next, now() + std::chrono::microseconds(1)));
}

void SimDds::submit(const dds::Segment& segment,
                    std::optional<client::CommitOrder::Range> missing) {
    order_.replies().ackSent();
    sample([this, segment, missing, acknowledged = order_.replies().taken()] {
        replies_.acknowledged(acknowledged, now());
        if (segment.sequence != 0) submits_.received(segment, now());
        if (missing) resend(*missing);
        if (!ended_) wakeServer();
    });
}

}  // namespace usdlive::simulation
