// Tests what looks for commits, opinions and paths in the history.
#include <gtest/gtest.h>

#include <map>

#include "RandomHistory.h"
#include "usdlive/common/history/Blame.h"
#include "usdlive/common/history/CommitFilter.h"

using namespace usdlive;

namespace {

Commit commitOf(const char* user, std::vector<Edit> edits, std::int64_t timeMs = 0) {
    Commit commit;
    commit.user = UserName{user};
    commit.edits = std::move(edits);
    commit.timeMs = timeMs;
    return commit;
}
Edit edit(const char* path, EditAction action, const char* layer = "shot.usda") {
    return {LayerId{layer}, {path, {}}, std::move(action), {}};
}
Edit move(const char* path, const char* parent, const char* name) {
    return edit(path, MoveSpec{{parent, {}}, name});
}
std::size_t foundBy(const CommitFilter& filter, const Commit& commit) {
    const auto found = CommitSearch(filter).look(commit);
    return found ? found->edits.size() : 99;
}
constexpr std::size_t kNotFound = 99;

}  // namespace

TEST(CommitFilter, ChoosesByUserAndTime) {
    const Commit commit = commitOf("ann", {edit("/A", setInt("f", 1))}, 1'000);
    EXPECT_EQ(foundBy({}, commit), 1u);
    EXPECT_EQ(foundBy({.users = {UserName{"ann"}}}, commit), 1u);
    EXPECT_EQ(foundBy({.users = {UserName{"bob"}}}, commit), kNotFound);
    EXPECT_EQ(foundBy({.sinceMs = 1'000, .untilMs = 1'000}, commit), 1u);
    EXPECT_EQ(foundBy({.sinceMs = 1'001}, commit), kNotFound);
    EXPECT_EQ(foundBy({.untilMs = 999}, commit), kNotFound);
}

TEST(CommitFilter, M18ChoosesByAPartOfTheLabel) {
    Commit commit = commitOf("ann", {edit("/A", setInt("f", 1))});
    EXPECT_EQ(foundBy({.label = "chairs"}, commit), kNotFound);
    commit.label = "Move Chairs é";
    for (const char* part : {"", "chairs", "MOVE", "Chairs é", "e c"})
        EXPECT_EQ(foundBy({.label = part}, commit), 1u) << part;
    EXPECT_EQ(foundBy({.label = "tables"}, commit), kNotFound);
}

TEST(CommitFilter, ChoosesEditsByLayerPathAndKind) {
    const Commit commit =
        commitOf("ann", {edit("/A", setInt("f", 1)), edit("/A.x", setInt("default", 1)),
                         edit("/AB", setInt("f", 1)), edit("/A/B", setInt("f", 1), "other.usda")});
    EXPECT_EQ(foundBy({.layer = kLayer}, commit), 3u);
    EXPECT_EQ(foundBy({.layer = kLayer, .path = "/A"}, commit), 2u);
    EXPECT_EQ(foundBy({.layer = kLayer, .path = "/C"}, commit), kNotFound);
    EXPECT_EQ(foundBy({.layer = LayerId{"none.usda"}}, commit), kNotFound);
    EXPECT_EQ(foundBy({.kinds = {OpinionKind::Metadata}}, commit), 3u);
    EXPECT_EQ(foundBy({.kinds = {OpinionKind::Property}}, commit), 1u);
    EXPECT_EQ(foundBy({.kinds = {OpinionKind::Transform}}, commit), kNotFound);
}

TEST(CommitFilter, AnImportIsFoundByItsLayer) {
    Commit commit;
    commit.imported = kLayer;
    EXPECT_EQ(foundBy({.layer = kLayer}, commit), 0u);
    EXPECT_EQ(foundBy({.layer = LayerId{"other.usda"}}, commit), kNotFound);
    EXPECT_EQ(foundBy({.layer = kLayer, .path = "/A"}, commit), kNotFound);
}

TEST(CommitFilter, APathIsFollowedThroughCommitsThatAreNotChosen) {
    CommitSearch search({.users = {UserName{"ann"}}, .layer = kLayer, .path = "/New/B"});
    EXPECT_TRUE(search.look(commitOf("ann", {edit("/New/B", setInt("f", 3))})));
    EXPECT_FALSE(search.look(commitOf("bob", {move("/Old", "/", "New")})));
    EXPECT_EQ(search.formerPath(), "/Old/B");
    EXPECT_FALSE(search.look(commitOf("ann", {edit("/New/B", setInt("f", 2))})));
    EXPECT_TRUE(search.look(commitOf("ann", {edit("/Old/B", setInt("f", 1))})));
    EXPECT_TRUE(search.look(commitOf("ann", {move("/C", "/Old", "B")}))) << "it came from there";
    EXPECT_EQ(search.formerPath(), "/C");
    EXPECT_TRUE(search.look(commitOf("ann", {edit("/C", DeleteSpec{})})));
}

TEST(CommitFilterProperty, APathIsFollowedToWhereTheSpecWas) {
    std::size_t renamed = 0;
    for (unsigned seed = 1; seed <= seedsOf(200); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 20);
        history.docs.back().visit([&](const LayerDoc::SpecView& spec) {
            const std::string then = pathOfNode(history.docs.front(), spec.node);
            if (then.empty() || spec.node == kRootNode) return;
            CommitSearch search({.layer = kLayer, .path = std::string(spec.path)});
            for (auto commit = history.commits.rbegin(); commit != history.commits.rend(); ++commit)
                (void)search.look(*commit);
            EXPECT_EQ(search.formerPath(), then) << spec.path;
            renamed += then != spec.path;
        });
    }
    EXPECT_GT(renamed, seedsOf(200) / 4);
}

// The oracle follows nodes, not paths.
TEST(BlameProperty, FindsTheLastEditOfEachOpinion) {
    std::size_t found = 0;
    for (unsigned seed = 1; seed <= seedsOf(300); ++seed) {
        SCOPED_TRACE(seed);
        const RandomHistory history(seed, 30);
        std::map<std::pair<NodeId, std::string>, Revision> last;
        for (const Commit& commit : history.commits) {
            LayerDoc doc = history.docs[commit.revision - 1];
            for (const Edit& edit : commit.edits) {
                const auto applied = doc.apply(edit.address.path, edit.action);
                ASSERT_TRUE(applied);
                if (const auto* set = std::get_if<SetField>(&edit.action))
                    last[{applied->node, set->field}] = commit.revision;
                if (const auto* erase = std::get_if<EraseField>(&edit.action))
                    last[{applied->node, erase->field}] = commit.revision;
                const bool isOfName = std::holds_alternative<CreateSpec>(edit.action) ||
                                      std::holds_alternative<MoveSpec>(edit.action);
                if (isOfName) last[{applied->node, {}}] = commit.revision;
            }
        }
        const LayerDoc& present = history.docs.back();
        Blame blame(present, kLayer, "/", Blame::Depth::Below);
        for (auto commit = history.commits.rbegin(); commit != history.commits.rend(); ++commit)
            blame.add(*commit);
        std::size_t count = 0;
        present.visit([&](const LayerDoc::SpecView& spec) {
            count += spec.fields->size() + (spec.node != kRootNode);
        });
        ASSERT_EQ(blame.opinions().size(), count);
        for (const BlamedOpinion& one : blame.opinions()) {
            const NodeId node = present.idsAlong(one.path).back();
            const auto expected = last.find({node, one.field});
            ASSERT_EQ(one.revision, expected == last.end() ? 0 : expected->second)
                << one.path << " " << one.field;
            if (one.revision == 0) continue;
            ++found;
            ASSERT_EQ(one.user, history.commits[one.revision - 1].user);
            ASSERT_EQ(one.pathThen, pathOfNode(history.docs[one.revision - 1], node))
                << one.path << " " << one.field;
        }
    }
    EXPECT_GT(found, seedsOf(300));
}

TEST(Blame, LooksAtTheSpecWithItsProperties) {
    LayerDoc doc;
    for (const auto& [path, kind] :
         {std::pair("/A", SpecKind::Prim), std::pair("/A.x", SpecKind::Attribute),
          std::pair("/A/B", SpecKind::Prim), std::pair("/A/B.y", SpecKind::Attribute)})
        ASSERT_TRUE(doc.apply(path, CreateSpec{kind}));
    ASSERT_TRUE(doc.apply("/A.x", setInt("f", 1)));
    const Blame one(doc, kLayer, "/A", Blame::Depth::Spec);
    ASSERT_EQ(one.opinions().size(), 3u);
    EXPECT_EQ(one.opinions()[2].path, "/A.x");
    EXPECT_EQ(one.opinions()[2].field, "f");
    EXPECT_EQ(Blame(doc, kLayer, "/A", Blame::Depth::Below).opinions().size(), 5u);
}

TEST(Blame, LooksAtTheSamplesOfOneField) {
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A.x", CreateSpec{SpecKind::Attribute}));
    std::vector<Commit> commits;
    for (const auto& [user, time] : {std::pair("ann", 1.0), std::pair("bob", 2.0)}) {
        const SetField sample{"timeSamples", SampleTime{time}, intValue(1)};
        ASSERT_TRUE(doc.apply("/A.x", sample));
        commits.push_back(commitOf(user, {edit("/A.x", sample)}));
        commits.back().revision = commits.size();
    }
    Blame blame(doc, kLayer, "/A.x", "timeSamples");
    ASSERT_EQ(blame.opinions().size(), 2u);
    blame.add(commits[1]);
    EXPECT_FALSE(blame.isComplete());
    blame.add(commits[0]);
    EXPECT_TRUE(blame.isComplete());
    EXPECT_EQ(blame.opinions()[0].user.value, "ann");
    EXPECT_EQ(blame.opinions()[1].user.value, "bob");
}

TEST(Blame, AnImportMakesEverythingThatIsLeft) {
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A", setInt("f", 1)));
    Blame blame(doc, kLayer, "/A", Blame::Depth::Spec);
    Commit import;
    import.revision = 7;
    import.imported = LayerId{"other.usda"};
    blame.add(import);
    EXPECT_FALSE(blame.isComplete());
    import.imported = kLayer;
    blame.add(import);
    EXPECT_TRUE(blame.isComplete());
    for (const BlamedOpinion& one : blame.opinions())
        EXPECT_TRUE(one.isImport && one.revision == 7);
}
