// Loads, checks and creates certificates of the server.
#include "transport/ServerTls.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <new>
#include <system_error>
#include <utility>

#include "transport/HostNames.h"
#include "usdlive/common/core/OwnedFile.h"

namespace usdlive::server {

namespace {

namespace fs = std::filesystem;

constexpr long kSecondsPerDay = 24 * 60 * 60;
constexpr long kDaysOfOwnCertificate = 3650;
// A client's clock may be behind by this much.
constexpr long kSecondsBefore = 60 * 60;

struct FreeParts {
    void operator()(BIO* bio) const { BIO_free_all(bio); }
    void operator()(GENERAL_NAMES* names) const { GENERAL_NAMES_free(names); }
    void operator()(X509_EXTENSION* extension) const { X509_EXTENSION_free(extension); }
};
template <class Type>
using Part = std::unique_ptr<Type, FreeParts>;

std::string systemError() { return std::error_code(errno, std::generic_category()).message(); }

tl::unexpected<Error> cannotUse(const std::string& what, const fs::path& path,
                                const std::string& why) {
    return fail(ErrorCode::InvalidConfiguration,
                "cannot use the " + what + " " + path.string() + ": " + why);
}

// ---- checks

/// A key of root may be readable for a group, as the packages of systems install it.
Result<void> checkMode(const fs::path& key) {
    struct stat status{};
    if (::stat(key.c_str(), &status) != 0) return cannotUse("key", key, systemError());
    const mode_t allowed = status.st_uid == 0 ? 0740 : 0700;
    if ((status.st_mode & 0777 & ~allowed) == 0) return {};
    return cannotUse("key", key, "other users can read it. Run `chmod 600 " + key.string() + "`");
}

std::string text(const ASN1_TIME* time) {
    const Part<BIO> memory(BIO_new(BIO_s_mem()));
    char* bytes = nullptr;
    if (!memory || ASN1_TIME_print(memory.get(), time) != 1) return "?";
    const long size = BIO_get_mem_data(memory.get(), &bytes);
    return {bytes, std::size_t(size)};
}

/// Returns the commands that make a new certificate of the same kind.
std::string renewal(const TlsFiles& files) {
    return "`openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365 -subj "
           "/CN=HOST -addext subjectAltName=DNS:HOST -keyout " +
           files.key.string() + " -out " + files.certificate.string() + "`";
}

Result<void> checkTime(const x509_st& certificate, const TlsFiles& files) {
    const ASN1_TIME* begin = X509_get0_notBefore(&certificate);
    const ASN1_TIME* end = X509_get0_notAfter(&certificate);
    if (X509_cmp_current_time(end) <= 0)
        return cannotUse(
            "certificate", files.certificate,
            "it expired on " + text(end) +
                ". Renew it with its authority, or make a self-signed one: " + renewal(files));
    if (X509_cmp_current_time(begin) > 0)
        return cannotUse("certificate", files.certificate,
                         "it is not valid before " + text(begin) +
                             ". Correct the clock of this machine (`date` shows it)");
    return {};
}

/// Compares the hosts of a certificate that an authority has signed with those of the server. One
/// for an address is not compared, because the server does not know all addresses under which it is
/// reached.
Result<void> checkHosts(x509_st* certificate, const TlsFiles& files,
                        const std::vector<std::string>& hosts) {
    for (const std::string& host : hosts)
        if (host == "*" || X509_check_host(certificate, host.c_str(), 0, 0, nullptr) == 1)
            return {};
    std::string first;
    const Part<GENERAL_NAMES> names(static_cast<GENERAL_NAMES*>(
        X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)));
    for (int i = 0; names && i < sk_GENERAL_NAME_num(names.get()); ++i) {
        const GENERAL_NAME* name = sk_GENERAL_NAME_value(names.get(), i);
        if (name->type == GEN_IPADD) return {};
        if (name->type != GEN_DNS || !first.empty()) continue;
        first.assign(reinterpret_cast<const char*>(ASN1_STRING_get0_data(name->d.dNSName)),
                     std::size_t(ASN1_STRING_length(name->d.dNSName)));
    }
    if (first.empty())
        return cannotUse("certificate", files.certificate,
                         "it names no host. Clients need one with the subject alternative name "
                         "DNS:HOST");
    return cannotUse("certificate", files.certificate,
                     "it is for " + first +
                         ", and the server does not answer under this name. Start it with "
                         "`--allow-host " +
                         first + "`, or use a certificate for this machine");
}

// ---- a key and a certificate of our own

/// Only this user can read the file if it is private.
Result<void> writeFile(const fs::path& path, const BIO& content, bool isPrivate) {
    constexpr mode_t kForAll = 0644;
    char* bytes = nullptr;
    const long size = BIO_get_mem_data(const_cast<BIO*>(&content), &bytes);
    return replaceFile(path, {bytes, std::size_t(size)}, isPrivate ? kOwnerOnly : kForAll)
        .map_error([](const Error& error) {
            return Error{ErrorCode::InvalidConfiguration, error.message};
        });
}

void addExtension(x509_st* certificate, int kind, const std::string& value) {
    X509V3_CTX context;
    X509V3_set_ctx_nodb(&context);
    X509V3_set_ctx(&context, certificate, certificate, nullptr, nullptr, 0);
    const Part<X509_EXTENSION> extension(
        X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str()));
    if (!extension || X509_add_ext(certificate, extension.get(), -1) != 1) throw std::bad_alloc();
}

