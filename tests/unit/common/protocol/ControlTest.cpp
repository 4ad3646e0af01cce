// Tests the encoding of control messages.
#include "usdlive/common/protocol/Control.h"

#include <gtest/gtest.h>

#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive {
namespace {

const Hash kHash = sha256(asBytes("x"));

void expectRoundTrip(const ControlMessage& message) {
    const auto decoded = decodeControl(encodeControl(message));
    ASSERT_TRUE(decoded) << decoded.error().message << "\n" << encodeControl(message);
    EXPECT_EQ(*decoded, message);
}

// Every list that a server can send about the largest project. A tenth of it shows the size.
TEST(Control, WhatAServerCanSendAClientAccepts) {
    constexpr std::size_t kPart = 10;
    Welcome welcome;
    LayerStates states;
    LayersSaved saved;
    LayersReloaded reloaded;
    Storage storage;
    for (std::size_t number = 0; number < kMaxLayers / kPart; ++number) {
        const LayerId layer{std::string(kMaxLayerNameBytes / kMaxLayers - 5, 'n') + ".usda"};
        welcome.layers.push_back({layer});
        LayerState& state = states.layers.emplace_back();
        state.layer = layer;
        state.owner = "ada";
        saved.saved.push_back(layer);
        reloaded.failed.push_back({layer, "locked", layer.value + " is locked by somebody else"});
        storage.layers.push_back({layer, 1, 1, 1, 1, 1, 1});
    }
    for (const ControlMessage& message :
         {ControlMessage(welcome), ControlMessage(ProjectLayers{welcome.layers}),
          ControlMessage(states), ControlMessage(saved), ControlMessage(reloaded),
          ControlMessage(storage)})
        EXPECT_LE(encodeControl(message).size() * kPart, kMaxServerControlBytes) << message.index();
    const auto tenth = welcome.layers;
    for (std::size_t part = 1; part < kPart; ++part)
        welcome.layers.insert(welcome.layers.end(), tenth.begin(), tenth.end());
    const std::string json = encodeControl(welcome);
    const auto read = decodeServerControl(json);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(std::get<Welcome>(*read).layers.size(), kMaxLayers);
    EXPECT_FALSE(decodeControl(json)) << "a client sends less";
    EXPECT_FALSE(decodeServerControl(std::string(kMaxServerControlBytes + 1, ' ')));
}

TEST(Control, EveryMessageComesBackAsItWas) {
    Hello hello{2,  1,  {"a", "b"}, {"0123456789abcdef0123456789abcdef"}, {"Zoë"}, "usdview",
                {}, {}, {}};
    expectRoundTrip(hello);
    hello.resume = Hello::Resume{3, 1ull << 60, kHash};
    expectRoundTrip(hello);
    expectRoundTrip(Welcome{
        1, {"a"}, "shot", 4, 9, kHash, true, {{{"a.usda"}}, {{"s/b.usdc"}}}, 64 << 20, 4ull << 30});
    expectRoundTrip(LayerList{{{"a.usda"}}, {{"s/b.usdc"}, {"c.usda"}}});
    expectRoundTrip(ShowToken{std::string(64, 'a')});
    expectRoundTrip(KeepLayers{{{"a.usda"}}});
    expectRoundTrip(ProjectLayers{{{{"a.usda"}}, {{"s/b.usdc"}}}});
    expectRoundTrip(OpenLayer{5, {"a.usda"}, 7});
    expectRoundTrip(LayerOpened{5, {"a.usda"}, 7, 1000});
    expectRoundTrip(CloseLayer{{"a.usda"}});
    expectRoundTrip(RequestBlob{kHash, 1ull << 33});
    expectRoundTrip(BlobStored{kHash});
    expectRoundTrip(AlreadyCommitted{4, 9});
    expectRoundTrip(SaveLayers{6, {{"a.usda"}}, {}});
    expectRoundTrip(SaveLayers{6, {}, true});
    const Checkpoint lunch{"before lunch", 7, {"Zoë"}, 1'700'000'000'000};
    expectRoundTrip(CreateCheckpoint{8, "before lunch"});
    expectRoundTrip(CheckpointCreated{8, lunch});
    expectRoundTrip(ListCheckpoints{9});
    expectRoundTrip(CompactHistory{9, 30});
    expectRoundTrip(CompactHistory{9, {}});
    expectRoundTrip(HistoryCompacted{9, 40, 39, 5'000, 300, "the checkpoint 'lunch'"});
    expectRoundTrip(RequestStorage{9});
    expectRoundTrip(
        Storage{9, 50, 40, 8, 7, 6, 5, 4, 3, 2, 1, 11, {{{"a.usda"}, 1, 2, 3, 4, 5, 6}}});
    expectRoundTrip(Checkpoints{9, {lunch, {"later", 8, {}, 0}}});
    expectRoundTrip(ReloadLayers{8, {{"a.usda"}}});
    expectRoundTrip(LayersReloaded{8, 9, {{"a.usda"}}, {{{"b.usda"}, "locked", "by Zoë"}}});
    expectRoundTrip(LayersSaved{6, 9, {{"a.usda"}}, {{{"b.usda"}, "saveFailed", "no space"}}});
    expectRoundTrip(CreateLayer{8, {"fx.usda"}});
    expectRoundTrip(UploadFile{8, "tex/a.png", sha256(asBytes("a")), 1, true});
    expectRoundTrip(FileUploaded{8, "tex/a.png", true});
    expectRoundTrip(LayerCreated{8, {"fx.usda"}});
    expectRoundTrip(ListSkipped{9});
    expectRoundTrip(SkippedFiles{9, 12, {{"a:b.usda", "holds a colon"}}});
    expectRoundTrip(RequestProgress{10, "save", {"a.usda"}, 3, 4});
    expectRoundTrip(RequestLog{7, 1, 0});
    expectRoundTrip(LogBegin{7});
    expectRoundTrip(LogEnd{7});
    hello.open = {{{"a.usda"}, {"s/b.usdc"}}};
    expectRoundTrip(hello);
    LayerState plain;
    plain.layer = {"b.usda"};
    expectRoundTrip(LayerStates{{{{"a.usda"},
                                  9,
                                  7,
                                  true,
                                  true,
                                  true,
                                  false,
                                  "ada",
                                  true,
                                  {"Zoë"},
                                  1'700'000'000'000,
                                  {{"a"}, {"b"}}},
                                 plain}});
    const std::vector<double> camera(16, 0.1);
    const Presence presence{{"c"},  {"ada"}, "usdview", {"/A", "/B.x"},
                            camera, 24.5,    "a.usda",  "{}"};
    expectRoundTrip(ShowPresence{presence});
    expectRoundTrip(Presences{{presence, Presence()}, {{"gone"}}});
    expectRoundTrip(AccessChanged{
        {{2, true, {"ada"}, {"editor"}, {"fx"}, {"*.usda"}, {"/A/**"}, {"transform"}, {{"save"}}},
         SentRule()}});
    expectRoundTrip(ErrorMessage{"internal", "fault", true, {}, {}});
    expectRoundTrip(ErrorMessage{"blobNotFound", "gone", false, 7, kHash});
}

TEST(Control, ReadsAsWritten) {
    EXPECT_EQ(encodeControl(OpenLayer{5, {"a.usda"}, 7}),
              R"({"layer":"a.usda","request":5,"revision":7,"type":"openLayer"})");
}

TEST(Control, UnknownMembersAreIgnored) {
    const auto decoded = decodeControl(
        R"({"type":"logBegin","request":7,"later":{"deep":[1,2,{"x":null}]},"request2":"x"})");
    EXPECT_EQ(decoded, ControlMessage(LogBegin{7}));
}

TEST(Control, OtherJsonIsMalformed) {
    const std::string deep = std::string(100'000, '[') + std::string(100'000, ']');
    for (const std::string& json : std::vector<std::string>{
             "",
             "{",
             "[]",
             "7",
             "null",
             "{}",
             R"({"type":7})",
             R"({"type":"fly"})",
             R"({"type":"logBegin"})",
             R"({"type":"logBegin","request":"7"})",
             R"({"type":"logBegin","request":-7})",
             R"({"type":"logBegin","request":7.5})",
             R"({"type":"logBegin","request":1e30})",
             R"({"type":"blobStored","hash":"00"})",
             R"({"type":"blobStored","hash":")" + std::string(64, 'G') + "\"}",
             R"({"type":"saveLayers","request":1,"layers":"a.usda"})",
             "{\"type\":\"closeLayer\",\"layer\":\"\xff.usda\"}",
             R"({"type":"logBegin","request":7,"x":)" + deep + "}",
             R"({"type":"hello","protocol":99999999999,"oldestProtocol":1,"features":[],)"
             R"("client":"c","user":"u","application":""})",
         }) {
        const auto decoded = decodeControl(json);
        ASSERT_FALSE(decoded) << json;
        EXPECT_EQ(decoded.error().code, ErrorCode::MalformedControl) << json;
        EXPECT_FALSE(decoded.error().message.empty());
    }
}

TEST(Control, LN1NamesThatLeadOutAreReported) {
    const auto decoded = decodeControl(R"({"type":"closeLayer","layer":"../../etc/a.usda"})");
    ASSERT_FALSE(decoded);
    EXPECT_EQ(decoded.error().code, ErrorCode::InvalidLayerName);
}

TEST(Control, LengthsAreBounded) {
    Hello hello{1, 1, {}, {"c"}, {std::string(300, 'u')}, "", {}, {}, {}};
    EXPECT_FALSE(decodeControl(encodeControl(hello)));
    ErrorMessage error{"internal", std::string(1'000'000, 'x'), false, {}, {}};
    const auto decoded = decodeControl(encodeControl(error));  // the writer cuts long texts
    ASSERT_TRUE(decoded);
    EXPECT_EQ(std::get<ErrorMessage>(*decoded).message.size(), 64u * 1024);
}

TEST(Control, InvalidUtf8IsRepairedWhenWritten) {
    const ErrorMessage error{"internal", "a \xff name", false, {}, {}};
    EXPECT_TRUE(decodeControl(encodeControl(error)));
}

}  // namespace
}  // namespace usdlive
