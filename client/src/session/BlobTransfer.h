#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <vector>

#include "Pending.h"
#include "usdlive/client/session/MessageReader.h"
#include "usdlive/client/session/Session.h"

namespace usdlive::client {

/// Big values on their way to the server (V9): part by part, beside the stream.
class BlobUploads {
public:
    explicit BlobUploads(SessionHost& host) : host_(host) {}

    /// Are they all on the server? Starts to bring those that are not.
    [[nodiscard]] bool ready(const std::vector<Value>& blobs);
    /// Sends up to `chunks` parts.
    void send(std::size_t chunks, std::int64_t nowMs);

    /// The server has it (BlobStored, or a commit that names it).
    void stored(const Hash& hash);
    /// It did not take it for now: brought again from the start, in a while.
    void again(const Hash& hash, std::int64_t nowMs);
    /// It turned out that the server does not hold it.
    void forget(const Hash& hash);
    void disconnected();
    void forgetAll();

private:
    struct Upload {
        Hash hash;
        SharedBytes bytes;
        std::uint64_t offset = 0;
        std::int64_t notBeforeMs = 0;
    };
    static constexpr std::int64_t kAgainMs = 1'000;

    [[nodiscard]] Upload* find(const Hash& hash);

    SessionHost& host_;
    std::deque<Upload> uploads_;
    // Grows by 32 bytes for each big value of a session's life.
    std::set<Hash> stored_;
};

/// Big values on their way from the server.
class BlobDownloads {
public:
    explicit BlobDownloads(SessionHost& host) : host_(host) {}

    /// True: it has to be asked for.
    bool want(const Hash& hash) { return wanted_.insert(hash).second; }
    /// What has to be asked for again on a new connection.
    [[nodiscard]] const std::set<Hash>& wanted() const { return wanted_; }
    /// A part of one. An error: the bytes are not what was asked for; it is given up.
    Result<void> received(ReceivedBlob&& blob);
    /// The server does not have it. False: it was not wanted.
    bool failed(const Hash& hash) { return wanted_.erase(hash) > 0; }

private:
    SessionHost& host_;
    std::set<Hash> wanted_;
};

}  // namespace usdlive::client
