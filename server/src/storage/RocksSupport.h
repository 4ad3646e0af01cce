// Converts between RocksDB's types and ours.
#pragma once

#include <rocksdb/slice.h>
#include <rocksdb/status.h>

#include <filesystem>
#include <string>
#include <string_view>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

[[nodiscard]] inline rocksdb::Slice slice(ByteView bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
[[nodiscard]] inline std::string_view text(const rocksdb::Slice& slice) {
    return {slice.data(), slice.size()};
}
[[nodiscard]] inline ByteView bytes(const rocksdb::Slice& slice) { return asBytes(text(slice)); }

/// Returns the error "cannot <verb> the store <folder>: IO error: ...".
[[nodiscard]] inline Error rocksError(const rocksdb::Status& status, const char* verb,
                                      const std::filesystem::path& folder) {
    ErrorCode code = ErrorCode::StorageFailed;
    if (status.IsCorruption() || status.IsNotFound()) code = ErrorCode::StorageCorrupt;
    if (status.IsNoSpace()) code = ErrorCode::StorageFull;
    return {code, std::string("cannot ") + verb + " the store " + folder.string() + ": " +
                      status.ToString()};
}

/// Returns the size of the log of a database.
[[nodiscard]] inline std::uint64_t logBytes(const std::filesystem::path& database) {
    std::uint64_t bytes = 0;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(database, error))
        if (entry.path().extension() == ".log") bytes += entry.file_size(error);
    return bytes;
}

}  // namespace usdlive::server
