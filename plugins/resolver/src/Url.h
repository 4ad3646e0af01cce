// Addresses of files in served projects: usdlive://HOST:PORT/PATH@PIN.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive::resolver {

inline constexpr std::string_view kScheme = "usdlive";
inline constexpr std::uint16_t kDefaultPort = 7447;
/// The version of addresses whose layers are live in this process begins with it.
inline constexpr std::string_view kLiveToken = "live";

/// An address. It has two texts: an identifier, as people write it, with the pin at the end, and a
/// resolved path, with the pin and the version before the path, so that it ends as the path does
/// (OpenUSD finds the tiles of a UDIM texture by the ending).
struct Url {
    std::string host;  ///< the result of fetch::hostOf()
    std::uint16_t port = kDefaultPort;
    /// Decoded and without `.` and `..`, except at its beginning if the path leads out of the
    /// project. With the name of the project first, if the server has several.
    std::string path;
    std::string pin;  ///< a revision or the name of a checkpoint, as written; usually empty
    /// Names the layer's content; only in resolved paths. In both texts, the token of a project
    /// that is live in this process.
    std::string version;

    bool operator==(const Url&) const = default;

    [[nodiscard]] std::string identifier() const;
    [[nodiscard]] std::string resolvedPath() const;
    /// Returns the part before the path, such as `usdlive://localhost:7447`. It has the brackets of
    /// an IPv6 address as `%5B` and `%5D`: OpenUSD reads brackets as the path in a package.
    [[nodiscard]] std::string server() const;
    [[nodiscard]] bool isLive() const { return version.starts_with(kLiveToken); }
    [[nodiscard]] bool leadsOut() const { return path == ".." || path.starts_with("../"); }
};

/// True for texts that begin with `usdlive:`.
[[nodiscard]] bool hasScheme(std::string_view text);

/// Parses both texts of an address. Returns nothing if it is neither; `why` is then a sentence.
[[nodiscard]] std::optional<Url> parseUrl(std::string_view text, std::string* why = nullptr);

/// Returns the address of `path`, a relative path as it is written in the layer `anchor`. It has
/// the anchor's pin, and no version unless the anchor is live.
[[nodiscard]] Url anchored(const Url& anchor, std::string_view path);

}  // namespace usdlive::resolver
