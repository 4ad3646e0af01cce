// Tests layers at each revision of a part of the history.
#include "history/DocTimeline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "unit/common/history/RandomHistory.h"

using namespace usdlive;
using client::DocTimeline;

namespace {

// Returns the commits after `from`, up to `to`.
std::vector<Commit> between(const RandomHistory& history, Revision from, Revision to) {
    return {history.commits.begin() + std::ptrdiff_t(from),
            history.commits.begin() + std::ptrdiff_t(to)};
}

void start(DocTimeline& timeline, const RandomHistory& history, Revision revision) {
    timeline.start({{kLayer, history.docs[revision]}}, revision);
}

// Expects the content of the history.
void expectAt(DocTimeline& timeline, const RandomHistory& history, Revision revision) {
    const auto docs = timeline.at(revision);
    ASSERT_TRUE(docs) << docs.error().message;
    EXPECT_EQ(docs->at(kLayer).dump(), history.docs[revision].dump()) << revision;
}

}  // namespace

TEST(DocTimeline, GivesTheContentAtEachRevisionInAnyOrder) {
    for (unsigned seed = 0; seed < 8; ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 300);
        std::mt19937 random{seed};
        DocTimeline timeline;
        start(timeline, history, 20);
        timeline.add(between(history, 20, 100));
        timeline.add(between(history, 100, 300));
        ASSERT_EQ(timeline.first(), 20u);
        ASSERT_EQ(timeline.last(), 300u);
        LayerDoc shown = history.docs[20];
        for (int step = 0; step < 200; ++step) {
            const Revision revision = 20 + random() % 281;
            expectAt(timeline, history, revision);
            // The ids of the specs are those of one history: the difference applies.
            const LayerDoc next = timeline.at(revision)->at(kLayer);
            for (const auto& [path, action] : difference(shown, next))
                ASSERT_TRUE(shown.apply(path, action));
            ASSERT_EQ(shown, next);
            shown = next;
        }
    }
}

TEST(DocTimeline, KeepsABoundedPartAroundWhatIsAskedFor) {
    const Revision newest = DocTimeline::kMostCommits + 2'000;
    const RandomHistory history(1, int(newest));
    DocTimeline timeline;
    start(timeline, history, 0);
    for (Revision from = 0; from < newest;) {
        const Revision to = std::min<Revision>(from + 500, newest);
        timeline.add(between(history, from, to));
        from = to;
        expectAt(timeline, history, to);
    }
    EXPECT_GT(timeline.first(), 0u);
    EXPECT_LE(timeline.last() - timeline.first(),
              DocTimeline::kMostCommits + DocTimeline::kKeptEvery);
    expectAt(timeline, history, timeline.first());
    // Asked for its begin, it forgets its end.
    start(timeline, history, 0);
    timeline.add(between(history, 0, newest));
    expectAt(timeline, history, 5);
    EXPECT_EQ(timeline.first(), 0u);
    EXPECT_EQ(timeline.last(), DocTimeline::kMostCommits);
    expectAt(timeline, history, timeline.last());
}

TEST(DocTimeline, AnImportChangesNothing) {
    DocTimeline timeline;
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    timeline.start({{kLayer, doc}}, 1);
    Commit import;
    import.revision = 2;
    import.timeMs = 7;
    import.imported = kLayer;
    import.edits.push_back({kLayer, {"/A", {}}, DeleteSpec{}, {}});
    timeline.add({import});
    EXPECT_EQ(timeline.timeOf(2), 7);
    EXPECT_TRUE(timeline.at(2)->at(kLayer).has("/A"));
}
