// Tests ED8-ED11 against OpenUSD itself: after any concurrent edits the layer can be written and
// read.
#include "usdlive/common/layer/FileRules.h"

#include <gtest/gtest.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/valueTypeName.h>
#include <unistd.h>

#include <deque>
#include <filesystem>

#include "MemoryBlobs.h"
#include "unit/common/layer/RandomEdits.h"
#include "unit/common/layer/RandomValue.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"
#include "usdlive/common/usd/TfComplaints.h"
#include "usdlive/common/usd/ValueCodec.h"

using namespace usdlive;

namespace {

const LayerId kLayer{"a.usda"};

// Several authors of one layer, each of whom sees it at some earlier revision.
class Authors {
public:
    explicit Authors(unsigned seed) : random_(seed), values_(seed) {
        seen_.emplace_back(0, LayerDoc());
    }

    const LayerDoc& doc() { return layers_[kLayer]; }

    void step() {
        const auto& [base, view] = seen_[random_.below(seen_.size())];
        std::vector<Edit> edits;
        for (std::size_t left = 1 + random_.below(3); left > 0; --left) add(edits, view);
        OwnCreations creations;
        const Transaction transaction{{{"someone"}, ++sequence_}, base, 0, std::move(edits)};
        const Outcome outcome = execute(layers_, log_, creations, transaction, revision_ + 1);
        if (!std::holds_alternative<Executed>(outcome)) return;
        ++revision_;
        accepted += std::get<Executed>(outcome).edits.size();
        seen_.emplace_back(revision_, layers_[kLayer]);
        if (seen_.size() > 5) seen_.pop_front();
    }
    std::size_t accepted = 0;

private:
    std::string name() { return random_.name(); }
    void put(std::vector<Edit>& edits, const std::string& path, EditAction action) {
        edits.push_back({kLayer, {path, {}}, std::move(action)});
    }
    void put(std::vector<Edit>& edits, const std::string& path, std::string field, FieldPart part,
             FieldValue value, ValueType form = ValueType::None) {
        put(edits, path, SetField{std::move(field), std::move(part), std::move(value), form});
    }

    std::string someType() {
        static const std::vector<std::string> kNames{
            "double",   "float",    "half",  "string",         "token",   "asset",
            "float3",   "double3",  "int",   "int64",          "bool",    "float[]",
            "string[]", "matrix4d", "quatf", "timecode",       "color3f", "opaque",
            "Own",      "My Type",  "None",  "pathExpression", "token[]", ""};
        return random_.of(kNames);
    }
    // Returns a value of a type that an attribute may have.
    Value someValue() {
        static const std::vector<ValueType> kTypes{
            ValueType::Double,         ValueType::Float,  ValueType::Int,
            ValueType::Bool,           ValueType::String, ValueType::Token,
            ValueType::Half3,          ValueType::Float3, ValueType::Double3,
            ValueType::Quatf,          ValueType::Block,  arrayOf(ValueType::Float),
            arrayOf(ValueType::String)};
        const ValueType type = random_.of(kTypes);
        // Finite, because a NaN is written without its bits.
        if (type == ValueType::Double) return doubleValue(double(random_.below(100)) / 8);
        if (type == ValueType::Float || type == ValueType::Float3 || type == ValueType::Half3 ||
            type == ValueType::Double3 || type == ValueType::Quatf)
            return {type, Bytes(values_.leafBytes(type).size(), 0)};
        if (type == arrayOf(ValueType::Float)) return {type, Bytes(8, 0)};
        return values_.leaf(type);
    }

