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

/// Where a project is: `ws://host:port`, `usdlive://host:port` or `host:port` (all the same), with
/// `/project` where the server has several; or `dds://project`. A path after it names a layer:
/// `ws://127.0.0.1:7447/shot.usda`, `ws://127.0.0.1:7447/project/shot.usda`.
struct ServerAddress {
    std::string host;
    std::uint16_t port = 7447;
    std::string layer;         ///< empty: none named
    std::string project = {};  ///< empty: the only one of the server
    bool dds = false;          ///< with an empty project: all that are there

    [[nodiscard]] std::string url() const;
};
/// InvalidArgument says what is wrong with the text.
[[nodiscard]] Result<ServerAddress> parseServerAddress(const std::string& text);

/// A project of a server, as it says over HTTP.
struct ListedProject {
    std::string name;
    std::string status;  ///< "ok", or what is the matter
    std::string reason;  ///< why it cannot be opened
    std::uint64_t revision = 0;
    std::size_t sessions = 0;
};
struct ListedProjects {
    bool areSeveral = false;  ///< they need their names in the address
    std::vector<ListedProject> all;
};
/// Asks a server for its projects, over HTTP. A server that does not know the question has one. The
/// call blocks for at most `timeout`. NotConnected, or Internal for an answer that makes no sense.
[[nodiscard]] Result<ListedProjects> listProjects(const ServerAddress& server,
                                                  std::chrono::milliseconds timeout);
/// Tells the project from the layer in the path `/A/B.usda`, which can be the layer B.usda of the
/// project A, or the layer A/B.usda of the only project: asks the server whether it has a project
/// A. Other addresses are returned as they are, and so are those of servers that do not answer.
[[nodiscard]] ServerAddress findProject(ServerAddress address, std::chrono::milliseconds timeout);

inline constexpr std::size_t kMaxQueuedBytes = 4 * 1024 * 1024;

/// One client's line to a server, kept up: connects, and after a loss connects again with growing
/// delays (0.1 s to 5 s, full jitter), until closed. Works on a thread of its own; what happened is
/// fetched by poll() from any one thread, so that nothing of it runs on the editor's.
class Connection {
public:
    struct Opened {};
    /// What messages come as: their bytes, or frames that the connection's thread has read.
    enum class Brings { Bytes, Frames };
    struct Message {
        /// The first for Brings::Bytes, the second for Brings::Frames.
        std::variant<SharedBytes, ReceivedMessage> content;
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
    /// Bytes handed to send() and not yet on their way: big values and their like wait for this,
    /// while it is more than kMaxQueuedBytes, so that edits pass them soon.
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
