// The client's side of TLS: decides whether the certificate of a server is accepted.
#pragma once

#include <boost/system/error_code.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/net/KnownServers.h"
#include "usdlive/common/net/NetStream.h"

struct x509_store_ctx_st;

namespace usdlive {

/// Checks the certificate of one server during one handshake: call encrypt() with the connected
/// stream, run its async_handshake(), and pass the error to check(). Send nothing before check()
/// has succeeded.
///
/// A certificate is accepted if it is valid now and
/// - an authority of the system, or of `authorities`, has signed it for the host, or
/// - it is self-signed, and its fingerprint is the one that is known for the server, or
/// - it is self-signed, nothing is known about the server, and the trust is FirstUse. Then check()
///   remembers the fingerprint.
///
/// Asks nobody. Any thread, one at a time; has to outlive the handshake.
class ClientTls {
public:
    /// Authorities: another service, of which nothing is known or remembered. FirstUse: the user
    /// has named this server with a scheme that demands encryption.
    enum class Trust { Authorities, Known, FirstUse };

    /// `authorities`: a file with certificates in PEM, used beside those of the system; empty:
    /// none.
    ClientTls(KnownServers known, std::string host, std::uint16_t port, Trust trust,
              std::filesystem::path authorities = authoritiesOfUser());
    ClientTls(const ClientTls&) = delete;
    ClientTls& operator=(const ClientTls&) = delete;

    /// Returns the value of the environment variable USDLIVE_CA; empty if it is not set.
    [[nodiscard]] static std::filesystem::path authoritiesOfUser();

    /// Encrypts a connected stream. Its next operation has to be the handshake. Error:
    /// InvalidConfiguration names a file that cannot be used.
    [[nodiscard]] Result<void> encrypt(NetStream& stream);
    /// Returns the result of the handshake, which ended with `error`. Errors: NotConnected names
    /// the reason and what to do next; InvalidConfiguration if the fingerprint of a self-signed
    /// certificate cannot be kept.
    [[nodiscard]] Result<void> check(const boost::system::error_code& error);

private:
    static int verify(x509_store_ctx_st* chain, void* self);
    [[nodiscard]] bool accepts(x509_store_ctx_st* chain);
    [[nodiscard]] std::string refusalOf(int problem, const std::string& text) const;

    const KnownServers known_;
    const std::string host_, name_;
    const std::uint16_t port_;
    const Trust trust_;
    const std::filesystem::path authorities_;
    std::string pin_;      // the known one; empty: none
    std::string found_;    // the pin of the certificate that was accepted
    std::string refusal_;  // the reason of one that was not
};

}  // namespace usdlive
