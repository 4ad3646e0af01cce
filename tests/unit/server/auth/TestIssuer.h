// An issuer for tests: makes keys, publishes them and signs tokens, also wrong ones.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

struct evp_pkey_st;

namespace usdlive::server {

[[nodiscard]] std::string base64Url(std::string_view bytes);

/// A private key of the issuer, with what its tokens and its public key say of it.
class TestKey {
public:
    using Json = nlohmann::json;

    static TestKey rsa(std::string id, unsigned bits = 2048);
    static TestKey curve(std::string id, const char* name = "P-256");
    static TestKey edwards(std::string id);

    /// Returns the public key as the issuer publishes it.
    [[nodiscard]] Json published() const;
    [[nodiscard]] Json header() const;
    /// Returns the bytes of a signature by the key's own algorithm.
    [[nodiscard]] std::string signature(std::string_view text) const;
    [[nodiscard]] std::string signText(std::string_view header, std::string_view claims) const;
    [[nodiscard]] std::string sign(const Json& header, const Json& claims) const;
    [[nodiscard]] std::string sign(const Json& claims) const;

    std::string id, algorithm;

private:
    TestKey(std::string id, std::string algorithm, evp_pkey_st* key);
    [[nodiscard]] std::string number(const char* name, std::size_t size) const;

    std::shared_ptr<evp_pkey_st> key_;
};

}  // namespace usdlive::server
