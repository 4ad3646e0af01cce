// Tests NamespaceLog: carrying paths forward through moves and deletes (M3, M4).
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "RandomEdits.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/TransactionExecutor.h"

using namespace usdlive;

namespace {

const LayerId kMovedLayer{"a.usda"}, kUnmovedLayer{"b.usda"};

}  // namespace

TEST(NamespaceLog, M3FollowsMovesOfTheSpecAndItsAncestors) {
    NamespaceLog log;
    log.recordMove(1, kMovedLayer, "/A", "/B");
    log.recordMove(2, kMovedLayer, "/B/x", "/C/y");
    EXPECT_EQ(log.translate(kMovedLayer, "/A", 0), "/B");
    EXPECT_EQ(log.translate(kMovedLayer, "/A/x.p", 0), "/C/y.p");
    EXPECT_EQ(log.translate(kMovedLayer, "/B/x.p", 1), "/C/y.p");
    EXPECT_EQ(log.translate(kMovedLayer, "/A/xx", 0), "/B/xx");
    EXPECT_EQ(log.translate(kMovedLayer, "/A", 1), "/A");  // another A, created since
    EXPECT_EQ(log.translate(kUnmovedLayer, "/A", 0), "/A");
    EXPECT_EQ(log.translate(kMovedLayer, "/", 0), "/");
}

TEST(NamespaceLog, M3FollowsVariants) {
    NamespaceLog log;
    log.recordMove(1, kMovedLayer, "/A{v=}", "/B{w=}");
    log.recordMove(2, kMovedLayer, "/B{w=one}", "/B{w=two}");
    EXPECT_EQ(log.translate(kMovedLayer, "/A{v=one}C.x", 0), "/B{w=two}C.x");
    EXPECT_EQ(log.translate(kMovedLayer, "/A{v=three}", 0), "/B{w=three}");
    EXPECT_EQ(log.translate(kMovedLayer, "/A{v=}", 0), "/B{w=}");
}

TEST(NamespaceLog, M4ReportsADeletedSpec) {
    NamespaceLog log;
    log.recordDelete(3, kMovedLayer, "/A{v=}");
    log.recordMove(4, kMovedLayer, "/A", "/B");
    EXPECT_EQ(log.translate(kMovedLayer, "/A{v=one}C", 2), std::nullopt);
    EXPECT_EQ(log.translate(kMovedLayer, "/A{v=one}C", 3), "/B{v=one}C");  // created again
    EXPECT_EQ(log.translate(kMovedLayer, "/A.v", 2), "/B.v");
}

TEST(NamespaceLog, M3TranslatesFromAMark) {
    NamespaceLog log;
    log.recordMove(1, kMovedLayer, "/A", "/B");
    const auto mark = log.mark();
    log.recordMove(1, kMovedLayer, "/B", "/C");
    EXPECT_EQ(log.translateFrom(kMovedLayer, "/A", mark), "/A");
    EXPECT_EQ(log.translateFrom(kMovedLayer, "/B", mark), "/C");
    EXPECT_EQ(log.translateFrom(kMovedLayer, "/A", mark - 1), "/C");
}

TEST(NamespaceLog, TruncateRemovesEntriesAfterTheMark) {
    NamespaceLog log;
    log.recordMove(1, kMovedLayer, "/A", "/B");
    const auto mark = log.mark();
    log.recordDelete(2, kMovedLayer, "/B");
    log.truncate(mark);
    EXPECT_EQ(log.mark(), mark);
    EXPECT_EQ(log.translate(kMovedLayer, "/A", 0), "/B");
}

TEST(NamespaceLog, PruneForgetsAndKeepsTheNumbers) {
    NamespaceLog log;
    log.recordMove(1, kMovedLayer, "/A", "/B");
    log.recordMove(2, kMovedLayer, "/B", "/C");
    const auto mark = log.mark();
    log.recordMove(3, kMovedLayer, "/C", "/D");
    log.prune(2);
    EXPECT_EQ(log.oldest(), 2U);
    EXPECT_EQ(log.translate(kMovedLayer, "/C", 2), "/D");
    EXPECT_EQ(log.translateFrom(kMovedLayer, "/C", mark), "/D");
    EXPECT_EQ(log.mark(), mark + 1);
    log.prune(9);
    EXPECT_EQ(log.oldest(), 9U);
    EXPECT_EQ(log.mark(), mark + 1);
    log.recordMove(10, kMovedLayer, "/D", "/E");
    EXPECT_EQ(log.translate(kMovedLayer, "/D", 9), "/E");
    EXPECT_EQ(log.translateFrom(kMovedLayer, "/D", mark + 1), "/E");
    log.prune(1);
    EXPECT_EQ(log.oldest(), 9U);
}

