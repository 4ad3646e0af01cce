// Tests Client: several editors with real layers, and the real project in one process.
#include "usdlive/client/usd/Client.h"

#include <gtest/gtest.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/base/tf/weakPtr.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <set>
#include <thread>

#include "unit/Seeds.h"
#include "unit/client/usd/MemoryServer.h"
#include "unit/client/usd/RandomEditor.h"
#include "usd/editor/ClientInternals.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using pxr::SdfLayer;
using pxr::SdfPath;
using tests::MemoryServer;
using tests::RandomEditor;
namespace event = client::event;
namespace fs = std::filesystem;

namespace {

const LayerId kRoot{"root.usda"}, kAnim{"shot/anim.usda"}, kLookLayer{"look.usdc"},
    kProp{"prop.usd"};

class NoBlobs final : public BlobSink, public BlobSource {
public:
    void keepBlob(const Hash& hash, SharedBytes bytes) override { blobs_[hash] = std::move(bytes); }
    SharedBytes blob(const Hash& hash) override { return blobs_[hash]; }

private:
    std::map<Hash, SharedBytes> blobs_;
};

LayerDoc docOf(const std::string& text) {
    const auto layer = SdfLayer::CreateAnonymous(".usda");
    EXPECT_TRUE(layer->ImportFromString("#usda 1.0\n" + text));
    NoBlobs blobs;
    return *usd::readLayer(layer, blobs);
}

std::string exportedText(const pxr::SdfLayerHandle& layer) {
    std::string exported;
    layer->ExportToString(&exported);
    return exported;
}

std::map<LayerId, LayerDoc> project() {
    return {{kRoot, docOf("(\n subLayers = [@./shot/anim.usda@]\n)\ndef \"World\" (\n references = "
                          "@./prop.usd@</Prop>\n)\n{\n double x = 1\n}\n")},
            {kAnim, docOf("over \"World\" {\n double x.timeSamples = {1: 2, 3: 4}\n}\n")},
            {kLookLayer, docOf("def \"Look\" {\n}\n")},
            {kProp, docOf("(\n defaultPrim = \"Prop\"\n)\ndef \"Prop\" {\n}\n")}};
}

void expectRefusesEdits(const pxr::SdfLayerHandle& layer) {
    const std::string before = exportedText(layer);
    EXPECT_FALSE(layer->PermissionToEdit());
    pxr::TfErrorMark errors;
    layer->SetComment("nobody gets it");
    EXPECT_FALSE(errors.IsClean());
    errors.Clear();
    EXPECT_EQ(exportedText(layer), before);
}

class ClientTest : public ::testing::Test {
protected:
    std::unique_ptr<Client> connect(const std::string& user, fs::path cacheFolder = {}) {
        Client::Options options;
        options.user = user;
        options.cacheFolder = std::move(cacheFolder);
        auto client = client::ClientInternals::connectBy(server.connect(), options);
        EXPECT_TRUE(client) << client.error().message;
        return std::move(*client);
    }
    static pxr::SdfLayerRefPtr open(Client& client, const LayerId& id) {
        auto layer = client.openLayer(id);
        EXPECT_TRUE(layer) << layer.error().message;
        return *layer;
    }
    static void tick(std::initializer_list<Client*> clients, int times = 5) {
        for (int i = 0; i < times; ++i)
            for (auto* client : clients)
                while (client->tick().filling > 0)
                    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    std::string serverText(const LayerId& id) { return *usd::exportText(server.doc(id), blobs); }

    MemoryServer server{project()};
    NoBlobs blobs;
};

// Counts the changes of a layer.
class LayerNotices : public pxr::TfWeakBase {
public:
    explicit LayerNotices(const pxr::SdfLayerHandle& layer) {
        pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &LayerNotices::changed, layer);
    }
    int count = 0;

private:
    void changed(const pxr::SdfNotice::LayersDidChangeSentPerLayer&) { ++count; }
};

fs::path freshFolder(const std::string& name) {
    const auto folder =
        fs::temp_directory_path() / ("usdlive-test-" + std::to_string(getpid())) / name;
    fs::remove_all(folder);
    fs::create_directories(folder);
    return folder;
}

}  // namespace

TEST_F(ClientTest, SaysThatThereIsNoServer) {
    server.setReachable(false);
    Client::Options options;
    options.connectTimeoutMs = 50;
    const auto client = client::ClientInternals::connectBy(server.connect(), options);
    ASSERT_FALSE(client);
    EXPECT_EQ(client.error().code, ErrorCode::NotConnected);
    EXPECT_FALSE(Client::connect("http://nowhere", {}));
}

TEST_F(ClientTest, KnowsTheProjectAndMirrorsItsNames) {
    const auto ada = connect("ada");
    EXPECT_EQ(ada->layers(), (std::vector{kLookLayer, kProp, kRoot, kAnim}));
    for (const auto& id : ada->layers()) {
        const auto place = ada->cacheFolder() / id.value;
        EXPECT_TRUE(SdfLayer::FindOrOpen(place.string())) << place;
    }
}

