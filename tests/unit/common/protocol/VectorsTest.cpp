// Tests that the frames of tests/vectors decode to their described meaning.
#include "unit/common/Vectors.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "SampleFrames.h"
#include "usdlive/common/protocol/CompactFrame.h"

using namespace usdlive;
using namespace usdlive::test;

namespace {

const std::string kFrames = vectorsFile("frames.json");
const std::string kCompact = vectorsFile("compact.json");

/// The meaning of each sample of a frame, in the order of the file.
std::vector<std::pair<std::string, Frame>> meanings() {
    Commit first = sampleCommit();
    first.revision = 1;
    first.edits = {edit("/World", CreateSpec{SpecKind::Prim})};
    first.dropped.clear();
    first.gesture = 0;
    first.previous = Hash();
    Commit imported = first;
    imported.revision = 2;
    imported.imported = LayerId{"shot/a.usda"};
    imported.edits.clear();
    CommitFrame stub{imported, sha256(asBytes("after the import"))};
    std::vector<std::pair<std::string, Frame>> all{
        {"first commit", CommitFrame{first}},
        {"stub of an import", stub},
        {"withdrawn preview", PreviewFrame{{"someone"}, 3, 17, {}}},
        {"first part of a transaction",
         SubmitFrame{{{{"client"}, 4}, 17, 0, first.edits}, 0, true}},
        {"last part of a commit", CommitFrame{first, {}, 2, false}}};
    const std::vector<std::string> names{"submit",
                                         "commit",
                                         "conflated commits",
                                         "refusal",
                                         "preview",
                                         "part of a big value",
                                         "part of a preview's big value",
                                         "snapshot",
                                         "control"};
    const auto samples = sampleFrames();
    for (std::size_t index = 0; index < names.size(); ++index)
        all.emplace_back(names[index], samples[index]);
    return all;
}

/// The compact frames that one side sends to the other, in order, with their names.
struct NamedBytes {
    std::string name;
    Bytes bytes;
};
std::vector<NamedBytes> compactSamples() {
    const Transaction transaction{{{}, 4}, 17, 5, everyKindOfEdit()};
    const PreviewFrame preview{{"someone"}, 3, 17, everyKindOfEdit()};
    const CompactCommit commit{sampleCommit(), sha256(asBytes("after"))};
    NameNumbers numbers;
    KnownNames known;
    std::vector<NamedBytes> all;
    const auto add = [&](const std::string& name, const auto& content) {
        const auto frame = encodeCompact(content, numbers).value();
        if (const SharedBytes names = known.introduce(frame))
            all.push_back({"names of " + name, *names});
        all.push_back({name, *frame.bytes});
    };
    add("transaction whose names are spelled", transaction);
    add("transaction whose names are new", transaction);
    add("transaction whose names are known", transaction);
    add("preview", preview);
    add("commit", commit);
    add("commit again", commit);
    const Commit& it = commit.commit;
    all.push_back({"acceptance", encodeAcceptance({it.revision, it.epoch, it.id.sequence, it.timeMs,
                                                   it.previous, commit.hashAfter})});
    return all;
}

}  // namespace

// The samples are read in order, as those of one connection.
TEST(Vectors, CompactFramesHaveTheirMeaning) {
    auto file = nlohmann::ordered_json::parse(std::ifstream(kCompact));
    if (writesVectors() && file["frames"].empty()) {
        for (const auto& [name, bytes] : compactSamples())
            file["frames"].push_back(
                {{"name", name}, {"bytes", toHex(ByteView(bytes).subspan(4))}});
        std::ofstream(kCompact) << file.dump(1) << "\n";
        return;
    }
    CompactReader reader, written;
    const auto meanings = compactSamples();
    ASSERT_EQ(file["frames"].size(), meanings.size());
    for (std::size_t index = 0; index < meanings.size(); ++index) {
        const auto& sample = file["frames"][index];
        SCOPED_TRACE(sample["name"]);
        const auto content = reader.read(fromHex(sample["bytes"]));
        const auto meaning = written.read(ByteView(meanings[index].bytes).subspan(4));
        ASSERT_TRUE(content && meaning);
        EXPECT_TRUE(*content == *meaning);
    }
}

TEST(Vectors, InvalidCompactFramesAreRefusedWithTheirCode) {
    const auto file = nlohmann::ordered_json::parse(std::ifstream(kCompact));
    ASSERT_FALSE(file["refused"].empty());
    for (const auto& sample : file["refused"]) {
        SCOPED_TRACE(sample["name"]);
        const auto content = CompactReader().read(fromHex(sample["bytes"]));
        ASSERT_FALSE(content);
        EXPECT_EQ(errorName(content.error().code), sample["code"].get<std::string>());
    }
}

TEST(Vectors, FramesHaveTheirMeaning) {
    auto file = nlohmann::ordered_json::parse(std::ifstream(kFrames));
    std::map<std::string, std::size_t> places;
    for (std::size_t index = 0; index < file["frames"].size(); ++index)
        places[file["frames"][index]["name"]] = index;
    for (const auto& [name, meaning] : meanings()) {
        SCOPED_TRACE(name);
        if (writesVectors() && !places.contains(name)) {
            const Bytes message = encodeFrame(meaning);
            file["frames"].push_back(
                {{"name", name}, {"bytes", toHex(ByteView(message).subspan(4))}});
            continue;
        }
        ASSERT_TRUE(places.contains(name));
        const auto& sample = file["frames"][places[name]];
        const Bytes bytes = fromHex(sample["bytes"]);
        const auto decoded = decodeFrame(bytes);
        ASSERT_TRUE(decoded) << decoded.error().message;
        EXPECT_TRUE(*decoded == meaning);
        const auto* commit = std::get_if<CommitFrame>(&meaning);
        if (!commit || !sample.contains("after")) continue;
        EXPECT_EQ(hashAfter(*commit, commit->commit.previous, bytes).hex(),
                  sample["after"].get<std::string>());
    }
    if (writesVectors()) {
        std::ofstream(kFrames) << file.dump(1) << "\n";
        return;
    }
    EXPECT_EQ(places.size(), meanings().size());
}

TEST(Vectors, InvalidFramesAreRefusedWithTheirCode) {
    const auto file = nlohmann::ordered_json::parse(std::ifstream(kFrames));
    ASSERT_FALSE(file["refused"].empty());
    for (const auto& sample : file["refused"]) {
        SCOPED_TRACE(sample["name"]);
        const Bytes bytes = fromHex(sample["bytes"]);
        const auto decoded = decodeFrame(bytes);
        ASSERT_FALSE(decoded);
        EXPECT_EQ(errorName(decoded.error().code), sample["code"].get<std::string>());
    }
}
