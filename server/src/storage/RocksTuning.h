#pragma once

#include <rocksdb/db.h>
#include <rocksdb/sst_file_manager.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace usdlive::server {

inline constexpr std::uint64_t kMib = 1024 * 1024;

/// The column families of the store, in the order they are opened. `default` holds what is said
/// about the store: head, epoch, layers and the runs of their commits, checkpoints, moves, deletes.
enum class Family { Meta, Commits, Clients };

/// Small in memory and files: a project is edited by people, and the log is read rarely.
[[nodiscard]] rocksdb::DBOptions databaseOptions(std::shared_ptr<rocksdb::SstFileManager> files);
[[nodiscard]] std::vector<rocksdb::ColumnFamilyDescriptor> columnFamilies();

}  // namespace usdlive::server