TEST_F(ClientTest, RemovesItsOwnCacheFolderOnly) {
    auto ada = connect("ada");
    const auto own = ada->cacheFolder();
    ada.reset();
    EXPECT_FALSE(fs::exists(own));
    const auto given = freshFolder("cache");
    connect("ada", given);
    EXPECT_TRUE(fs::exists(given / kRoot.value));
}

TEST_F(ClientTest, OpensALayerWithTheLayersItUses) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    EXPECT_EQ(exportedText(layer), serverText(kRoot));
    EXPECT_TRUE(layer->PermissionToEdit());
    EXPECT_EQ(layer->GetRealPath(), (ada->cacheFolder() / kRoot.value).string());
    for (const auto& used : {kAnim, kProp}) {
        const auto found = SdfLayer::Find((ada->cacheFolder() / used.value).string());
        ASSERT_TRUE(found) << used.value;
        EXPECT_EQ(ada->layerId(found), used);
        EXPECT_EQ(exportedText(found), serverText(used));
    }
    EXPECT_FALSE(SdfLayer::Find((ada->cacheFolder() / kLookLayer.value).string()));
    EXPECT_EQ(exportedText(open(*ada, kLookLayer)).substr(0, 5), "#usda");
}

TEST_F(ClientTest, LayersThatComeWithTheConnectionAreNotComposedAgain) {
    for (int connection = 0; connection < 5; ++connection) {
        const auto ada = connect("ada");
        const LayerNotices notices(open(*ada, kRoot));
        for (int i = 0; i < 20; ++i) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
            tick({ada.get()}, 1);
        }
        EXPECT_EQ(notices.count, 0);
    }
}

TEST_F(ClientTest, SaysThatThereIsNoSuchLayer) {
    const auto ada = connect("ada");
    const auto layer = ada->openLayer({"nothing/here.usda"});
    ASSERT_FALSE(layer);
    EXPECT_EQ(layer.error().code, ErrorCode::LayerNotFound);
    EXPECT_FALSE(fs::exists(ada->cacheFolder() / "nothing/here.usda"));
    EXPECT_TRUE(open(*ada, kRoot));
}

TEST_F(ClientTest, EditsGoBothWays) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    hers->SetField(SdfPath("/World.x"), pxr::SdfFieldKeys->Default, 5.0);
    pxr::SdfCreatePrimInLayer(his, SdfPath("/World/Ball"));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(his->GetFieldAs<double>(SdfPath("/World.x"), pxr::SdfFieldKeys->Default), 5.0);
    EXPECT_TRUE(hers->GetPrimAtPath(SdfPath("/World/Ball")));
    EXPECT_EQ(exportedText(hers), exportedText(his));
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
    EXPECT_EQ(ada->pendingTransactions(), 0u);
}

// M1: parts are sent also for a field that did not exist before.
TEST_F(ClientTest, M1TwoAuthorsOfTheFirstPartsOfAFieldBothKeepTheirs) {
    server.files[kRoot] = docOf("def \"World\" {\n double x\n rel r\n rel e\n}\n");
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const SdfPath world("/World"), x("/World.x"), r("/World.r"), e("/World.e");
    const auto write = [&](const pxr::SdfLayerRefPtr& layer, const std::string& name, double time) {
        const pxr::VtDictionary inner{{name, pxr::VtValue(1)}, {name + "2", pxr::VtValue(2)}};
        const pxr::VtDictionary whole{{"omni_layer", pxr::VtValue(inner)}};
        layer->SetCustomLayerData(whole);
        layer->SetFieldDictValueByKey(world, pxr::SdfFieldKeys->CustomData, pxr::TfToken("a:b"),
                                      pxr::VtValue(inner));
        layer->SetField(
            x, pxr::SdfFieldKeys->TimeSamples,
            pxr::SdfTimeSampleMap{{time, pxr::VtValue(1.0)}, {time + 1, pxr::VtValue(2.0)}});
        layer->SetField(x, pxr::SdfFieldKeys->CustomData, pxr::VtValue(inner));
        const SdfPath first("/" + name), second("/" + name + "2");
        layer->SetField(r, pxr::SdfFieldKeys->TargetPaths,
                        pxr::SdfPathListOp::Create({first, second}));
        layer->SetField(e, pxr::SdfFieldKeys->TargetPaths,
                        pxr::SdfPathListOp::CreateExplicit({first, second}));
        layer->SetSubLayerPaths({"./" + name + ".usda", "./" + name + "2.usda"});
        layer->SetField(world, pxr::SdfFieldKeys->VariantSelection,
                        pxr::SdfVariantSelectionMap{{name, "1"}, {name + "2", "2"}});
        layer->SetField(SdfPath::AbsoluteRootPath(), pxr::SdfFieldKeys->LayerRelocates,
                        pxr::SdfRelocates{{world.AppendChild(pxr::TfToken(name)), first},
                                          {world.AppendChild(pxr::TfToken(name + "2")), second}});
    };
    write(hers, "ada", 1);
    write(his, "bo", 11);
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(hers), exportedText(his));
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
    for (const std::string name : {"ada", "ada2", "bo", "bo2"}) {
        const auto hasKey = [&](const pxr::VtDictionary& dictionary, const std::string& keys) {
            return dictionary.GetValueAtPath(keys + name) != nullptr;
        };
        EXPECT_TRUE(hasKey(hers->GetCustomLayerData(), "omni_layer:")) << name;
        const auto dataOf = [&](const SdfPath& path) {
            return hers->GetFieldAs<pxr::VtDictionary>(path, pxr::SdfFieldKeys->CustomData);
        };
        EXPECT_TRUE(hasKey(dataOf(world), "a:b:")) << name;
        EXPECT_TRUE(hasKey(dataOf(x), "")) << name;
        for (const SdfPath& path : {r, e})
            EXPECT_TRUE(hers->GetFieldAs<pxr::SdfPathListOp>(path, pxr::SdfFieldKeys->TargetPaths)
                            .HasItem(SdfPath("/" + name)))
                << path << " " << name;
        EXPECT_TRUE(hers->GetFieldAs<pxr::SdfVariantSelectionMap>(
                            world, pxr::SdfFieldKeys->VariantSelection)
                        .contains(name));
        EXPECT_EQ(std::ranges::count(std::vector<std::string>(hers->GetSubLayerPaths()),
                                     "./" + name + ".usda"),
                  1);
        EXPECT_EQ(std::ranges::count_if(
                      hers->GetRelocates(),
                      [&](const auto& relocate) { return relocate.second == SdfPath("/" + name); }),
                  1);
    }
    EXPECT_EQ(hers->GetNumTimeSamplesForPath(x), 4u);
}

