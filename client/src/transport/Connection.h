// The interface of a connection to a server.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "session/MessageReader.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/core/StoreId.h"
#include "usdlive/common/dds/Domain.h"

namespace usdlive::client {

/// The address of a project: `ws://host:port`, or `wss://host:port` if the connection is encrypted,
/// followed by `/project` if the server has several projects; or `dds://project`. A further path
/// names a layer: `ws://127.0.0.1:7447/shot.usda`, `ws://127.0.0.1:7447/project/shot.usda`.
/// `?session=NAME` at the end names a live session of the project (LV1).
/// `usdlive://host:port` and `host:port` are encrypted if the server is known to be (KnownServers).
struct ServerAddress {
    std::string host;
    std::uint16_t port = 7447;
    std::string layer;  ///< empty: no layer
    /// With that of a live session: `shots`, `shots?session=dusk`. Empty: the server's only
    /// project,
    /// `?session=dusk`: a live session of it.
    std::string project = {};
    bool dds = false;        ///< with an empty project: all projects found
    bool isSecure = false;   ///< the connection is encrypted with TLS
    std::string token = {};  ///< the user's token; empty: the one that is known

    [[nodiscard]] std::string url() const;
    /// Returns the text of the header Host, with the brackets of an IPv6 address.
    [[nodiscard]] std::string hostAndPort() const;
};
/// Reads the file of known servers if the text does not say whether the connection is encrypted.
/// Errors: InvalidArgument names the problem of the text, InvalidConfiguration that of the file.
[[nodiscard]] Result<ServerAddress> parseServerAddress(const std::string& text);

/// A project of a server, as reported over HTTP.
struct ListedProject {
    std::string name;
    std::string status;  ///< "ok", or the problem
    std::string reason;  ///< the reason why it cannot be opened
    std::uint64_t revision = 0;
    std::size_t sessions = 0;
};
struct ListedProjects {
    bool areSeveral = false;  ///< addresses have to name the project
    std::vector<ListedProject> all;
};
/// Requests the projects of a server over HTTP. Older servers that do not know the request have one
/// project. Blocks for at most `timeout`. Errors: NotConnected, or Internal for an invalid answer.
[[nodiscard]] Result<ListedProjects> listProjects(const ServerAddress& server,
                                                  std::chrono::milliseconds timeout);
/// Separates the project from the layer. The path `/A/B.usda` can be the layer B.usda of the
/// project A, or the layer A/B.usda of the only project, so this asks the server whether it has a
/// project A. Returns other addresses unchanged, and also those of servers that do not answer.
[[nodiscard]] ServerAddress findProject(ServerAddress address, std::chrono::milliseconds timeout);

/// A client's connection to a server. Connects, and after a loss connects again with increasing
/// delays (0.1 s to 5 s, full jitter) until it is destroyed. Works on its own thread. Results are
/// fetched with poll() by any one thread, so that the work does not run on the editor's thread.
class Connection {
public:
    struct Opened {};
    /// The form of received messages: bytes, or frames that the connection's thread has decoded.
    enum class Brings { Bytes, Frames };
    struct Message {
        /// The first type for Brings::Bytes, the second for Brings::Frames.
        std::variant<SharedBytes, ReceivedMessage> content;
    };
    struct Lost {
        Error reason;
        /// The bytes that were passed to send() and perhaps did not arrive.
        std::size_t unconfirmed = 0;
    };  ///< also a failed attempt
    using Happening = std::variant<Opened, Message, Lost>;

    virtual ~Connection() = default;
    /// Sends frames in order. Drops them if the connection is not open.
    virtual void send(SharedBytes frames) = 0;
    /// Returns the events since the last call, in order, at most `most`.
    [[nodiscard]] virtual std::vector<Happening> poll(std::size_t most) = 0;
    /// Blocks until poll() has events or `time` is over. Returns true if it has events.
    virtual bool wait(std::chrono::milliseconds time) = 0;
    /// Returns the bytes passed to send() and not yet written to the line.
    [[nodiscard]] virtual std::size_t queuedBytes() const = 0;
    /// Names the store that the session has joined (ID1). Over DDS, several servers may have the
    /// project's name; the next connection prefers one with this store. Any thread.
    virtual void prefer(const StoreId& /*store*/) {}
    /// Returns the size of the next part of a big value, before compression, that the line takes
    /// now; 0: it has to wait, so that edits do not wait behind it (TL1).
    [[nodiscard]] virtual std::size_t bulkBytes() const = 0;
    /// Returns where the project's server answers HTTP; nothing if that is not known.
    [[nodiscard]] virtual std::optional<ServerAddress> web() const { return std::nullopt; }
    /// Drops the connection and connects again at once. Call it after an invalid message.
    virtual void reset() = 0;
};

/// Returns a connection for the kind of address. It receives frames. Error: InvalidConfiguration if
/// this process cannot use DDS with its settings.
[[nodiscard]] Result<std::unique_ptr<Connection>> createConnection(const ServerAddress& address);

/// Connects over WebSocket to `/live`. Identifies itself with the token of the address, or the one
/// that is known for the server, and accepts the certificates that ClientTls does. A lost peer is
/// detected within 15 s with pings.
[[nodiscard]] std::unique_ptr<Connection> createWebSocketConnection(
    const ServerAddress& address, Connection::Brings brings = Connection::Brings::Bytes);

/// Connects over DDS to the project with that name. If several servers have it, the one that
/// started last.
[[nodiscard]] Result<std::unique_ptr<Connection>> createDdsConnection(
    const ServerAddress& address, const dds::DomainSettings& settings,
    Connection::Brings brings = Connection::Brings::Bytes);
/// Reads the environment: USDLIVE_DDS_INTERFACE, USDLIVE_DDS_DOMAIN, USDLIVE_DDS_CONFIG (a file)
/// and USDLIVE_DDS_SECURITY (a folder). Error: InvalidConfiguration if the domain is not a number.
[[nodiscard]] Result<dds::DomainSettings> ddsSettings();
/// Returns the user that the certificate of DDS Security names (DD17); empty without one.
[[nodiscard]] std::string ddsIdentity(const dds::DomainSettings& settings);

/// A project that is served over DDS.
struct DdsProject {
    std::string name;
    std::string url;  ///< WebSocket address of the same project
    std::uint64_t revision = 0;
    StoreId store;  ///< identity of its store
};
/// Listens for announcements during `time`. Returns the projects sorted by name.
[[nodiscard]] Result<std::vector<DdsProject>> listDdsProjects(const dds::DomainSettings& settings,
                                                              std::chrono::milliseconds time);

}  // namespace usdlive::client
