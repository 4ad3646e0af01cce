// Tests both stores of a layer's content, LayerDoc and SdfLayerStore, with one suite: after the
// same edits they return the same results, hold the same content and export the same text.

#include <gtest/gtest.h>
#include <pxr/base/gf/half.h>
#include <pxr/base/gf/quatd.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/types.h>

#include <random>

#include "unit/Seeds.h"
#include "unit/common/usd/MemoryBlobs.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using usdlive::test::MemoryBlobs;

namespace {

using Edits = std::vector<std::pair<std::string, EditAction>>;

// Makes edits of every kind; most of them are valid for the given doc.
class RandomEdits {
public:
    RandomEdits(unsigned seed, BlobSink& blobs) : random_(seed), blobs_(blobs) {}

    Edits next(const LayerDoc& doc) {
        specs_.clear();
        doc.visit([&](const LayerDoc::SpecView& spec) {
            specs_.push_back({std::string(spec.path), spec.kind});
        });
        switch (below(12)) {
            case 0:
            case 1:
            case 2:
                return create();
            case 3:
                return {{anySpec().path, below(3) ? EditAction(EraseField{fieldFor(anySpec()), {}})
                                                  : EditAction(DeleteSpec{})}};
            case 4:
                return {{anySpec().path, move()}};
            case 5:
                return {{anySpec().path, PlaceSpec{below(4) ? name() : ""}}};
            default:
                return setSomething();
        }
    }

private:
    struct Spec {
        std::string path;
        SpecKind kind;
    };

    std::size_t below(std::size_t bound) { return random_() % bound; }
    template <class T>
    const T& oneOf(const std::vector<T>& all) {
        return all[below(all.size())];
    }

    std::string name() {
        return oneOf<std::string>({"A", "B", "C", "x", "y", "long_name", "\u00e9"});
    }
    // Returns some spec, sometimes one that does not exist.
    Spec anySpec() {
        if (below(40) == 0) return {"/Nowhere", SpecKind::Prim};
        return oneOf(specs_);
    }
    Spec anyOf(std::vector<SpecKind> kinds) {
        std::vector<Spec> fitting;
        for (const Spec& spec : specs_)
            if (std::ranges::find(kinds, spec.kind) != kinds.end()) fitting.push_back(spec);
        return fitting.empty() ? specs_.front() : oneOf(fitting);
    }

    Edits create() {
        using enum SpecKind;
        const SpecKind kind = oneOf<SpecKind>(
            {Prim, Prim, Attribute, Attribute, Relationship, VariantSet, Variant, Variant});
        std::string parent = kind == Variant ? anyOf({VariantSet}).path
                             : kind == Prim  ? anyOf({PseudoRoot, Prim, Variant}).path
                                             : anyOf({Prim, Variant}).path;
        if (below(30) == 0) parent = anySpec().path;
        const ChildList list = kind == Variant      ? ChildList::Variants
                               : kind == VariantSet ? ChildList::VariantSets
                               : kind == Prim       ? ChildList::Prims
                                                    : ChildList::Properties;
        const std::string path = specpath::child(parent, list, name());
        Edits edits{{path, CreateSpec{below(40) ? kind : Relationship}}};
        // A text without a type name cannot be read.
        if (kind == Attribute) edits.push_back({path, SetField{"typeName", {}, token("double")}});
        return edits;
    }

    EditAction move() {
        const std::string parent = oneOf(specs_).path;
        return MoveSpec{{parent, {}}, below(20) ? name() : "not/a name"};
    }

    // ---- values

    static FieldValue token(std::string_view text) { return FieldValue(tokenValue(text)); }
    FieldValue value(const pxr::VtValue& value) { return *usd::encodeValue(value, blobs_); }

