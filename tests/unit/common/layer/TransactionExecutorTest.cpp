// Tests execute(), which decides the result of a transaction (M2-M6, M13).
#include "usdlive/common/layer/TransactionExecutor.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "RandomEdits.h"
#include "usdlive/common/layer/AddressResolver.h"

using namespace usdlive;

namespace {

const LayerId kLayer{"a.usda"}, kOther{"b.usda"};

Edit on(std::string path, EditAction action, std::optional<Creation> creation = {}) {
    return {kLayer, {std::move(path), creation}, std::move(action)};
}
MoveSpec moveTo(std::string parent, std::string name, std::optional<Creation> creation = {}) {
    return {{std::move(parent), creation}, std::move(name)};
}
const CreateSpec kPrim{SpecKind::Prim}, kAttribute{SpecKind::Attribute};

// A server with one author, or with several that share the client id but not the creations.
struct Server {
    LayerDocs layers{{kLayer, {}}, {kOther, {}}};
    NamespaceLog log;
    OwnCreations creations;
    Revision revision = 0;
    std::uint64_t sequence = 0;

    LayerDoc& doc() { return layers[kLayer]; }

    Outcome submit(Revision base, std::vector<Edit> edits) {
        const Transaction transaction{{{"me"}, ++sequence}, base, 0, std::move(edits)};
        creations.seen(base);
        Outcome outcome = execute(layers, log, creations, transaction, revision + 1);
        if (std::holds_alternative<Executed>(outcome)) ++revision;
        return outcome;
    }

    // Commits edits of another author, based on the current content.
    void foreign(std::vector<Edit> edits) {
        OwnCreations theirs;
        const Transaction transaction{{{"other"}, 1}, revision, 0, std::move(edits)};
        const Outcome outcome = execute(layers, log, theirs, transaction, revision + 1);
        const auto* executed = std::get_if<Executed>(&outcome);
        ASSERT_TRUE(executed && executed->dropped.empty());
        ++revision;
    }

    ErrorCode refusal(Revision base, std::vector<Edit> edits, std::uint32_t edit = 0) {
        const std::string before = doc().dump();
        const auto mark = log.mark();
        const Outcome outcome = submit(base, std::move(edits));
        EXPECT_EQ(doc().dump(), before);
        EXPECT_EQ(log.mark(), mark);
        const auto* refused = std::get_if<Refused>(&outcome);
        EXPECT_NE(refused, nullptr);
        if (!refused) return {};
        EXPECT_EQ(refused->edit, edit);
        return refused->error.code;
    }

    Executed accepted(Revision base, std::vector<Edit> edits) {
        const Outcome outcome = submit(base, std::move(edits));
        const auto* refused = std::get_if<Refused>(&outcome);
        EXPECT_EQ(refused, nullptr) << refused->error.message;
        return refused ? Executed{} : std::get<Executed>(outcome);
    }
};

std::vector<std::string> pathsOf(const Executed& executed) {
    std::vector<std::string> paths;
    for (const auto& edit : executed.edits) paths.push_back(edit.edit.address.path);
    return paths;
}

using Paths = std::vector<std::string>;

}  // namespace

TEST(TransactionExecutor, M3AnEditArrivesAtTheRenamedPrim) {
    Server server;
    server.foreign({on("/A", kPrim), on("/A/B", kPrim), on("/A/B.x", kAttribute)});
    const Revision base = server.revision;
    server.foreign({on("/A", moveTo("/", "Z"))});
    server.foreign({on("/A", kPrim), on("/A/B", kPrim), on("/A/B.x", kAttribute)});
    const auto executed = server.accepted(base, {on("/A/B.x", setInt("default", 1))});
    EXPECT_EQ(pathsOf(executed), Paths{"/Z/B.x"});
    EXPECT_NE(server.doc().field("/Z/B.x", "default"), nullptr);
    EXPECT_EQ(server.doc().field("/A/B.x", "default"), nullptr);
}