// M13: a spec that both created at once has the parts of both.
TEST_F(ClientTest, M13TwoAuthorsWhoCreateOneSpecBothKeepTheirFields) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const auto write = [](const pxr::SdfLayerRefPtr& layer, const std::string& name, double time,
                          pxr::SdfSpecifier specifier) {
        const auto prim = pxr::SdfPrimSpec::New(layer, "New", specifier);
        const auto attribute =
            pxr::SdfAttributeSpec::New(prim, "a", pxr::SdfValueTypeNames->Double);
        layer->SetTimeSample(attribute->GetPath(), time, 1.0);
        layer->SetTimeSample(attribute->GetPath(), time + 1, 1.0);
        prim->SetCustomData(name, pxr::VtValue(1));
        prim->SetCustomData("shared", pxr::VtValue(name));
        prim->GetReferenceList().Prepend(pxr::SdfReference("./" + name + ".usda"));
    };
    write(hers, "ada", 1, pxr::SdfSpecifierDef);
    write(his, "bo", 11, pxr::SdfSpecifierOver);
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(hers), exportedText(his));
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
    const auto prim = his->GetPrimAtPath(SdfPath("/New"));
    EXPECT_EQ(prim->GetSpecifier(), pxr::SdfSpecifierDef);
    const auto data =
        his->GetFieldAs<pxr::VtDictionary>(prim->GetPath(), pxr::SdfFieldKeys->CustomData);
    EXPECT_EQ(data.size(), 3u);
    EXPECT_EQ(*data.GetValueAtPath("shared"), pxr::VtValue(std::string("bo")));
    EXPECT_EQ(prim->GetReferenceList().GetPrependedItems().size(), 2u);
    EXPECT_EQ(his->GetNumTimeSamplesForPath(SdfPath("/New.a")), 4u);

    // Only an explicit change turns a def into an over.
    his->GetPrimAtPath(SdfPath("/New"))->SetSpecifier(pxr::SdfSpecifierOver);
    tick({bo.get(), ada.get()});
    EXPECT_EQ(hers->GetPrimAtPath(SdfPath("/New"))->GetSpecifier(), pxr::SdfSpecifierOver);
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
}

TEST_F(ClientTest, OneFrameIsOneTransactionOverAllLayers) {
    const auto ada = connect("ada");
    const auto root = open(*ada, kRoot), look = open(*ada, kLookLayer);
    const Revision before = server.head();
    root->SetComment("one");
    look->SetComment("two");
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_EQ(server.head(), before + 1);
}

