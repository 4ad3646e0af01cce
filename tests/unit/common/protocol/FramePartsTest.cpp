// Tests transactions and commits in parts (FR8).
#include "usdlive/common/protocol/FrameParts.h"

#include <gtest/gtest.h>

#include "SampleFrames.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive {
namespace {

Commit largeCommit() {
    Commit commit = sampleCommit();
    const auto kinds = commit.edits;
    for (int times = 0; times < 20; ++times)
        commit.edits.insert(commit.edits.end(), kinds.begin(), kinds.end());
    for (std::uint32_t index = 0; index < 20; ++index)
        commit.dropped.push_back({index, ErrorCode::SpecDeleted, kinds.front()});
    commit.label = "Move chairs";
    return commit;
}

std::vector<Bytes> partsOf(const auto& whole, std::size_t bytes) {
    std::vector<Bytes> parts;
    for (PartsAt at; !at.isEnd;) parts.push_back(encodePart(whole, at, bytes));
    return parts;
}
ByteView encodedOf(const Bytes& part) { return ByteView(part).subspan(4); }
template <class T>
T frameOf(const Bytes& part) {
    return std::get<T>(decodeFrame(encodedOf(part)).value());
}

TEST(FrameParts, FR8ACommitInPartsComesBackAsItWas) {
    const Commit commit = largeCommit();
    const auto parts = partsOf(commit, 2'000);
    ASSERT_GT(parts.size(), 5u);
    CommitParts joining;
    Bytes stored;
    for (std::size_t index = 0; index < parts.size(); ++index) {
        EXPECT_LT(parts[index].size(), 4'000u);
        appendBytes(stored, parts[index]);
        const auto joined =
            joining.add(frameOf<CommitFrame>(parts[index]), encodedOf(parts[index])).value();
        ASSERT_EQ(joined.has_value(), index + 1 == parts.size());
        if (!joined) continue;
        EXPECT_EQ(joined->commit, commit);
        EXPECT_EQ(joined->hashAfter, chainHash(commit.previous, encodedOf(stored)));
    }
}

TEST(FrameParts, FR8ATransactionInPartsComesBackAsItWas) {
    Transaction transaction{{{"client"}, 4}, 17, 5, largeCommit().edits};
    transaction.label = "Move chairs";
    const auto parts = partsOf(transaction, 2'000);
    ASSERT_GT(parts.size(), 5u);
    SubmitParts joining;
    std::optional<Transaction> whole;
    for (const Bytes& part : parts) whole = joining.add(frameOf<SubmitFrame>(part)).value();
    EXPECT_EQ(whole, transaction);
}

TEST(FrameParts, ContentOfOneFrameIsThatFrame) {
    const Transaction transaction{{{"client"}, 4}, 17, 5, everyKindOfEdit()};
    const auto parts = partsOf(transaction, kPartBytes);
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_EQ(parts[0], encodeFrame(SubmitFrame{transaction}));
    const auto commit = partsOf(sampleCommit(), kPartBytes);
    ASSERT_EQ(commit.size(), 1u);
    EXPECT_EQ(commit[0], encodeFrame(CommitFrame{sampleCommit()}));
}

TEST(FrameParts, FR8PartsOutOfOrderAreRefused) {
    const auto parts = partsOf(largeCommit(), 2'000);
    const auto add = [&](CommitParts& joining, CommitFrame frame) {
        return joining.add(std::move(frame), encodedOf(parts[1])).has_value();
    };
    CommitFrame second = frameOf<CommitFrame>(parts[1]);
    CommitParts begun;
    EXPECT_FALSE(add(begun, second)) << "the first is missing";
    CommitParts other;
    ASSERT_TRUE(add(other, frameOf<CommitFrame>(parts[0])));
    ++second.commit.revision;
    EXPECT_FALSE(add(other, second)) << "of another commit";
    CommitParts twice;
    ASSERT_TRUE(add(twice, frameOf<CommitFrame>(parts[0])));
    EXPECT_FALSE(add(twice, frameOf<CommitFrame>(parts[0]))) << "the same again";

    CommitFrame stub = frameOf<CommitFrame>(parts[0]);
    stub.commit.conflated = 1;
    stub.hashAfter = Hash{};
    EXPECT_FALSE(decodeFrame(encodedOf(encodeFrame(stub))))
        << "a commit in parts is never conflated";
}

// 2 GiB cannot be built as one frame; only the parts that are requested are built.
TEST(FrameParts, TheSizeIsKnownBeforeAnythingIsEncoded) {
    const FieldValue big(stringValue(std::string(200'000, 'x')));
    std::vector<Edit> edits;
    for (int i = 0; i < 20'000; ++i)
        edits.push_back({{"a.usda"}, {"/A", {}}, SetField{"n" + std::to_string(i), {}, big}});
    EXPECT_GT(leastFrameBytes(edits), 20'000u * 200'000u);
    const Transaction transaction{{{"client"}, 4}, 17, 0, std::move(edits)};
    PartsAt at;
    const Bytes part = encodePart(transaction, at);
    EXPECT_FALSE(at.isEnd);
    EXPECT_GT(part.size(), kPartBytes / 2);
    EXPECT_LE(part.size(), kPartBytes + 1024);
}

// FR7's bounds grow with the frame, so a part stays readable even if many of its edits name the
// same layer.
TEST(FrameParts, AnyPartCanBeRead) {
    const LayerId layer{std::string(250, 'l') + ".usda"};
    const std::string path = "/" + std::string(120, 'p');
    std::vector<Edit> edits(
        60'000, Edit{layer, {path, {}}, SetField{std::string(120, 'f'), {}, doubleValue(1)}});
    const Transaction transaction{{{"client"}, 4}, 17, 0, std::move(edits)};
    for (const Bytes& part : partsOf(transaction, kPartBytes))
        EXPECT_TRUE(decodeFrame(encodedOf(part)));
}

}  // namespace
}  // namespace usdlive
