#include <algorithm>

#include "RocksSupport.h"
#include "StateRecords.h"
#include "StateTags.h"
#include "StoreKeys.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server {

namespace {

// Up to so many records are erased one by one. A range tombstone costs nothing to write, yet every
// later read has to look at all there are, until they are compacted away.
constexpr std::size_t kSingleErases = 256;
// Nodes with numbers in sequence are erased as one range from so many on.
constexpr NodeId kRangeOfNodes = 64;

rocksdb::Slice tag(const FieldTag& tag) { return {reinterpret_cast<const char*>(&tag), 1}; }

}  // namespace

void StateWriter::add(std::uint32_t layer, bool fresh, const StateChange& change) {
    if (fresh) written_[layer].fresh = true;
    std::visit([&](const auto& one) { put(layer, one); }, change);
}

void StateWriter::put(std::uint32_t layer, const PutNode& change) {
    putNode(layer, change.node, change.parent, change.order, change.kind, change.name);
}

void StateWriter::putNode(std::uint32_t layer, NodeId node, NodeId parent, std::uint64_t order,
                          SpecKind kind, std::string_view name) {
    value_.clear();
    appendNumber<NodeId>(value_, parent);
    appendNumber<std::uint64_t>(value_, order);
    appendNumber<std::uint8_t>(value_, std::uint8_t(kind));
    appendText(value_, name);
    batch_.Put(state_, storekeys::node(layer, node), slice(value_));
}

// As RocksDB sorts the records, which takes them in much faster so.
void StateWriter::put(std::uint32_t layer, const PutLayer& change) {
    LayerDoc::Walk nodes(change.doc);
    while (const auto* spec = nodes.next())
        if (spec->kind != SpecKind::PseudoRoot)
            putNode(layer, spec->node, spec->parent, spec->order, spec->kind, spec->name);
    LayerDoc::Walk fields(change.doc);
    while (const auto* spec = fields.next()) {
        if (!spec->fields->empty()) noteFields(layer, spec->node);
        for (const auto& [field, value] : *spec->fields)
            putField(storekeys::field(layer, spec->node, field), value);
    }
}

void StateWriter::put(std::uint32_t layer, const EraseNodes& change) {
    std::vector<NodeId> nodes(change.nodes);
    std::sort(nodes.begin(), nodes.end());
    for (auto first = nodes.begin(); first != nodes.end();) {
        auto last = first;
        while (last + 1 != nodes.end() && *(last + 1) <= *last + 1) ++last;
        for (auto node = first; node <= last; ++node)
            batch_.Delete(state_, storekeys::node(layer, *node));
        eraseFields(layer, *first, *last);
        first = last + 1;
    }
}

void StateWriter::put(std::uint32_t layer, const PutField& change) {
    const std::string field = storekeys::field(layer, change.node, change.field);
    if (change.hadSamples) eraseSamples(field);
    noteFields(layer, change.node);
    putField(field, change.value);
}

void StateWriter::putField(const std::string& key, const FieldValue& value) {
    if (const auto* samples = value.as<TimeSamples>()) return putSamples(key, *samples);
    value_.assign(1, std::uint8_t(FieldTag::Whole));
    encodeFieldValue(value, value_);
    batch_.Put(state_, key, slice(value_));
}

void StateWriter::put(std::uint32_t layer, const EraseField& change) {
    const std::string field = storekeys::field(layer, change.node, change.field);
    if (change.hadSamples) eraseSamples(field);
    batch_.Delete(state_, field);
}

void StateWriter::put(std::uint32_t layer, const PutSample& change) {
    const std::string field = storekeys::field(layer, change.node, change.field);
    noteFields(layer, change.node);
    putSamples(field, {{{change.time, change.value}}});
}

void StateWriter::put(std::uint32_t layer, const EraseSample& change) {
    const std::string field = storekeys::field(layer, change.node, change.field);
    batch_.Delete(state_, storekeys::sample(field, change.time));
}

void StateWriter::putSamples(const std::string& field, const TimeSamples& samples) {
    batch_.Put(state_, field,
               tag(samples.samples.empty() ? FieldTag::NoSamples : FieldTag::Samples));
    if (!samples.samples.empty()) sampledFields_.insert(field);
    for (const auto& [time, content] : samples.samples) {
        value_.clear();
        encodeFieldValue(content, value_);
        batch_.Put(state_, storekeys::sample(field, time), slice(value_));
    }
}

void StateWriter::eraseSamples(const std::string& field) {
    eraseRange(storekeys::samplesBegin(field), storekeys::samplesEnd(field),
               sampledFields_.contains(field));
}

void StateWriter::eraseFields(std::uint32_t layer, NodeId first, NodeId last) {
    const auto written = written_.find(layer);
    const auto inBatch = [&](const Written& all) {
        for (NodeId node = first; node <= last && !all.nodes.empty(); ++node)
            if (all.nodes.contains(node)) return true;
        return all.fresh;
    };
    const bool ranged =
        last - first >= kRangeOfNodes || (written != written_.end() && inBatch(written->second));
    eraseRange(storekeys::fields(layer, first), storekeys::fields(layer, last + 1), ranged);
}

void StateWriter::eraseRange(const std::string& begin, const std::string& end, bool alsoInBatch) {
    if (alsoInBatch) {
        batch_.DeleteRange(state_, begin, end);
        return;
    }
    if (!iterator_) iterator_.reset(db_.NewIterator(rocksdb::ReadOptions(), state_));
    std::vector<std::string> keys;
    for (iterator_->Seek(begin); iterator_->Valid() && text(iterator_->key()) < end;
         iterator_->Next()) {
        keys.emplace_back(text(iterator_->key()));
        if (keys.size() > kSingleErases) return eraseRange(begin, end, true);
    }
    if (!iterator_->status().ok()) status_ = iterator_->status();
    for (const std::string& key : keys) batch_.Delete(state_, key);
}

void StateWriter::noteFields(std::uint32_t layer, NodeId node) {
    Written& written = written_[layer];
    if (!written.fresh) written.nodes.insert(node);
}

}  // namespace usdlive::server