    void add(std::vector<Edit>& edits, const LayerDoc& view) {
        const auto all = RandomEdits::paths(view);
        const std::string path = random_.of(all);
        const SpecKind kind = *view.kind(path);
        if (random_.chance(3)) {
            const auto [child, childKind] = random_.childOf(path);
            if (hasPlace(kind, childKind)) create(edits, child, childKind);
        } else if (path != "/" && random_.chance(6)) {
            if (random_.chance(2))
                put(edits, path, DeleteSpec{});
            else
                put(edits, path, MoveSpec{{specpath::parent(path), {}}, name()});
        } else if (kind == SpecKind::Attribute) {
            ofAttribute(edits, path);
        } else if (kind == SpecKind::Prim || kind == SpecKind::Variant) {
            ofPrim(edits, path);
        }
    }
    static bool hasPlace(SpecKind parent, SpecKind child) {
        if (parent == SpecKind::VariantSet) return child == SpecKind::Variant;
        if (parent == SpecKind::PseudoRoot) return child == SpecKind::Prim;
        return parent == SpecKind::Prim || parent == SpecKind::Variant;
    }
    void create(std::vector<Edit>& edits, const std::string& path, SpecKind kind) {
        put(edits, path, CreateSpec{kind});
        if (kind == SpecKind::Prim)
            put(edits, path, "specifier", {},
                Value(ValueType::Specifier, Bytes{std::uint8_t(random_.below(3))}));
        if (kind == SpecKind::Attribute) {
            put(edits, path, "typeName", {}, tokenValue(someType()));
            put(edits, path, "default", {}, someValue());
            put(edits, path, "timeSamples", {}, TimeSamples{{{1, someValue()}}});
        }
    }
    void ofAttribute(std::vector<Edit>& edits, const std::string& path) {
        switch (random_.below(6)) {
            case 0:
                return put(edits, path, "typeName", {}, tokenValue(someType()));
            case 1:
                return put(edits, path, EraseField{"typeName", {}});
            case 2:
                return put(edits, path, "timeSamples", SampleTime{double(random_.below(3))},
                           someValue());
            case 3:
                return put(edits, path, "timeSamples", {},
                           TimeSamples{{{0, someValue()}, {2, someValue()}}});
            case 4:
                return put(edits, path, "customData", DictionaryKey{{name()}}, values_.leaf());
            default:
                return put(edits, path, "default", {}, someValue());
        }
    }
    void ofPrim(std::vector<Edit>& edits, const std::string& path) {
        switch (random_.below(7)) {
            case 0: {
                const ListItem item{random_.chance(2) ? ListName::Explicit : ListName::Prepended,
                                    stringValue(name()),
                                    {}};
                if (random_.chance(2)) return put(edits, path, EraseField{"variantSetNames", item});
                return put(edits, path, "variantSetNames", item, {}, ValueType::String);
            }
            case 1:
                if (random_.chance(2))
                    return put(edits, path, "variantSelection", {}, Map{ValueType::String, {}});
                return put(edits, path, "variantSelection", MapKey{stringValue(name())},
                           stringValue(name()), ValueType::String);
            case 2:
                return put(edits, path, "variantSetNames", {},
                           ListOp{ValueType::String, random_.chance(2), {}});
            case 3:
                return put(edits, path, "apiSchemas", {},
                           ListOp{ValueType::Token, random_.chance(2), {}});
            case 4: {
                const DictionaryKey key{{name(), values_.text()}};
                return put(edits, path, "customData", key,
                           random_.chance(2) ? someValue() : values_.leaf());
            }
            case 5:
                return put(edits, path, "comment", {}, stringValue(values_.text()));
            default:
                return put(edits, path, "typeName", {}, tokenValue(someType()));
        }
    }

    RandomEdits random_;
    RandomValue values_;
    LayerDocs layers_{{kLayer, {}}};
    NamespaceLog log_;
    std::deque<std::pair<Revision, LayerDoc>> seen_;
    Revision revision_ = 0;
    std::uint64_t sequence_ = 0;
};

std::string text(const pxr::SdfLayer& layer) {
    std::string exported;
    EXPECT_TRUE(layer.ExportToString(&exported));
    return exported;
}

}  // namespace

TEST(FileRules, ED9KnowsTheTypesOfSdf) {
    for (const auto& type : pxr::SdfSchema::GetInstance().GetAllTypes()) {
        usdlive::test::MemoryBlobs blobs;
        for (const pxr::TfToken& name : type.GetAliasesAsTokens()) {
            const auto value = valueTypeOf(name.GetString());
            EXPECT_TRUE(value) << name << type.GetDefaultValue().GetTypeName();
            if (!value) continue;
            const auto encoded = usd::encodeValue(type.GetDefaultValue(), blobs);
            ASSERT_TRUE(encoded) << name;
            EXPECT_EQ(*value, encoded->type()) << name;
            EXPECT_TRUE(fitsType(name.GetString(), "default", *encoded)) << name;
        }
    }
}

TEST(FileRules, AnyConcurrentEditsCanBeSavedAndReadBack) {
    const auto folder =
        std::filesystem::temp_directory_path() / ("usdlive-file-rules-" + std::to_string(getpid()));
    std::filesystem::create_directories(folder);
    std::size_t accepted = 0;
    for (unsigned seed = 0; seed < seedsOf(60); ++seed) {
        SCOPED_TRACE(seed);  // a failure prints the seed that repeats it
        Authors authors(seed);
        for (int step = 1; step <= 120; ++step) {
            authors.step();
            if (step % 40 != 0) continue;
            for (const std::string format : {"usda", "usdc"}) {
                const usd::TfComplaints complaints;
                usdlive::test::MemoryBlobs blobs;
                const auto layer = usd::makeLayer(authors.doc(), blobs, format);
                ASSERT_TRUE(layer) << layer.error().message << authors.doc().dump();
                // OpenUSD cannot read the -nan that it writes.
                if (text(**layer).find("-nan") != std::string::npos) continue;
                const auto file = (folder / ("a." + format)).string();
                EXPECT_TRUE((*layer)->Export(file) && !complaints.hasErrors())
                    << complaints.text("") << text(**layer);
                const auto read = pxr::SdfLayer::OpenAsAnonymous(file);
                ASSERT_TRUE(read) << complaints.text("") << text(**layer);
                EXPECT_EQ(text(*read), text(**layer));
            }
            if (HasFailure()) return;
        }
        accepted += authors.accepted;
    }
    EXPECT_GT(accepted, 2000u);
    std::filesystem::remove_all(folder);
}