TEST_F(ClientTest, ALayerCannotBeEditedUntilItHasArrived) {
    const auto ada = connect("ada");
    server.setReachable(false);
    ada->tick();
    const auto place = (ada->cacheFolder() / kLookLayer.value).string();
    const auto layer = SdfLayer::FindOrOpen(place);  // like composition
    // A client looks for such layers only from time to time.
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (layer->PermissionToEdit() && std::chrono::steady_clock::now() < end) {
        ada->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_FALSE(layer->PermissionToEdit());
    server.setReachable(true);
    EXPECT_TRUE(ada->openLayer(kLookLayer));
    EXPECT_TRUE(layer->PermissionToEdit());
    EXPECT_EQ(exportedText(layer), exportedText(open(*ada, kLookLayer)));
    layer->SetComment("mine");
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_NE(serverText(kLookLayer).find("mine"), std::string::npos);
}

// M12: edits that were written into the placeholder before the client knew that it was loaded.
TEST_F(ClientTest, M12WorkFromBeforeALayerWasLiveIsKept) {
    const auto ada = connect("ada");
    const auto layer = SdfLayer::FindOrOpen((ada->cacheFolder() / kLookLayer.value).string());
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/Early"));
    open(*ada, kLookLayer);
    EXPECT_FALSE(layer->GetPrimAtPath(SdfPath("/Early")));
    ASSERT_EQ(ada->lostWorkCount(), 1u);
    const auto kept = ada->lostWorkAsLayer(0, kLookLayer);
    ASSERT_TRUE(kept) << kept.error().message;
    EXPECT_TRUE((*kept)->GetPrimAtPath(SdfPath("/Early")));
}

// The client has not looked for loaded layers yet.
TEST_F(ClientTest, M12FlushReportsWorkFromBeforeALayerWasLive) {
    const auto ada = connect("ada");
    const auto layer = SdfLayer::FindOrOpen((ada->cacheFolder() / kLookLayer.value).string());
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/Early"));
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_EQ(ada->lostWorkCount(), 1u);
    EXPECT_EQ(ada->layerId(layer), kLookLayer);
}

TEST_F(ClientTest, ALayerThatCannotBeReadRefusesEditsUntilItIsMended) {
    server.unreadable.insert(kAnim);
    const auto ada = connect("ada");
    std::vector<event::JoinFailed> failures;
    ada->setEventHandler([&](const client::Event& event) {
        if (const auto* failed = std::get_if<event::JoinFailed>(&event))
            failures.push_back(*failed);
    });
    const auto root = open(*ada, kRoot);
    const auto anim = SdfLayer::Find(ada->identifierOf(kAnim));
    ASSERT_TRUE(anim);
    expectRefusesEdits(anim);
    EXPECT_FALSE(ada->layerId(anim));
    // It is joined again at once after a reconnect, and in pauses.
    for (const bool isMended : {false, true}) {
        if (isMended) server.unreadable.clear();
        server.setReachable(false);
        tick({ada.get()});
        server.setReachable(true);
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
        while ((!ada->isConnected() || anim->PermissionToEdit() != isMended) &&
               std::chrono::steady_clock::now() < end) {
            ada->tick();
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        for (int i = 0; i < 10; ++i) tick({ada.get()});
        EXPECT_EQ(anim->PermissionToEdit(), isMended);
    }
    ASSERT_EQ(failures.size(), 1u);
    EXPECT_EQ(failures[0].reason.code, ErrorCode::LayerUnreadable);
    EXPECT_EQ(exportedText(anim), serverText(kAnim));
    anim->SetComment("mine");
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_NE(serverText(kAnim).find("mine"), std::string::npos);
}

TEST_F(ClientTest, LayersOfAClientThatIsGoneRefuseEdits) {
    auto ada = connect("ada");
    const auto layer = open(*ada, kLookLayer);
    ada.reset();
    expectRefusesEdits(layer);
}

TEST_F(ClientTest, WorkDoneOfflineArrivesLater) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    std::vector<std::string> events;
    ada->setEventHandler([&](const client::Event& event) {
        if (std::holds_alternative<event::Disconnected>(event)) events.push_back("gone");
        if (std::holds_alternative<event::Connected>(event)) events.push_back("back");
    });
    server.setReachable(false);
    tick({ada.get(), bo.get()});
    EXPECT_FALSE(ada->isConnected());
    hers->SetComment("offline");
    pxr::SdfCreatePrimInLayer(his, SdfPath("/World/Offline"));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(ada->pendingTransactions(), 1u);
    EXPECT_FALSE(ada->flush(20));
    server.setReachable(true);
    EXPECT_TRUE(ada->flush(2000));
    EXPECT_TRUE(bo->flush(2000));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(hers), exportedText(his));
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
    EXPECT_EQ(events, (std::vector<std::string>{"gone", "back"}));
}

