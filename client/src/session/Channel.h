// The way to the server of the present connection.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "session/Session.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive::client {

/// Sends frames to the server of the present connection, and knows what that server understands.
class Channel {
public:
    explicit Channel(SessionHost& host) : host_(host) {}

    /// There is a new connection. Nothing is known of its server.
    void connected();
    void welcomed(const Welcome& message);
    /// The connection is lost, or ends because of a message that cannot be read.
    void ended() { online_ = false; }

    /// Returns whether the server has sent its welcome.
    [[nodiscard]] bool isOnline() const { return online_; }
    /// The last welcome, also without a connection. It has no list of layers.
    [[nodiscard]] const std::optional<Welcome>& welcome() const { return welcome_; }
    /// Returns whether the server of the last welcome has a feature.
    [[nodiscard]] bool knows(std::string_view feature) const;
    [[nodiscard]] bool takesPreviewValues() const { return takesPreviewValues_; }  ///< B3
    /// The most bytes of a frame, and of a transaction.
    [[nodiscard]] std::uint64_t frameLimit() const;
    [[nodiscard]] std::uint64_t transactionLimit() const;

    void send(const ControlMessage& message) { send(encodeControl(message)); }
    /// Sends an encoded control message.
    void send(std::string control);
    void send(SharedBytes frames) { host_.send(std::move(frames)); }
    void send(Bytes frames) { send(std::make_shared<const Bytes>(std::move(frames))); }
    /// FR9: returns the compact frame of a transaction or preview, after the one that introduces
    /// its names. Returns nothing if the server does not know such frames, or the frame would be
    /// larger than `mostBytes`. The result has to be sent.
    template <class Content>
    [[nodiscard]] Bytes compactFrames(const Content& content, std::uint64_t mostBytes) {
        const auto frame = takesCompact_ ? encodeCompact(content, names_) : std::nullopt;
        if (!frame || frame->bytes->size() > mostBytes) return {};
        Bytes frames;
        if (const SharedBytes names = namesSent_.introduce(*frame)) frames = *names;
        frames.insert(frames.end(), frame->bytes->begin(), frame->bytes->end());
        return frames;
    }

private:
    SessionHost& host_;
    bool online_ = false;
    std::optional<Welcome> welcome_;
    bool takesCompact_ = false, takesPreviewValues_ = false;
    NameNumbers names_;
    KnownNames namesSent_;
};

}  // namespace usdlive::client
