#include <algorithm>

#include "RocksSupport.h"
#include "StateRecords.h"
#include "StateTags.h"
#include "StoreKeys.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server {

namespace {

struct StoredNode {
    NodeId node = 0, parent = 0;
    std::uint64_t order = 0;
    SpecKind kind{};
    std::string name;
};

/// One pass over a layer's records: nodes, then fields with their samples.
class StateReader {
public:
    StateReader(rocksdb::Iterator& iterator, std::uint32_t layer, const std::string& what)
        : layer_(layer), what_(what), iterator_(iterator) {}

    Result<LayerDoc> read() {
        return readNodes()
            .and_then([this] { return addNodes(); })
            .and_then([this] { return readFields(); })
            .map([this] { return builder_.finish(); });
    }

private:
    tl::unexpected<Error> damaged(const std::string& why) const {
        return fail(ErrorCode::StorageCorrupt, what_ + " is damaged: " + why);
    }

    /// Visits the records of a part until `visit` returns an error.
    template <class Visit>
    Result<void> each(char part, Visit visit) {
        const std::string prefix = storekeys::layerPart(layer_, part);
        for (iterator_.Seek(prefix); iterator_.Valid() && text(iterator_.key()).starts_with(prefix);
             iterator_.Next())
            if (const auto done = visit(text(iterator_.key()), bytes(iterator_.value())); !done)
                return done;
        const auto status = iterator_.status();
        if (status.ok()) return {};
        if (status.IsCorruption()) return damaged(status.ToString());
        return fail(ErrorCode::StorageFailed, what_ + " cannot be read: " + status.ToString());
    }

    Result<void> readNodes() {
        return each(storekeys::kNodes,
                    [this](std::string_view key, ByteView value) -> Result<void> {
                        ByteReader in(value);
                        StoredNode node;
                        node.parent = in.u64();
                        node.order = in.u64();
                        node.kind = SpecKind(in.u8());
                        node.name = in.text();
                        if (key.size() != storekeys::kNodeKeyBytes || !in.finished())
                            return damaged("a spec's record cannot be read");
                        node.node = storekeys::bigEndian64(key.substr(storekeys::kLayerBytes + 1));
                        if (node.node != kRootNode) nodes_.push_back(std::move(node));
                        return {};
                    });
    }

    // A spec that was moved may stand below a younger one, so its number does not tell the order.
    Result<void> addNodes() {
        std::sort(nodes_.begin(), nodes_.end(),
                  [](const auto& a, const auto& b) { return a.parent < b.parent; });
        std::vector<NodeId> parents{kRootNode};
        std::size_t added = 0;
        while (!parents.empty()) {
            const NodeId parent = parents.back();
            parents.pop_back();
            for (auto node = std::lower_bound(
                     nodes_.begin(), nodes_.end(), parent,
                     [](const StoredNode& one, NodeId id) { return one.parent < id; });
                 node != nodes_.end() && node->parent == parent; ++node, ++added) {
                const auto done =
                    builder_.addSpec(node->node, parent, node->order, node->kind, node->name);
                if (!done) return damaged(done.error().message);
                parents.push_back(node->node);
            }
        }
        if (added != nodes_.size()) return damaged("it has specs without parents");
        nodes_ = {};
        return {};
    }

    Result<void> readFields() {
        return each(storekeys::kFields,
                    [this](std::string_view key, ByteView value) { return readField(key, value); })
            .and_then([this] { return addSamples(); });
    }

    Result<void> readField(std::string_view key, ByteView value) {
        const storekeys::FieldKey split = storekeys::splitField(key);
        if (split.name.empty()) return damaged("a field's key cannot be read");
        if (!split.time.empty()) return readSample(split, value);
        if (const auto done = addSamples(); !done) return done;
        if (value.empty()) return damaged("a field has no content");
        switch (FieldTag(value[0])) {
            case FieldTag::Samples:
                sampled_ = split.field;
                return {};
            case FieldTag::NoSamples:
                return addField(split, TimeSamples{});
            default:
                break;
        }
        auto content = decodeFieldValue(value.subspan(1));
        if (!content) return damaged(content.error().message);
        return addField(split, std::move(*content));
    }

    Result<void> readSample(const storekeys::FieldKey& key, ByteView value) {
        auto content = decodeFieldValue(value);
        if (!content) return damaged(content.error().message);
        auto* leaf = content->as<Value>();
        if (!leaf || key.field != sampled_) return damaged("a time sample stands alone");
        samples_.samples.emplace_back(storekeys::timeOf(storekeys::bigEndian64(key.time)),
                                      std::move(*leaf));
        return {};
    }

    Result<void> addSamples() {
        if (samples_.samples.empty()) return {};
        return addField(storekeys::splitField(sampled_), std::exchange(samples_, {}));
    }
    Result<void> addField(const storekeys::FieldKey& key, FieldValue value) {
        const auto done = builder_.addField(key.node, key.name, std::move(value));
        if (!done) return damaged(done.error().message);
        return {};
    }

    std::uint32_t layer_;
    const std::string& what_;
    rocksdb::Iterator& iterator_;
    std::vector<StoredNode> nodes_;
    LayerDoc::Builder builder_;
    std::string sampled_;  // key of the field whose samples are being read
    TimeSamples samples_;
};

}  // namespace

Result<LayerDoc> readLayer(rocksdb::DB& db, rocksdb::ColumnFamilyHandle* state, std::uint32_t layer,
                           const std::string& what) {
    rocksdb::ReadOptions options;
    options.fill_cache = false;
    options.readahead_size = 1024 * 1024;
    const std::unique_ptr<rocksdb::Iterator> records(db.NewIterator(options, state));
    return readLayer(*records, layer, what);
}

Result<LayerDoc> readLayer(rocksdb::Iterator& records, std::uint32_t layer,
                           const std::string& what) {
    return StateReader(records, layer, what).read();
}

}  // namespace usdlive::server