TEST_F(ClientTest, SiblingsThatTwoAddedOfflineTakeLinearTime) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const auto timeOf = [&](const std::string& parent, int number) {
        pxr::SdfCreatePrimInLayer(hers, SdfPath(parent));
        EXPECT_TRUE(ada->flush(2'000));
        tick({bo.get()});
        EXPECT_TRUE(his->GetPrimAtPath(SdfPath(parent)));
        server.setReachable(false);
        tick({ada.get(), bo.get()});
        for (const auto& [layer, user] : {std::pair(hers, "ada"), std::pair(his, "bo")}) {
            const pxr::SdfChangeBlock block;
            for (int i = 0; i < number; ++i)
                pxr::SdfCreatePrimInLayer(layer, SdfPath(parent + "/" + user + std::to_string(i)));
        }
        tick({ada.get(), bo.get()});
        const auto start = std::clock();
        server.setReachable(true);
        EXPECT_TRUE(ada->flush(20'000) && bo->flush(20'000));
        tick({ada.get(), bo.get()});
        EXPECT_TRUE(exportedText(hers) == exportedText(his));
        return double(std::clock() - start);
    };
    double ratio = 100;  // the best of some, because the machine may be busy
    for (const std::string name : {"A", "B", "C"})
        if (ratio >= 3)
            ratio = std::min(ratio, timeOf("/World/" + name + "2", 4'000) /
                                        timeOf("/World/" + name + "1", 2'000));
    EXPECT_LT(ratio, 3);
}

TEST_F(ClientTest, AValueThatCannotBeSharedIsReportedAndUndone) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    std::vector<std::string> lost;
    ada->setEventHandler([&](const client::Event& event) {
        if (const auto* work = std::get_if<event::Lost>(&event))
            lost.push_back(work->work.reason.message);
    });
    layer->SetTimeCodesPerSecond(0);
    tick({ada.get()});
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_NE(lost[0].find("root.usda </> timeCodesPerSecond"), std::string::npos);
    EXPECT_FALSE(layer->HasTimeCodesPerSecond());
    EXPECT_EQ(ada->lostWorkCount(), 1u);
}

// M12 includes the content of writes that capture cannot share.
TEST_F(ClientTest, M12AnUnsharedWriteKeepsItsContent) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    layer->SetTimeCodesPerSecond(0);
    tick({ada.get()});
    const auto work = ada->lostWork(0);
    ASSERT_TRUE(work);
    ASSERT_EQ(work->edits.size(), 1u);
    EXPECT_EQ(std::get<SetField>(work->edits[0].action).field, "timeCodesPerSecond");
}

TEST_F(ClientTest, EditsInTheFrameOfAMutingAreCommitted) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    layer->SetComment("before the muting");
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/World/Before"));
    SdfLayer::AddToMutedLayers(layer->GetIdentifier());
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_TRUE(layer->IsMuted());
    EXPECT_NE(serverText(kRoot).find("before the muting"), std::string::npos);
    EXPECT_NE(serverText(kRoot).find("Before"), std::string::npos);
    SdfLayer::RemoveFromMutedLayers(layer->GetIdentifier());
    tick({ada.get()});
    EXPECT_EQ(exportedText(layer), serverText(kRoot));
}

TEST_F(ClientTest, ALayerThatIsMutedWhileItIsJoinedCanBeEditedLater) {
    const auto ada = connect("ada");
    const auto path = (ada->cacheFolder() / kLookLayer.value).string();
    const auto layer = SdfLayer::FindOrOpen(path);
    SdfLayer::AddToMutedLayers(layer->GetIdentifier());
    open(*ada, kLookLayer);
    SdfLayer::RemoveFromMutedLayers(layer->GetIdentifier());
    tick({ada.get()});
    EXPECT_TRUE(layer->PermissionToEdit());
    layer->SetComment("mine");
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_NE(serverText(kLookLayer).find("mine"), std::string::npos);
}

TEST_F(ClientTest, ClosingAndOpeningAgainLosesOnlyEditsInBetween) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kLookLayer);
    layer->SetComment("mine");
    ada->close(kLookLayer);
    open(*ada, kLookLayer);
    EXPECT_EQ(ada->lostWorkCount(), 0u);
    ada->close(kLookLayer);
    expectRefusesEdits(layer);
    layer->SetPermissionToEdit(true);
    pxr::SdfCreatePrimInLayer(layer, SdfPath("/Between"));
    open(*ada, kLookLayer);
    ASSERT_EQ(ada->lostWorkCount(), 1u);
    const auto work = ada->lostWork(0);
    ASSERT_TRUE(work);
    for (const auto& edit : work->edits)
        EXPECT_TRUE(edit.path == "/Between" || edit.path == "/") << edit.path;
}

TEST_F(ClientTest, ALayerIsLiveThroughOneConnection) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kLookLayer);
    const auto bo = connect("bo", ada->cacheFolder());
    const auto refused = bo->openLayer(kLookLayer);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message.find("already live through another"), std::string::npos);
    ada->close(kLookLayer);
    EXPECT_TRUE(bo->openLayer(kLookLayer));
}

TEST_F(ClientTest, BigValuesTravelBesideTheStream) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const auto attribute = pxr::SdfAttributeSpec::New(
        hers->GetPrimAtPath(SdfPath("/World")), "points", pxr::SdfValueTypeNames->DoubleArray);
    pxr::VtArray<double> points(500'000);
    for (std::size_t i = 0; i < points.size(); ++i) points[i] = double(i);
    attribute->SetDefaultValue(pxr::VtValue(points));
    EXPECT_TRUE(ada->flush(5000));
    EXPECT_EQ(server.blobs.size(), 1u);
    tick({ada.get(), bo.get()}, 40);
    EXPECT_EQ(exportedText(his), exportedText(hers));
    // A client that connects later also waits for them.
    const auto cy = connect("cy");
    EXPECT_EQ(exportedText(open(*cy, kRoot)), exportedText(hers));
}