TEST(TransactionExecutor, M3AddressesMeanTheBaseAlsoAfterOwnMoves) {
    Server server;
    server.foreign({on("/A", kPrim), on("/B", kPrim)});
    const auto executed =
        server.accepted(server.revision, {on("/A", moveTo("/", "T")), on("/B", moveTo("/", "A")),
                                          on("/A", moveTo("/", "B")), on("/A", setInt("was", 1)),
                                          on("/B", setInt("was", 2))});
    EXPECT_EQ(pathsOf(executed), (Paths{"/A", "/B", "/T", "/B", "/A"}));
    EXPECT_EQ(*server.doc().field("/B", "was"), FieldValue(intValue(1)));
}

TEST(TransactionExecutor, M3APlaceFollowsOnlyItsParent) {
    Server server;
    server.foreign({on("/A", kPrim), on("/A/N", kPrim)});
    const Revision base = server.revision;
    server.foreign({on("/A/N", moveTo("/", "Elsewhere")), on("/A", moveTo("/", "P"))});
    EXPECT_EQ(pathsOf(server.accepted(base, {on("/A/N", kPrim)})), Paths{"/P/N"});
    const Revision later = server.revision;
    server.foreign({on("/P/N", DeleteSpec{})});
    EXPECT_EQ(pathsOf(server.accepted(later, {on("/P/N", kPrim)})), Paths{"/P/N"});
}

TEST(TransactionExecutor, M3TheNewParentOfAMoveIsFollowed) {
    Server server;
    server.foreign({on("/A", kPrim), on("/B", kPrim)});
    const Revision base = server.revision;
    server.foreign({on("/B", moveTo("/", "C"))});
    server.accepted(base, {on("/A", moveTo("/B", "A"))});
    EXPECT_TRUE(server.doc().has("/C/A"));
}

TEST(TransactionExecutor, M3CreationsAreFollowedThroughPendingTransactions) {
    Server server;
    const Revision base = server.revision;
    server.accepted(base, {on("/A", kPrim),                       // 1, 0
                           on("/N", kPrim, Creation{1, 0}),       // 1, 1
                           on(".x", kAttribute, Creation{1, 1}),  // 1, 2
                           on("", setInt("default", 1), Creation{1, 2})});
    EXPECT_TRUE(server.doc().has("/A/N.x"));
    server.foreign({on("/A", moveTo("/", "Z")), on("/A", kPrim), on("/A/N", kPrim)});
    const auto executed = server.accepted(
        base, {on("", setInt("default", 2), Creation{1, 2}),
               on("", moveTo("", "M", Creation{1, 0}), Creation{1, 1}),
               on("{v=}", CreateSpec{SpecKind::VariantSet}, Creation{1, 1}),  // 2, 2
               on("{v=one}", CreateSpec{SpecKind::Variant}, Creation{2, 2}),  // 2, 3
               on("B", kPrim, Creation{2, 3}), on("/A", kPrim)});
    EXPECT_EQ(pathsOf(executed),
              (Paths{"/Z/N.x", "/Z/N", "/Z/M{v=}", "/Z/M{v=one}", "/Z/M{v=one}B", "/A"}));
}

TEST(TransactionExecutor, M3CreationsAreForgottenWhenTheAuthorHasSeenThem) {
    Server server;
    server.accepted(0, {on("/A", kPrim)});
    server.accepted(0, {on("", setInt("f", 1), Creation{1, 0})});
    server.accepted(server.revision, {on("/A", setInt("f", 2))});
    EXPECT_EQ(server.creations.find({1, 0}), nullptr);
}

