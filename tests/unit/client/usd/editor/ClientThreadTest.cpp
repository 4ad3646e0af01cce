// A client belongs to one thread: every public function refuses another one. A lint compares the
// list here with Client.h, so that no function is missing.
#include <gtest/gtest.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "unit/client/usd/MemoryServer.h"
#include "usd/editor/ClientInternals.h"
#include "usdlive/client/usd/Client.h"

using namespace usdlive;

namespace {

const LayerId kThreadLayer{"shot.usda"};

struct ClientFunction {
    std::string name;
    /// Calls it and returns the error of its Result.
    std::function<std::optional<Error>(Client&)> call;
};

template <class T>
std::optional<Error> errorOf(const Result<T>& result) {
    return result ? std::nullopt : std::optional(result.error());
}

// A function that throws Misuse.
#define THROWS(name, ...)                                \
    {#name, [](Client& client) -> std::optional<Error> { \
         static_cast<void>(client.name(__VA_ARGS__));    \
         return std::nullopt;                            \
     }}
// A function that returns a Result.
#define RETURNS(name, ...) {#name, [](Client& client) { return errorOf(client.name(__VA_ARGS__)); }}

const std::vector<ClientFunction> kFunctions{
    THROWS(leave),
    THROWS(unsentWork),
    THROWS(withoutWaiting, [] {}),
    RETURNS(sendUnsent, ClientId{"a"}),
    RETURNS(unsentAsLayer, ClientId{"a"}, kThreadLayer),
    RETURNS(discardUnsent, ClientId{"a"}),
    THROWS(layers),
    RETURNS(openLayer, kThreadLayer),
    THROWS(requestOpenLayer, kThreadLayer),
    RETURNS(createLayer, LayerId{"new.usda"}),
    RETURNS(upload, "/tmp/a.png", "a.png"),
    THROWS(requestUpload, "/tmp/a.png", "a.png"),
    RETURNS(attach, "/"),
    THROWS(close, kThreadLayer),
    THROWS(layer, kThreadLayer),
    THROWS(layerId, pxr::SdfLayerHandle()),
    THROWS(identifierOf, kThreadLayer),
    RETURNS(addressAt, kThreadLayer, 1),
    RETURNS(openPlayer, kThreadLayer),
    RETURNS(readLog, {}),
    RETURNS(blame, kThreadLayer, "/A"),
    THROWS(tick),
    THROWS(beginGesture),
    THROWS(endGesture),
    RETURNS(undo),
    RETURNS(redo),
    THROWS(undoStack),
    THROWS(beginUndoGroup, "label"),
    THROWS(endUndoGroup),
    THROWS(undoGroup, "label"),
    THROWS(flush),
    THROWS(setEventHandler, {}),
    RETURNS(setLocked, kThreadLayer, true),
    RETURNS(setGloballyMuted, kThreadLayer, LayerId{"other.usda"}, true),
    THROWS(globallyMuted, kThreadLayer),
    THROWS(layerStates),
    RETURNS(showPresence, {}),
    THROWS(hidePresence),
    THROWS(presences),
    THROWS(request, ListCheckpoints{}),
    RETURNS(ask, ListCheckpoints{}),
    RETURNS(waitFor, 1, 10.0),
    THROWS(save),
    RETURNS(saveAndWait),
    THROWS(reload),
    THROWS(createCheckpoint, "name"),
    THROWS(listCheckpoints),
    THROWS(listSkipped),
    THROWS(lostWorkCount),
    RETURNS(lostWork, 0),
    RETURNS(lostWorkAsLayer, 0, kThreadLayer),
    THROWS(otherHistory),
    RETURNS(joinOtherHistory),
    THROWS(isConnected),
    THROWS(isApplying),
    THROWS(revision),
    THROWS(pendingTransactions),
    THROWS(id),
    THROWS(user),
    THROWS(role),
    RETURNS(mayEdit, kThreadLayer, "/A"),
    RETURNS(mayDo, "save", kThreadLayer),
    THROWS(isAdministrator),
    THROWS(cacheFolder),
};

// Returns the error of the function when another thread than the client's calls it.
std::optional<Error> refusalElsewhere(Client& client, const ClientFunction& function) {
    std::optional<Error> refusal;
    std::thread([&] {
        try {
            refusal = function.call(client);
        } catch (const Misuse& misuse) {
            refusal = misuse.error;
        }
    }).join();
    return refusal;
}

Result<std::unique_ptr<Client>> connectAda(tests::MemoryServer& server) {
    Client::Options options;
    options.user = "ada";
    return client::ClientInternals::connectBy(server.connect(), options);
}

}  // namespace

TEST(ClientThread, EveryFunctionRefusesAnotherThread) {
    tests::MemoryServer server{{{kThreadLayer, LayerDoc()}}};
    auto client = connectAda(server);
    ASSERT_TRUE(client) << client.error().message;
    (*client)->tick();  // this thread is the client's
    for (const ClientFunction& function : kFunctions) {
        const auto refusal = refusalElsewhere(**client, function);
        ASSERT_TRUE(refusal) << function.name << "() works on another thread";
        EXPECT_EQ(refusal->code, ErrorCode::InvalidArgument) << function.name;
        EXPECT_TRUE(refusal->message.starts_with(function.name + "() was called on another thread"))
            << refusal->message;
    }
    EXPECT_TRUE((*client)->openLayer(kThreadLayer)) << "nothing was harmed";
}

TEST(ClientThread, TheThreadThatCallsFirstHasTheClient) {
    tests::MemoryServer server{{{kThreadLayer, LayerDoc()}}};
    auto client = connectAda(server);
    ASSERT_TRUE(client) << client.error().message;
    (*client)->setEventHandler([](const client::Event&) {});  // does not choose the thread
    std::thread([&] { (*client)->tick(); }).join();
    EXPECT_THROW((*client)->tick(), Misuse);
    EXPECT_THROW((*client)->setEventHandler({}), Misuse);
}
