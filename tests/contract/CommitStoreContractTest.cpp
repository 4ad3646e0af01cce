// Tests all stores of a project's history with one suite: in memory and RocksDB.

#include <gtest/gtest.h>

#include "storage/MemoryCommitStore.h"
#include "storage/RocksCommitStore.h"
#include "unit/Seeds.h"
#include "unit/server/storage/TestCommits.h"

namespace usdlive::server {
namespace {

using test::RandomEdits;
using test::TestCommits;

const LayerId kLayer{"a.usda"}, kOther{"b.usda"};

/// A place that holds a store, which can be opened again.
class Disk {
public:
    virtual ~Disk() = default;
    virtual std::unique_ptr<CommitStore> open() = 0;
};

class InMemory final : public Disk {
public:
    std::unique_ptr<CommitStore> open() override { return createMemoryCommitStore(disk_); }

private:
    std::shared_ptr<MemoryDisk> disk_ = createMemoryDisk();
};

class InRocks final : public Disk {
public:
    std::unique_ptr<CommitStore> open() override {
        RocksCommitStoreOptions options;
        options.durability = Durability::OperatingSystem;
        options.minFreeBytes = 0;
        options.reserveBytes = 0;
        auto store = createRocksCommitStore(folder_.path, options);
        if (!store) throw std::runtime_error(store.error().message);
        return std::move(*store);
    }

private:
    test::TestFolder folder_;
};

template <class Where>
class CommitStoreContract : public testing::Test {
public:
    void reopen() {
        store.reset();
        store = disk.open();
    }
    Result<void> append(const CommitRecord& commit) { return store->append({&commit, 1}); }
    void expectLayers() {
        for (const auto& [layer, doc] : commits.layers) {
            const auto stored = store->loadLayer(layer);
            ASSERT_TRUE(stored) << stored.error().message;
            ASSERT_TRUE(*stored) << layer.value;
            ASSERT_EQ((*stored)->dump(), doc.dump());
            ASSERT_TRUE(**stored == doc);
        }
    }

