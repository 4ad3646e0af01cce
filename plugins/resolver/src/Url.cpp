// Parses and writes addresses of files in served projects.
#include "Url.h"

#include <algorithm>
#include <cctype>
#include <vector>

#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/fetch/Origin.h"

namespace usdlive::resolver {

namespace {

constexpr std::string_view kPrefix = "usdlive://";

/// Encodes what would be read as something else. All other characters are kept, because OpenUSD and
/// people recognize file names and patterns such as <UDIM> by them.
std::string encodedPath(std::string_view path) {
    // A last part such as `name@12` would be read as a file with a pin: no dot follows the `@`.
    const std::size_t slash = path.rfind('/'), dot = path.rfind('.');
    const auto looksLikePin = [&](std::size_t at) {
        return (slash == std::string_view::npos || at > slash) &&
               (dot == std::string_view::npos || at > dot);
    };
    std::string result;
    for (std::size_t i = 0; i < path.size(); ++i) {
        if (path[i] == '%')
            result += "%25";
        else if (path[i] == '@' && (i == 0 || looksLikePin(i)))
            result += "%40";
        else
            result += path[i];
    }
    return result;
}

/// A pin never has a dot (see parseUrl), and no slash, so that it is one part of the path.
std::string encodedPin(std::string_view pin) {
    return percentEncodedIf(
        pin, [](char c) { return std::string_view("%./@~[]").find(c) != std::string_view::npos; });
}

/// Removes `.` and `..` and empty parts. Keeps `..` at the beginning, which leads out.
std::string normalized(std::string_view path) {
    std::vector<std::string_view> parts;
    while (!path.empty()) {
        const std::string_view part = path.substr(0, path.find('/'));
        path.remove_prefix(std::min(path.size(), part.size() + 1));
        if (part.empty() || part == ".") continue;
        if (part == ".." && !parts.empty() && parts.back() != "..")
            parts.pop_back();
        else
            parts.push_back(part);
    }
    std::string result;
    for (const std::string_view part : parts) {
        if (!result.empty()) result += '/';
        result += part;
    }
    return result;
}

std::nullopt_t refuse(std::string* why, std::string reason) {
    if (why) *why = std::move(reason);
    return std::nullopt;
}

bool parseAuthority(std::string_view text, Url& url, std::string* why) {
    const auto origin = fetch::parseOrigin(percentDecoded(text).value_or(""), kDefaultPort);
    if (!origin) {
        refuse(why, origin.error().cause + ". An example is usdlive://localhost:7447/shot.usda");
        return false;
    }
    url.host = origin->host;
    url.port = origin->port;
    return true;
}

/// Parses `PIN~VERSION`, each of which may be missing.
bool parseMark(std::string_view text, Url& url) {
    const std::size_t tilde = text.find('~');
    const auto pin = percentDecoded(text.substr(0, tilde));
    if (!pin) return false;
    url.pin = *pin;
    if (tilde != std::string_view::npos) url.version = text.substr(tilde + 1);
    return true;
}

}  // namespace

std::string Url::server() const {
    const bool isIpv6 = host.find(':') != std::string::npos;
    return std::string(kPrefix) + (isIpv6 ? "%5B" + host + "%5D" : host) + ":" +
           std::to_string(port);
}

std::string Url::identifier() const {
    if (isLive()) return resolvedPath();
    return server() + "/" + encodedPath(path) + (pin.empty() ? "" : "@" + encodedPin(pin));
}

std::string Url::resolvedPath() const {
    std::string text = server() + "/";
    if (!pin.empty() || !version.empty()) text += "@" + encodedPin(pin);
    if (!version.empty()) text += "~" + version;
    if (!pin.empty() || !version.empty()) text += "/";
    return text + encodedPath(path);
}

bool hasScheme(std::string_view text) {
    if (text.size() <= kScheme.size() || text[kScheme.size()] != ':') return false;
    return std::equal(kScheme.begin(), kScheme.end(), text.begin(), [](char ours, char theirs) {
        return ours == std::tolower(static_cast<unsigned char>(theirs));
    });
}

std::optional<Url> parseUrl(std::string_view text, std::string* why) {
    if (!hasScheme(text) || text.substr(kScheme.size(), 3) != "://")
        return refuse(why, "it does not begin with usdlive://");
    text.remove_prefix(kPrefix.size());
    Url url;
    const std::string_view authority = text.substr(0, text.find('/'));
    if (!parseAuthority(authority, url, why)) return std::nullopt;
    text.remove_prefix(std::min(text.size(), authority.size() + 1));
    if (text.starts_with('@')) {
        const std::string_view mark = text.substr(0, text.find('/'));
        if (!parseMark(mark.substr(1), url)) return refuse(why, "its revision is malformed");
        text.remove_prefix(std::min(text.size(), mark.size() + 1));
    }
    const std::size_t slash = text.rfind('/'), at = text.rfind('@');
    const bool isInLast =
        at != std::string_view::npos && (slash == std::string_view::npos || at > slash);
    if (isInLast && at + 1 < text.size() && text.find('.', at) == std::string_view::npos) {
        if (!url.pin.empty()) return refuse(why, "it names two revisions");
        const auto pin = percentDecoded(text.substr(at + 1));
        if (!pin) return refuse(why, "its revision is malformed");
        url.pin = *pin;
        text = text.substr(0, at);
    }
    const auto path = percentDecoded(text);
    if (!path || path->find('\0') != std::string::npos)
        return refuse(why, "a % in it is not followed by two hexadecimal digits");
    url.path = normalized(*path);
    return url;
}

Url anchored(const Url& anchor, std::string_view path) {
    Url url = anchor;
    if (!url.isLive()) url.version.clear();
    const std::size_t slash = anchor.path.rfind('/');
    const std::string folder =
        slash == std::string::npos ? std::string() : anchor.path.substr(0, slash + 1);
    url.path = normalized(folder + std::string(path));
    return url;
}

}  // namespace usdlive::resolver