TEST(TransactionExecutor, M3OwnDeleteAndRecreateAreTwoSpecs) {
    Server server;
    server.foreign({on("/A", kPrim), on("/A/B", kPrim)});
    const auto executed = server.accepted(
        server.revision, {on("/A", DeleteSpec{}), on("/A", kPrim), on("/A/B", setInt("f", 1)),
                          on("/B", kPrim, Creation{1, 1})});
    EXPECT_EQ(pathsOf(executed), (Paths{"/A", "/A", "/A/B"}));
    ASSERT_EQ(executed.dropped.size(), 1U);
    EXPECT_EQ(executed.dropped[0].index, 2U);
    EXPECT_EQ(executed.dropped[0].reason, ErrorCode::SpecDeleted);
    EXPECT_EQ(executed.dropped[0].edit, on("/A/B", setInt("f", 1)));
}

TEST(TransactionExecutor, M4AnEditBelowADeletedSpecIsDroppedAndTheOthersStay) {
    Server server;
    server.foreign({on("/A", kPrim), on("/A/B", kPrim), on("/C", kPrim)});
    const Revision base = server.revision;
    server.foreign({on("/A", DeleteSpec{})});
    const auto executed = server.accepted(
        base, {on("/A/B", setInt("f", 1)), on("/C", setInt("f", 1)), on("/A/N", kPrim),
               on(".x", kAttribute, Creation{1, 2}), on("/A", DeleteSpec{}),
               on("/C", moveTo("/A", "C")), on("/nowhere", setInt("f", 1)), on("/nowhere/N", kPrim),
               on("", setInt("f", 1), Creation{77, 0})});
    EXPECT_EQ(pathsOf(executed), Paths{"/C"});
    std::vector<std::pair<std::uint32_t, ErrorCode>> dropped;
    for (const auto& item : executed.dropped) dropped.emplace_back(item.index, item.reason);
    const std::vector<std::pair<std::uint32_t, ErrorCode>> expected{
        {0, ErrorCode::SpecDeleted},  {2, ErrorCode::SpecDeleted}, {3, ErrorCode::SpecDeleted},
        {4, ErrorCode::SpecDeleted},  {5, ErrorCode::SpecDeleted}, {6, ErrorCode::SpecNotFound},
        {7, ErrorCode::SpecNotFound}, {8, ErrorCode::SpecDeleted}};
    EXPECT_EQ(dropped, expected);
}

TEST(TransactionExecutor, M2MergesAreKeptInTheCommit) {
    Server server;
    server.foreign({on("/A", kPrim)});
    const auto executed =
        server.accepted(0, {on("/A", kPrim), on("", setInt("f", 1), Creation{1, 0}),
                            on("", EraseField{"g", {}}, Creation{1, 0})});
    ASSERT_EQ(executed.edits.size(), 3U);
    EXPECT_FALSE(executed.edits[0].applied.changed);
    EXPECT_FALSE(executed.edits[2].applied.changed);
    EXPECT_NE(server.doc().field("/A", "f"), nullptr);
}

// Found by seed 8733 of the simulation: a server whose store was rolled back has another spec of
// that name.
TEST(TransactionExecutor, ED7AnEditForTheOtherKindOfPropertyIsDropped) {
    Server server;
    server.foreign({on("/A", kPrim), on("/A.x", CreateSpec{SpecKind::Relationship})});
    const auto executed = server.accepted(
        server.revision, {on("/A", setInt("f", 1)), on("/A.x", setInt("default", 1)),
                          on("/A.x", EraseField{"default", {}})});
    EXPECT_EQ(pathsOf(executed), (Paths{"/A", "/A.x"}));
    ASSERT_EQ(executed.dropped.size(), 1U);
    EXPECT_EQ(executed.dropped[0].index, 1U);
    EXPECT_EQ(executed.dropped[0].reason, ErrorCode::SpecKindConflict);
    EXPECT_EQ(server.doc().field("/A.x", "default"), nullptr);
}

