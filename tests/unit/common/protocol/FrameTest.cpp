// Tests the encoding of frames, and the refusal of malformed ones.
#include "usdlive/common/protocol/Frame.h"

#include <gtest/gtest.h>

#include <random>

#include "SampleFrames.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/frames_generated.h"

namespace usdlive {
namespace {

ByteView withoutLength(const Bytes& frame) { return ByteView(frame).subspan(4); }

void expectRoundTrip(const Frame& frame) {
    const Bytes bytes = encodeFrame(frame);
    ByteReader reader(bytes);
    EXPECT_EQ(reader.u32(), bytes.size() - 4);
    const auto decoded = decodeFrame(withoutLength(bytes));
    ASSERT_TRUE(decoded) << decoded.error().message;
    EXPECT_EQ(*decoded, frame);
}

ErrorCode refusal(const Bytes& frame) {
    const auto decoded = decodeFrame(withoutLength(frame));
    return decoded ? ErrorCode::Internal : decoded.error().code;
}

TEST(Frame, M18ALabelIsShortAndOnOneLine) {
    for (const std::string& label : {std::string(1'001, 'x'), std::string("a\nb"),
                                     std::string("a\0b", 3), std::string("\x7f")}) {
        SubmitFrame submit{{{{"client"}, 4}, 17, 5, everyKindOfEdit()}};
        submit.transaction.label = label;
        EXPECT_EQ(refusal(encodeFrame(submit)), ErrorCode::MalformedFrame);
        EXPECT_NE(labelOf(label), label);
        EXPECT_EQ(labelOf(labelOf(label)), labelOf(label));
    }
    EXPECT_EQ(labelOf("a\nb"), "a b");
    EXPECT_EQ(labelOf("a\xff"
                      "b"),
              "ab");
    EXPECT_EQ(labelOf(std::string(999, 'x') + "é"), std::string(999, 'x'));
}

TEST(Frame, EveryKindComesBackAsItWas) {
    expectRoundTrip(ControlFrame{R"({"type":"hello"})"});
    expectRoundTrip(SubmitFrame{{{{"client"}, 4}, 17, 5, everyKindOfEdit()}});
    expectRoundTrip(SubmitFrame{{{{"client"}, 1}, 0, 0, {}}});
    expectRoundTrip(CommitFrame{sampleCommit()});
    for (const std::string& label : {std::string("Möve chairs"), std::string(1'000, 'x')}) {  // M18
        SubmitFrame submit{{{{"client"}, 4}, 17, 5, everyKindOfEdit()}};
        CommitFrame commit{sampleCommit()};
        submit.transaction.label = commit.commit.label = label;
        expectRoundTrip(submit);
        expectRoundTrip(commit);
    }
    expectRoundTrip(RefusalFrame{4, 2, {ErrorCode::MoveIntoItself, "/A cannot go below /A/B"}});
    expectRoundTrip(PreviewFrame{{"someone"}, 3, 17, everyKindOfEdit()});
    expectRoundTrip(PreviewFrame{{}, 3, 17, {}});
    expectRoundTrip(SnapshotFrame{5, 2, true, 100, {1, 2, 3}});
    expectRoundTrip(BlobFrame{sha256(asBytes("x")), 10'000'000'000, 256, 100, {1, 2, 3}});
}

TEST(Frame, StubsOfImportsNameTheHash) {
    CommitFrame frame{sampleCommit()};
    frame.commit.edits.clear();
    frame.commit.dropped.clear();
    frame.commit.imported = LayerId{"shot/a.usda"};
    frame.hashAfter = sha256(asBytes("after"));
    expectRoundTrip(frame);
    EXPECT_EQ(hashAfter(frame, {}, {}), *frame.hashAfter);

    CommitFrame noImport{sampleCommit()};
    noImport.hashAfter = frame.hashAfter;
    EXPECT_EQ(refusal(encodeFrame(noImport)), ErrorCode::MalformedFrame);
}

TEST(Frame, CH2ImportStubDropsTheEditsOfAnImportOnly) {
    CommitFrame import{sampleCommit()};
    const Bytes plain = encodeFrame(import);
    EXPECT_FALSE(importStub(withoutLength(plain), {}).value());

    import.commit.imported = LayerId{"shot/a.usda"};
    import.commit.dropped.clear();
    const Hash hash = sha256(asBytes("after"));
    const auto stub = importStub(withoutLength(encodeFrame(import)), hash).value();
    ASSERT_TRUE(stub);
    import.commit.edits.clear();
    import.commit.gesture = 0;
    import.hashAfter = hash;
    EXPECT_EQ(std::get<CommitFrame>(decodeFrame(withoutLength(*stub)).value()), import);
    EXPECT_FALSE(importStub(asBytes("nonsense nonsense"), {}));
}

TEST(Frame, AnImportMakesTheWholeLayer) {
    LayerDoc doc;
    std::string path = "/" + std::string(150, 'L');  // too long to be shared (FR7)
    for (const std::string& prim : {std::string("/A"), path}) {
        ASSERT_TRUE(doc.apply(prim, CreateSpec{SpecKind::Prim}));
        for (int number = 0; number < 20; ++number) {
            const std::string attribute = prim + ".a" + std::to_string(number);
            ASSERT_TRUE(doc.apply(attribute, CreateSpec{SpecKind::Attribute}));
            ASSERT_TRUE(doc.apply(attribute, SetField{"default", {}, doubleValue(number)}));
            ASSERT_TRUE(
                doc.apply(attribute, SetField{"timeSamples", SampleTime{1}, doubleValue(number)}));
        }
    }
    ASSERT_TRUE(doc.apply("/", SetField{"comment", {}, stringValue("whole")}));
    const LayerId layer{"shot/a.usda"};
    auto import = encodeImport(layer, doc, 1 << 20);
    ASSERT_TRUE(import);
    CommitFrame frame{sampleCommit()};
    frame.commit.timeMs = 1'700'000'000'000;
    stampCommit(import->bytes, frame.commit);
    const auto decoded = decodeFrame(withoutLength(import->bytes));
    ASSERT_TRUE(decoded) << decoded.error().message;
    const Commit& commit = std::get<CommitFrame>(*decoded).commit;
    EXPECT_EQ(commit.imported, layer);
    EXPECT_EQ(commit.revision, frame.commit.revision);
    EXPECT_EQ(commit.epoch, frame.commit.epoch);
    EXPECT_EQ(commit.timeMs, frame.commit.timeMs);
    EXPECT_EQ(commit.previous, frame.commit.previous);
    EXPECT_EQ(commit.edits.size(), import->edits);
    LayerDoc made;
    for (const Edit& edit : commit.edits)
        ASSERT_TRUE(made.apply(edit.address.path, edit.action)) << edit.address.path;
    EXPECT_EQ(made, doc);

    EXPECT_FALSE(encodeImport(layer, doc, 1000));
    Bytes unprepared = encodeFrame(CommitFrame{Commit()});
    EXPECT_THROW(stampCommit(unprepared, frame.commit), std::logic_error);
}

TEST(Frame, CH1TheChainHashCoversTheFrameAndTheHashBefore) {
    const Bytes bytes = encodeFrame(CommitFrame{sampleCommit()});
    const Hash hash = chainHash({}, withoutLength(bytes));
    EXPECT_EQ(hashAfter(CommitFrame{sampleCommit()}, {}, withoutLength(bytes)), hash);
    EXPECT_NE(chainHash(hash, withoutLength(bytes)), hash);
}

TEST(Frame, M17ACommitSaysWhatItsAuthorHadNotSeen) {
    CommitFrame frame{sampleCommit()};
    frame.commit.firstUnseen = frame.commit.revision - 1;
    EXPECT_EQ(decodeFrame(withoutLength(encodeFrame(frame))), Frame(frame));
    frame.commit.firstUnseen = frame.commit.revision;
    EXPECT_FALSE(decodeFrame(withoutLength(encodeFrame(frame))));
}

TEST(Frame, AsManyEditsAsAFrameHoldsPass) {
    SubmitFrame frame{{{{"client"}, 1}, 0, 0, {}}};
    for (int number = 0; number < 700'000; ++number)
        frame.transaction.edits.push_back(
            {{"a.usda"}, {"/P" + std::to_string(number), {}}, CreateSpec{SpecKind::Prim}});
    const Bytes bytes = encodeFrame(frame);
    EXPECT_LT(bytes.size(), kMaxFrameBytes);
    EXPECT_TRUE(decodeFrame(withoutLength(bytes)));
}

TEST(Frame, ManySamplesOfOneAttributePass) {
    SubmitFrame frame{{{{"client"}, 1}, 0, 0, {}}};
    for (int number = 0; number < 100'000; ++number)
        frame.transaction.edits.push_back(
            edit("/World/Characters/Someone/Rig/Body.xformOp:translate",
                 SetField{"timeSamples", SampleTime{double(number)}, doubleValue(1), {}}));
    EXPECT_TRUE(decodeFrame(withoutLength(encodeFrame(frame))));
}

TEST(Frame, AMessageIsSplitIntoItsFrames) {
    Bytes message = encodeFrame(ControlFrame{"{}"});
    const std::size_t first = message.size();
    const Bytes second = encodeFrame(RefusalFrame{1, 0, {ErrorCode::Locked, "x"}});
    message.insert(message.end(), second.begin(), second.end());
    const auto frames = splitMessage(message);
    ASSERT_TRUE(frames);
    ASSERT_EQ(frames->size(), 2u);
    EXPECT_EQ((*frames)[0].size(), first - 4);
    // The decoder accepts a frame at any address in memory.
    EXPECT_TRUE(decodeFrame((*frames)[1]));
}

TEST(Frame, AFrameMayBeAtAnyAddress) {
    const Bytes frame = encodeFrame(CommitFrame{sampleCommit()});
    for (std::size_t before = 0; before < 8; ++before) {
        Bytes memory(before);
        appendBytes(memory, withoutLength(frame));
        EXPECT_TRUE(decodeFrame(ByteView(memory).subspan(before)));
    }
}

TEST(Frame, MalformedMessagesAreRefused) {
    const auto code = [](const Bytes& message, std::size_t limit = 100) {
        return splitMessage(message, limit).error().code;
    };
    EXPECT_EQ(code({}), ErrorCode::MalformedFrame);
    EXPECT_EQ(code({1, 0}), ErrorCode::MalformedFrame);
    EXPECT_EQ(code({0, 0, 0, 0}), ErrorCode::MalformedFrame);
    EXPECT_EQ(code({5, 0, 0, 0, 1}), ErrorCode::MalformedFrame);
    EXPECT_EQ(code({101, 0, 0, 0, 1}), ErrorCode::FrameTooLarge);
    EXPECT_EQ(code({255, 255, 255, 255, 1}), ErrorCode::FrameTooLarge);
}

// ---- frames that usdlive never writes

/// Builds a frame with one edit from parts that the test gives.
class ByHand {
public:
    flatbuffers::FlatBufferBuilder builder;

    Bytes submit(std::vector<flatbuffers::Offset<wire::Edit>> edits, const char* layer = "a.usda",
                 std::uint64_t sequence = 1) {
        const auto list = builder.CreateVector(edits);
        const std::vector layers{builder.CreateString(layer)};
        const auto names = builder.CreateVector(layers);
        const auto client = builder.CreateString("client");
        return finish(wire::CreateSubmit(builder, client, sequence, 0, 0, names, list));
    }
    template <class T>
    Bytes finish(flatbuffers::Offset<T> body, wire::Body type = wire::BodyTraits<T>::enum_value) {
        wire::FinishFrameBuffer(builder, wire::CreateFrame(builder, type, body.Union()));
        Bytes bytes(4);
        bytes.insert(bytes.end(), builder.GetBufferPointer(),
                     builder.GetBufferPointer() + builder.GetSize());
        return bytes;
    }
    flatbuffers::Offset<wire::Edit> deletion(std::uint32_t layer = 0) {
        const auto path = builder.CreateString("/A");
        return wire::CreateEdit(builder, layer, path, 0, 0, wire::Action::DeleteSpec,
                                wire::CreateDeleteSpec(builder).Union());
    }
    flatbuffers::Offset<wire::Edit> create(std::uint8_t kind) {
        const auto path = builder.CreateString("/A");
        return wire::CreateEdit(builder, 0, path, 0, 0, wire::Action::CreateSpec,
                                wire::CreateCreateSpec(builder, kind).Union());
    }
    flatbuffers::Offset<wire::Edit> set(const Bytes& value, const std::string& field = "default",
                                        wire::Part type = wire::Part::NONE,
                                        flatbuffers::Offset<void> part = 0,
                                        std::uint16_t form = 0) {
        const auto path = builder.CreateString("/A");
        const auto name = builder.CreateString(field);
        const auto bytes = builder.CreateVector(value);
        return wire::CreateEdit(
            builder, 0, path, 0, 0, wire::Action::SetField,
            wire::CreateSetField(builder, name, type, part, bytes, form).Union());
    }
};

TEST(FrameDecoder, AcceptsValidFrames) {
    ByHand hand;
    EXPECT_EQ(refusal(hand.submit({hand.deletion()})), ErrorCode::Internal);
    ByHand value;
    EXPECT_EQ(refusal(value.submit({value.set(encodeFieldValue(doubleValue(1)))})),
              ErrorCode::Internal);
}

TEST(FrameDecoder, ChecksEveryNumberOfAKind) {
    ByHand kind;
    EXPECT_EQ(refusal(kind.submit({kind.create(9)})), ErrorCode::MalformedFrame);
    ByHand layer;
    EXPECT_EQ(refusal(layer.submit({layer.deletion(1)})), ErrorCode::MalformedFrame);
    ByHand sequence;
    EXPECT_EQ(refusal(sequence.submit({sequence.deletion()}, "a.usda", 0)),
              ErrorCode::MalformedFrame);
    ByHand action;
    {
        const auto path = action.builder.CreateString("/A");
        const auto empty = wire::CreateDeleteSpec(action.builder).Union();
        const auto edit = wire::CreateEdit(action.builder, 0, path, 0, 0, wire::Action(99), empty);
        EXPECT_EQ(refusal(action.submit({edit})), ErrorCode::MalformedFrame);
    }
    ByHand body;
    EXPECT_EQ(refusal(body.finish(wire::CreateDeleteSpec(body.builder), wire::Body(99))),
              ErrorCode::UnknownFrame);
    ByHand none;
    EXPECT_EQ(refusal(none.finish(wire::CreateDeleteSpec(none.builder), wire::Body::NONE)),
              ErrorCode::UnknownFrame);
    ByHand part;
    const auto empty = wire::CreateDeleteSpec(part.builder).Union();
    EXPECT_EQ(refusal(part.submit(
                  {part.set(encodeFieldValue(doubleValue(1)), "f", wire::Part(9), empty)})),
              ErrorCode::MalformedFrame);
    ByHand missing;
    EXPECT_EQ(refusal(missing.submit(
                  {missing.set(encodeFieldValue(doubleValue(1)), "f", wire::Part::SampleTime)})),
              ErrorCode::MalformedFrame);
    ByHand list;
    const auto item = list.builder.CreateVector(encodeFieldValue(tokenValue("a")));
    const auto sixth = wire::CreateListItem(list.builder, 6, item).Union();
    const auto path = list.builder.CreateString("/A");
    const auto field = list.builder.CreateString("apiSchemas");
    const auto erase =
        wire::CreateEraseField(list.builder, field, wire::Part::ListItem, sixth).Union();
    EXPECT_EQ(refusal(list.submit({wire::CreateEdit(list.builder, 0, path, 0, 0,
                                                    wire::Action::EraseField, erase)})),
              ErrorCode::MalformedFrame);
}

TEST(FrameDecoder, ChecksNamesOfLayers) {
    for (const char* name :
         {"../a.usda", "/a.usda", "a/../b.usda", "", "a.txt", ".usdlive/a.usda"}) {
        ByHand hand;
        EXPECT_EQ(refusal(hand.submit({hand.deletion()}, name)), ErrorCode::InvalidLayerName)
            << name;
    }
}

TEST(FrameDecoder, ChecksValues) {
    const auto code = [](const Bytes& value, const std::string& field = "default") {
        ByHand hand;
        return refusal(hand.submit({hand.set(value, field)}));
    };
    EXPECT_EQ(code({}), ErrorCode::InvalidValue);
    Bytes value = encodeFieldValue(doubleValue(1));
    value.pop_back();
    EXPECT_EQ(code(value), ErrorCode::InvalidValue);
    EXPECT_EQ(code(encodeFieldValue(doubleValue(1)), ""), ErrorCode::MalformedFrame);
    EXPECT_EQ(code(encodeFieldValue(doubleValue(1)), std::string(2000, 'f')),
              ErrorCode::MalformedFrame);
    EXPECT_EQ(code(encodeFieldValue(doubleValue(1)), "\xff"), ErrorCode::MalformedFrame);

    ByHand time;
    const auto never =
        wire::CreateSampleTime(time.builder, std::numeric_limits<double>::infinity()).Union();
    EXPECT_EQ(refusal(time.submit({time.set(encodeFieldValue(doubleValue(1)), "timeSamples",
                                            wire::Part::SampleTime, never)})),
              ErrorCode::InvalidValue);
    ByHand form;
    EXPECT_EQ(refusal(form.submit(
                  {form.set(encodeFieldValue(doubleValue(1)), "f", wire::Part::NONE, 0, 13)})),
              ErrorCode::MalformedFrame);
}

TEST(FrameEncoder, FR7RepeatedContentOfAnAuthorCanBeRead) {
    const std::vector<EditAction> actions = {
        DeleteSpec{},
        CreateSpec{SpecKind::Prim},
        MoveSpec{},
        PlaceSpec{},
        EraseField{"kind", {}},
        SetField{"active", {}, Value(ValueType::Bool, Bytes{1}), {}}};
    for (const EditAction& action : actions) {
        const std::vector<Edit> edits(1000, Edit{{"a.usda"}, {"/A", {}}, action});
        const Bytes frame = encodeFrame(SubmitFrame{{{{"client"}, 4}, 17, 0, edits}});
        EXPECT_TRUE(decodeFrame(withoutLength(frame))) << action.index();
    }
}

TEST(FrameDecoder, FR7RepeatedElementsAreRefusedBeforeTheyAreCopied) {
    ByHand hand;
    const auto value = hand.set(encodeFieldValue(stringValue(std::string(200'000, 's'))));
    const std::vector edits(5'000, value);  // 1 GB of values in a frame of 220 KB
    EXPECT_EQ(refusal(hand.submit(edits)), ErrorCode::MalformedFrame);

    ByHand many;
    const std::vector deletions(1'000'000, many.deletion());
    EXPECT_EQ(refusal(many.submit(deletions)), ErrorCode::MalformedFrame);
}

TEST(FrameDecoder, ChangedAndShortenedFramesDoNoHarm) {
    std::mt19937_64 random(4);
    std::vector<Bytes> frames;
    for (const Frame& frame : sampleFrames()) {
        const Bytes bytes = encodeFrame(frame);
        frames.emplace_back(bytes.begin() + 4, bytes.end());
    }
    for (int round = 0; round < 20'000; ++round) {
        Bytes frame = frames[random() % frames.size()];
        for (std::uint64_t change = random() % 4 + 1; change > 0; --change) {
            const std::size_t at = random() % frame.size();
            if (random() % 8 == 0)
                frame.resize(std::max<std::size_t>(at, 1));
            else
                frame[at] = random() % 2 ? std::uint8_t(random()) : std::uint8_t(frame[at] ^ 0x80);
        }
        const auto decoded = decodeFrame(frame);
        // A decoded frame is valid: it can be encoded again.
        if (decoded) (void)encodeFrame(*decoded);
    }
}

// ---- zstd

TEST(Compression, InflatesWhatItDeflated) {
    const Bytes raw(100'000, 7);
    const Bytes data = deflate(raw);
    EXPECT_LT(data.size(), 1'000u);
    EXPECT_EQ(inflate(data, raw.size(), raw.size()), raw);
    EXPECT_EQ(inflate(deflate({}), 0, 0), Bytes());
}

TEST(Compression, RefusesOtherSizesBeforeAllocating) {
    const Bytes bomb = deflate(Bytes(100'000'000, 0));
    EXPECT_FALSE(inflate(bomb, 100'000'000, kChunkBytes));
    EXPECT_FALSE(inflate(bomb, 1'000, kChunkBytes));
    EXPECT_FALSE(inflate(asBytes("no zstd"), 7, kChunkBytes));
    EXPECT_FALSE(inflate({}, 0, kChunkBytes));
    Bytes damaged = deflate(asBytes("some text that is long enough to be damaged somewhere"));
    damaged.resize(damaged.size() - 3);
    EXPECT_FALSE(inflate(damaged, 53, kChunkBytes));
}

}  // namespace
}  // namespace usdlive
