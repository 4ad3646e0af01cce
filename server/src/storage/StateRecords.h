#pragma once

#include <rocksdb/db.h>
#include <rocksdb/write_batch.h>

#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// Turns the state changes of one group of commits into records of one batch. See StoreKeys.h.
class StateWriter {
public:
    StateWriter(rocksdb::DB& db, rocksdb::ColumnFamilyHandle* state, rocksdb::WriteBatch& batch)
        : db_(db), state_(state), batch_(batch) {}

    /// `layer` is the layer's number; `fresh`: the store holds nothing of it before this batch.
    void add(std::uint32_t layer, bool fresh, const StateChange& change);
    /// What reading the records to be replaced said.
    [[nodiscard]] const rocksdb::Status& status() const { return status_; }

private:
    // What this batch has written of a layer, as it cannot be read back from the batch.
    struct Written {
        bool fresh = false;  // then the nodes are not noted: an import writes very many
        std::unordered_set<NodeId> nodes;
    };

    void put(std::uint32_t layer, const PutNode& change);
    void put(std::uint32_t layer, const EraseNodes& change);
    void put(std::uint32_t layer, const PutField& change);
    void put(std::uint32_t layer, const EraseField& change);
    void put(std::uint32_t layer, const PutSample& change);
    void put(std::uint32_t layer, const EraseSample& change);
    void put(std::uint32_t layer, const PutLayer& change);

    void putNode(std::uint32_t layer, NodeId node, NodeId parent, std::uint64_t order,
                 SpecKind kind, std::string_view name);
    void putField(const std::string& key, const FieldValue& value);
    void putSamples(const std::string& field, const TimeSamples& samples);
    void eraseSamples(const std::string& field);
    void eraseFields(std::uint32_t layer, NodeId first, NodeId last);
    void eraseRange(const std::string& begin, const std::string& end, bool alsoInBatch);
    void noteFields(std::uint32_t layer, NodeId node);

    rocksdb::DB& db_;
    rocksdb::ColumnFamilyHandle* state_;
    rocksdb::WriteBatch& batch_;
    std::unordered_map<std::uint32_t, Written> written_;
    Bytes value_;                                    // of the record being made
    std::unordered_set<std::string> sampledFields_;  // those of which the batch holds samples
    std::unique_ptr<rocksdb::Iterator> iterator_;    // over what was there before the batch
    rocksdb::Status status_;
};

/// Rebuilds the layer from its records. Errors: StorageCorrupt, StorageFailed.
[[nodiscard]] Result<LayerDoc> readLayer(rocksdb::DB& db, rocksdb::ColumnFamilyHandle* state,
                                         std::uint32_t layer, const std::string& what);
/// The same of records wherever they are.
[[nodiscard]] Result<LayerDoc> readLayer(rocksdb::Iterator& records, std::uint32_t layer,
                                         const std::string& what);

}  // namespace usdlive::server
