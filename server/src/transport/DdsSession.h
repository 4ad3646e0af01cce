// One client's session over DDS.
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string_view>

#include "transport/DdsServer.h"
#include "transport/IgnoredSamples.h"
#include "transport/SentCommits.h"
#include "transport/SessionCore.h"
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"

namespace usdlive::server {

class DdsSession;

/// A Submit sample that was copied out of DDS.
struct Submit {
    IgnoredSamples::Participant participant{};
    std::string user;  ///< see SampleInfo::user
    std::uint8_t protocol = 0;
    std::uint64_t client = 0, connection = 0;
    std::uint64_t ackReply = 0, ackBeside = 0;
    Revision resendFrom = 0, resendTo = 0;
    bool answer = false;
    bool isTooLarge = false;  ///< its bytes were not copied
    dds::Segment segment;
};

/// The part of the server that sessions use. It outlives them for a moment.
class DdsHub : public SessionHub {
public:
    const DdsServerOptions options;
    const std::unique_ptr<dds::Domain> domain;
    const std::uint64_t server;  ///< its number in DDS
    SentCommits commits;

    /// Calls the session's flush() at the end of this turn of the event loop.
    virtual void flushLater(std::shared_ptr<DdsSession> session) = 0;
    /// Called when the session has ended; the hub forgets it.
    virtual void finished(DdsSession& session) = 0;
    /// Counts an ignored sample, and logs the first one of a participant (DD13).
    virtual void ignored(IgnoreReason reason, const Submit& submit) = 0;

protected:
    DdsHub(boost::asio::io_context& io, DdsServerOptions options, SessionHandler& handler,
           Background background, Log& log, std::unique_ptr<dds::Domain> domain,
           std::uint64_t server)
        : SessionHub(io, handler, std::move(background), log, options.greetTime),
          options(std::move(options)),
          domain(std::move(domain)),
          server(server) {}
    ~DdsHub() = default;
};

/// One client's session over DDS: its streams and the calls of Transport for one session.
class DdsSession : public SessionCore {
public:
    [[nodiscard]] virtual std::uint64_t client() const = 0;
    [[nodiscard]] virtual std::uint64_t connection() const = 0;
    /// Returns the only participant that may send for this client.
    [[nodiscard]] virtual const IgnoredSamples::Participant& participant() const = 0;

    /// Reports the new session to the handler.
    virtual void start() = 0;
    virtual void received(Submit submit) = 0;

    /// Marks the stream for a commit that is sent to all, and that this session takes.
    virtual void commitSent(Revision revision) = 0;
    /// Returns the mark that the commit needs for this session, whether it takes the commit or not
    /// (ReplyMarks::unmarked()).
    [[nodiscard]] virtual std::optional<SentCommits::Mark> mark() = 0;
    /// Sends a commit that is too large to be sent to all.
    virtual void sendCommit(SharedBytes frame, Revision revision) = 0;
    virtual void holdCommits() = 0;
    virtual void releaseCommits(Revision next) = 0;
    /// Sends the present states of one kind (`frame` is nullptr if there are none). From then on
    /// the session takes samples with this number or a higher one.
    virtual void sendFirst(SharedBytes frame, std::uint64_t statesFrom,
                           std::uint64_t presencesFrom) = 0;
    virtual void setReading(bool reading) = 0;

    /// Writes everything that is due.
    virtual void flush(dds::TimePoint now) = 0;
    /// Ends the session if the peer is lost or does not read.
    virtual void sweep(dds::TimePoint now) = 0;
    /// Returns the time when flush() is due again.
    [[nodiscard]] virtual dds::TimePoint deadline() const = 0;
    [[nodiscard]] virtual std::size_t queuedBytes() const = 0;

protected:
    using SessionCore::SessionCore;
};

/// Throws std::runtime_error if Cyclone DDS cannot create the writers.
[[nodiscard]] std::shared_ptr<DdsSession> createDdsSession(DdsHub& hub, SessionId id,
                                                           const Submit& first);

}  // namespace usdlive::server
