// Tests MessageReader: decoding commits, snapshots and big values beside the session.
#include "session/MessageReader.h"

#include <gtest/gtest.h>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Snapshot.h"

using namespace usdlive;
using namespace usdlive::client;

namespace {

// Returns a doc of several chunks, with a field that takes more than one.
LayerDoc bigDoc() {
    LayerDoc doc;
    for (int i = 0; i < 4'000; ++i) {
        const std::string path = "/p" + std::to_string(i);
        EXPECT_TRUE(doc.apply(path, CreateSpec{SpecKind::Prim}));
        EXPECT_TRUE(doc.apply(path, SetField{"documentation", {}, stringValue(path + " of many")}));
    }
    EXPECT_TRUE(doc.apply("/p7", SetField{"comment", {}, stringValue(std::string(250'000, 'c'))}));
    return doc;
}

std::vector<SnapshotFrame> chunksOf(const LayerDoc& doc) {
    std::vector<SnapshotFrame> chunks;
    SnapshotEncoder encoder(doc, 5);
    while (auto chunk = encoder.next()) chunks.push_back(std::move(*chunk));
    EXPECT_GT(chunks.size(), 3U);
    return chunks;
}

template <class T>
T only(const ReceivedMessage& message) {
    EXPECT_EQ(message.frames.size(), 1U);
    const auto& frame = message.frames.at(0);
    if (!frame) throw std::runtime_error(frame.error().message);
    return std::get<T>(*frame);
}

// Builds a layer from the parts of a snapshot.
class Remade {
public:
    void add(const SnapshotPart& part) {
        for (const auto& record : part.records) {
            if (const auto* spec = std::get_if<SnapshotPart::Spec>(&record)) {
                node_ = spec->node;
                EXPECT_TRUE(builder_.addSpec(spec->node, spec->parent, spec->order, spec->kind,
                                             spec->name));
            } else {
                const auto& field = std::get<SnapshotPart::Field>(record);
                EXPECT_TRUE(builder_.addField(node_, field.name, field.value));
            }
        }
    }
    LayerDoc finish() { return builder_.finish(); }

private:
    LayerDoc::Builder builder_;
    NodeId node_ = 0;
};

}  // namespace

TEST(MessageReader, ReadsALayerAsADocAndAsParts) {
    const LayerDoc doc = bigDoc();
    MessageReader reader;
    // The parts are checked when all have arrived, because a worker may be behind.
    std::vector<std::shared_ptr<const SnapshotPart>> parts;
    std::optional<LayerDoc> whole;
    std::uint64_t specs = 0;
    for (const SnapshotFrame& chunk : chunksOf(doc)) {
        EXPECT_FALSE(whole);
        const Bytes message = encodeFrame(chunk);
        const ReceivedMessage read = reader.read(message);
        EXPECT_GT(read.bytes, message.size() + chunk.rawBytes);
        auto received = only<ReceivedSnapshot>(read);
        EXPECT_EQ(received.request, 5U);
        EXPECT_EQ(received.part->first, parts.empty());
        EXPECT_GE(received.specs, specs);
        specs = received.specs;
        parts.push_back(received.part);
        whole = std::move(received.whole);
    }
    ASSERT_TRUE(whole);
    EXPECT_EQ(whole->dump(), doc.dump());
    EXPECT_EQ(specs, doc.specCount());
    Remade remade;
    for (const auto& part : parts) remade.add(*part);
    EXPECT_EQ(remade.finish().dump(), doc.dump());
}

TEST(MessageReader, KeepsSnapshotsApart) {
    const LayerDoc doc = bigDoc();
    MessageReader reader;
    const auto chunks = chunksOf(doc);
    std::size_t whole = 0;
    for (SnapshotFrame chunk : chunks)
        for (const std::uint64_t request : {5, 6}) {
            chunk.request = request;
            const auto received = only<ReceivedSnapshot>(reader.read(encodeFrame(chunk)));
            if (received.whole) {
                ++whole;
                EXPECT_EQ(received.whole->dump(), doc.dump());
            }
        }
    EXPECT_EQ(whole, 2U);
}

TEST(MessageReader, RefusesChunksOutOfOrder) {
    const auto chunks = chunksOf(bigDoc());
    MessageReader reader;
    only<ReceivedSnapshot>(reader.read(encodeFrame(chunks[0])));
    const auto read = reader.read(encodeFrame(chunks[2]));
    ASSERT_EQ(read.frames.size(), 1U);
    ASSERT_FALSE(read.frames[0]);
    EXPECT_EQ(read.frames[0].error().code, ErrorCode::MalformedFrame);
}

TEST(MessageReader, ReturnsTheHashAfterACommit) {
    Commit commit;
    commit.revision = 2;
    commit.epoch = 1;
    commit.previous = sha256(Bytes{1});
    const Bytes message = encodeFrame(CommitFrame{commit});
    MessageReader reader;
    const auto received = only<ReceivedCommit>(reader.read(message));
    EXPECT_EQ(received.commit.revision, 2U);
    EXPECT_EQ(received.hashAfter, chainHash(commit.previous, ByteView(message).subspan(4)));
}

TEST(MessageReader, ReadsNothingAfterAnError) {
    Bytes message = encodeFrame(ControlFrame{encodeControl(CloseLayer{{"a.usda"}})});
    appendBytes(message, encodeFrame(SubmitFrame{{.id = {{"ada"}, 1}, .edits = {}}}));
    appendBytes(message, encodeFrame(ControlFrame{encodeControl(CloseLayer{{"b.usda"}})}));
    MessageReader reader;
    const auto read = reader.read(message);
    ASSERT_EQ(read.frames.size(), 2U);
    EXPECT_TRUE(read.frames[0]);
    ASSERT_FALSE(read.frames[1]);
    EXPECT_EQ(read.frames[1].error().code, ErrorCode::UnknownFrame);
}

TEST(MessageReader, AMessageThatDoesNotSplitIsAnError) {
    Bytes message = encodeFrame(ControlFrame{encodeControl(CloseLayer{{"a.usda"}})});
    message.pop_back();
    MessageReader reader;
    const auto read = reader.read(message);
    ASSERT_EQ(read.frames.size(), 1U);
    ASSERT_FALSE(read.frames[0]);
    EXPECT_EQ(read.frames[0].error().code, ErrorCode::MalformedFrame);
}

class MessageReaderBlobs : public testing::Test {
protected:
    MessageReaderBlobs() { welcome(); }
    void welcome() {
        Welcome welcome;
        welcome.maxBlobBytes = 1'000'000;
        only<ControlMessage>(reader_->read(encodeFrame(ControlFrame{encodeControl(welcome)})));
    }
    void nextConnection() {
        reader_.emplace(reader_->takeBegun());
        welcome();
    }
    Result<SharedBytes> read(std::uint64_t offset, std::uint32_t bytes) {
        const ByteView part = ByteView(blob_).subspan(offset, bytes);
        return read(BlobFrame{sha256(blob_), blob_.size(), offset, bytes, deflate(part)});
    }
    Result<SharedBytes> read(const BlobFrame& part) {
        auto received = only<ReceivedBlob>(reader_->read(encodeFrame(part)));
        EXPECT_EQ(received.hash, part.hash);
        return std::move(received.whole);
    }
    static void expectMismatch(const Result<SharedBytes>& read) {
        ASSERT_FALSE(read);
        EXPECT_EQ(read.error().code, ErrorCode::BlobMismatch);
    }

    const Bytes blob_ = Bytes(600'000, 7);
    std::optional<MessageReader> reader_{std::in_place};
};

TEST_F(MessageReaderBlobs, B2TheLastChunkCompletesTheValue) {
    EXPECT_EQ(read(0, kChunkBytes), nullptr);
    EXPECT_EQ(read(kChunkBytes, kChunkBytes), nullptr);
    const auto whole = read(2 * kChunkBytes, std::uint32_t(blob_.size() - 2 * kChunkBytes));
    ASSERT_TRUE(whole && *whole);
    EXPECT_EQ(**whole, blob_);
}

TEST_F(MessageReaderBlobs, ChunksOfTwoValuesAlternate) {
    const Bytes other(300'000, 8);
    const auto part = [&](std::uint64_t offset, std::uint32_t bytes) {
        return BlobFrame{sha256(other), other.size(), offset, bytes,
                         deflate(ByteView(other).subspan(offset, bytes))};
    };
    EXPECT_EQ(read(0, kChunkBytes), nullptr);
    EXPECT_EQ(read(part(0, kChunkBytes)), nullptr);
    EXPECT_EQ(read(kChunkBytes, kChunkBytes), nullptr);
    const auto whole = read(part(kChunkBytes, std::uint32_t(other.size() - kChunkBytes)));
    ASSERT_TRUE(whole && *whole);
    EXPECT_EQ(**whole, other);
}

TEST_F(MessageReaderBlobs, AMismatchAbandonsTheValue) {
    EXPECT_EQ(read(0, kChunkBytes), nullptr);
    expectMismatch(read(2 * kChunkBytes, 1'000));
    expectMismatch(read(kChunkBytes, kChunkBytes));  // the chunks of an abandoned request
    EXPECT_EQ(read(0, kChunkBytes), nullptr);        // then from the start again
}

TEST_F(MessageReaderBlobs, TL3TheNextConnectionContinues) {
    EXPECT_EQ(read(0, kChunkBytes), nullptr);
    EXPECT_EQ(read(kChunkBytes, kChunkBytes), nullptr);
    nextConnection();
    // The session had not seen the last part.
    EXPECT_EQ(read(kChunkBytes, kChunkBytes), nullptr);
    nextConnection();
    const auto whole = read(2 * kChunkBytes, std::uint32_t(blob_.size() - 2 * kChunkBytes));
    ASSERT_TRUE(whole && *whole);
    EXPECT_EQ(**whole, blob_);
}

TEST_F(MessageReaderBlobs, TL3AValueThatNobodyContinuesIsDropped) {
    EXPECT_EQ(read(0, kChunkBytes), nullptr);
    for (int connection = 0; connection < 10; ++connection) nextConnection();
    expectMismatch(read(kChunkBytes, kChunkBytes));
}

TEST_F(MessageReaderBlobs, V9BytesOfAnotherValueAreRefused) {
    expectMismatch(read(BlobFrame{sha256(Bytes{1}), 1, 0, 1, deflate(Bytes{2})}));
}

TEST_F(MessageReaderBlobs, NoValueIsLargerThanTheServersLimit) {
    expectMismatch(read(BlobFrame{sha256(blob_), 1'000'001, 0, 1, deflate(Bytes{7})}));
}

TEST_F(MessageReaderBlobs, DamagedBytesAreAnError) {
    const auto damaged = read(BlobFrame{sha256(blob_), blob_.size(), 0, 4, {1, 2, 3}});
    ASSERT_FALSE(damaged);
    EXPECT_EQ(damaged.error().code, ErrorCode::MalformedFrame);
}
