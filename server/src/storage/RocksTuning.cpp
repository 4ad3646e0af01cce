// The options of RocksDB.
#include "storage/RocksTuning.h"

#include <rocksdb/cache.h>
#include <rocksdb/env.h>
#include <rocksdb/filter_policy.h>
#include <rocksdb/slice_transform.h>
#include <rocksdb/table.h>

#include "storage/RocksCommitStore.h"
#include "storage/StoreKeys.h"
#include "usdlive/common/core/Thread.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kKib = 1024;
constexpr std::size_t kWriteBufferBytes = 16 * kMib;

struct NoLog : rocksdb::Logger {
    using rocksdb::Logger::Logv;
    void Logv(const char*, va_list) override {}
};

rocksdb::ColumnFamilyOptions familyOptions(const std::shared_ptr<rocksdb::Cache>& cache) {
    rocksdb::BlockBasedTableOptions table;
    table.block_cache = cache;
    table.cache_index_and_filter_blocks = true;
    table.pin_l0_filter_and_index_blocks_in_cache = true;
    table.filter_policy.reset(rocksdb::NewBloomFilterPolicy(10, false));
    table.block_size = 16 * kKib;
    table.format_version = 5;

    rocksdb::ColumnFamilyOptions options;
    options.table_factory.reset(rocksdb::NewBlockBasedTableFactory(table));
    options.write_buffer_size = kWriteBufferBytes;
    // Lets writes continue while the tables of a large import are written, which takes seconds.
    options.max_write_buffer_number = 8;
    options.compression = rocksdb::kLZ4Compression;
    options.bottommost_compression = rocksdb::kZSTD;
    // Limits the extra disk space of one compaction.
    options.target_file_size_base = 16 * kMib;
    options.max_bytes_for_level_base = 64 * kMib;
    options.max_compaction_bytes = 128 * kMib;
    return options;
}

}  // namespace

std::shared_ptr<void> startStoreThreads() try {
    // Two of each kind, so that the tables of one busy project do not delay those of the others.
    constexpr int kThreads = 2;
    for (const auto priority : {rocksdb::Env::Priority::LOW, rocksdb::Env::Priority::HIGH})
        rocksdb::Env::Default()->SetBackgroundThreads(kThreads, priority);
    // The first database starts the thread of a timer, which ends with the last one. RocksDB does
    // not survive that this thread is refused, so another one tries it before.
    startThread("rocksdb:timer", [] {}).join();
    const std::shared_ptr<rocksdb::Env> memory(rocksdb::NewMemEnv(rocksdb::Env::Default()));
    rocksdb::Options options(databaseOptions(nullptr), rocksdb::ColumnFamilyOptions());
    options.create_if_missing = true;
    options.write_buffer_size = 64 * kKib;
    options.env = memory.get();
    rocksdb::DB* opened = nullptr;
    if (const auto status = rocksdb::DB::Open(options, "/timer", &opened); !status.ok())
        throw std::runtime_error("RocksDB cannot start its timer: " + status.ToString());
    return {opened, [memory](rocksdb::DB* database) { delete database; }};
} catch (const std::system_error& why) {
    throw ThreadRefused("rocksdb", why);
}

rocksdb::DBOptions databaseOptions(std::shared_ptr<rocksdb::SstFileManager> files) {
    rocksdb::DBOptions options;
    options.create_missing_column_families = true;
    options.paranoid_checks = true;
    // The default would open a log with damage in the middle and silently stop before it.
    options.wal_recovery_mode = rocksdb::WALRecoveryMode::kTolerateCorruptedTailRecords;
    options.track_and_verify_wals_in_manifest = true;
    options.atomic_flush = true;  // all families contain the same commits at any time
    // A flush during recovery is recorded separately for each family. If the end of the MANIFEST
    // were lost later, some families would lose a table without notice.
    options.avoid_flush_during_recovery = true;
    options.db_write_buffer_size = kWriteBufferBytes;
    options.max_total_wal_size = 4 * kWriteBufferBytes;
    options.max_background_jobs = 1;
    options.max_open_files = 128;
    options.max_file_opening_threads = 1;  // others would start while a store is opened
    options.manifest_preallocation_size = 64 * kKib;
    options.sst_file_manager = std::move(files);
    options.info_log = std::make_shared<NoLog>();
    options.stats_dump_period_sec = 0;
    options.stats_persist_period_sec = 0;
    return options;
}

std::vector<rocksdb::ColumnFamilyDescriptor> columnFamilies() {
    const auto cache = rocksdb::NewLRUCache(16 * kMib);
    std::vector<rocksdb::ColumnFamilyDescriptor> families;
    for (const char* name : {"default", "commits", "clients"})
        families.emplace_back(name, familyOptions(cache));
    // Keys of commits increase, and so do those of each client's transactions. The hint inserts
    // each key next to the previous one with the same prefix.
    const auto inOrder = [&](Family family, std::size_t beginning) {
        families[std::size_t(family)].options.memtable_insert_with_hint_prefix_extractor.reset(
            rocksdb::NewFixedPrefixTransform(beginning));
    };
    inOrder(Family::Commits, storekeys::kCommitBeginning);
    inOrder(Family::Clients, storekeys::kClientBeginning);
    return families;
}

}  // namespace usdlive::server
