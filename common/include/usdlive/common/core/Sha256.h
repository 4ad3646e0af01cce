// Computes SHA-256 hashes.
#pragma once

#include <memory>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"

struct evp_md_ctx_st;

namespace usdlive {

/// Computes the SHA-256 of bytes that arrive in parts. For bytes in one piece use sha256().
class Sha256 {
public:
    Sha256();
    void add(ByteView part);
    /// Returns the hash. Do not call add() afterwards.
    [[nodiscard]] Hash finish();

private:
    struct Free {
        void operator()(evp_md_ctx_st* context) const;
    };
    std::unique_ptr<evp_md_ctx_st, Free> context_;
};

}  // namespace usdlive
