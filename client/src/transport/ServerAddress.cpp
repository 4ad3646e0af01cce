// Parses the addresses of servers, projects and layers.
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <iterator>
#include <optional>

#include "transport/Connection.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::client {

namespace {

// The meaning of a scheme.
enum class Encrypted { Yes, No, IfKnown };
constexpr std::array<std::pair<std::string_view, Encrypted>, 3> kSchemes{
    {{"ws://", Encrypted::No}, {"wss://", Encrypted::Yes}, {"usdlive://", Encrypted::IfKnown}}};
constexpr std::string_view kDds = "dds://";
constexpr std::string_view kSession = "?session=";
constexpr std::string_view kHint =
    "expected ws://HOST:PORT, wss://HOST:PORT, ws://HOST:PORT/PROJECT, HOST:PORT, dds://PROJECT, "
    "one with /LAYER, or one with ?session=NAME at its end";

tl::unexpected<Error> badAddress(const std::string& text, const std::string& what) {
    return fail(ErrorCode::InvalidArgument, "'" + text + "' is not the address of a server: " +
                                                what + "; " + std::string(kHint));
}

char lower(char c) { return char(std::tolower(static_cast<unsigned char>(c))); }

/// Returns whether the text begins with the scheme, which is in lower case.
bool hasScheme(std::string_view text, std::string_view scheme) {
    return std::ranges::equal(text.substr(0, scheme.size()), scheme, {}, lower);
}

struct Unprefixed {
    std::string_view rest;
    Encrypted encrypted = Encrypted::IfKnown;
};
std::optional<Unprefixed> withoutScheme(std::string_view text) {
    for (const auto& [scheme, encrypted] : kSchemes)
        if (hasScheme(text, scheme)) return Unprefixed{text.substr(scheme.size()), encrypted};
    if (text.find("://") == std::string_view::npos) return Unprefixed{text};  // HOST:PORT
    return std::nullopt;
}

Result<bool> isEncrypted(Encrypted encrypted, const ServerAddress& address) {
    if (encrypted != Encrypted::IfKnown) return encrypted == Encrypted::Yes;
    const auto known = KnownServers().find(address.host, address.port);
    if (!known) return tl::unexpected(known.error());
    return *known && (*known)->isTls;
}

/// Removes the spaces that a pasted address may have around it.
std::string_view trimmed(std::string_view text) {
    constexpr std::string_view kSpaces = " \t\r\n";
    const auto begin = text.find_first_not_of(kSpaces);
    if (begin == std::string_view::npos) return {};
    return text.substr(begin, text.find_last_not_of(kSpaces) + 1 - begin);
}

std::optional<std::uint16_t> parsePort(std::string_view text) {
    std::uint16_t port = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
    if (error != std::errc{} || end != text.data() + text.size() || port == 0) return std::nullopt;
    return port;
}

struct HostAndPort {
    std::string_view host;
    std::optional<std::string_view> port;
};

// Splits `host`, `host:port`, `[::1]` and `[::1]:port`. Returns nothing if the brackets do not
// match.
std::optional<HostAndPort> splitAuthority(std::string_view text) {
    HostAndPort split;
    std::string_view rest;
    if (text.starts_with('[')) {
        const auto end = text.find(']');
        if (end == std::string_view::npos) return std::nullopt;
        split.host = text.substr(1, end - 1);
        rest = text.substr(end + 1);
        if (!rest.empty() && !rest.starts_with(':')) return std::nullopt;
    } else {
        const auto colon = text.find(':');
        split.host = text.substr(0, colon);
        rest = colon == std::string_view::npos ? std::string_view{} : text.substr(colon);
    }
    if (!rest.empty()) split.port = rest.substr(1);
    return split;
}

bool isHost(std::string_view host) {
    return !host.empty() && host.find_first_of(" \t\r\n/@[]?#\\") == std::string_view::npos;
}

// Reads the layer after the slash in `rest`, if there is one.
Result<ServerAddress> withLayer(ServerAddress address, std::string_view rest, std::size_t slash,
                                const std::string& text) {
    if (slash == std::string_view::npos || slash + 1 == rest.size()) return address;
    const auto layer = percentDecoded(rest.substr(slash + 1));
    if (!layer) return badAddress(text, "a % is not followed by two hexadecimal digits");
    const auto id = parseLayerId(*layer);
    if (!id) return badAddress(text, id.error().message);
    address.layer = id->value;
    return address;
}

/// Reads the path of a WebSocket URL: a project, a layer, or both. Reads the first of several parts
/// as a part of the layer; see findProject().
Result<ServerAddress> withPath(ServerAddress address, std::string_view rest, std::size_t slash,
                               const std::string& text) {
    std::string_view path = slash == std::string_view::npos ? "" : rest.substr(slash + 1);
    if (path.ends_with('/')) path.remove_suffix(1);
    const auto decoded = percentDecoded(path);
    if (!decoded) return badAddress(text, "a % is not followed by two hexadecimal digits");
    if (path.empty() || path.find('/') != std::string_view::npos || parseLayerId(*decoded))
        return withLayer(std::move(address), rest, slash, text);
    if (*decoded == "." || *decoded == ".." || decoded->find('/') != std::string::npos)
        return badAddress(text, "it does not name a project");
    address.project = *decoded;
    return address;
}

Result<ServerAddress> parseDds(const std::string& text) {
    const std::string_view rest = std::string_view(text).substr(kDds.size());
    const auto slash = rest.find('/');
    const auto project = percentDecoded(rest.substr(0, slash));
    if (!project) return badAddress(text, "a % is not followed by two hexadecimal digits");
    ServerAddress address;
    address.dds = true;
    address.project = *project;
    if (project->empty() && slash != std::string_view::npos)
        return badAddress(text, "it does not name a project");
    return withLayer(std::move(address), rest, slash, text);
}

/// Reads an address without a live session.
Result<ServerAddress> parseMainLine(const std::string& text) {
    if (hasScheme(text, kDds)) return parseDds(text);
    const auto unprefixed = withoutScheme(text);
    if (!unprefixed)
        return badAddress(text, "it must begin with ws://, wss://, usdlive:// or dds://");

    const std::string_view rest = unprefixed->rest;
    const auto slash = rest.find('/');
    // Addresses in OpenUSD have the brackets of IPv6 encoded.
    const std::string host = percentDecoded(rest.substr(0, slash)).value_or("");
    const auto authority = splitAuthority(host);
    if (!authority || !isHost(authority->host)) return badAddress(text, "the host is invalid");

    ServerAddress address;
    std::ranges::transform(authority->host, std::back_inserter(address.host), lower);
    if (authority->port) {
        const auto port = parsePort(*authority->port);
        if (!port) return badAddress(text, "the port must be a number from 1 to 65535");
        address.port = *port;
    }
    const auto encrypted = isEncrypted(unprefixed->encrypted, address);
    if (!encrypted) return tl::unexpected(encrypted.error());
    address.isSecure = *encrypted;
    return withPath(std::move(address), rest, slash, text);
}

}  // namespace

