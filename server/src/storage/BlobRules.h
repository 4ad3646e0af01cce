#pragma once

#include <cstdint>
#include <string>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

[[nodiscard]] inline tl::unexpected<Error> blobError(ErrorCode code, const Hash& hash,
                                                     const std::string& what) {
    return fail(code, "the value " + hash.hex() + " " + what);
}

/// May a part of `bytes` at `offset` come, where `written` bytes of a value of `size` are there?
[[nodiscard]] inline Result<void> checkPart(const Hash& hash, std::uint64_t size,
                                            std::uint64_t written, std::uint64_t offset,
                                            std::uint64_t bytes, std::uint64_t maxBytes) {
    if (size > maxBytes)
        return blobError(ErrorCode::BlobTooLarge, hash,
                         "has " + std::to_string(size) + " bytes, more than the " +
                             std::to_string(maxBytes) + " that are taken");
    if (offset != written)
        return blobError(ErrorCode::BlobMismatch, hash,
                         "goes on at byte " + std::to_string(offset) + " where " +
                             std::to_string(written) + " are there");
    if (bytes > size - offset)
        return blobError(ErrorCode::BlobMismatch, hash, "has more bytes than it was said to have");
    return {};
}

}  // namespace usdlive::server
