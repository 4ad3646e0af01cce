// Fuzzes the store's reading of a layer's file.
#include "Fuzz.h"
#include "server/src/storage/LayerSnapshots.h"
#include "unit/common/layer/RandomValue.h"
#include "usdlive/common/layer/SpecPath.h"

using namespace usdlive;
using namespace usdlive::server;
using fuzz::require;

namespace {

void add(LayerDoc& doc, const char* path, SpecKind kind, const char* field, FieldValue value) {
    (void)doc.apply(path, CreateSpec{kind});
    (void)doc.apply(path, SetField{field, {}, std::move(value)});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto snapshot = decodeSnapshot({data, size});
    if (!snapshot) return 0;
    const LayerDoc* doc = &snapshot->doc;
    std::size_t specs = 0;
    doc->visit([&](const LayerDoc::SpecView& spec) {
        ++specs;
        require(specpath::parse(spec.path).has_value(), "a stored spec has a path");
        require(doc->kind(spec.path) == spec.kind, "a stored spec is found");
    });
    require(specs == doc->specCount(), "the layer has all stored specs");
    require(difference(*doc, *doc).empty(), "a layer equals itself");
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
        all.push_back(encodeSnapshot({seed, {}, doc}));
    }
    return all;
}
