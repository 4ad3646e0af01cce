// Tests LiveLayer: filling an SdfLayer while its snapshot arrives.
#include "usd/live/LiveLayer.h"

#include <gtest/gtest.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "unit/common/usd/MemoryBlobs.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Snapshot.h"

using namespace usdlive;
using client::LiveLayer;
using usdlive::test::MemoryBlobs;

namespace {

using Parts = std::vector<std::shared_ptr<const client::SnapshotPart>>;

std::string textOf(const pxr::SdfLayerHandle& layer) {
    std::string text;
    layer->ExportToString(&text);
    return text;
}

// Returns a doc that takes several steps to build.
LayerDoc bigDoc(const std::string& name, int prims = 6'000) {
    LayerDoc doc;
    EXPECT_TRUE(doc.apply("/" + name, CreateSpec{SpecKind::Prim}));
    for (int i = 0; i < prims; ++i) {
        const std::string path = "/" + name + "/p" + std::to_string(i);
        EXPECT_TRUE(doc.apply(path, CreateSpec{SpecKind::Prim}));
        EXPECT_TRUE(doc.apply(path, SetField{"documentation", {}, stringValue(path)}));
    }
    return doc;
}

Value subLayer(const std::string& path) {
    Bytes bytes;
    appendText(bytes, path);
    appendNumber<double>(bytes, 0);
    appendNumber<double>(bytes, 1);
    return {ValueType::SubLayer, std::move(bytes)};
}

Parts partsOf(const LayerDoc& doc) {
    Parts parts;
    SnapshotEncoder encoder(doc, 1);
    client::MessageReader reader;
    while (const auto chunk = encoder.next()) {
        auto read = reader.read(encodeFrame(*chunk));
        parts.push_back(std::get<client::ReceivedSnapshot>(*read.frames.at(0)).part);
    }
    EXPECT_GT(parts.size(), 2U);
    return parts;
}

class LiveLayerTest : public ::testing::Test {
protected:
    void arrive(const Parts& parts) {
        for (const auto& part : parts) live.arriving(part);
    }
    void show(const LayerDoc& doc) {
        view = doc;
        live.reset(doc);
    }
    // Joins a layer to which nothing was committed meanwhile.
    void join(const Parts& parts, const LayerDoc& doc) {
        arrive(parts);
        live.arrived(doc);
        show(doc);
        expectView();
    }
    void apply(const std::string& path, const EditAction& action) {
        ASSERT_TRUE(view.apply(path, action));
        usd::SdfLayerStore::Block block;
        live.apply(path, action, block);
    }
    void expectView() {
        for (int ms = 0; !live.isFilled() && ms < 60'000; ++ms) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
            const pxr::SdfChangeBlock block;
            live.fill();
        }
        ASSERT_TRUE(live.isFilled());
        const auto expected = usd::makeLayer(view, blobs, "usda");
        ASSERT_TRUE(expected);
        EXPECT_EQ(textOf(live.layer()), textOf(*expected));
        EXPECT_TRUE(*usd::readLayer(live.layer(), blobs) == view);
        EXPECT_TRUE(errors.empty()) << errors.front().message;
    }

    MemoryBlobs blobs;
    client::Worker worker;
    LayerDoc view;
    std::vector<Error> errors;
    LiveLayer live{LayerId{"a.usda"}, pxr::SdfLayer::CreateAnonymous(".usda"),
                   LiveLayer::Dependencies{blobs, blobs, blobs, worker, [this] { return &view; },
                                           [this](Error error) { errors.push_back(error); }, [] {},
                                           [](const auto&) {}}};
};

}  // namespace

TEST_F(LiveLayerTest, ShowsTheSnapshotWithTheCommitsSince) {
    LayerDoc doc = bigDoc("W");
    arrive(partsOf(doc));
    live.arrived(doc);
    ASSERT_TRUE(doc.apply("/W/p7", MoveSpec{{"/W", {}}, "renamed"}));
    ASSERT_TRUE(doc.apply("/W/p8", DeleteSpec{}));
    ASSERT_TRUE(doc.apply("/W/p9", SetField{"comment", {}, stringValue("since")}));
    show(doc);
    apply("/W/p10", SetField{"comment", {}, stringValue("while it is made")});
    expectView();
    apply("/W/p11", DeleteSpec{});
    expectView();
}

