// Caches the tokens of frequent names.
#pragma once

#include <pxr/base/tf/token.h>

#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>

namespace usdlive::usd {

/// Caches the tokens of frequent names, above all of fields and properties, because Tf looks each
/// one up under a lock. One thread.
class Tokens {
public:
    pxr::TfToken operator()(std::string_view name) {
        if (const auto known = tokens_.find(name); known != tokens_.end()) return known->second;
        pxr::TfToken token{std::string(name)};
        if (tokens_.size() < kMost) tokens_.emplace(name, token);
        return token;
    }

private:
    struct NameHash : std::hash<std::string_view> {
        using is_transparent = void;
    };
    static constexpr std::size_t kMost = 4096;
    std::unordered_map<std::string, pxr::TfToken, NameHash, std::equal_to<>> tokens_;
};

}  // namespace usdlive::usd
