// Tests compact frames (FR9-FR11): their round trip, their size, names with numbers, and the
// refusal of malformed ones.
#include "usdlive/common/protocol/CompactFrame.h"

#include <gtest/gtest.h>

#include <random>

#include "SampleFrames.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive {
namespace {

ByteView contentOf(const Bytes& frame) { return ByteView(frame).subspan(4); }

Edit translate(const std::string& path, double x) {
    Bytes bytes;
    for (const double number : {x, x + 1, x + 2}) appendNumber<double>(bytes, number);
    return {{"shot/anim.usda"},
            {path, {}},
            SetField{"default", {}, Value(ValueType::Double3, bytes), {}}};
}

CompactCommit sampleCompact() {
    CompactCommit sample{sampleCommit(), sha256(asBytes("after"))};
    std::fill(sample.commit.previous.bytes.begin() + 8, sample.commit.previous.bytes.end(), 0);
    return sample;
}

/// A sender and a receiver of compact frames.
struct Line {
    NameNumbers numbers;
    KnownNames known;
    CompactReader reader;
    std::size_t bytes = 0;  ///< size of the last frame, with the one that introduces its names

    CompactContent send(const CompactFrame& frame) {
        bytes = frame.bytes->size();
        if (const SharedBytes names = known.introduce(frame)) {
            bytes += names->size();
            const auto told = reader.read(contentOf(*names));
            EXPECT_TRUE(told && std::holds_alternative<std::monostate>(*told));
        }
        EXPECT_TRUE(isCompact(contentOf(*frame.bytes)));
        auto content = reader.read(contentOf(*frame.bytes));
        EXPECT_TRUE(content) << content.error().message;
        return content ? std::move(*content) : CompactContent();
    }
    CompactContent send(const auto& content) {
        const auto frame = encodeCompact(content, numbers);
        EXPECT_TRUE(frame);
        return send(*frame);
    }
};

ErrorCode refusal(CompactReader& reader, const Bytes& frame) {
    const auto content = reader.read(frame);
    return content ? ErrorCode::Internal : content.error().code;
}

TEST(CompactFrame, FR9EveryKindComesBackAsItWas) {
    Line line;
    for (int time = 0; time < 3; ++time) {  // spelled, introduced, known
        const Transaction transaction{{{}, 4}, 17, 5, everyKindOfEdit()};
        EXPECT_EQ(line.send(transaction), CompactContent(SubmitFrame{transaction}));
        const PreviewFrame preview{{"someone"}, 3, 17, everyKindOfEdit()};
        EXPECT_EQ(line.send(preview), CompactContent(preview));
        EXPECT_EQ(line.send(sampleCompact()), CompactContent(sampleCompact()));
    }
    const Transaction empty{{{}, 1}, 0, 0, {}};
    EXPECT_EQ(line.send(empty), CompactContent(SubmitFrame{empty}));
    const Transaction large{{{}, ~std::uint64_t(0)}, ~std::uint64_t(0), ~std::uint64_t(0), {}};
    EXPECT_EQ(line.send(large), CompactContent(SubmitFrame{large}));
}

TEST(CompactFrame, FR11AnAcceptanceComesBackAsItWas) {
    Acceptance acceptance{900, 3, 4, 1'700'000'000'123, {}, sha256(asBytes("after"))};
    acceptance.previous.bytes[7] = 9;
    const Bytes bytes = encodeAcceptance(acceptance);
    CompactReader reader;
    const auto content = reader.read(contentOf(bytes));
    ASSERT_TRUE(content);
    EXPECT_EQ(*content, CompactContent(acceptance));
}

TEST(CompactFrame, OtherFramesAreNotCompact) {
    for (const Frame& frame : sampleFrames())
        EXPECT_FALSE(isCompact(contentOf(encodeFrame(frame))));
}

TEST(CompactFrame, WhatAnAuthorHadSeenIsCompactOnlyIfItIsTheBase) {
    NameNumbers names;
    CompactCommit commit{sampleCommit(), {}};
    EXPECT_TRUE(encodeCompact(commit, names));
    commit.commit.firstUnseen = 8;
    EXPECT_FALSE(encodeCompact(commit, names));
    Transaction transaction{{{}, 1}, 5, 0, everyKindOfEdit()};
    transaction.seen = 5;
    EXPECT_TRUE(encodeCompact(transaction, names));
    transaction.seen = 4;
    EXPECT_FALSE(encodeCompact(transaction, names));
}

TEST(CompactFrame, M18ALabelIsNotCompact) {
    NameNumbers names;
    CompactCommit commit{sampleCommit(), {}};
    commit.commit.label = "Move chairs";
    EXPECT_FALSE(encodeCompact(commit, names));
    Transaction transaction{{{}, 1}, 5, 0, everyKindOfEdit()};
    transaction.label = "Move chairs";
    EXPECT_FALSE(encodeCompact(transaction, names));
}

TEST(CompactFrame, ATransformIsSmall) {
    Line line;
    CompactCommit commit{sampleCommit(), {}};
    commit.commit.dropped.clear();
    commit.commit.id.sequence = 1'000;
    commit.commit.revision = 100'000;
    for (int time = 0; time < 3; ++time) {
        commit.commit.edits = {translate("/World/Set/Chair_0012.xformOp:translate", time)};
        line.send(commit);
    }
    EXPECT_LT(line.bytes, 110u);
    for (int time = 0; time < 3; ++time) {
        line.send(Transaction{{{}, 1'000}, 100'000, 0, commit.commit.edits});
    }
    EXPECT_LT(line.bytes, 60u);
    commit.commit.edits.clear();
    for (int index = 0; index < 50; ++index)
        commit.commit.edits.push_back(
            translate("/World/Set/Lamp_" + std::to_string(index) + ".xformOp:translate", index));
    for (int time = 0; time < 3; ++time) {
        line.send(commit);
        EXPECT_LT(line.bytes, 50u * 70) << "also while the names are new";
    }
    EXPECT_LT(line.bytes, 50u * 35);
}

TEST(CompactFrame, FR10ANameGetsANumberWhenItOccursAgain) {
    NameNumbers numbers;
    numbers.beginFrame();
    EXPECT_FALSE(numbers.numberOf("/World/Chair"));
    EXPECT_EQ(numbers.numberOf("/World/Chair"), 0u);
    EXPECT_FALSE(numbers.numberOf(std::string(kMaxNameBytes + 1, 'x')));
    EXPECT_FALSE(numbers.numberOf(std::string(kMaxNameBytes + 1, 'x')));
    CompactFrame frame;
    numbers.endFrame(frame);
    ASSERT_EQ(frame.names.size(), 1u);
    EXPECT_EQ(*frame.names[0].text, "/World/Chair");
}

TEST(CompactFrame, FR10AReceiverThatComesLaterIsToldWhatItNeeds) {
    Line first;
    const Transaction transaction{{{}, 4}, 17, 0, {translate("/World/Chair.xformOp:translate", 1)}};
    for (int time = 0; time < 3; ++time) first.send(transaction);
    const auto frame = encodeCompact(transaction, first.numbers);
    KnownNames known;
    CompactReader reader;
    EXPECT_EQ(refusal(reader, {contentOf(*frame->bytes).begin(), contentOf(*frame->bytes).end()}),
              ErrorCode::MalformedFrame);
    const SharedBytes names = known.introduce(*frame);
    ASSERT_TRUE(names && reader.read(contentOf(*names)));
    EXPECT_EQ(known.introduce(*frame), nullptr);
    const auto content = reader.read(contentOf(*frame->bytes));
    ASSERT_TRUE(content);
    EXPECT_EQ(*content, CompactContent(SubmitFrame{transaction}));
    EXPECT_EQ(first.known.introduce(*frame), nullptr);
}

TEST(CompactFrame, FR10MoreNamesThanNumbers) {
    Line line;
    std::mt19937 random{1};
    for (int frames = 0; frames < 400; ++frames) {
        Transaction transaction{{{}, 4}, 17, 0, {}};
        for (int index = 0; index < 200; ++index)
            transaction.edits.push_back(
                translate("/World/P" + std::to_string(random() % (frames < 200 ? 9'000 : 100)) +
                              ".xformOp:translate",
                          index));
        ASSERT_EQ(line.send(transaction), CompactContent(SubmitFrame{transaction}));
    }
    EXPECT_LT(line.bytes, 200u * 32) << "the names that are used now have the numbers";
}

TEST(CompactFrame, FR9LargeContentIsSentOtherwise) {
    NameNumbers names;
    Transaction many{{{}, 4}, 17, 0, {}};
    many.edits.assign(kMaxCompactEdits, translate("/A.x", 1));
    EXPECT_TRUE(encodeCompact(many, names));
    many.edits.push_back(translate("/A.x", 1));
    EXPECT_FALSE(encodeCompact(many, names));
    const Value big(arrayOf(ValueType::UChar), Bytes(kMaxCompactBytes + 1));
    EXPECT_FALSE(encodeCompact(
        Transaction{{{}, 4}, 17, 0, {edit("/A.x", SetField{"default", {}, big, {}})}}, names));
    // A decoder accepts everything that the encoder writes (FR7).
    const std::vector<std::string> keys(64, std::string(kMaxNameBytes, 'k'));
    Transaction keyed{{{}, 4}, 17, 0, {}};
    for (std::size_t count : {100u, 700u, 4'000u}) {
        keyed.edits.assign(count, edit("/A", EraseField{"customData", DictionaryKey{keys}}));
        Line line;
        if (const auto frame = encodeCompact(keyed, line.numbers)) (void)line.send(*frame);
        EXPECT_EQ(encodeCompact(keyed, line.numbers).has_value(), count <= 700) << count;
    }
}

TEST(CompactFrame, FR9DamagedFramesAreRefusedOrMeanSomethingElse) {
    Line line;
    const Transaction transaction{{{}, 4}, 17, 5, everyKindOfEdit()};
    for (int time = 0; time < 3; ++time) line.send(transaction);
    const auto frame = encodeCompact(transaction, line.numbers);
    const ByteView whole = contentOf(*frame->bytes);
    for (std::size_t size = 0; size < whole.size(); ++size) {
        CompactReader reader = line.reader;
        EXPECT_FALSE(reader.read(whole.first(size))) << size;
    }
    std::mt19937 random{1};
    for (int round = 0; round < 20'000; ++round) {
        Bytes damaged(whole.begin(), whole.end());
        for (unsigned count = 1 + random() % 3; count > 0; --count)
            damaged[random() % damaged.size()] = std::uint8_t(random());
        CompactReader reader = line.reader;
        (void)reader.read(damaged);
    }
}

TEST(CompactFrame, FR9MalformedFramesAreRefused) {
    CompactReader reader;
    const auto padded = [](Bytes bytes) {
        bytes.resize(std::max<std::size_t>(bytes.size(), 16));
        return bytes;
    };
    EXPECT_EQ(refusal(reader, padded({0x0b})), ErrorCode::UnknownFrame);
    EXPECT_EQ(refusal(reader, padded({1, 0, 0, 0, 0})), ErrorCode::MalformedFrame) << "no number";
    EXPECT_EQ(refusal(reader, padded({1, 4, 0, 0, 1, 1, 1})), ErrorCode::MalformedFrame)
        << "no layer";
    EXPECT_EQ(refusal(reader, padded({1, 4, 0, 0, 1, 0x41, 1})), ErrorCode::MalformedFrame)
        << "no such name";
    EXPECT_EQ(refusal(reader, padded({1, 4, 0, 0, 1, 0x46, 2, 'x'})), ErrorCode::InvalidLayerName);
    EXPECT_EQ(refusal(reader, padded({1, 4, 0, 0, 0xff, 0xff, 3})), ErrorCode::MalformedFrame)
        << "edits";
    EXPECT_EQ(refusal(reader, padded({9, 1, 0xff, 0x1f, 1, 'x'})), ErrorCode::MalformedFrame)
        << "number";
    EXPECT_EQ(refusal(reader, padded({9, 1, 0, 0})), ErrorCode::MalformedFrame) << "empty";
    EXPECT_EQ(refusal(reader, padded({9, 1, 0, 1, 0xff})), ErrorCode::MalformedFrame) << "no UTF-8";
    Bytes tail = padded({9, 1, 0, 1, 'x'});
    EXPECT_TRUE(reader.read(tail));
    tail.back() = 1;
    EXPECT_EQ(refusal(reader, tail), ErrorCode::MalformedFrame) << "it continues";
    tail = padded({9, 1, 0, 1, 'x'});
    tail.push_back(0);
    EXPECT_EQ(refusal(reader, tail), ErrorCode::MalformedFrame) << "padded too far";
}

}  // namespace
}  // namespace usdlive
