// Checks the files of DDS Security and writes the configuration that uses them.
#include "SecurityConfig.h"

#include <dds/dds.h>
#include <dlfcn.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>

#include "usdlive/common/dds/Domain.h"

namespace usdlive::dds {

namespace {

/// Returns the folder with Cyclone's plug-ins for DDS Security: beside its library, or in Debian's
/// folder.
Result<std::string> securityPlugins() {
    Dl_info library{};
    if (::dladdr(reinterpret_cast<const void*>(&dds_create_domain), &library) != 0) {
        std::error_code ignored;
        const auto beside = std::filesystem::canonical(library.dli_fname, ignored).parent_path();
        for (const auto& folder : {beside, beside / "libddsc0debian"})
            if (std::filesystem::exists(folder / "libdds_security_auth.so", ignored))
                return folder.string();
    }
    return fail(ErrorCode::InvalidConfiguration,
                "DDS: the security plug-ins of Cyclone DDS are not installed");
}

std::string escaped(const std::string& text) {
    std::string xml;
    for (const char character : text) {
        if (character == '&')
            xml += "&amp;";
        else if (character == '<')
            xml += "&lt;";
        else if (character == '"')
            xml += "&quot;";
        else
            xml += character;
    }
    return xml;
}

/// Checks the content of a file, because the errors of Cyclone DDS do not name the file or are many
/// lines long.
Result<void> checkSecurityFile(const std::filesystem::path& path) {
    const auto wrong = [&](const std::string& what) {
        return fail(ErrorCode::InvalidConfiguration, "DDS: " + path.string() + " " + what);
    };
    std::ifstream file(path);
    const std::string text(std::istreambuf_iterator<char>(file), {});
    if (!file) return wrong("cannot be read");
    const auto needs = [&](const char* name, const char* element) {
        return path.filename() == name && text.find(element) == std::string::npos;
    };
    if (needs("governance.p7s", "<domain_access_rules>"))
        return wrong("contains no governance document");
    if (needs("permissions.p7s", "<permissions>")) return wrong("contains no permissions document");
    return {};
}

/// Checks that key and certificate match. Cyclone DDS starts with any key, but then no participant
/// trusts it.
Result<void> checkIdentity(const std::filesystem::path& folder) {
    const auto open = [&](const char* name) {
        return std::unique_ptr<FILE, int (*)(FILE*)>(std::fopen((folder / name).c_str(), "r"),
                                                     std::fclose);
    };
    const auto wrong = [&](const char* name, const std::string& what) {
        return fail(ErrorCode::InvalidConfiguration,
                    "DDS: " + (folder / name).string() + " " + what);
    };
    const auto certificateFile = open("identity.pem"), keyFile = open("identity.key");
    const std::unique_ptr<X509, void (*)(X509*)> certificate(
        certificateFile ? PEM_read_X509(certificateFile.get(), nullptr, nullptr, nullptr) : nullptr,
        X509_free);
    if (!certificate) return wrong("identity.pem", "is not a certificate");
    const auto noPassword = [](char*, int, int, void*) { return 0; };
    const std::unique_ptr<EVP_PKEY, void (*)(EVP_PKEY*)> key(
        keyFile ? PEM_read_PrivateKey(keyFile.get(), nullptr, noPassword, nullptr) : nullptr,
        EVP_PKEY_free);
    if (!key) return wrong("identity.key", "is not a private key, or needs a password");
    if (X509_check_private_key(certificate.get(), key.get()) != 1)
        return wrong("identity.key", "is not the key of identity.pem");
    return {};
}

}  // namespace

Result<std::string> securityConfig(const std::string& folder) {
    for (const char* name : kSecurityFiles)
        if (const auto good = checkSecurityFile(std::filesystem::path(folder) / name); !good)
            return tl::unexpected(good.error());
    if (const auto good = checkIdentity(folder); !good) return tl::unexpected(good.error());
    const auto plugins = securityPlugins();
    if (!plugins) return plugins;
    std::error_code error;
    const auto absolute = std::filesystem::absolute(folder, error);
    const auto plugin = [&](const char* name, const char* what) {
        return std::string(R"(<Library initFunction="init_)") + what +
               R"(" finalizeFunction="finalize_)" + what + R"(" path=")" +
               escaped(*plugins + "/libdds_security_" + name + ".so") + R"("/>)";
    };
    const auto file = [&](const char* element, const char* name) {
        return std::string("<") + element + ">file:" + escaped((absolute / name).string()) + "</" +
               element + ">";
    };
    return "<Security><Authentication>" + plugin("auth", "authentication") +
           file("IdentityCA", "identity_ca.pem") + file("IdentityCertificate", "identity.pem") +
           file("PrivateKey", "identity.key") + "</Authentication><AccessControl>" +
           plugin("ac", "access_control") + file("PermissionsCA", "permissions_ca.pem") +
           file("Governance", "governance.p7s") + file("Permissions", "permissions.p7s") +
           "</AccessControl><Cryptographic>" + plugin("crypto", "crypto") +
           "</Cryptographic></Security>";
}

std::string identityOf(const DomainSettings& settings) {
    if (settings.securityFolder.empty()) return {};
    const auto path = std::filesystem::path(settings.securityFolder) / "identity.pem";
    const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen(path.c_str(), "r"), std::fclose);
    const std::unique_ptr<X509, void (*)(X509*)> certificate(
        file ? PEM_read_X509(file.get(), nullptr, nullptr, nullptr) : nullptr, X509_free);
    char name[256] = {};
    if (!certificate || X509_NAME_get_text_by_NID(X509_get_subject_name(certificate.get()),
                                                  NID_commonName, name, sizeof name) <= 0)
        return {};
    return name;
}

}  // namespace usdlive::dds