// With many entries, the log uses an index. The result must be the same as from visiting each
// entry.
TEST(NamespaceLog, M3FollowsThroughManyEntries) {
    struct Move {
        Revision revision;
        std::string from;
        std::optional<std::string> to;
    };
    for (unsigned seed = 0; seed < 50; ++seed) {
        SCOPED_TRACE(seed);
        RandomEdits random{seed};
        const auto path = [&] {
            std::string text;
            for (std::size_t depth = 1 + random.below(3); depth > 0; --depth)
                text += (text.ends_with('}') ? "" : "/") + random.name() +
                        (random.chance(4) ? "{v=" + random.name() + "}" : "");
            return text;
        };
        NamespaceLog log;
        std::vector<Move> model;
        for (Revision revision = 1; revision <= 300; ++revision) {
            log.recordMove(revision, kUnmovedLayer, path(), path());
            model.push_back({revision, path(), std::nullopt});
            if (!random.chance(10)) {
                const std::string parent = specpath::parent(model.back().from);
                model.back().to =
                    specpath::child(parent, specpath::last(model.back().from).list, random.name());
            }
            if (model.back().to)
                log.recordMove(revision, kMovedLayer, model.back().from, *model.back().to);
            else
                log.recordDelete(revision, kMovedLayer, model.back().from);
            if (random.chance(20)) {  // reverted
                const auto mark = log.mark();
                for (int i = 0; i < 5; ++i) log.recordDelete(revision, kMovedLayer, path());
                log.truncate(mark);
            }
        }
        log.prune(random.below(100));
        for (int i = 0; i < 200; ++i) {
            const Revision since = log.oldest() + random.below(301 - log.oldest());
            const std::string start = path();
            std::optional<std::string> expected = start;
            for (const Move& move : model) {
                if (move.revision <= since || !expected) continue;
                if (!specpath::hasPrefix(*expected, move.from)) continue;
                expected =
                    move.to ? std::optional(specpath::replacePrefix(*expected, move.from, *move.to))
                            : std::nullopt;
            }
            ASSERT_EQ(log.translate(kMovedLayer, start, since), expected) << start << " " << since;
        }
    }
}

TEST(NamespaceLog, ALogAboveAnotherFollowsIt) {
    NamespaceLog confirmed;
    confirmed.recordMove(1, kMovedLayer, "/A", "/B");
    NamespaceLog predicted(&confirmed);
    predicted.recordMove(2, kMovedLayer, "/B", "/C");
    const std::uint64_t first = predicted.mark();
    predicted.recordMove(2, kMovedLayer, "/C", "/A");
    EXPECT_EQ(predicted.translate(kMovedLayer, "/A.x", 0), "/A.x");
    EXPECT_EQ(predicted.translateFrom(kMovedLayer, "/B", confirmed.mark()), "/A");
    EXPECT_EQ(predicted.translateFrom(kMovedLayer, "/C", first), "/A");
    // The first move is confirmed: from now on it is in the log below.
    confirmed.recordMove(2, kMovedLayer, "/B", "/C");
    predicted.pruneBefore(first);
    EXPECT_EQ(predicted.translate(kMovedLayer, "/A.x", 0), "/A.x");
    EXPECT_EQ(predicted.translate(kMovedLayer, "/B", 1), "/A");
    EXPECT_EQ(predicted.translate(kMovedLayer, "/B", 2), "/B");
    confirmed.recordDelete(3, kMovedLayer, "/C");
    EXPECT_EQ(predicted.translate(kMovedLayer, "/A", 0), std::nullopt);
    confirmed.prune(2);
    EXPECT_EQ(predicted.oldest(), 2u);
}

// M16: a prediction that has moved the spec corrects what others wrote to it at its present path.
TEST(NamespaceLog, M16NamedSpecsFollowTheMovesOfALogAbove) {
    NamespaceLog below;
    below.recordNaming(1, kMovedLayer, "/A", "inheritPaths", 1);
    below.recordNaming(1, kMovedLayer, "/B", "inheritPaths", 1);
    below.recordMove(2, kMovedLayer, "/A", "/C");
    NamespaceLog above(&below);
    above.recordMove(3, kMovedLayer, "/C", "/D");
    above.recordDelete(3, kMovedLayer, "/B");
    std::vector<std::string> named;
    const auto note = [&](std::string path, const std::string&) {
        named.push_back(std::move(path));
    };
    EXPECT_TRUE(above.forEachNaming(kMovedLayer, 0, 2, note));
    EXPECT_EQ(named, std::vector<std::string>{"/D"});
}

