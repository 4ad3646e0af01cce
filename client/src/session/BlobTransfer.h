#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "Pending.h"
#include "session/MessageReader.h"
#include "session/Session.h"

namespace usdlive::client {

/// The next part of a big value from `offset` on.
[[nodiscard]] BlobFrame blobPart(const Hash& hash, const Bytes& bytes, std::uint64_t offset);

/// Big values on their way to the server (V9): part by part, beside the stream. Of those that wait
/// only the hash is kept; the host has the bytes.
class BlobUploads {
public:
    explicit BlobUploads(SessionHost& host) : host_(host) {}

    /// Are they all on the server? Queues those that are not.
    [[nodiscard]] bool ready(const std::vector<Value>& blobs);
    /// Removes uploads that are not begun and that no ready() has asked for since the last call:
    /// nothing names them any more.
    void dropUnwanted();
    /// Sends up to `chunks` parts.
    void send(std::size_t chunks, std::int64_t nowMs);

    /// How far the uploads are, if that is to be told now: every kTellEveryMs, from then on when
    /// they have taken so long.
    [[nodiscard]] std::optional<event::Progress> progress(std::int64_t nowMs);

    [[nodiscard]] bool isStored(const Hash& hash) const { return stored_.contains(hash); }
    /// The server has it (BlobStored, or a commit that names it).
    void stored(const Hash& hash);
    /// The server has refused it. It is sent again from the start in a while, or, if that is of no
    /// use, counts as stored: then the server refuses the transactions that name it.
    void refused(const Hash& hash, ErrorCode why, std::int64_t nowMs);
    /// It turned out that the server does not hold it.
    void forget(const Hash& hash) { stored_.erase(hash); }
    void disconnected() {
        uploads_.clear();
        toldMs_.reset();
    }

private:
    struct Upload {
        Hash hash;
        std::uint64_t size = 0;
        SharedBytes bytes = nullptr;  ///< while parts of it are sent
        std::uint64_t offset = 0;
        bool sent = false;   ///< all of it; to be answered
        bool wanted = true;  ///< since dropUnwanted()
        int mismatches = 0;
        std::int64_t notBeforeMs = 0;
    };
    static constexpr std::int64_t kAgainMs = 1'000;
    static constexpr std::int64_t kTellEveryMs = 500;
    static constexpr int kMaxMismatches = 5;

    [[nodiscard]] Upload* find(const Hash& hash);

    SessionHost& host_;
    std::deque<Upload> uploads_;
    std::optional<std::int64_t> toldMs_;  ///< or begun; nothing: none are under way
    std::uint64_t storedBytes_ = 0;       ///< of those that were under way together
    // Grows by 32 bytes for each big value of a session's life.
    std::set<Hash> stored_;
};

/// Big values on their way from the server.
class BlobDownloads {
public:
    /// True: it has to be asked for now. `lasting`: asked for again until it has come or nobody
    /// needs it (B5); otherwise only for as long as a preview waits for it.
    [[nodiscard]] bool want(const Hash& hash, bool lasting, bool online);
    [[nodiscard]] bool isAsked(const Hash& hash) const {
        const auto found = wanted_.find(hash);
        return found != wanted_.end() && found->second.asked;
    }
    /// What follows from its arrival or failure.
    enum class Outcome { NotWanted, Arrived, GivenUp, TriedAgain };
    struct Done {
        Outcome outcome = Outcome::NotWanted;
        bool lasting = false;
        bool first = false;  ///< the first failure
    };
    Done arrived(const Hash& hash);
    Done failed(const Hash& hash, std::int64_t nowMs);
    /// What has to be asked for again by now; `needed` says whether there is still a use for it.
    [[nodiscard]] std::vector<Hash> due(std::int64_t nowMs,
                                        const std::function<bool(const Hash&)>& needed);
    /// Everything has to be asked for again on the next connection, but what previews waited for.
    void disconnected();

private:
    struct Wanted {
        bool lasting = false;
        bool asked = false;
        int failures = 0;
        std::int64_t notBeforeMs = 0;
    };
    static constexpr std::int64_t kFirstPauseMs = 100, kLongestPauseMs = 10'000;

    std::map<Hash, Wanted> wanted_;
};

}  // namespace usdlive::client
