#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "SimClock.h"
#include "SimRandom.h"
#include "usdlive/client/transport/CommitOrder.h"
#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"
#include "usdlive/server/transport/SentCommits.h"

namespace usdlive::simulation {

/// A session over DDS: what thinks at its two ends, the real parts, and between them samples that
/// are lost, doubled and overtake one another. Commits come once for all sessions (SimNetwork).
class SimDds : public std::enable_shared_from_this<SimDds> {
public:
    struct Ends {
        std::function<void(SharedBytes)> toClient, toServer;
        std::function<void()> goodbye;     ///< the client has had all that the server sent
        std::function<void()> drained;     ///< the server's end
        std::function<void()> missedMuch;  ///< more than is kept to be sent again
    };

    SimDds(SimClock& clock, SimRandom& random, const server::SentCommits& commits,
           std::uint64_t name, unsigned lossPercent, Ends ends)
        : clock_(clock),
          random_(random),
          commits_(commits),
          name_(name),
          lossPercent_(lossPercent),
          ends_(std::move(ends)) {}
    /// What is on its way is nobody's, and nothing is called any more.
    void end() { ended_ = true; }

    // The server's end.
    void send(SharedBytes frames);
    std::optional<server::SentCommits::Mark> commitSent(Revision revision);
    void sendCommit(SharedBytes frame, Revision revision);
    void holdCommits();
    void releaseCommits(Revision next);
    [[nodiscard]] bool congested();
    void close();

    // The client's end.
    void sendToServer(SharedBytes frames);
    /// A commit that was sent to all; on its way from here on.
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

    // The server's.
    dds::SegmentSender replies_;
    dds::SegmentReceiver submits_{kMaxMessage};
    std::uint64_t streamEnd_ = 0, marked_ = 0;
    Revision lastCommit_ = 0;
    bool live_ = false, congested_ = false;
    std::int64_t serverWakesUs_ = 0, serverSpokeUs_ = 0;

    // The client's.
    client::CommitOrder order_{kMaxMessage};
    dds::SegmentSender out_;
    std::int64_t clientWakesUs_ = 0;
};

}  // namespace usdlive::simulation
