#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/client/session/MessageReader.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/dds/Domain.h"

namespace usdlive::client {

/// Where a project is: `ws://host:port`, `usdlive://host:port` or `host:port` (all the same), or
/// `dds://project`. A path after it names a layer: `ws://127.0.0.1:7447/shot.usda`.
struct ServerAddress {
    std::string host;
    std::uint16_t port = 7447;
    std::string layer;         ///< empty: none named
    std::string project = {};  ///< of dds://, which has no host
    bool dds = false;          ///< with an empty project: all that are there

    [[nodiscard]] std::string url() const;
};
/// InvalidArgument says what is wrong with the text.
[[nodiscard]] Result<ServerAddress> parseServerAddress(const std::string& text);

/// One client's line to a server, kept up: connects, and after a loss connects again with growing
/// delays (0.1 s to 5 s, full jitter), until closed. Works on a thread of its own; what happened is
/// fetched by poll() from any one thread, so that nothing of it runs on the editor's.
class Connection {
public:
    struct Opened {};
    /// As it came, or read on the connection's thread already.
    enum class Brings { Bytes, Frames };
    struct Message {
        SharedBytes bytes;        ///< nullptr unless the connection brings bytes
        ReceivedMessage content;  ///< empty unless it brings frames
    };
    struct Lost {
        Error reason;
    };  ///< also a failed attempt
    using Happening = std::variant<Opened, Message, Lost>;

    virtual ~Connection() = default;
    /// In order. Dropped when not open.
    virtual void send(SharedBytes frames) = 0;
    /// What has happened since the last call, in order, at most `most`.
    [[nodiscard]] virtual std::vector<Happening> poll(std::size_t most) = 0;
    /// Blocks until something is there for poll(), or the time is over. True: something is there.
    virtual bool wait(std::chrono::milliseconds time) = 0;
    /// Bytes handed to send() and not yet on their way: beside-the-stream work waits for this.
    [[nodiscard]] virtual std::size_t queuedBytes() const = 0;
    /// Drops the connection; a new one is tried at once (for who saw nonsense).
    virtual void reset() = 0;
};

/// Of the address's kind; brings frames. InvalidConfiguration: this process cannot use DDS as it is
/// told to.
[[nodiscard]] Result<std::unique_ptr<Connection>> createConnection(const ServerAddress& address);

/// WebSocket at `/live`. A dead peer is noticed within 15 s by pings.
[[nodiscard]] std::unique_ptr<Connection> createWebSocketConnection(
    const ServerAddress& address, Connection::Brings brings = Connection::Brings::Bytes);

/// DDS, to the project of that name. Several servers of the name: the one started last.
[[nodiscard]] Result<std::unique_ptr<Connection>> createDdsConnection(
    const ServerAddress& address, const dds::DomainSettings& settings,
    Connection::Brings brings = Connection::Brings::Bytes);
/// What the environment says: USDLIVE_DDS_INTERFACE, USDLIVE_DDS_DOMAIN, USDLIVE_DDS_CONFIG (a
/// file) and USDLIVE_DDS_SECURITY (a folder). InvalidConfiguration: the domain is no number.
[[nodiscard]] Result<dds::DomainSettings> ddsSettings();

/// A project that is served over DDS.
struct DdsProject {
    std::string name;
    std::string url;  ///< of the same by WebSocket
    std::uint64_t revision = 0;
};
/// Looks around for so long. Sorted by name.
[[nodiscard]] Result<std::vector<DdsProject>> listDdsProjects(const dds::DomainSettings& settings,
                                                              std::chrono::milliseconds time);

}  // namespace usdlive::client