    Where disk;
    std::unique_ptr<CommitStore> store = disk.open();
    TestCommits commits;
};

using Disks = testing::Types<InMemory, InRocks>;
TYPED_TEST_SUITE(CommitStoreContract, Disks);

std::vector<Revision> revisions(const CommitStore& store, Revision from, Revision to) {
    std::vector<Revision> all;
    EXPECT_TRUE(store.read(from, to, [&](const StoredCommit& commit) {
        all.push_back(commit.revision);
        return true;
    }));
    return all;
}

TYPED_TEST(CommitStoreContract, ID1HasAnIdentityOfItsOwnForEver) {
    const StoreId identity = this->store->identity();
    EXPECT_EQ(identity.value.size(), 32u);
    TypeParam another;
    EXPECT_NE(another.open()->identity(), identity);
    this->reopen();
    EXPECT_EQ(this->store->identity(), identity);
}

TYPED_TEST(CommitStoreContract, BeginsEmpty) {
    EXPECT_EQ(this->store->head().revision, 0u);
    EXPECT_EQ(this->store->head().hash, Hash());
    EXPECT_EQ(this->store->head().epoch, 1u);
    EXPECT_TRUE(this->store->layers()->empty());
    EXPECT_FALSE(*this->store->loadLayer(kLayer));
    EXPECT_TRUE(revisions(*this->store, 1, 100).empty());
    EXPECT_TRUE(this->store->hasSpace());
    EXPECT_TRUE(this->store->append({}));
}

TYPED_TEST(CommitStoreContract, OpeningAgainKeepsAllAndTakesTheNextEpoch) {
    std::vector<CommitRecord> group;
    for (int number = 0; number < 5; ++number)
        group.push_back(
            this->commits.next(kLayer, "/P" + std::to_string(number), CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(this->store->append(group));
    for (Epoch epoch = 1; epoch < 4; ++epoch) {
        EXPECT_EQ(this->store->head().revision, 5u);
        EXPECT_EQ(this->store->head().hash, group.back().hash);
        EXPECT_EQ(this->store->head().epoch, epoch);
        std::size_t at = 0;
        EXPECT_TRUE(this->store->read(0, ~Revision(0), [&](const StoredCommit& commit) {
            EXPECT_EQ(commit.revision, group[at].revision);
            EXPECT_EQ(*commit.frame, *group[at].frame);
            EXPECT_EQ(commit.hash, group[at].hash);
            return ++at < group.size() + 1;
        }));
        EXPECT_EQ(at, group.size());
        this->expectLayers();
        this->reopen();
    }
}

TYPED_TEST(CommitStoreContract, ReadsARangeAndStopsOnRequest) {
    for (int number = 0; number < 9; ++number) ASSERT_TRUE(this->append(this->commits.empty()));
    EXPECT_EQ(revisions(*this->store, 3, 5), (std::vector<Revision>{3, 4, 5}));
    EXPECT_EQ(revisions(*this->store, 8, 20), (std::vector<Revision>{8, 9}));
    EXPECT_TRUE(revisions(*this->store, 10, 20).empty());
    int visits = 0;
    EXPECT_TRUE(this->store->read(1, 9, [&](const StoredCommit&) { return ++visits < 2; }));
    EXPECT_EQ(visits, 2);
    EXPECT_EQ(*this->store->hashAt(9), this->commits.head.hash);
    EXPECT_EQ(*this->store->hashAt(0), Hash());
    EXPECT_EQ(this->store->hashAt(10).error().code, ErrorCode::FutureRevision);
}

TYPED_TEST(CommitStoreContract, RefusesAGapAndAWrongHash) {
    const auto first = this->commits.empty(), second = this->commits.empty();
    EXPECT_EQ(this->append(second).error().code, ErrorCode::Internal);
    auto wrong = first;
    wrong.hash.bytes[0] ^= 1;
    EXPECT_EQ(this->append(wrong).error().code, ErrorCode::Internal);
    const std::vector group{first, first};
    EXPECT_EQ(this->store->append(group).error().code, ErrorCode::Internal);
    EXPECT_EQ(this->store->head().revision, 0u) << "all or nothing";
    EXPECT_TRUE(this->append(first));
    EXPECT_TRUE(this->append(second));
}

/// Appends groups of random edits of two layers to a store, and checks that it returns their
/// results.
template <class Where>
class RandomHistory {
public:
    explicit RandomHistory(unsigned seed) : random(seed) {}

    /// Calls `made` after each commit of the group, before the group is appended.
    template <class Made>
    void appendGroup(Made made) {
        std::vector<CommitRecord> group;
        for (auto size = random.below(6) + 1; size > 0; --size) {
            const LayerId& layer = random.below(3) ? kLayer : kOther;
            commits.inParts = commits.head.revision % 4 == 3;  // FR8
            group.push_back(commits.next(random.next(layer, commits.layers[layer])));
            made();
        }
        ASSERT_TRUE(store->append(group));
    }
    /// Compares once in `times` calls; half of these after opening the store again.
    void compare(std::size_t times) {
        if (random.below(times)) return;
        if (random.below(2)) {
            store.reset();
            store = disk.open();
        }
        for (const auto& [layer, doc] : commits.layers) {
            const auto stored = store->loadLayer(layer);
            ASSERT_TRUE(stored) << stored.error().message;
            ASSERT_EQ(stored->value_or(LayerDoc()).dump(), doc.dump());
        }
    }

    RandomEdits random;
    Where disk;
    std::unique_ptr<CommitStore> store = disk.open();
    TestCommits commits;
};

TYPED_TEST(CommitStoreContract, StateFollowsAnyEdits) {
    for (unsigned seed = 0; seed < seedsOf(15); ++seed) {
        RandomHistory<TypeParam> history(seed);
        for (int step = 0; step < 60; ++step) {
            SCOPED_TRACE(testing::Message() << "seed " << seed << ", step " << step);
            ASSERT_NO_FATAL_FAILURE(history.appendGroup([] {}));
            ASSERT_NO_FATAL_FAILURE(history.compare(8));
        }
    }
}

TYPED_TEST(CommitStoreContract, AnImportedLayerIsThereAndSaved) {
    ASSERT_TRUE(this->append(this->commits.import(kOther, LayerDoc())));
    EXPECT_EQ(*this->store->layers(), std::vector{kOther});
    EXPECT_TRUE(this->store->loadLayer(kOther)->has_value()) << "though it is empty";

    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A.x", CreateSpec{SpecKind::Attribute}));
    for (double time : {-2.0, -0.5, 0.0, 1e-300, 3.0, 1e300})
        ASSERT_TRUE(
            doc.apply("/A.x", SetField{"timeSamples", SampleTime{time}, doubleValue(time)}));
    ASSERT_TRUE(doc.apply("/A.x", SetField{"default", {}, doubleValue(1)}));
    ASSERT_TRUE(this->append(this->commits.import(kLayer, doc)));
    EXPECT_EQ(this->store->saved(kLayer)->revision, 2u);
    EXPECT_EQ(this->store->saved(kLayer)->file, test::kFile);
    EXPECT_TRUE(this->store->unsavedLayers()->empty());
    this->expectLayers();
    this->reopen();
    this->expectLayers();
    EXPECT_EQ(*this->store->layers(), (std::vector{kLayer, kOther}));

    ASSERT_TRUE(this->append(this->commits.next(kLayer, "/B", CreateSpec{SpecKind::Prim})));
    EXPECT_EQ(*this->store->unsavedLayers(), std::vector{kLayer});
    this->reopen();
    EXPECT_EQ(*this->store->unsavedLayers(), std::vector{kLayer});
    const SavedState saved{3, FileStamp{{9, 8, 7, 6}, {}}, SavedState::PendingSave{4, sha256({})}};
    ASSERT_TRUE(this->store->setSaved(kLayer, saved));
    this->reopen();
    EXPECT_EQ(*this->store->saved(kLayer), saved);
    EXPECT_TRUE(this->store->unsavedLayers()->empty());
    EXPECT_EQ(*this->store->saved({"c.usda"}), SavedState());
    EXPECT_EQ(this->store->setSaved({"c.usda"}, saved).error().code, ErrorCode::LayerNotFound);
}

// The store loads the snapshot and the commits since. A snapshot of another revision would
// therefore be noticed.
TYPED_TEST(CommitStoreContract, ASnapshotIsFollowedByTheCommitsSince) {
    for (unsigned seed = 0; seed < seedsOf(15); ++seed) {
        RandomHistory<TypeParam> history(seed);
        LayerDocs before;
        CommitStore::Head at;
        for (int step = 0; step < 60; ++step) {
            SCOPED_TRACE(testing::Message() << "seed " << seed << ", step " << step);
            ASSERT_NO_FATAL_FAILURE(history.appendGroup([&] {
                if (history.random.below(12)) return;  // compares also in the middle of a group
                before = history.commits.layers;
                at = history.commits.head;
            }));
            const auto known = *history.store->layers();
            if (history.random.below(4) == 0)
                for (const auto& [layer, doc] : before)
                    if (std::ranges::find(known, layer) != known.end()) {
                        ASSERT_TRUE(history.store->keepSnapshot(layer, doc, at.revision, at.hash));
                    }
            ASSERT_NO_FATAL_FAILURE(history.compare(4));
        }
    }
}

TYPED_TEST(CommitStoreContract, ALayerCanBeReadAtEachRevision) {
    for (unsigned seed = 0; seed < seedsOf(8); ++seed) {
        RandomHistory<TypeParam> history(seed);
        std::vector<LayerDocs> contents(1);  // by revision
        std::map<LayerId, Revision> first;
        for (int step = 0; step < 40; ++step) {
            SCOPED_TRACE(testing::Message() << "seed " << seed << ", step " << step);
            ASSERT_NO_FATAL_FAILURE(
                history.appendGroup([&] { contents.push_back(history.commits.layers); }));
            const Revision newest = contents.size() - 1;
            const auto layers = *history.store->layers();
            for (const LayerId& layer : layers) first.try_emplace(layer);
            for (auto& [layer, revision] : first)
                while (contents[revision][layer] == LayerDoc()) ++revision;
            if (history.random.below(4) == 0)
                for (const LayerId& layer : layers) {
                    const Revision at = std::max(
                        first[layer], newest - history.random.below(std::min(newest, 5UL)));
                    ASSERT_TRUE(history.store->keepSnapshot(layer, contents[at][layer], at,
                                                            *history.store->hashAt(at)));
                }
            const Revision wanted = history.random.below(newest + 1);
            for (const LayerId& layer : layers) {
                const auto found = history.store->layerAt(layer, wanted);
                ASSERT_TRUE(found) << found.error().message;
                ASSERT_EQ((*found)->dump(), contents[std::max(wanted, first[layer])][layer].dump())
                    << layer.value << " at " << wanted;
            }
            EXPECT_FALSE(*history.store->layerAt({"c.usda"}, wanted));
            ASSERT_NO_FATAL_FAILURE(history.compare(8));
        }
    }
}

bool always() { return true; }

/// Checks a whole store from its base on: its chain, and the content of each layer at each
/// revision.
template <class Where>
void expectFromBase(RandomHistory<Where>& history, std::vector<LayerDocs>& contents,
                    std::map<LayerId, Revision>& first) {
    const CommitStore& store = *history.store;
    const auto base = store.base();
    const Revision newest = store.head().revision;
    ASSERT_EQ(*store.hashAt(base.revision), base.hash);
    Hash hash = base.hash;
    Revision next = base.revision;
    ASSERT_TRUE(store.read(0, ~Revision(0), [&](const StoredCommit& commit) {
        EXPECT_EQ(commit.revision, ++next);
        hash = chainHash(hash, withoutLength(*commit.frame));
        EXPECT_EQ(commit.hash, hash);
        EXPECT_EQ(*store.hashAt(next), hash);
        return true;
    }));
    ASSERT_EQ(next, newest);
    ASSERT_EQ(hash, store.head().hash);
    const auto layers = *store.layers();
    for (const LayerId& layer : layers)
        for (Revision at = base.revision; at <= newest; ++at) {
            const auto found = store.layerAt(layer, at);
            ASSERT_TRUE(found) << found.error().message;
            ASSERT_EQ((*found)->dump(), contents[std::max(at, first[layer])][layer].dump())
                << layer.value << " at " << at << ", base " << base.revision;
            const auto version = store.versionAt(layer, at);
            ASSERT_TRUE(version) << version.error().message;
            ASSERT_LE((*version)->revision, std::max(at, first[layer]));
            ASSERT_EQ((*version)->hash, *store.hashAt((*version)->revision));
            ASSERT_EQ((*found)->dump(),
                      contents[std::max((*version)->revision, first[layer])][layer].dump())
                << layer.value << " at " << at << ", version " << (*version)->revision;
            ASSERT_EQ(*store.versionAt(layer, (*version)->revision), *version);
        }
    EXPECT_FALSE(*store.versionAt({"unknown.usda"}, newest));
    if (base.revision == 0) return;
    const Revision older = base.revision - 1;
    EXPECT_EQ(store.hashAt(older).error().code, ErrorCode::HistoryReplaced);
    EXPECT_EQ(store.layerAt(kLayer, older).error().code, ErrorCode::HistoryReplaced);
    EXPECT_EQ(store.versionAt(kLayer, older).error().code, ErrorCode::HistoryReplaced);
    EXPECT_EQ(store.read(base.revision, newest + 1, [](const auto&) { return true; }).error().code,
              ErrorCode::HistoryReplaced);
}

TYPED_TEST(CommitStoreContract, TheBaseRepresentsTheCommitsThatItReplaced) {
    for (unsigned seed = 0; seed < seedsOf(8); ++seed) {
        RandomHistory<TypeParam> history(seed);
        std::vector<LayerDocs> contents(1);  // by revision
        std::map<LayerId, Revision> first;
        for (int step = 0; step < 40; ++step) {
            SCOPED_TRACE(testing::Message() << "seed " << seed << ", step " << step);
            ASSERT_NO_FATAL_FAILURE(
                history.appendGroup([&] { contents.push_back(history.commits.layers); }));
            const Revision newest = contents.size() - 1;
            const auto layers = *history.store->layers();
            for (const LayerId& layer : layers) first.try_emplace(layer);
            for (auto& [layer, revision] : first)
                while (contents[revision][layer] == LayerDoc()) ++revision;
            const Revision base = history.store->base().revision;
            if (history.random.below(4) == 0) {
                const Revision at = newest - history.random.below(newest - base + 1);
                const auto hash = *history.store->hashAt(at);
                for (const LayerId& layer : layers)
                    if (at >= first[layer]) {
                        ASSERT_TRUE(
                            history.store->keepSnapshot(layer, contents[at][layer], at, hash));
                    }
            }
            if (history.random.below(5) == 0) {
                const Revision to = newest - history.random.below(newest + 1);
                const Hash hash = to > base ? *history.store->hashAt(to) : Hash();
                const auto done = history.store->compact(to, always);
                ASSERT_TRUE(done) << done.error().message;
                EXPECT_EQ(history.store->base().revision, std::max(base, to));
                if (to > base) {
                    EXPECT_EQ(history.store->base().hash, hash);
                }
            }
            if (history.random.below(4) == 0) expectFromBase(history, contents, first);
            ASSERT_FALSE(testing::Test::HasFailure());
            ASSERT_NO_FATAL_FAILURE(history.compare(4));
        }
        EXPECT_GT(history.store->base().revision, 0u);
    }
}

TYPED_TEST(CommitStoreContract, ABaseNeedsExistingCommits) {
    EXPECT_EQ(this->store->base(), CommitStore::Base());
    EXPECT_TRUE(this->store->compact(0, always));
    EXPECT_EQ(this->store->compact(1, always).error().code, ErrorCode::FutureRevision);
    for (const char* path : {"/A", "/B", "/C"})
        ASSERT_TRUE(this->append(this->commits.next(kLayer, path, CreateSpec{SpecKind::Prim})));
    int asked = 0;
    const auto ended = this->store->compact(2, [&] { return ++asked < 1; });
    EXPECT_EQ(ended.error().code, ErrorCode::ShuttingDown);
    EXPECT_EQ(this->store->base(), CommitStore::Base());
    EXPECT_EQ(revisions(*this->store, 0, 9), (std::vector<Revision>{1, 2, 3}));

    ASSERT_TRUE(this->store->compact(3, always)) << "up to the newest";
    for (int opened = 0; opened < 2; ++opened) {
        EXPECT_EQ(this->store->base().revision, 3u);
        EXPECT_EQ(this->store->base().hash, this->store->head().hash);
        EXPECT_TRUE(revisions(*this->store, 0, 9).empty());
        EXPECT_EQ(*this->store->unsavedLayers(), std::vector{kLayer});
        EXPECT_EQ(this->store->clientRecord(this->commits.id.client)->find(2), Revision(2)) << "M9";
        this->expectLayers();
        this->reopen();
    }
    ASSERT_TRUE(this->append(this->commits.next(kOther, "/D", CreateSpec{SpecKind::Prim})));
    EXPECT_EQ(revisions(*this->store, 0, 9), std::vector<Revision>{4});
    this->expectLayers();
}

TYPED_TEST(CommitStoreContract, ALayerBeginsWithItsNewestSnapshot) {
    ASSERT_TRUE(this->append(this->commits.next(kLayer, "/A", CreateSpec{SpecKind::Prim})));
    const Hash first = this->commits.head.hash;
    ASSERT_TRUE(this->append(this->commits.next(kLayer, "/B", CreateSpec{SpecKind::Prim})));
    const Hash second = this->commits.head.hash;
    LayerDoc older, newer;  // the log alone would give neither of them
    ASSERT_TRUE(older.apply("/Older", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(newer.apply("/Newer", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(this->store->keepSnapshot(kLayer, newer, 2, second));
    ASSERT_TRUE(this->store->keepSnapshot(kLayer, older, 1, first))
        << "it is late and will not be used";
    ASSERT_TRUE(this->append(this->commits.next(kLayer, "/C", CreateSpec{SpecKind::Prim})));
    ASSERT_TRUE(newer.apply("/C", CreateSpec{SpecKind::Prim}));
    EXPECT_TRUE(**this->store->loadLayer(kLayer) == newer);
    this->reopen();
    Replayed replayed;
    EXPECT_TRUE(**this->store->loadLayer(kLayer, &replayed) == newer);
    EXPECT_GT(replayed.snapshotBytes, 0u);
    EXPECT_GT(replayed.cost, 0u);
    EXPECT_LT(replayed.cost, 1'000u) << "of one commit";
}

TYPED_TEST(CommitStoreContract, ASnapshotIsOfThisHistory) {
    ASSERT_TRUE(this->append(this->commits.next(kLayer, "/A", CreateSpec{SpecKind::Prim})));
    const Hash hash = this->commits.head.hash;
    const LayerDoc doc = this->commits.layers[kLayer];
    const auto refusal = [&](const LayerId& layer, Revision revision, const Hash& of) {
        return this->store->keepSnapshot(layer, doc, revision, of).error().code;
    };
    EXPECT_EQ(refusal(kLayer, 1, Hash()), ErrorCode::HistoryDiverged);
    EXPECT_EQ(refusal(kLayer, 0, Hash()), ErrorCode::HistoryDiverged);
    EXPECT_EQ(refusal(kOther, 1, hash), ErrorCode::LayerNotFound);
    EXPECT_TRUE(this->store->keepSnapshot(kLayer, doc, 1, hash));
    this->expectLayers();
}

// The content is like that of an imported file: plug-ins may give their metadata any name.
TYPED_TEST(CommitStoreContract, AnImportedFileIsStoredCompletely) {
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A", SetField{"maxChildren", {}, doubleValue(3)}));
    ASSERT_TRUE(this->append(this->commits.import(kLayer, doc)));
    this->expectLayers();
}

TYPED_TEST(CommitStoreContract, KeepsMovesAndDeletes) {
    std::vector<NamespaceChange> all;
    const auto append = [&](CommitRecord commit) {
        all.insert(all.end(), commit.namespaceChanges.begin(), commit.namespaceChanges.end());
        ASSERT_TRUE(this->append(commit));
    };
    append(this->commits.next(kLayer, "/A", CreateSpec{SpecKind::Prim}));
    append(this->commits.next(kLayer, "/A", MoveSpec{{"/", {}}, "B"}));
    append(this->commits.next(
        {{kLayer, {"/B", {}}, MoveSpec{{"/", {}}, "C"}}, {kLayer, {"/C", {}}, DeleteSpec{}}}));
    ASSERT_EQ(all.size(), 3u);
    for (int opened = 0; opened < 2; ++opened) {
        EXPECT_EQ(*this->store->namespaceChanges(0), all);
        EXPECT_EQ(*this->store->namespaceChanges(2), std::vector(all.begin() + 1, all.end()));
        EXPECT_TRUE(this->store->namespaceChanges(3)->empty());
        this->reopen();
    }
}

TYPED_TEST(CommitStoreContract, M14ForgetsTheClientsThatCameFirst) {
    const auto id = [](std::uint64_t number) {
        return ClientId{"client" + std::to_string(number)};
    };
    std::vector<CommitRecord> group;
    const auto commit = [&](std::uint64_t number, std::uint64_t sequence) {
        this->commits.id = {id(number), sequence - 1};
        group.push_back(this->commits.empty());
    };
    for (std::uint64_t number = 1; number <= 20; ++number) commit(number, 1);
    for (std::uint64_t sequence = 2; sequence <= 30; ++sequence) commit(3, sequence);
    commit(4, 2'000);
    commit(4, 5);  // late (SE4), and the newest commit
    ASSERT_TRUE(this->store->append(group));
    EXPECT_EQ(this->store->forgottenUpTo(), 0u);
    EXPECT_EQ(*this->store->forgetClients(20, {}), 0u);
    EXPECT_EQ(this->store->clientRecord(id(1))->find(1), Revision(1));

    const auto expectKnown = [&] {
        for (std::uint64_t number = 1; number <= 20; ++number) {
            const bool known = number == 3 || number == 4 || number > 14;
            EXPECT_EQ(this->store->clientRecord(id(number))->last() != 0, known) << number;
            EXPECT_EQ(this->store->clientRecord(id(number))->find(1).has_value(),
                      known && number != 4)
                << number;
        }
        EXPECT_EQ(this->store->clientRecord(id(3))->find(30), Revision(49));
        EXPECT_EQ(this->store->clientRecord(id(4))->find(2'000), Revision(50));
        EXPECT_EQ(this->store->clientRecord(id(4))->find(5), Revision(51));
        EXPECT_EQ(this->store->forgottenUpTo(), 14u);
    };
    // Clients that the caller keeps are not forgotten, however old they are.
    std::set<ClientId> all;
    for (std::uint64_t number = 1; number <= 20; ++number) all.insert(id(number));
    EXPECT_EQ(*this->store->forgetClients(10, all), 0u);
    EXPECT_EQ(this->store->forgottenUpTo(), 0u);
    // forgetClients() forgets some more than necessary, so that it is not due again at once.
    EXPECT_EQ(*this->store->forgetClients(10, {}), 12u);
    expectKnown();
    this->reopen();
    expectKnown();
    EXPECT_EQ(*this->store->forgetClients(10, {}), 0u);
    // A client that commits again is known again.
    group.clear();
    commit(1, 2);
    ASSERT_TRUE(this->store->append(group));
    EXPECT_EQ(this->store->clientRecord(id(1))->last(), 2u);
    EXPECT_EQ(this->store->clientRecord(id(1))->find(2), Revision(52));
    EXPECT_EQ(this->store->clientRecord(id(1))->find(1), std::nullopt);
}

TYPED_TEST(CommitStoreContract, M9KnowsTheLast1024OfAClient) {
    const ClientId ada = this->commits.id.client, bo{"ffeeddccbbaa99887766554433221100"};
    std::vector<CommitRecord> group;
    const auto commit = [&](const ClientId& client, std::uint64_t sequence) {
        this->commits.id = {client, sequence - 1};
        group.push_back(this->commits.empty());
        if (group.size() < 100) return;
        ASSERT_TRUE(this->store->append(group));
        group.clear();
    };
    commit(bo, 1);
    for (std::uint64_t sequence = 1; sequence <= 1'030; ++sequence) commit(ada, sequence);
    ASSERT_TRUE(this->store->append(group));
    group.clear();
    const auto committed = [&](const ClientId& client, std::uint64_t sequence) {
        return this->store->clientRecord(client)->find(sequence);
    };
    const auto last = [&](const ClientId& client) {
        return this->store->clientRecord(client)->last();
    };
    EXPECT_EQ(last(ada), 1'030u);
    EXPECT_EQ(last(bo), 1u);
    EXPECT_EQ(last({"nobody"}), 0u);
    EXPECT_EQ(committed(ada, 6), std::nullopt);
    const auto record = this->store->clientRecord(ada);
    for (std::uint64_t sequence = 7; sequence <= 1'030; ++sequence)
        ASSERT_EQ(record->find(sequence), sequence + 1);
    EXPECT_EQ(committed(ada, 1'031), std::nullopt);
    EXPECT_EQ(committed(ada, 0), std::nullopt);
    EXPECT_EQ(committed(bo, 1), Revision(1));
    this->reopen();
    EXPECT_EQ(last(ada), 1'030u);
    EXPECT_EQ(committed(ada, 1'030), Revision(1'031));
    commit(ada, 2'000);  // those in between were refused
    ASSERT_TRUE(this->store->append(group));
    group.clear();
    EXPECT_EQ(committed(ada, 976), std::nullopt);
    EXPECT_EQ(committed(ada, 977), Revision(978));
    EXPECT_EQ(committed(ada, 2'000), Revision(1'032));
    commit(ada, 100'000);
    ASSERT_TRUE(this->store->append(group));
    EXPECT_EQ(committed(ada, 2'000), std::nullopt);
    EXPECT_EQ(committed(ada, 1'030), std::nullopt);
    EXPECT_EQ(committed(ada, 100'000), Revision(1'033));
    EXPECT_EQ(committed(bo, 1), Revision(1));

    group.clear();

    // SE4: a transaction whose big value was late comes after all these, and replaces no other
    // record.
    for (std::uint64_t sequence = 98'900; sequence < 100'000; ++sequence) commit(ada, sequence);
    commit(ada, 98'305);  // uses the same slot as 100,000
    ASSERT_TRUE(this->store->append(group));
    for (int opened = 0; opened < 2; ++opened) {
        EXPECT_TRUE(committed(ada, 98'305));
        EXPECT_EQ(committed(ada, 100'000), Revision(1'033));
        for (std::uint64_t sequence = 98'977; sequence < 100'000; ++sequence)
            ASSERT_TRUE(committed(ada, sequence)) << sequence;
        EXPECT_EQ(last(ada), 100'000u);
        this->reopen();
    }
}

TYPED_TEST(CommitStoreContract, KeepsCheckpoints) {
    ASSERT_TRUE(this->append(this->commits.empty()));
    const Checkpoint lunch{"lunch", 1, {"ada"}, 12}, before{"before lunch", 0, {"Zoë"}, 11};
    EXPECT_TRUE(this->store->addCheckpoint(lunch));
    EXPECT_TRUE(this->store->addCheckpoint(before));
    this->reopen();
    EXPECT_EQ(*this->store->checkpoints(), (std::vector{before, lunch}));
    const auto again = this->store->addCheckpoint({"lunch", 0, {}, 0});
    EXPECT_EQ(again.error().code, ErrorCode::CheckpointExists);
    const auto future = this->store->addCheckpoint({"dinner", 2, {}, 0});
    EXPECT_EQ(future.error().code, ErrorCode::FutureRevision);
    EXPECT_EQ(this->store->checkpoints()->size(), 2u);
}

}  // namespace
}  // namespace usdlive::server
