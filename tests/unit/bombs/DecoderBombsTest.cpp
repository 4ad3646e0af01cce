// Tests that few bytes which claim a large content (F4) are refused by a declared limit, and
// measures their cost.
#include <gtest/gtest.h>

#include <limits>

#include "Cost.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/Snapshot.h"
#include "usdlive/common/protocol/frames_generated.h"

namespace usdlive::bombs {
namespace {

constexpr std::size_t kMib = 1024 * 1024;

template <class T>
using Offset = flatbuffers::Offset<T>;

/// Returns the code with which `call` refuses; the call may take `mostBytes` of memory and 50 ms.
template <class Call>
ErrorCode refusal(const Call& call, std::size_t mostBytes) {
    auto code = ErrorCode::Internal;
    const Cost cost = costOf([&] {
        const auto result = call();
        if (!result) code = result.error().code;
    });
    EXPECT_LE(cost.bytes, mostBytes);
    EXPECT_LE(cost.time.count(), 50 * kSlowness);
    return code;
}

// ---- Values

Bytes field(ValueType type, const Bytes& content) {
    Bytes out;
    appendNumber<std::uint16_t>(out, std::uint16_t(type));
    appendNumber<std::uint8_t>(out, 0);
    appendNumber<std::uint64_t>(out, content.size());
    appendBytes(out, content);
    return out;
}

/// A count, followed by only ten bytes.
template <class T>
Bytes counting(T count, Bytes before = {}) {
    appendNumber<T>(before, count);
    before.resize(before.size() + 10);
    return before;
}

TEST(ValueBombs, F4CountsWithoutContentAllocateNothing) {
    const std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
    const std::uint32_t many = std::numeric_limits<std::uint32_t>::max();
    const Bytes stringKeys{std::uint8_t(ValueType::String), 0};
    const Bytes tokenItems{std::uint8_t(ValueType::Token), 0, 1};
    for (const Bytes& bomb :
         {field(arrayOf(ValueType::Float3), counting<std::uint64_t>(1ULL << 31)),
          field(arrayOf(ValueType::Float3), counting(most)),
          field(arrayOf(ValueType::Matrix4d), counting(most / 128 + 1)),  // its size overflows to 0
          field(arrayOf(ValueType::Token), counting(most)),
          field(arrayEditOf(ValueType::Int), counting(most)),
          field(ValueType::String, counting(many)), field(ValueType::TokenVector, counting(many)),
          field(ValueType::Spline, counting(many)), field(ValueType::Dictionary, counting(many)),
          field(ValueType::TimeSamples, counting(most)),
          field(ValueType::ListOp, counting(many, tokenItems)),
          field(ValueType::Map, counting(many, stringKeys))})
        EXPECT_EQ(refusal([&] { return decodeFieldValue(bomb); }, 4096), ErrorCode::InvalidValue);
}

TEST(ValueBombs, F4DictionariesNestedATenThousandDeepAreRefused) {
    Bytes bomb = field(ValueType::Dictionary, {0, 0, 0, 0});
    for (int level = 0; level < 10'000; ++level) {
        Bytes outer{1, 0, 0, 0, 0, 0, 0, 0};  // one entry, without a name
        appendBytes(outer, bomb);
        bomb = field(ValueType::Dictionary, outer);
    }
    EXPECT_EQ(refusal([&] { return decodeFieldValue(bomb); }, 4096), ErrorCode::InvalidValue);
}

TEST(ValueBombs, F4AMillionItemsHaveAProportionalCost) {
    ListOp list;
    list.itemType = ValueType::Int;
    list[ListName::Appended] =
        std::vector<Value>(1'000'000, Value(ValueType::Int, Bytes{1, 2, 3, 4}));
    const Bytes bytes = encodeFieldValue(list);
    const Cost cost = costOf([&] { EXPECT_TRUE(decodeFieldValue(bytes)); });
    EXPECT_LE(cost.bytes, 8 * bytes.size());
}

// ---- Texts

TEST(TextBombs, F4DeepAndLongPathsAreRefused) {
    std::string deep;
    for (int level = 0; level < 100'000; ++level) deep += "/a";
    const auto parse = [](const std::string& path) {
        return refusal([&] { return specpath::parse(path); }, 64 * 1024);
    };
    EXPECT_EQ(parse(deep), ErrorCode::InvalidPath);
    EXPECT_EQ(parse(deep.substr(0, 4'000)), ErrorCode::InvalidPath);
    EXPECT_EQ(parse("/" + std::string(64 * kMib, 'a')), ErrorCode::InvalidPath);
}

TEST(TextBombs, F4DeepAndLongJsonIsRefused) {
    const auto decode = [](const std::string& json) {
        return refusal([&] { return decodeControl(json); }, 64 * 1024);
    };
    EXPECT_EQ(decode(std::string(100'000, '[')), ErrorCode::MalformedControl);
    std::string objects;
    for (int level = 0; level < 100'000; ++level) objects += R"({"a":)";
    EXPECT_EQ(decode(objects), ErrorCode::MalformedControl);
    EXPECT_EQ(decode("\"" + std::string(64 * kMib, 'a') + "\""), ErrorCode::MalformedControl);
}

// ---- Compressed chunks

TEST(CompressedBombs, F4ChunksThatInflateToMoreAreRefused) {
    const Bytes bomb = deflate(Bytes(100 * kMib, 0));
    EXPECT_LT(bomb.size(), 16 * 1024u);
    for (const std::uint32_t claimed : {0U, 1000U, std::uint32_t(kChunkBytes), 100U << 20}) {
        EXPECT_EQ(refusal([&] { return inflate(bomb, claimed, kChunkBytes); }, 4096),
                  ErrorCode::MalformedFrame);
        const auto snapshot = [&] {
            return SnapshotDecoder().add(SnapshotFrame{1, 0, true, claimed, bomb});
        };
        EXPECT_EQ(refusal(snapshot, 64 * 1024), ErrorCode::MalformedFrame);
    }
    // The size in the header of this chunk is false.
    Bytes lie = deflate(Bytes(kChunkBytes, 0));
    lie.resize(lie.size() / 2);
    EXPECT_EQ(refusal([&] { return inflate(lie, kChunkBytes, kChunkBytes); }, 2 * kChunkBytes),
              ErrorCode::MalformedFrame);
}

// ---- Frames that refer to the same element very often (FR7)

class FrameBomb {
public:
    Offset<wire::Edit> deletion(const std::string& at) {
        const auto path = builder.CreateString(at);
        return wire::CreateEdit(builder, 0, path, 0, 0, wire::Action::DeleteSpec,
                                wire::CreateDeleteSpec(builder).Union());
    }
    Offset<wire::Edit> set(const FieldValue& value) {
        const auto path = builder.CreateString("/A"), name = builder.CreateString("f");
        const auto content = builder.CreateVector(encodeFieldValue(value));
        const auto set = wire::CreateSetField(builder, name, wire::Part::NONE, 0, content);
        return wire::CreateEdit(builder, 0, path, 0, 0, wire::Action::SetField, set.Union());
    }
    Offset<wire::Edit> eraseKey(std::size_t parts) {
        const std::vector names(parts, builder.CreateString("k"));
        const auto key = wire::CreateDictionaryKey(builder, builder.CreateVector(names));
        const auto path = builder.CreateString("/A"), name = builder.CreateString("f");
        const auto erase =
            wire::CreateEraseField(builder, name, wire::Part::DictionaryKey, key.Union());
        return wire::CreateEdit(builder, 0, path, 0, 0, wire::Action::EraseField, erase.Union());
    }
    /// Returns a frame of about `size` bytes that contains the edit as often as possible.
    Bytes submit(Offset<wire::Edit> edit, std::size_t size, std::size_t layers = 1) {
        const auto edits = builder.CreateVector(std::vector(size / 40, edit));
        const auto names =
            builder.CreateVector(std::vector(layers, builder.CreateString("a.usda")));
        const auto client = builder.CreateString("client");
        if (size > builder.GetSize()) builder.CreateVector(Bytes(size - builder.GetSize()));
        const auto submit = wire::CreateSubmit(builder, client, 1, 0, 0, names, edits);
        wire::FinishFrameBuffer(builder,
                                wire::CreateFrame(builder, wire::Body::Submit, submit.Union()));
        return {builder.GetBufferPointer(), builder.GetBufferPointer() + builder.GetSize()};
    }

    flatbuffers::FlatBufferBuilder builder;
};

void expectBounded(const Bytes& bomb) {
    const std::size_t limit = 8 * bomb.size() + 16 * kMib;
    auto code = ErrorCode::Internal;
    const Cost cost = costOf([&] {
        if (const auto frame = decodeFrame(bomb); !frame) code = frame.error().code;
    });
    EXPECT_EQ(code, ErrorCode::MalformedFrame);
    EXPECT_LE(cost.bytes, limit + limit / 2);
    // Includes the part that is built before the limit is reached.
    EXPECT_LE(cost.time.count(), 500 * kSlowness);
}

constexpr std::size_t kBombBytes = 8 * kMib;

TEST(FrameBombs, FR7TheSameEditOverAndOver) {
    FrameBomb bomb;
    expectBounded(bomb.submit(bomb.deletion(std::string(600, 'p')), kBombBytes));
}

TEST(FrameBombs, FR7TheSameCompositeValueOverAndOver) {
    Dictionary dictionary;
    for (int number = 0; number < 3000; ++number)
        dictionary.entries[std::to_string(number)] = Value(ValueType::Block, Bytes());
    FrameBomb inDictionary;
    expectBounded(inDictionary.submit(inDictionary.set(dictionary), kBombBytes));

    TimeSamples samples;
    for (int number = 0; number < 3000; ++number)
        samples.samples.emplace(number, Value(ValueType::Block, Bytes()));
    FrameBomb inSamples;
    expectBounded(inSamples.submit(inSamples.set(samples), kBombBytes));
}

TEST(FrameBombs, FR7TheSameLayerOverAndOver) {
    FrameBomb bomb;
    expectBounded(bomb.submit(bomb.deletion("/A"), kBombBytes, kBombBytes / 5));
}

// The verifier visited each part of each edit's key: a frame of 1 MiB took 12 s.
TEST(FrameBombs, FR7TheSameKeyOverAndOverIsRefusedBeforeItIsVerified) {
    FrameBomb submitted;
    const Bytes bomb = submitted.submit(submitted.eraseKey(kBombBytes / 10), kBombBytes);
    EXPECT_EQ(refusal([&] { return decodeFrame(bomb); }, 4096), ErrorCode::MalformedFrame);

    FrameBomb dropped;
    auto& builder = dropped.builder;
    const auto edit = dropped.eraseKey(200'000);
    const auto reason = builder.CreateString("x");
    const auto all =
        builder.CreateVector(std::vector(200'000, wire::CreateDropped(builder, 0, reason, edit)));
    const auto hash = builder.CreateVector(Bytes(32));
    const auto commit =
        wire::CreateCommit(builder, 1, 1, reason, 1, reason, 0, 0, 0, 0, 0, all, hash);
    wire::FinishFrameBuffer(builder,
                            wire::CreateFrame(builder, wire::Body::Commit, commit.Union()));
    const ByteView frame(builder.GetBufferPointer(), builder.GetSize());
    EXPECT_EQ(refusal([&] { return decodeFrame(frame); }, 4096), ErrorCode::MalformedFrame);
    EXPECT_EQ(refusal([&] { return importStub(frame, {}); }, 4096), ErrorCode::MalformedFrame);
}

TEST(FrameBombs, FR1AMessageOfFramesTooSmallIsRefusedAtTheFirst) {
    const Bytes message(64 * kMib, 1);  // each part claims 0x01010101 bytes
    EXPECT_EQ(refusal([&] { return splitMessage(message); }, 4096), ErrorCode::MalformedFrame);
    Bytes small;
    for (std::size_t frame = 0; frame < 1'000'000; ++frame)
        small.insert(small.end(), {1, 0, 0, 0, 7});
    EXPECT_EQ(refusal([&] { return splitMessage(small); }, 4096), ErrorCode::MalformedFrame);
}

}  // namespace
}  // namespace usdlive::bombs
