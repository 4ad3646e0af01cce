// The options and column families of the RocksDB database.
#pragma once

#include <rocksdb/db.h>
#include <rocksdb/sst_file_manager.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace usdlive::server {

inline constexpr std::uint64_t kMib = 1024 * 1024;

/// The column families of the store, in the order of opening. Meta (`default`) holds the head,
/// epoch, layers, runs of their commits, checkpoints, moves and deletes.
enum class Family { Meta, Commits, Clients };

/// Returns options for little memory and small files, because people edit a project and the log is
/// rarely read.
[[nodiscard]] rocksdb::DBOptions databaseOptions(std::shared_ptr<rocksdb::SstFileManager> files);
[[nodiscard]] std::vector<rocksdb::ColumnFamilyDescriptor> columnFamilies();

}  // namespace usdlive::server
