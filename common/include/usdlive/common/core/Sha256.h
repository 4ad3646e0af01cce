#pragma once

#include <memory>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"

struct evp_md_ctx_st;

namespace usdlive {

/// The SHA-256 of bytes that come in parts; sha256() does it for those that are all here.
class Sha256 {
public:
    Sha256();
    void add(ByteView part);
    /// Ends it: nothing may be added any more.
    [[nodiscard]] Hash finish();

private:
    struct Free {
        void operator()(evp_md_ctx_st* context) const;
    };
    std::unique_ptr<evp_md_ctx_st, Free> context_;
};

}  // namespace usdlive