TEST(NamespaceLog, M15APlaceFollowsUntilItLeavesWhatIsAboveIt) {
    constexpr NamespaceLog::Author kSelf = 1, kOther = 2;
    NamespaceLog below;
    below.recordMove(1, kMovedLayer, "/B", "/E", NamespaceLog::Of::Place, kOther);
    below.recordMove(1, kMovedLayer, "/E/C", "/X", NamespaceLog::Of::Place, kSelf);
    below.recordMove(1, kMovedLayer, "/E/C", "/X", NamespaceLog::Of::Spec, kOther);
    const std::uint64_t end = below.mark();
    const auto follow = [&](const NamespaceLog& log, std::uint64_t to) {
        return log.followPlace(kMovedLayer, "/B/C", "/B", 0, to, kSelf);
    };
    EXPECT_EQ(follow(below, end).place, "/E/C");
    EXPECT_EQ(follow(below, end).above, "/E");
    EXPECT_EQ(follow(below, end).left, std::nullopt);

    NamespaceLog above(&below);
    above.recordMove(2, kMovedLayer, "/E/C", "/D/A", NamespaceLog::Of::Place, kOther);
    const std::uint64_t left = above.mark();
    above.recordDelete(2, kMovedLayer, "/D", NamespaceLog::Of::Place, kOther);
    EXPECT_EQ(follow(above, above.mark()).place, "/D/A");
    EXPECT_EQ(follow(above, above.mark()).above, "/E");
    EXPECT_EQ(follow(above, above.mark()).left, left);
    EXPECT_EQ(follow(above, left - 1).left, std::nullopt);

    below.recordDelete(1, kMovedLayer, "/E", NamespaceLog::Of::Place, kOther);
    EXPECT_EQ(follow(below, below.mark()).place, std::nullopt);
}

TEST(OwnCreations, M3ConfirmedCreationsPrecedePredictedOnes) {
    OwnCreations confirmed;
    OwnCreations predicted(&confirmed);
    predicted.record({1, 0}, {kMovedLayer, "/A", 0}, 5);
    EXPECT_EQ(predicted.find({1, 0})->path, "/A");
    confirmed.record({1, 0}, {kMovedLayer, "/B", 0}, 5);
    EXPECT_EQ(predicted.find({1, 0})->path, "/B");
}

TEST(OwnCreations, M3KeepsThemUntilTheAuthorHasSeenThem) {
    OwnCreations creations;
    creations.record({1, 0}, {kMovedLayer, "/A", 0}, 5);
    creations.record({1, 1}, {kMovedLayer, "/B", 0}, 5);
    creations.record({2, 0}, {kMovedLayer, "/C", 1}, 6);
    EXPECT_EQ(creations.find({1, 1})->path, "/B");
    EXPECT_EQ(creations.find({3, 0}), nullptr);
    creations.seen(5);
    EXPECT_EQ(creations.find({1, 0}), nullptr);
    EXPECT_NE(creations.find({2, 0}), nullptr);
    creations.forget(2);
    EXPECT_EQ(creations.find({2, 0}), nullptr);
}

TEST(RelativePath, GoesThereAndBack) {
    const std::vector<std::array<std::string, 3>> cases{
        {"/A", "/A", ""},
        {"/A/B.x", "/A", "/B.x"},
        {"/A.x", "/A", ".x"},
        {"/A{v=}", "/A", "{v=}"},
        {"/A{v=one}B", "/A", "{v=one}B"},
        {"/A{v=one}B.x", "/A{v=one}", "B.x"},
        {"/A{v=one}.x", "/A{v=one}", ".x"},
        {"/A{v=one}{w=}", "/A{v=one}", "{w=}"},
        {"/A{v=one}B.x", "/A{v=}", "{v=one}B.x"},
        {"/A{v=one}", "/A{v=}", "{v=one}"},
    };
    for (const auto& [path, created, relative] : cases) {
        EXPECT_EQ(relativePath(path, created), relative);
        EXPECT_EQ(absolutePath(relative, created), path);
    }
}

TEST(RelativePath, UsesTheCurrentNameOfTheSpec) {
    EXPECT_EQ(absolutePath("{v=one}B", "/A{w=}"), "/A{w=one}B");
    EXPECT_EQ(absolutePath("/B", "/A{v=one}"), "/A{v=one}B");
    EXPECT_EQ(absolutePath("B", "/A"), std::nullopt);
    EXPECT_EQ(absolutePath("one}", "/A{v=}"), std::nullopt);
}