TEST(TransactionExecutor, M6ARefusedTransactionChangesNothing) {
    Server server;
    server.foreign({on("/A", kPrim), on("/B", kPrim), on("/A.x", kAttribute)});
    const Revision base = server.revision;
    const auto set = on("/A", setInt("f", 1));
    EXPECT_EQ(server.refusal(base,
                             {set, on("/B", moveTo("/", "C")), on("/A", moveTo("/", "B")),
                              on("/A", moveTo("/", "C"))},
                             3),
              ErrorCode::SpecExists);
    EXPECT_EQ(server.refusal(base, {set, on("/A", moveTo("/A", "B"))}, 1),
              ErrorCode::MoveIntoItself);
    EXPECT_EQ(server.refusal(base, {set, on("/A.x", CreateSpec{SpecKind::Relationship})}, 1),
              ErrorCode::SpecKindConflict);
    EXPECT_EQ(server.refusal(base, {set, on("/", DeleteSpec{})}, 1), ErrorCode::InvalidEdit);
    EXPECT_EQ(server.refusal(base, {set, on("/", kPrim)}, 1), ErrorCode::InvalidEdit);
    EXPECT_EQ(server.refusal(base, {set, on("x", setInt("f", 1))}, 1), ErrorCode::InvalidPath);
    EXPECT_EQ(server.refusal(base, {set, on("x", kPrim)}, 1), ErrorCode::InvalidPath);
    EXPECT_EQ(server.refusal(base, {set, on("/A", setInt("", 1))}, 1), ErrorCode::InvalidEdit);
    EXPECT_EQ(server.refusal(base, {set, on("/", setInt("timeCodesPerSecond", 1))}, 1),
              ErrorCode::InvalidValue);
    EXPECT_EQ(
        server.refusal(
            base, {on("/N", kPrim), on("?", setInt("f", 1), Creation{server.sequence + 1, 0})}, 1),
        ErrorCode::InvalidPath);
    Edit elsewhere = set;
    elsewhere.layer = {"c.usda"};
    EXPECT_EQ(server.refusal(base, {set, elsewhere}, 1), ErrorCode::LayerNotFound);
    EXPECT_EQ(server.refusal(base,
                             {on("/N", kPrim),
                              Edit{kOther, {"", Creation{server.sequence + 1, 0}}, DeleteSpec{}}},
                             1),
              ErrorCode::InvalidEdit);
}

TEST(TransactionExecutor, M6ARefusalRevertsAllLayers) {
    Server server;
    const Edit other{kOther, {"/X", {}}, kPrim};
    EXPECT_EQ(server.refusal(0, {on("/A", kPrim), other, on("/", DeleteSpec{})}, 2),
              ErrorCode::InvalidEdit);
    EXPECT_FALSE(server.layers[kOther].has("/X"));
    EXPECT_EQ(server.creations.find({1, 0}), nullptr);
}

TEST(TransactionExecutor, RefusesBasesThatAreTooOldOrNotYetThere) {
    Server server;
    server.foreign({on("/A", kPrim)});
    server.foreign({on("/A", moveTo("/", "B"))});
    const auto set = on("/B", setInt("f", 1));
    EXPECT_EQ(server.refusal(3, {set}), ErrorCode::FutureRevision);
    server.log.prune(2);
    EXPECT_EQ(server.refusal(1, {set}), ErrorCode::StaleBase);
    server.accepted(2, {set});
}

TEST(TransactionExecutor, AReplicaThatDivergedNamesTheLayerAndKeepsTheOthers) {
    LayerDocs layers{{kLayer, {}}, {kOther, {}}};
    NamespaceLog log;
    Commit commit;
    commit.revision = 1;
    commit.edits = {on("/missing", setInt("f", 1)),
                    on("/A", kPrim),
                    {kOther, {"/X", {}}, kPrim},
                    {{"absent.usda"}, {"/X", {}}, kPrim}};
    const auto applied = applyCommit(layers, log, commit);
    ASSERT_FALSE(applied);
    EXPECT_NE(applied.error().message.find("a.usda"), std::string::npos);
    EXPECT_FALSE(layers[kLayer].has("/A"));
    EXPECT_TRUE(layers[kOther].has("/X"));
}

// ---- several authors with old bases