    Value leaf() {
        using namespace pxr;
        static const std::vector<VtValue> kLeaves{
            VtValue(1.5),
            VtValue(-0.0),
            VtValue(7),
            VtValue(true),
            VtValue(TfToken("t")),
            VtValue(std::string("quoted \"text\"\nof lines")),
            VtValue(SdfAssetPath("./a.png")),
            VtValue(GfVec3f(1, 2, 3)),
            VtValue(VtArray<GfVec3f>{{1, 2, 3}, {4, 5, 6}}),
            VtValue(VtArray<TfToken>{TfToken("a")}),
            VtValue(GfQuatd(1, 2, 3, 4)),
            VtValue(VtArray<int>()),
            VtValue(GfHalf(0.1f)),
            VtValue(std::uint64_t(1) << 60),
            VtValue(VtArray<double>(40'000, 0.5)) /* a blob */};
        return *usd::encodeLeaf(oneOf(kLeaves), blobs_);
    }

    Dictionary dictionary(int depth = 0) {
        Dictionary result;
        for (std::size_t count = below(4); count > 0; --count) {
            auto& entry = result.entries[key()];
            if (depth < 2 && below(3) == 0)
                entry = dictionary(depth + 1);
            else
                entry = leaf();
        }
        return result;
    }
    std::string key() {
        return oneOf<std::string>({"a", "b", "c", "with:colon", "with space", "\u00e9", ""});
    }

    std::string specPath() {
        std::string path = oneOf(specs_).path;
        return path.find('{') == std::string::npos && path != "/" ? path : "/Some/Where";
    }
    std::string primPath() {
        const std::string path = specPath();
        return path.substr(0, path.find('.'));
    }

    Value item(const std::string& field) {
        using namespace pxr;
        if (field == "subLayers") {
            Bytes bytes;
            appendText(bytes, oneOf<std::string>({"a.usda", "b.usda", "c.usda"}));
            appendNumber<double>(bytes, double(below(3)));
            appendNumber<double>(bytes, 1 + double(below(2)));
            return {ValueType::SubLayer, std::move(bytes)};
        }
        if (field == "references")
            return *usd::encodeLeaf(
                VtValue(SdfReference(oneOf<std::string>({"r.usd", "", "s.usd"}),
                                     SdfPath(primPath()), SdfLayerOffset(double(below(2)), 1),
                                     VtDictionary{{"k", VtValue(int(below(2)))}})),
                blobs_);
        if (field == "payload")
            return *usd::encodeLeaf(VtValue(SdfPayload("p.usd", SdfPath(primPath()))), blobs_);
        if (field == "inheritPaths" || field == "specializes") return pathValue(primPath());
        if (field == "targetPaths" || field == "connectionPaths") return pathValue(specPath());
        if (field == "variantSetNames" || field == "clipSets") return stringValue(name());
        return tokenValue(name());
    }

    ListOp listOp(const std::string& field) {
        ListOp op;
        op.itemType = item(field).type();
        op.isExplicit = field == "subLayers" || below(3) == 0;
        for (std::size_t list = 0; list < kListNames; ++list)
            if ((list == 0) == op.isExplicit)
                for (std::size_t count = below(3); count > 0; --count) {
                    auto& items = op.lists[list];
                    const Value candidate = item(field);
                    const bool isNew = std::ranges::none_of(items, [&](const Value& other) {
                        return itemKey(other) == itemKey(candidate);
                    });
                    if (isNew) items.push_back(candidate);
                }
        return op;
    }

    // ---- fields

    std::string fieldFor(const Spec& spec) {
        using Names = std::vector<std::string>;
        switch (spec.kind) {
            case SpecKind::PseudoRoot:
                return oneOf<std::string>({"subLayers", "customLayerData", "defaultPrim",
                                           "startTimeCode", "timeCodesPerSecond", "layerRelocates",
                                           "comment", "subLayers", "expressionVariables"});
            case SpecKind::Attribute:
                return oneOf<std::string>({"default", "default", "timeSamples", "timeSamples",
                                           "customData", "connectionPaths", "connectionPaths",
                                           "custom", "documentation", "displayUnit",
                                           "allowedTokens"});
            case SpecKind::Relationship:
                return oneOf<std::string>({"targetPaths", "targetPaths", "customData", "custom"});
            case SpecKind::VariantSet:
                return "customField";
            default:
                return oneOf<std::string>(
                    Names{"specifier", "typeName", "customData", "customData", "references",
                          "payload", "inheritPaths", "specializes", "variantSetNames", "apiSchemas",
                          "variantSelection", "kind", "active", "primOrder", "propertyOrder",
                          "documentation", "assetInfo", "clipSets", "instanceable"});
        }
    }

    enum class Form { Leaf, Dictionary, Samples, List, Selection, Relocates };
    static Form formOf(const std::string& field) {
        static const std::map<std::string, Form> kForms{{"customData", Form::Dictionary},
                                                        {"customLayerData", Form::Dictionary},
                                                        {"expressionVariables", Form::Dictionary},
                                                        {"assetInfo", Form::Dictionary},
                                                        {"timeSamples", Form::Samples},
                                                        {"subLayers", Form::List},
                                                        {"references", Form::List},
                                                        {"payload", Form::List},
                                                        {"inheritPaths", Form::List},
                                                        {"specializes", Form::List},
                                                        {"variantSetNames", Form::List},
                                                        {"clipSets", Form::List},
                                                        {"apiSchemas", Form::List},
                                                        {"targetPaths", Form::List},
                                                        {"connectionPaths", Form::List},
                                                        {"variantSelection", Form::Selection},
                                                        {"layerRelocates", Form::Relocates}};
        const auto found = kForms.find(field);
        return found == kForms.end() ? Form::Leaf : found->second;
    }

    Edits setSomething() {
        const Spec spec = anySpec();
        const std::string field = fieldFor(spec);
        switch (formOf(field)) {
            case Form::Leaf:
                return {{spec.path, SetField{field, {}, leafFor(field)}}};
            case Form::Dictionary:
                return {{spec.path, dictionaryEdit(field)}};
            case Form::Samples:
                return {{spec.path, samplesEdit()}};
            case Form::List:
                return {{spec.path, listEdit(field)}};
            case Form::Selection:
                return {{spec.path, mapEdit(field, ValueType::String, stringValue(name()),
                                            stringValue(name()))}};
            case Form::Relocates:
                return {{spec.path, mapEdit(field, ValueType::Path, pathValue(primPath()),
                                            pathValue(primPath()))}};
        }
        return {};
    }

    FieldValue leafFor(const std::string& field) {
        using namespace pxr;
        if (field == "specifier")
            return value(VtValue(
                oneOf<SdfSpecifier>({SdfSpecifierDef, SdfSpecifierOver, SdfSpecifierClass})));
        if (field == "startTimeCode") return FieldValue(doubleValue(double(below(100))));
        if (field == "timeCodesPerSecond")
            return FieldValue(doubleValue(oneOf<double>({24, 25, 0, -1, 1.0 / 0.0})));
        if (field == "custom" || field == "active" || field == "instanceable")
            return FieldValue(boolValue(below(2) == 0));
        if (field == "documentation" || field == "comment")
            return FieldValue(stringValue(oneOf<std::string>({"one line", "two\nlines \"\"\""})));
        if (field == "displayUnit") return token(oneOf<std::string>({"m", "deg"}));
        if (field == "allowedTokens")
            return value(VtValue(VtArray<TfToken>{TfToken("a"), TfToken(name())}));
        if (field == "primOrder" || field == "propertyOrder")
            return value(VtValue(TfTokenVector{TfToken(name()), TfToken("z")}));
        if (field == "default")
            return below(5) ? FieldValue(leaf()) : value(VtValue(SdfValueBlock()));
        return token(name());
    }

    EditAction dictionaryEdit(const std::string& field) {
        DictionaryKey part{{key()}};
        while (below(2)) part.path.push_back(key());
        switch (below(6)) {
            case 0:
                return SetField{field, {}, dictionary()};
            case 1:
                return EraseField{field, part};
            case 2:
                return SetField{field, part, dictionary()};
            default:
                return SetField{field, part, leaf()};
        }
    }

    EditAction samplesEdit() {
        const SampleTime part{oneOf<double>({0, -0.0, 1, 2.5, -3, 1e10, 1.0 / 0.0})};
        TimeSamples whole;
        for (double time = 0; below(3); ++time) whole.samples.emplace(time, leaf());
        switch (below(6)) {
            case 0:
                return SetField{"timeSamples", {}, whole};
            case 1:
            case 2:
                return EraseField{"timeSamples", part};
            default:
                return SetField{"timeSamples", part, leaf()};
        }
    }

    EditAction listEdit(const std::string& field) {
        const bool whole = below(4) == 0;
        if (whole) return SetField{field, {}, listOp(field)};
        ListItem part;
        part.list = field == "subLayers" ? ListName::Explicit : ListName(below(kListNames));
        part.item = item(field);
        if (below(2)) part.before = item(field);
        if (below(4) == 0) return EraseField{field, part};
        const ValueType type = part.item.type();
        return SetField{field, part, {}, type};
    }

    EditAction mapEdit(const std::string& field, ValueType keyType, const Value& key,
                       const Value& value) {
        if (below(5) == 0) return SetField{field, {}, Map{keyType, {{key, value}}}};
        if (below(4) == 0) return EraseField{field, MapKey{key}};
        return SetField{field, MapKey{key}, value, keyType};
    }

    std::mt19937 random_;
    BlobSink& blobs_;
    std::vector<Spec> specs_;
};

// Compares the content of a layer with that of the doc.
void expectSame(const LayerDoc& doc, const pxr::SdfLayerRefPtr& layer, MemoryBlobs& blobs) {
    const auto read = usd::readLayer(layer, blobs);
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_TRUE(*read == doc) << "layer:\n" << read->dump() << "doc:\n" << doc.dump();
    std::string text;
    ASSERT_TRUE(layer->ExportToString(&text));
    const auto made = usd::makeLayer(doc, blobs, "usda");
    ASSERT_TRUE(made) << made.error().message;
    std::string docText;
    ASSERT_TRUE((*made)->ExportToString(&docText));
    ASSERT_EQ(docText, text);
}

// Half of the seeds apply several steps in one block.
void runSeed(unsigned seed, const char* format, int steps) {
    const bool inBlocks = seed % 2 == 1;
    MemoryBlobs blobs;
    RandomEdits edits(seed, blobs);
    LayerDoc doc;
    const auto layer =
        pxr::SdfLayer::CreateAnonymous("store", pxr::SdfFileFormat::FindById(pxr::TfToken(format)));
    usd::SdfLayerStore store(layer, blobs, nullptr);
    std::optional<usd::SdfLayerStore::Block> block;
    for (int step = 0; step < steps; ++step) {
        if (inBlocks && !block) block.emplace();
        for (const auto& [path, action] : edits.next(doc)) {
            const auto inDoc = doc.apply(path, action);
            const auto inStore =
                block ? store.apply(path, action, *block) : store.apply(path, action);
            ASSERT_EQ(inDoc.has_value(), inStore.has_value())
                << step << ": " << path << ": "
                << (inDoc ? inStore.error().message : inDoc.error().message);
            if (!inDoc) {
                ASSERT_EQ(inDoc.error().code, inStore.error().code) << inStore.error().message;
            }
        }
        if (step % 16 == 15 || step + 1 == steps) {
            SCOPED_TRACE(step);
            block.reset();
            ASSERT_NO_FATAL_FAILURE(expectSame(doc, layer, blobs));
        }
    }
}

}  // namespace

TEST(LayerStoreContract, M8TheSameEditsGiveTheSameContentAndText) {
    for (unsigned seed = 0; seed < seedsOf(400); ++seed) {
        SCOPED_TRACE(seed);
        ASSERT_NO_FATAL_FAILURE(runSeed(seed, "usda", 64));
    }
}

TEST(LayerStoreContract, M8HoldsForBinaryLayers) {
    for (unsigned seed = 1000; seed < 1000 + seedsOf(100); ++seed) {
        SCOPED_TRACE(seed);
        ASSERT_NO_FATAL_FAILURE(runSeed(seed, "usdc", 64));
    }
}
