// The certificate and the key with which the server encrypts its connections.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/net/Tls.h"

namespace usdlive::server {

/// Two files in PEM. The certificate may be followed by those of its authorities.
struct TlsFiles {
    std::filesystem::path certificate, key;
};

/// Returns the files `certificate.pem` and `key.pem` in `folder`. Creates them, if the first is
/// missing: a key that only this user can read, and a certificate that it has signed itself, for 10
/// years. The certificate is for `names`, which are hosts and addresses. Error:
/// InvalidConfiguration names the file.
[[nodiscard]] Result<TlsFiles> ownTlsFiles(const std::filesystem::path& folder,
                                           const std::vector<std::string>& names);

/// Encrypts connections with the certificate of two files. Belongs to one thread.
class ServerTls {
public:
    /// `hosts`: the names under which the server answers; "*" is all. Errors: InvalidConfiguration
    /// if a file cannot be used: the certificate has expired or is for none of the hosts, the key
    /// is not the one of the certificate, or others can read it. The message says what mends it.
    [[nodiscard]] static Result<std::unique_ptr<ServerTls>> load(TlsFiles files,
                                                                 std::vector<std::string> hosts);

    /// Reads the files again, for the connections that follow. Keeps the certificate after an
    /// error.
    [[nodiscard]] Result<void> reload();
    /// Returns the state of TLS for a connection that was accepted.
    [[nodiscard]] TlsState accepted() const;

    /// Returns the fingerprint of a certificate that no authority has signed, or an empty text.
    /// Users compare it with the one that clients name.
    [[nodiscard]] const std::string& fingerprint() const { return loaded_.fingerprint; }

private:
    struct Loaded {
        TlsContext context;
        std::string fingerprint;
    };
    ServerTls(TlsFiles files, std::vector<std::string> hosts)
        : files_(std::move(files)), hosts_(std::move(hosts)) {}
    [[nodiscard]] Result<Loaded> read() const;

    const TlsFiles files_;
    const std::vector<std::string> hosts_;
    Loaded loaded_;
};

}  // namespace usdlive::server