TEST_F(ClientTest, B3AGestureOnABigValueIsSeenAndLeavesEverybodyEqual) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const auto attribute = pxr::SdfAttributeSpec::New(
        hers->GetPrimAtPath(SdfPath("/World")), "points", pxr::SdfValueTypeNames->DoubleArray);
    ASSERT_TRUE(ada->flush(5000));
    const auto seen = [&] {
        const auto now = his->GetAttributeAtPath(SdfPath("/World.points"));
        const auto value = now ? now->GetDefaultValue() : pxr::VtValue();
        return value.IsHolding<pxr::VtArray<double>>()
                   ? value.UncheckedGet<pxr::VtArray<double>>()[0]
                   : 0.0;
    };
    ada->beginGesture();
    std::set<double> intermediate;
    double last = 0;
    for (int frame = 0; frame < 2'000 && intermediate.size() < 2; ++frame) {
        attribute->SetDefaultValue(pxr::VtValue(pxr::VtArray<double>(50'000, ++last)));
        tick({ada.get(), bo.get()});
        if (seen() != 0) intermediate.insert(seen());
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    EXPECT_EQ(intermediate.size(), 2u) << "the dragged value is shown";
    EXPECT_TRUE(server.blobs.empty()) << "the dragged value is not stored";
    ada->endGesture();
    EXPECT_TRUE(ada->flush(5000));
    tick({ada.get(), bo.get()}, 40);
    EXPECT_EQ(seen(), last);
    EXPECT_TRUE(exportedText(his) == exportedText(hers));
    EXPECT_EQ(server.blobs.size(), 1u);
}

TEST_F(ClientTest, AReloadRestoresTheProjectsContentAndAffectsNobodyElse) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    hers->SetComment("kept");
    tick({ada.get(), bo.get()});
    const auto before = exportedText(his);
    hers->Reload(true);  // its file is an empty placeholder
    EXPECT_EQ(exportedText(hers), before);
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(his), before);
    EXPECT_EQ(exportedText(hers), before);
    hers->SetComment("works on");
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(hers), exportedText(his));
}

TEST_F(ClientTest, ALayerThatIsClosedRightAfterAReloadKeepsItsContent) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    for (int i = 0; i < 3'000; ++i)
        pxr::SdfPrimSpec::New(pxr::SdfLayerHandle(layer), "p" + std::to_string(i),
                              pxr::SdfSpecifierDef);
    ASSERT_TRUE(ada->flush(10'000));
    const auto before = exportedText(layer);
    layer->Reload(true);
    ada->close(kRoot);
    EXPECT_EQ(exportedText(layer), before);
}

TEST_F(ClientTest, AMutedLayerIsLeftAloneAndComesBackUpToDate) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    for (const bool dirty : {false, true}) {
        if (dirty) hers->SetComment("dirty");
        tick({ada.get(), bo.get()});
        hers->SetMuted(true);
        tick({ada.get(), bo.get()});
        his->SetDocumentation("meanwhile");
        tick({ada.get(), bo.get()});
        hers->SetMuted(false);
        tick({ada.get(), bo.get()});
        EXPECT_EQ(exportedText(hers), exportedText(his));
        EXPECT_EQ(exportedText(his), serverText(kRoot));
        EXPECT_NE(exportedText(his).find("World"), std::string::npos);
    }
}

TEST_F(ClientTest, AGestureIsSeenAtOnceAndCommittedOnce) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const SdfPath x("/World.x");
    const auto value = [&](const auto& layer) {
        return layer->template GetFieldAs<double>(x, pxr::SdfFieldKeys->Default);
    };
    const Revision before = server.head();
    ada->beginGesture();
    for (int i = 0; i < 5; ++i) {
        hers->SetField(x, pxr::SdfFieldKeys->Default, 100.0 + i);
        std::this_thread::sleep_for(std::chrono::milliseconds(40));
        tick({ada.get(), bo.get()}, 2);
    }
    EXPECT_GE(value(his), 100.0);
    EXPECT_EQ(server.head(), before);
    ada->endGesture();
    EXPECT_TRUE(ada->flush(1000));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(server.head(), before + 1);
    EXPECT_EQ(value(his), 104.0);
    EXPECT_EQ(exportedText(hers), serverText(kRoot));
}