Certificate selfSigned(evp_pkey_st& key, const std::vector<std::string>& names) {
    Certificate certificate(X509_new());
    std::uint64_t serial = 0;
    if (!certificate || RAND_bytes(reinterpret_cast<unsigned char*>(&serial), sizeof serial) != 1)
        throw std::bad_alloc();
    X509_set_version(certificate.get(), X509_VERSION_3);
    ASN1_INTEGER_set_uint64(X509_get_serialNumber(certificate.get()), serial >> 1);
    X509_gmtime_adj(X509_getm_notBefore(certificate.get()), -kSecondsBefore);
    X509_gmtime_adj(X509_getm_notAfter(certificate.get()), kDaysOfOwnCertificate * kSecondsPerDay);
    X509_set_pubkey(certificate.get(), &key);
    X509_NAME* subject = X509_get_subject_name(certificate.get());
    X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8,
                               reinterpret_cast<const unsigned char*>("usdlive"), -1, -1, 0);
    X509_set_issuer_name(certificate.get(), subject);
    std::string alternatives;
    for (const std::string& name : names)
        alternatives += (alternatives.empty() ? "" : ",") +
                        std::string(isAddress(name) ? "IP:" : "DNS:") + name;
    addExtension(certificate.get(), NID_basic_constraints, "critical,CA:FALSE");
    addExtension(certificate.get(), NID_key_usage, "critical,digitalSignature");
    addExtension(certificate.get(), NID_ext_key_usage, "serverAuth");
    addExtension(certificate.get(), NID_subject_alt_name, alternatives);
    if (X509_sign(certificate.get(), &key, EVP_sha256()) == 0) throw std::bad_alloc();
    return certificate;
}

int noPassphrase(char* /*buffer*/, int /*size*/, int /*isWriting*/, void* /*data*/) { return -1; }

}  // namespace

Result<TlsFiles> ownTlsFiles(const fs::path& folder, const std::vector<std::string>& names) {
    TlsFiles files{folder / "certificate.pem", folder / "key.pem"};
    std::error_code error;
    if (fs::exists(files.certificate, error)) return files;
    fs::create_directories(folder, error);
    if (!error) fs::permissions(folder, fs::perms::owner_all, error);
    if (error)
        return fail(ErrorCode::InvalidConfiguration,
                    "cannot create " + folder.string() + ": " + error.message());
    const PrivateKey key(EVP_EC_gen("P-256"));
    const Part<BIO> keyText(BIO_new(BIO_s_mem())), certificateText(BIO_new(BIO_s_mem()));
    if (!key || !keyText || !certificateText) throw std::bad_alloc();
    const Certificate certificate = selfSigned(*key, names);
    if (PEM_write_bio_PKCS8PrivateKey(keyText.get(), key.get(), nullptr, nullptr, 0, nullptr,
                                      nullptr) != 1 ||
        PEM_write_bio_X509(certificateText.get(), certificate.get()) != 1)
        throw std::bad_alloc();
    if (auto written = writeFile(files.key, *keyText, true); !written)
        return tl::unexpected(written.error());
    if (auto written = writeFile(files.certificate, *certificateText, false); !written)
        return tl::unexpected(written.error());
    return files;
}

Result<std::unique_ptr<ServerTls>> ServerTls::load(TlsFiles files, std::vector<std::string> hosts) {
    std::unique_ptr<ServerTls> tls(new ServerTls(std::move(files), std::move(hosts)));
    if (auto loaded = tls->reload(); !loaded) return tl::unexpected(loaded.error());
    return tls;
}

Result<void> ServerTls::reload() {
    auto loaded = read();
    if (!loaded) return tl::unexpected(loaded.error());
    loaded_ = std::move(*loaded);
    return {};
}

Result<ServerTls::Loaded> ServerTls::read() const {
    if (auto checked = checkMode(files_.key); !checked) return tl::unexpected(checked.error());
    ERR_clear_error();
    TlsContext context = createTlsContext();
    SSL_CTX_set_default_passwd_cb(context.get(), noPassphrase);
    if (SSL_CTX_use_certificate_chain_file(context.get(), files_.certificate.c_str()) != 1)
        return cannotUse("certificate", files_.certificate,
                         takeTlsError() + ". It has to be a certificate in PEM");
    if (SSL_CTX_use_PrivateKey_file(context.get(), files_.key.c_str(), SSL_FILETYPE_PEM) != 1)
        return cannotUse("key", files_.key,
                         takeTlsError() + ". It has to be the key of " +
                             files_.certificate.string() +
                             " in PEM, without a passphrase (`openssl pkey -in KEY -out FILE` "
                             "removes one)");
    x509_st* certificate = SSL_CTX_get0_certificate(context.get());
    if (auto checked = checkTime(*certificate, files_); !checked)
        return tl::unexpected(checked.error());
    // A self-signed certificate is known by its fingerprint, for any host.
    if (X509_self_signed(certificate, 0) == 1)
        return Loaded{std::move(context), fingerprintOf(*certificate)};
    if (auto checked = checkHosts(certificate, files_, hosts_); !checked)
        return tl::unexpected(checked.error());
    return Loaded{std::move(context), ""};
}

TlsState ServerTls::accepted() const {
    TlsState tls(SSL_new(loaded_.context.get()));
    if (!tls) throw std::bad_alloc();
    SSL_set_accept_state(tls.get());
    return tls;
}

}  // namespace usdlive::server
