// Checks certificates of servers, and remembers those of servers without an authority.
#include "usdlive/common/net/ClientTls.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509_vfy.h>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/ssl/error.hpp>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>
#include <system_error>
#include <utility>

namespace usdlive {

namespace {

bool isAddress(const std::string& host) {
    boost::system::error_code error;
    (void)boost::asio::ip::make_address(host, error);
    return !error;
}

std::string withoutBrackets(const std::string& host) {
    return host.starts_with('[') && host.ends_with(']') ? host.substr(1, host.size() - 2) : host;
}

struct FreeStore {
    void operator()(X509_STORE* store) const { X509_STORE_free(store); }
};
using Authorities = std::unique_ptr<X509_STORE, FreeStore>;

Authorities copied(X509_STORE* store) {
    X509_STORE_up_ref(store);
    return Authorities(store);
}

/// Returns the authorities of the system and those in `file`, which may be empty. Reading them
/// takes longer than a handshake, so they are kept until another file is named, or it has changed.
Result<Authorities> trustedAuthorities(const std::filesystem::path& file) {
    struct Kept {
        std::mutex mutex;  // guards the next members
        std::filesystem::path file;
        std::filesystem::file_time_type changed;
        Authorities authorities;
    };
    static auto& kept = *new Kept;  // never destroyed: a thread may connect while the process ends
    std::error_code none;
    const auto changed =
        file.empty() ? decltype(kept.changed)() : std::filesystem::last_write_time(file, none);
    const std::lock_guard lock(kept.mutex);
    if (kept.authorities && kept.file == file && kept.changed == changed)
        return copied(kept.authorities.get());
    Authorities read(X509_STORE_new());
    if (!read) throw std::bad_alloc();
    X509_STORE_set_default_paths(read.get());
    if (!file.empty() && X509_STORE_load_file(read.get(), file.c_str()) != 1)
        return fail(ErrorCode::InvalidConfiguration,
                    "cannot read the certificates of authorities in " + file.string() + ": " +
                        takeTlsError() +
                        ". USDLIVE_CA has to name a file with certificates in PEM");
    ERR_clear_error();
    kept.authorities = copied(read.get());
    kept.file = file;
    kept.changed = changed;
    return read;
}

/// Sets the name that the server is asked for, and that its certificate must have.
void setHost(ssl_st* tls, const std::string& host) {
    X509_VERIFY_PARAM* expected = SSL_get0_param(tls);
    X509_VERIFY_PARAM_set_hostflags(expected, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
    const bool isSet = isAddress(host)
                           ? X509_VERIFY_PARAM_set1_ip_asc(expected, host.c_str()) == 1
                           : X509_VERIFY_PARAM_set1_host(expected, host.c_str(), 0) == 1 &&
                                 SSL_set_tlsext_host_name(tls, host.c_str()) == 1;
    if (!isSet) throw std::bad_alloc();
}

/// Returns whether the chain can only be trusted because its certificate is known.
bool isSelfSigned(int problem) { return problem == X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT; }

bool isTimely(const x509_st& certificate) {
    return X509_cmp_current_time(X509_get0_notBefore(&certificate)) < 0 &&
           X509_cmp_current_time(X509_get0_notAfter(&certificate)) > 0;
}

std::string described(const std::string& pin) {
    return pin == kSignedByAuthority ? "signed by a known authority" : pin;
}

}  // namespace

std::filesystem::path ClientTls::authoritiesOfUser() {
    const char* file = std::getenv("USDLIVE_CA");
    return file ? file : "";
}

ClientTls::ClientTls(KnownServers known, std::string host, std::uint16_t port, Trust trust,
                     std::filesystem::path authorities)
    : known_(std::move(known)),
      host_(withoutBrackets(host)),
      name_(serverName(host, port)),
      port_(port),
      trust_(trust),
      authorities_(std::move(authorities)) {}

Result<void> ClientTls::encrypt(NetStream& stream) {
    if (trust_ != Trust::Authorities) {
        const auto known = known_.find(host_, port_);
        if (!known) return tl::unexpected(known.error());
        if (*known) pin_ = (*known)->pin;
    }

    const auto trusted = trustedAuthorities(authorities_);
    if (!trusted) return tl::unexpected(trusted.error());
    const TlsContext context = createTlsContext();
    SSL_CTX_set1_cert_store(context.get(), trusted->get());
    SSL_CTX_set_verify(context.get(), SSL_VERIFY_PEER, nullptr);
    SSL_CTX_set_cert_verify_callback(context.get(), &ClientTls::verify, this);
    TlsState tls(SSL_new(context.get()));
    if (!tls) throw std::bad_alloc();
    setHost(tls.get(), host_);
    SSL_set_connect_state(tls.get());
    stream.encrypt(std::move(tls));
    return {};
}

int ClientTls::verify(x509_store_ctx_st* chain, void* self) {
    if (static_cast<ClientTls*>(self)->accepts(chain)) {
        X509_STORE_CTX_set_error(chain, X509_V_OK);
        return 1;
    }
    if (X509_STORE_CTX_get_error(chain) == X509_V_OK)  // the alert names the error
        X509_STORE_CTX_set_error(chain, X509_V_ERR_CERT_REJECTED);
    return 0;
}

bool ClientTls::accepts(x509_store_ctx_st* chain) {
    const x509_st* certificate = X509_STORE_CTX_get0_cert(chain);
    if (X509_verify_cert(chain) == 1) {
        found_ = kSignedByAuthority;
        return true;
    }
    const int problem = X509_STORE_CTX_get_error(chain);
    if (!certificate || !isSelfSigned(problem) || trust_ == Trust::Authorities) {
        refusal_ = refusalOf(problem, X509_verify_cert_error_string(problem));
        return false;
    }
    const std::string fingerprint = fingerprintOf(*certificate);
    if (!isTimely(*certificate)) {
        refusal_ = refusalOf(X509_V_ERR_CERT_HAS_EXPIRED, "");
    } else if (!pin_.empty() && pin_ != fingerprint) {
        refusal_ = "the certificate of " + name_ + " has changed (was " + described(pin_) +
                   ", is " + fingerprint + "). If this is expected, run `usdlive forget " + name_ +
                   "` and connect again; otherwise somebody may be reading the connection";
    } else if (pin_.empty() && trust_ == Trust::Known) {
        refusal_ = "the certificate of " + name_ +
                   " is self-signed and not known yet. If its fingerprint is the one that the "
                   "server printed at its start, connect once to wss://" +
                   name_ + " to accept it: " + fingerprint;
    } else {
        found_ = fingerprint;
        return true;
    }
    return false;
}

std::string ClientTls::refusalOf(int problem, const std::string& text) const {
    const std::string certificate = "the certificate of " + name_;
    switch (problem) {
        case X509_V_ERR_CERT_HAS_EXPIRED:
        case X509_V_ERR_CERT_NOT_YET_VALID:
            return certificate +
                   " has expired or is not valid yet. Compare the clocks of both machines, or "
                   "renew "
                   "the certificate of the server";
        case X509_V_ERR_HOSTNAME_MISMATCH:
        case X509_V_ERR_IP_ADDRESS_MISMATCH:
            return certificate +
                   " is for another host. Connect with a name that it has, or make "
                   "one for " +
                   host_;
        case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
            return certificate +
                   " is self-signed. Set USDLIVE_CA to a file with this certificate to trust it";
        case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
        case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
        case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
        case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
            return certificate +
                   " is signed by an authority that is not known here. Set USDLIVE_CA to the file "
                   "with the authority's certificate";
        default:
            return certificate + " is not valid: " + text;
    }
}

Result<void> ClientTls::check(const boost::system::error_code& error) {
    if (!refusal_.empty()) return fail(ErrorCode::NotConnected, refusal_);
    if (error) {
        // A plain server answers the hello with a text.
        const bool isPlain = error.category() == boost::asio::error::get_ssl_category() &&
                             ERR_GET_REASON(unsigned(error.value())) == SSL_R_WRONG_VERSION_NUMBER;
        const std::string advice = trust_ == Trust::Authorities ? "" : ". Connect to ws://" + name_;
        return fail(ErrorCode::NotConnected,
                    "cannot encrypt the connection to " + name_ + ": " +
                        (isPlain ? "the server does not speak TLS" + advice : error.message()));
    }
    if (found_ == pin_ || trust_ == Trust::Authorities) return {};
    auto kept = known_.update(host_, port_, [this](KnownServer& server) {
        server.pin = found_;
        server.isTls = true;
    });
    // Without the entry, the next connection trusts the authority again.
    if (!kept && found_ == kSignedByAuthority) return {};
    return kept;
}

}  // namespace usdlive
