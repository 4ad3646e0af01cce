#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string_view>

#include "SessionCore.h"
#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"
#include "usdlive/server/transport/DdsServer.h"
#include "usdlive/server/transport/OddSamples.h"
#include "usdlive/server/transport/SentCommits.h"

namespace usdlive::server {

class DdsSession;

/// A Submit sample, once it has been copied out of DDS.
struct Submit {
    OddSamples::Participant participant{};
    std::uint8_t protocol = 0;
    std::uint64_t client = 0, connection = 0;
    std::uint64_t ackReply = 0, ackBeside = 0;
    Revision resendFrom = 0, resendTo = 0;
    bool answer = false;
    bool isTooLarge = false;  ///< its bytes are not here
    dds::Segment segment;
};

/// What sessions know of the server they belong to, and outlive for a moment.
class DdsHub : public SessionHub {
public:
    const DdsServerOptions options;
    const std::unique_ptr<dds::Domain> domain;
    const std::uint64_t server;  ///< its name in DDS
    SentCommits commits;

    /// Calls flush() of it at the end of the turn.
    virtual void flushLater(std::shared_ptr<DdsSession> session) = 0;
    /// It is forgotten.
    virtual void finished(DdsSession& session) = 0;
    /// A sample is ignored: counts it, and says so the first time (DD13).
    virtual void ignored(Oddity oddity, const Submit& submit) = 0;

protected:
    DdsHub(boost::asio::io_context& io, DdsServerOptions options, SessionHandler& handler,
           Background background, Log& log, std::unique_ptr<dds::Domain> domain,
           std::uint64_t server)
        : SessionHub(io, handler, std::move(background), log),
          options(std::move(options)),
          domain(std::move(domain)),
          server(server) {}
    ~DdsHub() = default;
};

/// One client's session over DDS: its streams, and what a Transport does with one.
class DdsSession : public SessionCore {
public:
    [[nodiscard]] virtual std::uint64_t client() const = 0;
    [[nodiscard]] virtual std::uint64_t connection() const = 0;
    /// Who alone may speak for the client.
    [[nodiscard]] virtual const OddSamples::Participant& participant() const = 0;

    /// Tells the handler that it is there.
    virtual void start() = 0;
    virtual void received(Submit submit) = 0;

    /// The commit goes to all: marks the stream, and says what of it the client has to have before.
    virtual std::optional<SentCommits::Mark> commitSent(Revision revision) = 0;
    /// A commit too large for that.
    virtual void sendCommit(SharedBytes frame, Revision revision) = 0;
    virtual void holdCommits() = 0;
    virtual void releaseCommits(Revision next) = 0;
    /// News of one kind (nullptr: there is none); from now on the session is told what has this
    /// number or a higher one.
    virtual void sendFirst(SharedBytes frame, std::uint64_t statesFrom,
                           std::uint64_t presencesFrom) = 0;
    virtual void setReading(bool reading) = 0;

    /// Writes what is due.
    virtual void flush(dds::TimePoint now) = 0;
    /// Looks for a peer that is gone or does not read.
    virtual void sweep(dds::TimePoint now) = 0;
    /// When flush() is due again.
    [[nodiscard]] virtual dds::TimePoint deadline() const = 0;
    [[nodiscard]] virtual std::size_t queuedBytes() const = 0;

protected:
    using SessionCore::SessionCore;
};

/// Throws std::runtime_error when Cyclone cannot make its writers.
[[nodiscard]] std::shared_ptr<DdsSession> createDdsSession(DdsHub& hub, SessionId id,
                                                           const Submit& first);

}  // namespace usdlive::server