TEST_F(ClientTest, AnUndoIsInTheLayersAtOnce) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    const std::string before = exportedText(hers);
    {
        const auto group = ada->undoGroup("Describe");
        hers->SetComment("one");
        tick({ada.get(), bo.get()});
        hers->SetDocumentation("two");
        EXPECT_EQ(ada->undo().error().code, ErrorCode::InvalidArgument);
    }
    EXPECT_EQ(ada->undoStack().undo, std::vector<std::string>{"Describe"});
    const std::string after = exportedText(hers);
    const auto undone = ada->undo();
    ASSERT_TRUE(undone);
    EXPECT_TRUE(undone->done);
    EXPECT_EQ(undone->label, "Describe");
    EXPECT_EQ(exportedText(hers), before);
    EXPECT_TRUE(ada->flush(1000));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(exportedText(his), before);
    EXPECT_TRUE(ada->redo()->done);
    EXPECT_EQ(exportedText(hers), after);
    EXPECT_TRUE(ada->flush(1000));
    his->SetComment("his");
    EXPECT_TRUE(bo->flush(1000));
    tick({ada.get(), bo.get()});
    const auto kept = ada->undo()->kept;
    ASSERT_EQ(kept.size(), 1u);
    EXPECT_EQ(kept[0].author.value, "bo");
    EXPECT_EQ(kept[0].field, "comment");
    EXPECT_EQ(hers->GetComment(), "his");
}

TEST_F(ClientTest, AClosedLayerIsIndependent) {
    const auto ada = connect("ada"), bo = connect("bo");
    const auto hers = open(*ada, kRoot), his = open(*bo, kRoot);
    hers->SetComment("last");
    ada->close(kRoot);
    EXPECT_FALSE(ada->layerId(hers));
    tick({ada.get(), bo.get()});
    EXPECT_EQ(his->GetComment(), "last");
    expectRefusesEdits(hers);
    hers->SetPermissionToEdit(true);  // she wants a copy of her own
    hers->SetComment("alone");
    his->SetDocumentation("together");
    tick({ada.get(), bo.get()});
    EXPECT_EQ(his->GetComment(), "last");
    EXPECT_EQ(hers->GetDocumentation(), "");
    EXPECT_TRUE(hers->PermissionToEdit());
    // When it is opened again, it has the project's content.
    EXPECT_EQ(exportedText(open(*ada, kRoot)), exportedText(his));
}

TEST_F(ClientTest, AttachesLayersOpenedFromAFolder) {
    const auto folder = freshFolder("project");
    fs::create_directories(folder / "shot");
    for (const auto& [id, doc] : project())
        if (id != kLookLayer) std::ofstream(folder / id.value) << *usd::exportText(doc, blobs);
    const auto mine = SdfLayer::FindOrOpen((folder / kRoot.value).string());
    const auto other = SdfLayer::FindOrOpen((folder / kProp.value).string());
    const auto ada = connect("ada"), bo = connect("bo");
    const auto his = open(*bo, kRoot);
    his->SetComment("newer than the file");
    tick({bo.get()});

    mine->SetDocumentation("unsaved");
    const auto refused = ada->attach(folder);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::InvalidArgument);
    mine->Reload();

    const auto attached = ada->attach(folder);
    ASSERT_TRUE(attached) << attached.error().message;
    EXPECT_EQ(*attached, (std::vector{kProp, kRoot}));
    EXPECT_EQ(exportedText(mine), exportedText(his));
    mine->SetDocumentation("shared");
    tick({ada.get(), bo.get()});
    EXPECT_EQ(his->GetDocumentation(), "shared");
    // Layers that composition opens later from there become live, too.
    const auto anim = SdfLayer::FindOrOpen((folder / kAnim.value).string());
    ada->tick();
    std::this_thread::sleep_for(std::chrono::milliseconds(120));
    tick({ada.get()});
    EXPECT_EQ(ada->layerId(anim), kAnim);
}

TEST_F(ClientTest, AHandlerMayCallTheClient) {
    const auto ada = connect("ada");
    open(*ada, kRoot);
    std::vector<Revision> revisions;
    ada->setEventHandler([&](const client::Event& event) {
        if (const auto* committed = std::get_if<event::Committed>(&event)) {
            revisions.push_back(committed->commit.revision);
            ada->tick();
            if (revisions.size() == 1) open(*ada, kLookLayer);
        }
    });
    for (int i = 0; i < 3; ++i) {
        open(*ada, kRoot)->SetComment(std::to_string(i));
        ada->tick();
    }
    EXPECT_TRUE(ada->flush(1000));
    EXPECT_EQ(revisions, (std::vector<Revision>{1, 2, 3}));
}

TEST_F(ClientTest, SavesOnTheServer) {
    const auto ada = connect("ada");
    open(*ada, kRoot)->SetComment("to be saved");
    EXPECT_TRUE(ada->flush(1000));
    bool isSaved = false;
    ada->setEventHandler([&](const client::Event& event) {
        if (const auto* saved = std::get_if<event::Saved>(&event))
            isSaved = saved->answer.saved == std::vector{kRoot};
    });
    ada->save({kRoot});
    tick({ada.get()});
    EXPECT_TRUE(isSaved);
    EXPECT_EQ(server.saved, std::vector{kRoot});
}

