// A simulated session over DDS.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "SimClock.h"
#include "SimRandom.h"
#include "transport/CommitOrder.h"
#include "transport/ReplyMarks.h"
#include "transport/SentCommits.h"
#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"

namespace usdlive::simulation {

/// A session over DDS. Its two ends are the real classes; between them samples are lost, duplicated
/// and reordered. Commits are sent once for all sessions (SimNetwork).
class SimDds : public std::enable_shared_from_this<SimDds> {
public:
    struct Ends {
        std::function<void(SharedBytes)> toClient, toServer;
        std::function<void()> goodbye;  ///< the client has received everything that the server sent
        std::function<void()> drained;  ///< at the server's end
        std::function<void()> missedMuch;  ///< more is missing than the server keeps to send again
    };

    SimDds(SimClock& clock, SimRandom& random, const server::SentCommits& commits,
           std::uint64_t name, unsigned lossPercent, Ends ends)
        : clock_(clock),
          random_(random),
          commits_(commits),
          name_(name),
          lossPercent_(lossPercent),
          ends_(std::move(ends)) {}
    /// Drops everything that is on its way; no callback is called any more.
    void end() { ended_ = true; }

    // ---- the server's end
    void send(SharedBytes frames);
    void commitSent(Revision revision);
    [[nodiscard]] std::optional<server::SentCommits::Mark> mark();
    void sendCommit(SharedBytes frame, Revision revision);
    void holdCommits();
    void releaseCommits(Revision next);
    [[nodiscard]] bool congested();
    void close();

    // ---- the client's end
    void sendToServer(SharedBytes frames);
    /// Delivers a commit that was sent to all clients, with the usual losses and delays.
    void broadcast(Revision revision, std::uint64_t position, const SharedBytes& frame);

private:
    static constexpr std::size_t kMaxMessage = 64 << 20;
    [[nodiscard]] dds::TimePoint now() const {
        return dds::TimePoint{} + std::chrono::microseconds(clock_.nowUs());
    }
    void sample(std::function<void()> arrives);
    void push(SharedBytes frames, dds::StreamMark mark);
    void wakeServer(std::optional<dds::TimePoint> at = {});
    void wakeClient(std::optional<dds::TimePoint> at = {});
    void serverWorks();
    void clientWorks();
    void reply(const dds::Segment& segment);
    void submit(const dds::Segment& segment, std::optional<client::CommitOrder::Range> missing);
    void resend(client::CommitOrder::Range asked);

    SimClock& clock_;
    SimRandom& random_;
    const server::SentCommits& commits_;
    const std::uint64_t name_;
    const unsigned lossPercent_;
    const Ends ends_;
    bool ended_ = false;

    // ---- the server's end
    dds::SegmentSender replies_;
    dds::SegmentReceiver submits_{kMaxMessage};
    server::ReplyMarks marks_;
    bool congested_ = false;
    std::int64_t serverWakesUs_ = 0, serverSpokeUs_ = 0;

    // ---- the client's end
    client::CommitOrder order_{kMaxMessage};
    dds::SegmentSender out_;
    std::int64_t clientWakesUs_ = 0;
};

}  // namespace usdlive::simulation