namespace {

// An edit of a random transaction, with its intended spec by identity.
struct Intent {
    NodeId target = 0;  // the spec (for a Create: the parent); 0 if it was never created
    NodeId parent = 0;  // the new parent of a Move
};

// A spec that an author created: its id on the server (0 if the creation failed) and the path that
// the author knows.
struct Made {
    NodeId node = 0;
    std::string local;
};

// An author who sees the project at its base, with its own creations since. It also runs a replica
// like a client, whose predictions must be correct.
struct Author {
    ClientId client;
    std::uint64_t sequence = 0;
    Revision base = 0;
    LayerDoc seen;
    std::map<Creation, Made> created;  // since the base
    OwnCreations onServer;
    LayerDocs replica{{kLayer, {}}};
    NamespaceLog log;
    OwnCreations onReplica;
};

class Authoring {
public:
    explicit Authoring(unsigned seed) : random_(seed) {
        authors_[0].client = {"ada"};
        authors_[1].client = {"bo"};
    }

    void run(int steps) {
        for (int step = 0; step < steps && !testing::Test::HasFailure(); ++step) {
            Author& author = authors_[random_.below(2)];
            if (random_.chance(4)) synchronize(author);
            submit(author);
        }
        for (const Author& author : authors_)
            EXPECT_EQ(author.replica.at(kLayer).dump(), doc().dump());
    }

    int executed = 0, dropped = 0, refused = 0;

private:
    LayerDoc& doc() { return layers_[kLayer]; }

    void synchronize(Author& author) {
        author.base = revision_;
        author.seen = doc();
        author.created.clear();
    }

    struct Known {
        Address address;
        NodeId node;
        std::string local;
        [[nodiscard]] bool isPrim() const {
            return local != "/" && specpath::last(local).list == ChildList::Prims;
        }
        [[nodiscard]] bool isProperty() const {
            return local != "/" && specpath::last(local).list == ChildList::Properties;
        }
    };

    // Returns a spec that the author knows: by its path at the base, or by its creation.
    Known known(Author& author) {
        std::vector<Known> all;
        author.seen.visit([&](const LayerDoc::SpecView& spec) {
            const std::string path(spec.path);
            all.push_back({{path, {}}, spec.node, path});
        });
        for (const auto& [creation, made] : author.created)
            all.push_back({{"", creation}, made.node, made.local});
        return random_.of(all);
    }

    Edit randomEdit(Author& author, Intent& intent, std::string& local) {
        const Known spec = known(author);
        intent.target = spec.node;
        const std::size_t choice = random_.below(8);
        if (choice == 0) return {kLayer, spec.address, DeleteSpec{}};
        if (choice == 1 && spec.isPrim()) {
            const Known parent = known(author);
            intent.parent = parent.node;
            return {kLayer, spec.address, MoveSpec{parent.address, random_.name()}};
        }
        if (choice < 4 || spec.isProperty())
            return {kLayer, spec.address, setInt("f", static_cast<int>(++number_ % 100))};
        const auto [path, kind] = random_.childOf(spec.local);
        local = path;
        const std::string address = spec.address.creation ? relativePath(path, spec.local) : path;
        return {kLayer, {address, spec.address.creation}, CreateSpec{kind}};
    }

    void submit(Author& author) {
        Transaction transaction{{author.client, ++author.sequence}, author.base, 0, {}};
        std::vector<Intent> intents;
        const auto before = author.created;
        for (std::size_t count = 1 + random_.below(4); count > 0; --count) {
            const auto index = static_cast<std::uint32_t>(transaction.edits.size());
            intents.emplace_back();
            std::string local;
            transaction.edits.push_back(randomEdit(author, intents.back(), local));
            if (!local.empty())
                author.created[{author.sequence, index}] = {kUnknown - index, local};
        }
        predictAndExecute(author, transaction, intents, before);
    }

