// Tests that the history is read backward, in pages, to where it begins.
#include "history/HistoryReader.h"

#include <gtest/gtest.h>

#include <numeric>

using namespace usdlive;
using namespace usdlive::client;

namespace {

constexpr Revision kNewest = 2'500;

// Has the commits after a base, as a server. Its connection was made before the base.
class ReaderInMemory final : public HistoryReader {
public:
    explicit ReaderInMemory(Revision begin) : begin_(begin) {}
    std::size_t reads = 0;

    [[nodiscard]] Revision newest() const override { return kNewest; }
    [[nodiscard]] Revision base() const override { return 0; }
    Result<std::vector<Commit>> readLog(Revision from, Revision to) override {
        ++reads;
        if (from <= begin_) return fail(ErrorCode::HistoryReplaced, "the history begins later");
        std::vector<Commit> commits(to - from + 1);
        for (Commit& commit : commits) commit.revision = from++;
        return commits;
    }
    Result<Content> readLayer(const LayerId&, Revision) override {
        return fail(ErrorCode::LayerNotFound, "there are no layers");
    }

private:
    const Revision begin_;
};

}  // namespace

TEST(HistoryReader, ReadsEveryCommitBackToABaseThatWasMadeSince) {
    for (const Revision base :
         {0, 1, 499, 500, 501, 900, 1'499, 1'500, 1'501, 2'000, 2'499, 2'500}) {
        SCOPED_TRACE(base);
        ReaderInMemory reader(base);
        std::vector<Revision> visited;
        const auto read = readBackward(
            reader, kNewest, 1,
            [&](const Commit& commit) {
                visited.push_back(commit.revision);
                return true;
            },
            AtBase::End);
        ASSERT_TRUE(read) << read.error().message;
        std::vector<Revision> wanted(kNewest - base);
        std::iota(wanted.rbegin(), wanted.rend(), base + 1);
        EXPECT_EQ(visited, wanted);
        EXPECT_LT(reader.reads, 30u);
    }
}

// A caller that needs all of them is told that some are gone.
TEST(HistoryReader, ABaseThatWasMadeSinceIsAnErrorUnlessItMayEndThere) {
    ReaderInMemory reader(700);
    std::vector<Revision> visited;
    const auto read = readBackward(reader, kNewest, 1, [&](const Commit& commit) {
        visited.push_back(commit.revision);
        return true;
    });
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::HistoryReplaced);
    EXPECT_EQ(visited.size(), 1'000u);  // the first page
}
