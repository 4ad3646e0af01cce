// Big values that a session uploads and downloads.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "session/Channel.h"
#include "session/MessageReader.h"
#include "session/Pending.h"
#include "session/Session.h"

namespace usdlive::client {

/// Makes the chunk of a big value that begins at `offset`, of at most `most` bytes.
[[nodiscard]] BlobFrame blobPart(const Hash& hash, const Bytes& bytes, std::uint64_t offset,
                                 std::size_t most);

/// The latest parts of big values that were sent on a connection. When it is lost, they say where
/// to continue (TL2).
class SentParts {
public:
    /// A part was sent as a frame of `frameBytes`.
    void add(const Hash& hash, std::uint64_t offset, std::size_t frameBytes);
    /// Returns for each value the first part among the last `unconfirmed` bytes that were sent;
    /// nothing for values without one.
    [[nodiscard]] std::map<Hash, std::uint64_t> firstOf(std::size_t unconfirmed) const;
    /// Returns the offset of the last part of the value, or 0.
    [[nodiscard]] std::uint64_t lastOf(const Hash& hash) const;
    void clear();

private:
    struct Part {
        Hash hash;
        std::uint64_t offset = 0;
        std::size_t frameBytes = 0;
    };
    /// More than this is never on the way (BulkWindow::kMost).
    static constexpr std::size_t kKeptBytes = 8 * 1024 * 1024;

    std::deque<Part> parts_;
    std::size_t bytes_ = 0;
};

/// Uploads big values to the server (V9), chunk by chunk between other messages. Keeps only the
/// hash of those that wait; the host has the bytes.
class BlobUploads {
public:
    explicit BlobUploads(SessionHost& host) : host_(host) {}

    /// Returns whether the server has all of them. Queues those that it does not have.
    [[nodiscard]] bool ready(const std::vector<Value>& blobs);
    /// Removes uploads that have not begun and that no ready() has named since the last call.
    void dropUnwanted();
    /// Sends up to `chunks` chunks, as many as the host takes.
    void send(std::size_t chunks, std::int64_t nowMs);

    /// Returns the progress of the uploads every kReportEveryMs, first when they have taken so
    /// long.
    [[nodiscard]] std::optional<event::Progress> progress(std::int64_t nowMs);

    [[nodiscard]] bool isStored(const Hash& hash) const { return stored_.contains(hash); }
    /// Called when the server has a value (BlobStored, or a commit that names it).
    void stored(const Hash& hash);
    /// Called when the server has refused a value. It is sent again from the start later, or, if
    /// that is useless, counts as stored: the server then refuses the transactions that name it.
    void refused(const Hash& hash, ErrorCode why, std::int64_t nowMs);
    /// Called when the server does not have a value that counted as stored.
    void forget(const Hash& hash) { stored_.erase(hash); }
    /// Called when the connection is lost. The next one continues the uploads before the last
    /// `unconfirmed` bytes that were sent (TL2).
    void disconnected(std::size_t unconfirmed);

private:
    struct Upload {
        Hash hash;
        std::uint64_t size = 0;
        SharedBytes bytes = nullptr;  ///< while parts of it are sent
        std::uint64_t offset = 0;
        bool begun = false;  ///< a part was sent on this connection
        bool sent = false;   ///< completely; the answer is pending
        bool wanted = true;  ///< named by a ready() since the last dropUnwanted()
        int mismatches = 0;
        std::int64_t notBeforeMs = 0;
    };
    static constexpr std::int64_t kAgainMs = 1'000;
    static constexpr std::int64_t kReportEveryMs = 500;
    static constexpr int kMaxMismatches = 5;
    static constexpr std::size_t kMostInterrupted = 1'000;

    [[nodiscard]] Upload* find(const Hash& hash);
    [[nodiscard]] std::uint64_t beginning(const Hash& hash) const;

    SessionHost& host_;
    std::deque<Upload> uploads_;
    SentParts parts_;
    std::map<Hash, std::uint64_t> interrupted_;  ///< offsets at which these uploads continue
    std::optional<std::int64_t>
        reportedMs_;  ///< time of the last report or of the start; nothing: no uploads
    std::uint64_t storedBytes_ = 0;  ///< size of the completed uploads since the start
    // Grows by 32 bytes for each big value of a session's life.
    std::set<Hash> stored_;
};

/// Downloads big values from the server.
class BlobDownloads {
public:
    explicit BlobDownloads(Channel& channel) : channel_(channel) {}

    /// Requests a value, now or when there is a connection. `lasting`: it is requested again until
    /// it has arrived or nobody needs it (B5); otherwise only while a preview waits.
    void want(const Hash& hash, bool lasting);
    [[nodiscard]] bool isAsked(const Hash& hash) const {
        const auto found = wanted_.find(hash);
        return found != wanted_.end() && found->second.asked;
    }
    /// The consequence of an arrival or a failure.
    enum class Outcome { NotWanted, Arrived, GivenUp, TriedAgain };
    struct Done {
        Outcome outcome = Outcome::NotWanted;
        bool lasting = false;
        bool first = false;  ///< the first failure
    };
    Done arrived(const Hash& hash);
    Done failed(const Hash& hash, std::int64_t nowMs);
    /// Requests again what is due. `needed` says whether a value is still needed.
    void requestDue(std::int64_t nowMs, const std::function<bool(const Hash&)>& needed);
    /// Called when a part has arrived; `bytes` of the value are here.
    void progressed(const Hash& hash, std::uint64_t bytes) {
        if (const auto found = wanted_.find(hash); found != wanted_.end())
            found->second.here = bytes;
    }
    /// Called when the connection is lost. The next one requests all lasting values again.
    void disconnected();

private:
    struct Wanted {
        bool lasting = false;
        bool asked = false;
        int failures = 0;
        std::int64_t notBeforeMs = 0;
        std::uint64_t here = 0;  ///< bytes, from which on it is requested (TL3)
    };
    static constexpr std::int64_t kFirstPauseMs = 100, kLongestPauseMs = 10'000;

    Channel& channel_;
    std::map<Hash, Wanted> wanted_;
};

}  // namespace usdlive::client