    void predictAndExecute(Author& author, const Transaction& transaction,
                           std::vector<Intent>& intents, const std::map<Creation, Made>& before) {
        LayerDocs predicted = author.replica;
        NamespaceLog log = author.log;
        OwnCreations creations = author.onReplica;
        const Outcome expected = execute(predicted, log, creations, transaction, revision_ + 1);
        const std::string text = doc().dump();
        const Outcome outcome = execute(layers_, log_, author.onServer, transaction, revision_ + 1);
        ASSERT_EQ(outcome.index(), expected.index());
        if (std::holds_alternative<Refused>(outcome)) {
            ++refused;
            EXPECT_EQ(doc().dump(), text);
            author.created = before;
            return;
        }
        ++revision_;
        const auto& done = std::get<Executed>(outcome);
        EXPECT_EQ(predicted.at(kLayer).dump(), doc().dump());
        check(author, transaction, intents, done);
        commit(author, transaction, done);
    }

    // Checks that each edit reached its intended spec, wherever that is, or was dropped because the
    // spec was deleted.
    void check(Author& author, const Transaction& transaction, std::vector<Intent>& intents,
               const Executed& done) {
        std::map<NodeId, NodeId> made;  // placeholder ids of this transaction
        const auto actual = [&](NodeId node) { return node > kUnknown - 100 ? made[node] : node; };
        auto executedEdit = done.edits.begin();
        auto droppedEdit = done.dropped.begin();
        for (std::uint32_t i = 0; i < transaction.edits.size(); ++i) {
            const auto& action = transaction.edits[i].action;
            const bool creates = std::holds_alternative<CreateSpec>(action);
            const bool moves = std::holds_alternative<MoveSpec>(action);
            const NodeId target = actual(intents[i].target);
            const NodeId parent = actual(intents[i].parent);
            if (droppedEdit != done.dropped.end() && droppedEdit->index == i) {
                EXPECT_TRUE(!isAlive(target) || (moves && !isAlive(parent)));
                EXPECT_EQ(droppedEdit->reason, ErrorCode::SpecDeleted);
                EXPECT_EQ(droppedEdit->edit, transaction.edits[i]);
                if (creates) made[kUnknown - i] = author.created[{author.sequence, i}].node = 0;
                ++droppedEdit;
                ++dropped;
                continue;
            }
            ASSERT_NE(executedEdit, done.edits.end());
            const auto& applied = executedEdit->applied;
            EXPECT_EQ(creates ? applied.parent : applied.node, target);
            EXPECT_TRUE(isAlive(target));
            if (moves) {
                EXPECT_EQ(applied.parent, parent);
            }
            if (creates) {
                made[kUnknown - i] = author.created[{author.sequence, i}].node = applied.node;
                alive_.insert(applied.node);
            }
            for (const NodeId node : applied.erased) alive_.erase(node);
            ++executedEdit;
            ++executed;
        }
        EXPECT_EQ(executedEdit, done.edits.end());
        EXPECT_EQ(droppedEdit, done.dropped.end());
    }

    [[nodiscard]] bool isAlive(NodeId node) const { return alive_.contains(node); }

    void commit(Author& author, const Transaction& transaction, const Executed& done) {
        Commit commit;
        commit.revision = revision_;
        commit.id = transaction.id;
        for (const auto& edit : done.edits) commit.edits.push_back(edit.edit);
        commit.dropped = done.dropped;
        for (Author& other : authors_) {
            const auto applied = applyCommit(other.replica, other.log, commit);
            ASSERT_TRUE(applied) << applied.error().message;
            if (&other != &author) continue;
            other.onReplica.seen(transaction.base);
            recordCreations(other.onReplica, other.log, transaction, commit);
        }
    }

    static constexpr NodeId kUnknown = ~NodeId{0};

    RandomEdits random_;
    LayerDocs layers_{{kLayer, {}}};
    NamespaceLog log_;
    Revision revision_ = 0;
    std::array<Author, 2> authors_;
    std::set<NodeId> alive_{kRootNode};
    int number_ = 0;
};

}  // namespace

