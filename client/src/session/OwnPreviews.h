// Previews of the own gesture.
#pragma once

#include <cstdint>

#include "session/BlobTransfer.h"
#include "session/Channel.h"
#include "session/Gesture.h"

namespace usdlive::client {

/// Sends previews of the own gesture to the others (M11), each after its big values (B3).
class OwnPreviews {
public:
    OwnPreviews(const Session::Options& options, SessionHost& host, Channel& channel,
                const BlobUploads& uploads)
        : options_(options), host_(host), channel_(channel), uploads_(uploads) {}

    /// Sends a preview if the gesture has changed and it is time.
    void send(Gesture& gesture, std::int64_t nowMs);
    /// Takes the last preview of a gesture back. 0: there is none.
    void withdraw(std::uint64_t gesture, Revision revision);

private:
    [[nodiscard]] bool prepare(Gesture& gesture, std::int64_t nowMs);
    [[nodiscard]] bool sendValues(Gesture& gesture);

    const Session::Options& options_;
    SessionHost& host_;
    Channel& channel_;
    const BlobUploads& uploads_;
};

}  // namespace usdlive::client
