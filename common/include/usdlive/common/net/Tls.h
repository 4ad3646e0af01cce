// The parts of OpenSSL that both ends of an encrypted connection use.
#pragma once

#include <memory>
#include <string>

struct ssl_st;
struct ssl_ctx_st;
struct x509_st;
struct evp_pkey_st;

namespace usdlive {

struct FreeTls {
    void operator()(ssl_st* tls) const;
    void operator()(ssl_ctx_st* context) const;
    void operator()(x509_st* certificate) const;
    void operator()(evp_pkey_st* key) const;
};

/// The state of TLS on one connection.
using TlsState = std::unique_ptr<ssl_st, FreeTls>;
/// The settings of many connections. Each of them holds a reference, also after the owner has
/// replaced its own. May be used by several threads once it is complete.
using TlsContext = std::unique_ptr<ssl_ctx_st, FreeTls>;
using Certificate = std::unique_ptr<x509_st, FreeTls>;
using PrivateKey = std::unique_ptr<evp_pkey_st, FreeTls>;

/// Returns settings without certificates: TLS 1.2 or 1.3, no compression, no renegotiation, no
/// resumed sessions. Throws std::bad_alloc.
[[nodiscard]] TlsContext createTlsContext();

/// Returns `sha256:` and the hash of the certificate in hexadecimal digits.
[[nodiscard]] std::string fingerprintOf(const x509_st& certificate);

/// Returns the reason of the newest error of OpenSSL on this thread, and removes all of them.
[[nodiscard]] std::string takeTlsError();

}  // namespace usdlive