TEST_F(LiveLayerTest, IsBuiltAgainIfMuchWasCommittedSince) {
    LayerDoc doc = bigDoc("W");
    arrive(partsOf(doc));
    live.arrived(doc);
    for (int i = 0; i < 6'000; ++i)
        ASSERT_TRUE(
            doc.apply("/W/p" + std::to_string(i), SetField{"comment", {}, stringValue("x")}));
    show(doc);
    expectView();
}

// Code that reloads a layer may use it after the next tick.
TEST_F(LiveLayerTest, ASmallLayerIsFilledAtOnce) {
    show(bigDoc("W", 500));
    live.fill();
    EXPECT_TRUE(live.isFilled());
    expectView();
}

TEST_F(LiveLayerTest, ASnapshotThatStartsAgainReplacesThePreviousOne) {
    Parts first = partsOf(bigDoc("First"));
    first.pop_back();
    arrive(first);
    const LayerDoc doc = bigDoc("Second");
    join(partsOf(doc), doc);
}

TEST_F(LiveLayerTest, IsFilledAgainWhileASnapshotArrives) {
    const LayerDoc next = bigDoc("Next");
    Parts parts = partsOf(next);
    live.arriving(parts.front());
    parts.erase(parts.begin());
    show(bigDoc("Now", 3));
    expectView();
    join(parts, next);
}

TEST_F(LiveLayerTest, ShowsTheViewIfPartsAreOutOfOrder) {
    const LayerDoc doc = bigDoc("W");
    Parts parts = partsOf(doc);
    std::swap(parts[1], parts[2]);
    join(parts, doc);
}

TEST_F(LiveLayerTest, MayBeDestroyedWhileItIsFilled) { arrive(partsOf(bigDoc("W", 50'000))); }

TEST_F(LiveLayerTest, AFieldThatIsTakenOutComesBackWithoutAnEdit) {
    const pxr::TfToken comment("comment");
    show(bigDoc("W", 1));
    apply("/W/p0", SetField{"comment", {}, stringValue("kept")});
    expectView();
    const pxr::SdfPath path("/W/p0");
    for (const bool isWritten : {false, true}) {
        live.takeOut("/W/p0", "comment");
        EXPECT_FALSE(live.layer()->HasField(path, comment));
        EXPECT_FALSE(live.hasWrites());
        // A notice handler may write meanwhile.
        if (isWritten) live.layer()->SetField(path, comment, pxr::VtValue("written"));
        live.restore();
        EXPECT_EQ(live.layer()->GetFieldAs<std::string>(path, comment),
                  isWritten ? "written" : "kept");
        EXPECT_EQ(live.hasWrites(), isWritten);
    }
}

TEST_F(LiveLayerTest, ALayerThatIsClosedMeanwhileKeepsItsContent) {
    LayerDoc doc = bigDoc("W", 1);
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    {
        LiveLayer closed{LayerId{"b.usda"}, layer,
                         LiveLayer::Dependencies{blobs, blobs, blobs, worker, [&] { return &doc; },
                                                 [](Error) {}, [] {}, [](const auto&) {}}};
        closed.reset(doc);
        closed.fill();
        ASSERT_TRUE(closed.isFilled());
        closed.takeOut("/W/p0", "documentation");
    }
    EXPECT_TRUE(*usd::readLayer(layer, blobs) == doc);
}

// OpenUSD crashes on some edits of layer stacks in one change block.
TEST_F(LiveLayerTest, EditsOfTheLayerStackGetChangeBlocksOfTheirOwn) {
    show(bigDoc("W", 1));
    expectView();
    apply("/", SetField{"expressionVariables", DictionaryKey{{"V"}}, stringValue("one"), {}});
    apply("/", SetField{"expressionVariables", DictionaryKey{{"V"}}, stringValue("two"), {}});
    apply("/", SetField{"subLayers",
                        ListItem{ListName::Explicit, subLayer("./b.usda"), std::nullopt},
                        {},
                        ValueType::SubLayer});
    apply("/W", SetField{"documentation", {}, stringValue("at once")});
    EXPECT_EQ(live.layer()->GetExpressionVariables().size(), 0U);
    EXPECT_EQ(live.layer()->GetNumSubLayerPaths(), 0U);
    std::vector<std::size_t> variables;
    while (live.hasApart()) {
        EXPECT_FALSE(live.isIdle());
        const pxr::SdfChangeBlock block;
        live.applyApart();
        variables.push_back(live.layer()->GetExpressionVariables().size());
    }
    EXPECT_EQ(variables, (std::vector<std::size_t>{1, 2, 1, 1}));
    EXPECT_FALSE(live.hasWrites());
    expectView();
}
