// Checks and errors that all stores of big values share.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

[[nodiscard]] inline tl::unexpected<Error> blobError(ErrorCode code, const Hash& hash,
                                                     const std::string& what) {
    return fail(code, "the value " + hash.hex() + " " + what);
}

/// Checks whether a part of `bytes` at `offset` can follow the `written` bytes of a value of
/// `size`.
[[nodiscard]] inline Result<void> checkPart(const Hash& hash, std::uint64_t size,
                                            std::uint64_t written, std::uint64_t offset,
                                            std::uint64_t bytes, std::uint64_t maxBytes) {
    if (size > maxBytes)
        return blobError(ErrorCode::BlobTooLarge, hash,
                         "has " + std::to_string(size) + " bytes, more than the limit of " +
                             std::to_string(maxBytes));
    if (offset != written)
        return blobError(ErrorCode::BlobMismatch, hash,
                         "continues at byte " + std::to_string(offset) + ", but " +
                             std::to_string(written) + " bytes are stored");
    if (bytes > size - offset)
        return blobError(ErrorCode::BlobMismatch, hash, "has more bytes than announced");
    return {};
}

/// Removes the beginning of a part that is among the `written` bytes already, because a client that
/// lost its connection sends again what perhaps did not arrive. Returns the offset of the rest.
[[nodiscard]] inline std::uint64_t skipWritten(std::uint64_t written, std::uint64_t offset,
                                               ByteView& part) {
    if (offset >= written) return offset;
    part = part.subspan(std::min<std::uint64_t>(written - offset, part.size()));
    return written;
}

}  // namespace usdlive::server
