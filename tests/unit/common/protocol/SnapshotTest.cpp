// Tests the encoding of snapshots (SN1, SN4).
#include "usdlive/common/protocol/Snapshot.h"

#include <gtest/gtest.h>

#include <random>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {
namespace {

void apply(LayerDoc& doc, const std::string& path, EditAction action) {
    const auto applied = doc.apply(path, action);
    ASSERT_TRUE(applied) << path << ": " << applied.error().message;
}

LayerDoc sample() {
    LayerDoc doc;
    apply(doc, "/", SetField{"defaultPrim", {}, tokenValue("A"), {}});
    apply(doc, "/A", CreateSpec{SpecKind::Prim});
    apply(doc, "/B", CreateSpec{SpecKind::Prim});
    apply(doc, "/A.x", CreateSpec{SpecKind::Attribute});
    apply(doc, "/A.x", SetField{"default", {}, doubleValue(3), {}});
    apply(doc, "/A{v=}", CreateSpec{SpecKind::VariantSet});
    apply(doc, "/A{v=one}", CreateSpec{SpecKind::Variant});
    apply(doc, "/A{v=one}C", CreateSpec{SpecKind::Prim});
    apply(doc, "/A", MoveSpec{{"/B", {}}, "Moved"});  // a parent with a higher id than its child
    apply(doc, "/D", CreateSpec{SpecKind::Prim});
    apply(doc, "/D", PlaceSpec{"B"});
    return doc;
}

std::vector<SnapshotFrame> framesOf(const LayerDoc& doc) {
    SnapshotEncoder encoder(doc, 5);
    std::vector<SnapshotFrame> frames;
    while (auto frame = encoder.next()) frames.push_back(std::move(*frame));
    return frames;
}

void expectSame(const LayerDoc& doc, const std::vector<SnapshotFrame>& frames) {
    SnapshotDecoder decoder;
    for (std::size_t index = 0; index < frames.size(); ++index) {
        EXPECT_EQ(frames[index].request, 5u);
        EXPECT_EQ(frames[index].index, index);
        EXPECT_LE(frames[index].rawBytes, kChunkBytes);
        const auto last = decoder.add(frames[index]);
        ASSERT_TRUE(last) << last.error().message;
        EXPECT_EQ(*last, index + 1 == frames.size());
    }
    EXPECT_EQ(decoder.specs(), doc.specCount());
    LayerDoc copy = decoder.take();
    EXPECT_EQ(copy, doc);
    // The snapshot contains orders and ids, so that both docs behave the same afterwards.
    EXPECT_EQ(copy.idsAlong("/B/Moved.x"), doc.idsAlong("/B/Moved.x"));
}

TEST(Snapshot, SN1HoldsTheWholeLayer) {
    const auto frames = framesOf(sample());
    EXPECT_EQ(frames.size(), 1u);
    expectSame(sample(), frames);
}

TEST(Snapshot, SN1AnEmptyLayerIsOneChunk) {
    const auto frames = framesOf({});
    EXPECT_EQ(frames.size(), 1u);
    expectSame({}, frames);
}

TEST(Snapshot, SN1IsCutIntoChunks) {
    LayerDoc doc;
    for (int number = 0; number < 20'000; ++number) {
        const std::string path = "/Prim" + std::to_string(number);
        apply(doc, path, CreateSpec{SpecKind::Prim});
        apply(doc, path, SetField{"comment", {}, stringValue(std::string(60, 'c')), {}});
    }
    const auto frames = framesOf(doc);
    EXPECT_GT(frames.size(), 10u);
    expectSame(doc, frames);
}

TEST(Snapshot, SN1AFieldLongerThanAChunkIsDivided) {
    TimeSamples samples;
    for (int number = 0; number < 300'000; ++number)
        samples.samples.emplace(double(number), doubleValue(number * 0.5));
    LayerDoc doc = sample();
    apply(doc, "/B/Moved.x", SetField{"timeSamples", {}, samples, {}});
    apply(doc, "/B/Moved.x", SetField{"zLast", {}, doubleValue(1), {}});
    expectSame(doc, framesOf(doc));
}

// ---- snapshots that usdlive never writes

class Records {
public:
    Records& spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                  std::string_view name) {
        raw.push_back(1);
        appendNumber<std::uint64_t>(raw, node);
        appendNumber<std::uint64_t>(raw, parent);
        appendNumber<std::uint64_t>(raw, order);
        raw.push_back(std::uint8_t(kind));
        appendText(raw, name);
        return *this;
    }
    Records& root() { return spec(kRootNode, 0, 0, SpecKind::PseudoRoot, ""); }
    Records& field(std::string_view name, const Bytes& value) {
        raw.push_back(2);
        appendText(raw, name);
        appendNumber<std::uint32_t>(raw, std::uint32_t(value.size()));
        appendBytes(raw, value);
        return *this;
    }
    Records& part(std::string_view name, std::uint64_t size, const Bytes& value) {
        raw.push_back(3);
        appendText(raw, name);
        appendNumber<std::uint64_t>(raw, size);
        appendNumber<std::uint32_t>(raw, std::uint32_t(value.size()));
        appendBytes(raw, value);
        return *this;
    }
    [[nodiscard]] Result<bool> decode() const {
        SnapshotDecoder decoder;
        return decoder.add({5, 0, true, std::uint32_t(raw.size()), deflate(raw)});
    }
    Bytes raw;
};

const Bytes kValue = encodeFieldValue(doubleValue(1));

TEST(SnapshotDecoder, AcceptsValidSnapshots) {
    const Bytes first(kValue.begin(), kValue.begin() + 5), rest(kValue.begin() + 5, kValue.end());
    EXPECT_TRUE(Records()
                    .root()
                    .field("a", kValue)
                    .spec(2, 1, 10, SpecKind::Prim, "A")
                    .part("b", kValue.size(), first)
                    .part("b", kValue.size(), rest)
                    .decode());
}

TEST(SnapshotDecoder, RefusesInconsistentRecords) {
    const Bytes first(kValue.begin(), kValue.begin() + 5);
    const std::uint64_t size = kValue.size();
    std::vector<Records> wrong{
        Records(),
        Records().spec(2, 1, 10, SpecKind::Prim, "A"),
        Records().field("a", kValue),
        Records().root().root(),
        Records().root().spec(2, 7, 10, SpecKind::Prim, "A"),
        Records().root().spec(2, 1, 10, SpecKind::Prim, "not a name"),
        Records().root().spec(2, 1, 10, SpecKind::Variant, "A"),
        Records().root().spec(2, 1, 10, SpecKind(99), "A"),
        Records().root().spec(1, 1, 10, SpecKind::Prim, "A"),
        Records().root().spec(2, 1, 10, SpecKind::Prim, "A").spec(2, 1, 11, SpecKind::Prim, "B"),
        Records().root().spec(2, 1, 10, SpecKind::Prim, "A").spec(3, 1, 11, SpecKind::Prim, "A"),
        Records().root().field("", kValue),
        Records().root().field("\xff", kValue),
        Records().root().field("a", kValue).field("a", kValue),
        Records().root().field("a", first),
        Records().root().part("a", size, first),
        Records().root().part("a", size, first).field("b", kValue),
        Records().root().part("a", size, first).part("b", size, first),
        Records().root().part("a", size, first).part("a", size + 1, first),
        Records().root().part("a", 3, first),
        Records().root().part("a", size, {}),
        Records().root().part("a", 1ull << 40, first),
    };
    wrong.emplace_back().raw = {9};
    wrong.push_back(Records().root());
    wrong.back().raw.pop_back();
    for (std::size_t index = 0; index < wrong.size(); ++index) {
        const auto decoded = wrong[index].decode();
        ASSERT_FALSE(decoded) << index;
        EXPECT_TRUE(decoded.error().code == ErrorCode::MalformedFrame ||
                    decoded.error().code == ErrorCode::InvalidValue);
    }
}

TEST(SnapshotDecoder, RefusesChunksOutOfOrderAndBombs) {
    const auto frames = framesOf(sample());
    SnapshotDecoder skipped;
    SnapshotFrame second = frames[0];
    second.index = 1;
    EXPECT_FALSE(skipped.add(second));
    EXPECT_FALSE(skipped.add(frames[0]));  // it stays failed

    SnapshotDecoder after;
    EXPECT_EQ(after.add(frames[0]), true);
    EXPECT_FALSE(after.add(second));

    SnapshotDecoder bomb;
    const Bytes zeroes(50'000'000);
    EXPECT_FALSE(bomb.add({5, 0, false, 50'000'000, deflate(zeroes)}));
    SnapshotFrame liar = frames[0];
    liar.rawBytes += 1;
    SnapshotDecoder lied;
    EXPECT_FALSE(lied.add(liar));
}

TEST(SnapshotDecoder, ChangedRecordsDoNoHarm) {
    const auto frames = framesOf(sample());
    const Bytes raw = inflate(frames[0].data, frames[0].rawBytes, kChunkBytes).value();
    std::mt19937_64 random(7);
    for (int round = 0; round < 20'000; ++round) {
        Records changed;
        changed.raw = raw;
        for (std::uint64_t change = random() % 3 + 1; change > 0; --change)
            changed.raw[random() % raw.size()] = std::uint8_t(random());
        (void)changed.decode();
    }
}

}  // namespace
}  // namespace usdlive