std::string ServerAddress::hostAndPort() const { return serverName(host, port); }

std::string ServerAddress::url() const {
    const std::size_t end = std::min(project.find(kSession), project.size());
    const std::string main = percentEncoded(project.substr(0, end));
    std::string text =
        dds ? std::string(kDds) + main
            : (isSecure ? "wss://" : "ws://") + hostAndPort() + (main.empty() ? "" : "/" + main);
    if (!layer.empty()) text += "/" + percentEncoded(layer);
    if (end < project.size())
        text += std::string(kSession) + percentEncoded(project.substr(end + kSession.size()));
    return text;
}

Result<ServerAddress> parseServerAddress(const std::string& pasted) {
    const std::string text(trimmed(pasted));
    const std::size_t end = std::min(text.find(kSession), text.size());
    auto address = parseMainLine(text.substr(0, end));
    if (address && address->project.ends_with(kSession))
        return badAddress(text, "it does not name a live session");
    if (!address || end == text.size()) return address;
    const auto name = percentDecoded(std::string_view(text).substr(end + kSession.size()));
    if (!name) return badAddress(text, "a % is not followed by two hexadecimal digits");
    if (name->empty()) return badAddress(text, "it does not name a live session");
    address->project += std::string(kSession) + *name;
    return address;
}

Result<std::unique_ptr<Connection>> createConnection(const ServerAddress& address) try {
    if (!address.dds) return createWebSocketConnection(address, Connection::Brings::Frames);
    const auto settings = ddsSettings();
    if (!settings) return tl::unexpected(settings.error());
    return createDdsConnection(address, *settings, Connection::Brings::Frames);
} catch (const ThreadRefused& refused) {
    return fail(ErrorCode::NotConnected,
                "cannot connect to " + address.url() + ": " + refused.what());
}

}  // namespace usdlive::client