TEST(TransactionExecutor, M3ToM6HoldForTwoAuthorsWithOldBases) {
    constexpr unsigned kSeeds = seedsOf(1000);
    unsigned executed = 0;
    unsigned dropped = 0;
    unsigned refused = 0;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
        SCOPED_TRACE(seed);
        Authoring authoring(seed);
        authoring.run(60);
        if (HasFailure()) return;
        executed += authoring.executed;
        dropped += authoring.dropped;
        refused += authoring.refused;
    }
    // Checks that the seeds reach all tested cases.
    EXPECT_GT(executed, 10 * kSeeds);
    EXPECT_GT(dropped, 10 * kSeeds);
    EXPECT_GT(refused, kSeeds);
}

// ---- M13: a spec that two authors create at once

namespace {

SetField specifierIs(std::uint8_t number) {
    return {"specifier", {}, Value(ValueType::Specifier, Bytes{number}), {}};
}
constexpr std::uint8_t kDef = 0, kOver = 1, kClass = 2;

}  // namespace

TEST(TransactionExecutor, M13AnOverCreatedOnTheWayKeepsTheSpecifier) {
    for (const std::uint8_t theirs : {kDef, kClass}) {
        Server server;
        server.foreign({on("/A", kPrim), on("", specifierIs(theirs), Creation{1, 0})});
        const auto executed = server.accepted(
            0, {on("/A", kPrim), on("", specifierIs(kOver), Creation{1, 0}),
                on("/B", kPrim, Creation{1, 0}), on("", specifierIs(kOver), Creation{1, 2})});
        EXPECT_EQ(*server.doc().field("/A", "specifier"), specifierIs(theirs).value);
        EXPECT_EQ(*server.doc().field("/A/B", "specifier"), specifierIs(kOver).value);
        // The commit contains the result, so that receivers need no special case.
        ASSERT_EQ(executed.edits.size(), 4u);
        EXPECT_EQ(executed.edits[1].edit.action, EditAction(specifierIs(theirs)));
        EXPECT_FALSE(executed.edits[1].applied.changed);
    }
}

TEST(TransactionExecutor, M13AnExplicitSpecifierIsSet) {
    Server server;
    server.foreign({on("/A", kPrim), on("", specifierIs(kDef), Creation{1, 0})});
    server.accepted(0, {on("/A", kPrim), on("", specifierIs(kClass), Creation{1, 0})});
    EXPECT_EQ(*server.doc().field("/A", "specifier"), specifierIs(kClass).value);
    server.accepted(0, {on("", specifierIs(kOver), Creation{1, 0})});
    EXPECT_EQ(*server.doc().field("/A", "specifier"), specifierIs(kOver).value);
    // A spec that was deleted and created again is another spec.
    server.accepted(0, {on("", specifierIs(kDef), Creation{1, 0})});
    server.accepted(
        2, {on("/A", DeleteSpec{}), on("/A", kPrim), on("", specifierIs(kOver), Creation{4, 1})});
    EXPECT_EQ(*server.doc().field("/A", "specifier"), specifierIs(kOver).value);
}

TEST(TransactionExecutor, M13PartsOfBothAreKept) {
    const auto samples = [](double time, double value) {
        return SetField{"timeSamples",
                        {},
                        TimeSamples{{{0, doubleValue(value)}, {time, doubleValue(value)}}},
                        {}};
    };
    Server server;
    server.foreign({on("/A", kPrim), on("/A.x", kAttribute), on("/A.x", samples(1, 1))});
    server.accepted(0, {on("/A", kPrim), on(".x", kAttribute, Creation{1, 0}),
                        on("", samples(2, 2), Creation{1, 1})});
    const TimeSamples both{{{0, doubleValue(2)}, {1, doubleValue(1)}, {2, doubleValue(2)}}};
    EXPECT_EQ(*server.doc().field("/A.x", "timeSamples"), FieldValue(both));
}
