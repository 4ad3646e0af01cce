// The records of a layer as the store reads them back: an input is key and value, one after the
// other.
#include <rocksdb/db.h>
#include <rocksdb/env.h>

#include <map>

#include "Fuzz.h"
#include "server/src/storage/RocksSupport.h"
#include "server/src/storage/StateRecords.h"
#include "unit/common/layer/RandomValue.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/server/project/StateChanges.h"

using namespace usdlive;
using namespace usdlive::server;
using fuzz::require;

namespace {

constexpr std::uint32_t kLayer = 0;

/// Records in memory, sorted as RocksDB sorts them.
class Records final : public rocksdb::Iterator {
public:
    explicit Records(ByteView input) {
        ByteReader in(input);
        while (in.left() > 0) {
            std::string key(in.text());
            records_.insert_or_assign(std::move(key), std::string(in.text()));
        }
        at_ = records_.end();
    }
    bool Valid() const override { return at_ != records_.end(); }
    void SeekToFirst() override { at_ = records_.begin(); }
    void SeekToLast() override { at_ = records_.empty() ? at_ : std::prev(records_.end()); }
    void Seek(const rocksdb::Slice& key) override { at_ = records_.lower_bound(key.ToString()); }
    void SeekForPrev(const rocksdb::Slice&) override { std::abort(); }
    void Next() override { ++at_; }
    void Prev() override { std::abort(); }
    rocksdb::Slice key() const override { return at_->first; }
    rocksdb::Slice value() const override { return at_->second; }
    rocksdb::Status status() const override { return {}; }

private:
    std::map<std::string, std::string> records_;
    std::map<std::string, std::string>::const_iterator at_;
};

/// As the store writes the layer.
Bytes recordsOf(const LayerDoc& doc) {
    const std::unique_ptr<rocksdb::Env> memory(rocksdb::NewMemEnv(rocksdb::Env::Default()));
    rocksdb::Options options;
    options.create_if_missing = true;
    options.env = memory.get();
    rocksdb::DB* opened = nullptr;
    require(rocksdb::DB::Open(options, "/store", &opened).ok(), "a store opens");
    const std::unique_ptr<rocksdb::DB> db(opened);
    rocksdb::WriteBatch batch;
    StateWriter writer(*db, db->DefaultColumnFamily(), batch);
    writer.add(kLayer, true, PutLayer{{"a.usda"}, doc});
    require(db->Write({}, &batch).ok(), "a store is written");
    Bytes out;
    const std::unique_ptr<rocksdb::Iterator> at(db->NewIterator({}));
    for (at->SeekToFirst(); at->Valid(); at->Next()) {
        appendText(out, text(at->key()));
        appendText(out, text(at->value()));
    }
    return out;
}

void add(LayerDoc& doc, const char* path, SpecKind kind, const char* field, FieldValue value) {
    (void)doc.apply(path, CreateSpec{kind});
    (void)doc.apply(path, SetField{field, {}, std::move(value)});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Records records({data, size});
    const auto doc = readLayer(records, kLayer, "the layer");
    if (!doc) {
        require(doc.error().code == ErrorCode::StorageCorrupt, "damage is told as such");
        return 0;
    }
    std::size_t specs = 0;
    doc->visit([&](const LayerDoc::SpecView& spec) {
        ++specs;
        require(specpath::parse(spec.path).has_value(), "a stored spec has a path");
        require(doc->kind(spec.path) == spec.kind, "a stored spec is found");
    });
    require(specs == doc->specCount(), "all stored specs are there");
    require(difference(*doc, *doc).empty(), "a layer differs from itself");
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (unsigned seed = 0; seed < 16; ++seed) {
        RandomValue random(seed);
        LayerDoc doc;
        add(doc, "/", SpecKind::PseudoRoot, "customLayerData", random.dictionary());
        add(doc, "/A", SpecKind::Prim, "apiSchemas", random.listOp());
        add(doc, "/A.x", SpecKind::Attribute, "timeSamples", random.timeSamples());
        add(doc, "/A.r", SpecKind::Relationship, "doc", random.leaf(ValueType::String));
        add(doc, "/A/B", SpecKind::Prim, "variantSelection", random.map());
        add(doc, "/A/B{v=}", SpecKind::VariantSet, "other", random.field());
        add(doc, "/A/B{v=one}", SpecKind::Variant, "other", random.field());
        add(doc, "/A/B{v=one}C.x", SpecKind::Attribute, "timeSamples", TimeSamples{});
        all.push_back(recordsOf(doc));
    }
    return all;
}