// Several editors edit at once and lose their connections, until everything has arrived: M8.
TEST_F(ClientTest, M8AllEditorsEndAlike) {
    const char* given = std::getenv("USDLIVE_CLIENT_SEEDS");
    const unsigned seeds = given ? unsigned(std::atoi(given)) : seedsOf(30);
    const char* first = std::getenv("USDLIVE_CLIENT_FIRST");
    const unsigned from = first ? unsigned(std::atoi(first)) : 0;
    for (unsigned seed = from; seed < from + seeds; ++seed) {
        SCOPED_TRACE(seed);  // a failure prints the seed that repeats it
        std::mt19937 random(seed);
        MemoryServer shared(project());
        std::vector<std::unique_ptr<Client>> clients;
        std::vector<RandomEditor> editors;
        std::vector<std::vector<pxr::SdfLayerRefPtr>> layers;
        const std::vector<LayerId> ids{kRoot, kProp};
        for (unsigned i = 0; i < 3; ++i) {
            Client::Options options;
            options.user = "user" + std::to_string(i);
            clients.push_back(
                std::move(*client::ClientInternals::connectBy(shared.connect(), options)));
            layers.emplace_back();
            for (const auto& id : ids) {
                layers.back().push_back(open(*clients.back(), id));
                editors.emplace_back(layers.back().back(), unsigned(random()));
            }
        }
        for (int step = 0; step < 150; ++step) {
            const auto who = random() % editors.size();
            editors[who].step();
            if (random() % 2) clients[random() % clients.size()]->tick();
            if (random() % 60 == 0) shared.setReachable(false);
            if (random() % 20 == 0) shared.setReachable(true);
        }
        shared.setReachable(true);
        for (int round = 0; round < 3; ++round)
            for (const auto& client : clients) ASSERT_TRUE(client->flush(5000));
        for (std::size_t layer = 0; layer < ids.size(); ++layer) {
            NoBlobs none;
            const auto served = shared.doc(ids[layer]).dump();
            for (std::size_t i = 0; i < clients.size(); ++i) {
                EXPECT_EQ(usd::readLayer(layers[i][layer], none)->dump(), served)
                    << "client " << i << " " << ids[layer].value;
                EXPECT_EQ(exportedText(layers[i][layer]), exportedText(layers[0][layer]));
            }
        }
        if (HasFailure()) return;
    }
}

TEST_F(ClientTest, AHandlerMaySaveWhileItsCallerWaitsForASave) {
    const auto ada = connect("ada");
    const auto layer = open(*ada, kRoot);
    layer->SetComment("by ada");
    int depth = 0;
    std::optional<Result<LayersSaved>> inner;
    ada->setEventHandler([&](const client::Event& one) {
        if (!std::holds_alternative<event::Saved>(one) || depth++ > 0) return;
        inner = ada->saveAndWait({kAnim}, true, 5'000);
    });
    const auto outer = ada->saveAndWait({kRoot}, true, 5'000);
    ada->setEventHandler({});
    ASSERT_TRUE(inner && *inner);
    EXPECT_EQ((*inner)->saved, std::vector{kAnim});
    ASSERT_TRUE(outer) << outer.error().message;
    EXPECT_EQ(outer->saved, std::vector{kRoot});
}

TEST_F(ClientTest, AHandlerMaySaveBeforeItsCallersSaveIsAnswered) {
    const auto ada = connect("ada");
    const auto bob = connect("bob");
    const auto layer = open(*ada, kRoot);
    open(*bob, kRoot)->SetComment("by bob");
    EXPECT_TRUE(bob->flush(5'000));
    std::optional<Result<LayersSaved>> inner;
    ada->setEventHandler([&](const client::Event& one) {
        if (std::holds_alternative<event::Committed>(one) && !inner)
            inner = ada->saveAndWait({kAnim}, true, 5'000);
    });
    layer->SetDocumentation("by ada");
    const auto outer = ada->saveAndWait({kRoot}, true, 5'000);
    ada->setEventHandler({});
    ASSERT_TRUE(inner && *inner);
    EXPECT_EQ((*inner)->saved, std::vector{kAnim});
    ASSERT_TRUE(outer) << outer.error().message;
    EXPECT_EQ(outer->saved, std::vector{kRoot});
}

TEST_F(ClientTest, FI6ANewLayerIsOpenAndPartOfTheProject) {
    const auto ada = connect("ada");
    const auto bob = connect("bob");
    const auto made = ada->createLayer({"fx/new.usda"});
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_TRUE((*made)->IsEmpty());
    tick({bob.get()});
    EXPECT_EQ(bob->layers().size(), 5u);
    EXPECT_EQ(bob->createLayer({"fx/new.usda"}).error().code, ErrorCode::LayerExists);
    EXPECT_EQ(bob->createLayer({"../new.usda"}).error().code, ErrorCode::InvalidLayerName);
    server.setReachable(false);
    tick({bob.get()});
    EXPECT_EQ(bob->createLayer({"other.usda"}).error().code, ErrorCode::NotConnected);
}
