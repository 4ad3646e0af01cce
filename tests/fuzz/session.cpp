// Fuzzes the real project with a session that follows the rules, except in a few of its messages
// (F3). An input says which messages are changed and how. Whatever happens, a second session must
// not be affected.
#include <fuzzer/FuzzedDataProvider.h>

#include "Fuzz.h"
#include "unit/server/project/FakeHost.h"

using namespace usdlive;
using namespace usdlive::server;
using namespace usdlive::server::projecttest;
using fuzz::require;

namespace {

// The numbers of the two sessions. Their clients' names differ much: a session that sends the name
// of another session's client would replace that session.
constexpr SessionId kBystander = 777, kStranger = 1;
const LayerId kA{"a.usda"}, kB{"b.usda"};

Frame control(const ControlMessage& message) { return ControlFrame{encodeControl(message)}; }

Frame submission(std::uint64_t sequence, std::vector<Edit> edits, std::uint64_t gesture = 0) {
    return SubmitFrame{{{World::client(kStranger), sequence}, 0, gesture, std::move(edits)}};
}

/// The messages of a normal session of an editor.
std::vector<Frame> script(const World& world) {
    const Bytes texture(1000, 7);
    const Hash hash = sha256(texture);
    const Value blob = Value::blob(arrayOf(ValueType::UChar), hash, texture.size());
    const LayerId past = kA;
    return {
        control(world.hello(kStranger)),
        control(OpenLayer{1, kA, 0}),
        control(OpenLayer{2, kB, 0}),
        submission(1, {create("/C"), inCreated(1, 0, ".x", CreateSpec{SpecKind::Attribute}),
                       inCreated(1, 1, "", SetField{"default", {}, doubleValue(1)})}),
        PreviewFrame{World::client(kStranger), 7, 0, {set("/A.x", 2)}},
        submission(2, {set("/A.x", 3)}, 7),
        submission(3, {inCreated(1, 0, "", MoveSpec{{"/B", {}}, "D"}), erase("/A")}),
        BlobFrame{hash, texture.size(), 0, std::uint32_t(texture.size()), deflate(texture)},
        submission(4, {create("/E", kB), {kB, {"/E", {}}, SetField{"other", {}, blob}}}),
        control(RequestBlob{hash, 0}),
        control(OpenLayer{3, past, 2}),
        control(RequestLog{4, 1, 0}),
        control(SaveLayers{5, {}}),
        submission(5, {move("/B/D", "/", "F"), erase("/F")}),
        control(CloseLayer{kB}),
    };
}

/// Answers everything that the project has requested.
void serve(World& world) {
    FakeHost& host = world.host;
    world.answerQuestions();
    while (!host.loading.empty() || !host.appending.empty() || !host.reading.empty() ||
           !host.readingHistory.empty() || !host.blobParts.empty() || !host.saves.empty()) {
        if (!host.loading.empty()) world.load(true);
        world.store();
        if (!host.reading.empty()) world.answerRead();
        for (const auto& read : std::exchange(host.readingHistory, {}))
            world.project->historyRead(read.session, read.request, World::sample());
        for (const auto& [session, part] : std::exchange(host.blobParts, {})) {
            host.blobs.insert(part.hash);
            world.project->blobWritten(session, part.hash, true);
        }
        for (const auto& save : std::exchange(host.saves, {}))
            world.project->layersSaved(save.session, save.request, {});
        world.answerQuestions();
    }
}

// ---- faults of a message

class Mutator {
public:
    explicit Mutator(FuzzedDataProvider& choices) : choices_(choices) {}

    /// Changes the script: order, repeats, fields with wrong content.
    void change(std::vector<Frame>& script) {
        const std::size_t at = choices_.ConsumeIntegralInRange<std::size_t>(0, script.size() - 1);
        const auto here = script.begin() + std::ptrdiff_t(at);
        switch (choices_.ConsumeIntegralInRange(0, 5)) {
            case 0:
                script.erase(here);
                if (script.empty()) script.push_back(ControlFrame{"{}"});
                return;
            case 1:
                script.insert(here, Frame(*here));
                return;
            case 2:
                std::swap(
                    *here,
                    script[choices_.ConsumeIntegralInRange<std::size_t>(0, script.size() - 1)]);
                return;
            case 3:
                script.insert(here, foreign());
                return;
            default:
                std::visit([this](auto& frame) { wrong(frame); }, *here);
        }
    }

    /// Changes bytes: type, length, an end too early, anything.
    void change(Bytes& message) {
        if (message.empty()) return;
        const std::size_t at = choices_.ConsumeIntegralInRange<std::size_t>(0, message.size() - 1);
        switch (choices_.ConsumeIntegralInRange(0, 3)) {
            case 0:
                return message.resize(at);
            case 1:
                message[at] = choices_.ConsumeIntegral<std::uint8_t>();
                return;
            case 2:
                message[at % 4] = choices_.ConsumeIntegral<std::uint8_t>();
                return;
            default:
                const auto more = choices_.ConsumeBytes<std::uint8_t>(32);
                message.insert(message.begin() + std::ptrdiff_t(at), more.begin(), more.end());
        }
    }

private:
    std::uint64_t number() {
        static constexpr std::uint64_t kNumbers[] = {0, 1, 2, 3, 4, 5, 100'000, ~0ULL, ~0ULL - 1};
        return choices_.PickValueInArray(kNumbers);
    }
    LayerId layer() {
        static constexpr const char* kNames[] = {"a.usda", "b.usda", "c.usda", "../a.usda", ""};
        return {choices_.PickValueInArray(kNames)};
    }
    std::string path() {
        static constexpr const char* kPaths[] = {"",   "/", "/A", "/A.x",   "/B/D",     "/A/B/C",
                                                 ".x", "A", "//", "/A{v=}", "/A{v=one}"};
        return choices_.PickValueInArray(kPaths);
    }
    Hash hash() { return sha256(asBytes(path())); }

    // Returns a frame that only a server sends.
    Frame foreign() {
        switch (choices_.ConsumeIntegralInRange(0, 3)) {
            case 0:
                return CommitFrame{};
            case 1:
                return RefusalFrame{number(), 0, {ErrorCode::Locked, "no"}};
            case 2:
                return SnapshotFrame{number(), 0, true, 0, {}};
            default:
                return control(LogEnd{number()});
        }
    }
    void wrong(ControlFrame& frame) {
        auto message = decodeControl(frame.json);
        if (!message) return;
        std::visit([this](auto& content) { wrong(content); }, *message);
        frame.json = encodeControl(*message);
    }
    void wrong(Hello& hello) {
        if (choices_.ConsumeBool()) hello.resume = Hello::Resume{number(), number(), hash()};
        hello.protocol = int(number() % 1'000'000);
    }
    void wrong(OpenLayer& open) { open = {number(), layer(), number()}; }
    void wrong(CloseLayer& close) { close.layer = layer(); }
    void wrong(RequestBlob& request) { request = {hash(), number()}; }
    void wrong(RequestLog& request) { request = {number(), number(), number()}; }
    void wrong(SaveLayers& save) { save = {number(), {layer(), layer()}}; }
    void wrong(auto&) {}  // sent by the server only

    void wrong(SubmitFrame& frame) {
        Transaction& transaction = frame.transaction;
        switch (choices_.ConsumeIntegralInRange(0, 4)) {
            case 0:
                transaction.id.sequence = number();
                return;
            case 1:
                transaction.id.client = World::client(kBystander);
                return;
            case 2:
                transaction.base = number();
                return;
            case 3:
                transaction.gesture = number();
                return;
            default:
                wrong(transaction.edits);
        }
    }
    void wrong(PreviewFrame& frame) {
        frame.base = number();
        frame.gesture = number();
        wrong(frame.edits);
    }
    void wrong(BlobFrame& frame) {
        frame.offset = number();
        frame.size = number();
        frame.hash = hash();
    }
    void wrong(std::vector<Edit>& edits) {
        if (edits.empty()) return;
        Edit& edit = edits[choices_.ConsumeIntegralInRange<std::size_t>(0, edits.size() - 1)];
        switch (choices_.ConsumeIntegralInRange(0, 4)) {
            case 0:
                edit.layer = layer();
                return;
            case 1:
                edit.address.path = path();
                return;
            case 2:
                edit.address.creation = Creation{number(), std::uint32_t(number())};
                return;
            case 3:
                edit.action = MoveSpec{{path(), {}}, path()};
                return;
            default:
                edit.action =
                    CreateSpec{choices_.ConsumeBool() ? SpecKind::VariantSet : SpecKind::Attribute};
        }
    }

    FuzzedDataProvider& choices_;
};

// ---- the other session

/// Checks that the messages which it received make one history, and that its layer is the server's
/// (SE1, CH1, M8).
void checkBystander(World& world) {
    require(!world.host.closed.contains(kBystander), "no other session is closed");
    LayerDoc seen = World::sample();
    Revision revision = 0;
    Hash hash;
    for (const Bytes& bytes : world.host.sent[kBystander]) {
        const auto frame = decodeFrame(bytes);
        require(frame.has_value(), "a sent message is a frame");
        const auto* sent = std::get_if<CommitFrame>(&*frame);
        if (!sent) continue;
        require(sent->commit.revision == ++revision, "SE1: revisions without gaps");
        require(sent->commit.previous == hash, "CH1: the chain holds");
        hash = hashAfter(*sent, hash, bytes);
        for (const Edit& edit : sent->commit.edits)
            if (edit.layer == kA)
                require(seen.apply(edit.address.path, edit.action).has_value(),
                        "an edit of a commit applies");
    }
    const LayerDoc* layer = world.project->layer(kA);
    require(layer && seen == *layer, "M8: the layer is the server's");
}

void checkBystanderWorks(World& world) {
    const Revision before = world.project->durableRevision();
    world.submit(kBystander, 1, {create("/Mine")}, before);
    serve(world);
    require(world.project->durableRevision() == before + 1, "others can edit");
    checkBystander(world);
}

/// Checks FR5.
void checkReasonBeforeClosed(World& world) {
    if (!world.host.closed.contains(kStranger)) return;
    const auto frame = decodeFrame(world.host.sent[kStranger].back());
    const auto* last = frame ? std::get_if<ControlFrame>(&*frame) : nullptr;
    const auto message = last ? decodeControl(last->json) : fail(ErrorCode::Internal, "");
    const auto* error = message ? std::get_if<ErrorMessage>(&*message) : nullptr;
    require(error && error->closing, "FR5: a session that is closed gets the reason");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    FuzzedDataProvider choices(data, size);
    Mutator mutator(choices);
    World world;
    world.connect(kBystander);
    world.receive(kBystander, ControlMessage(OpenLayer{1, kA, 0}));
    serve(world);

    std::vector<Frame> frames = script(world);
    for (auto left = choices.ConsumeIntegralInRange(0, 3); left > 0; --left) mutator.change(frames);
    // The bytes of one message may be changed; of none if the number is beyond the last.
    const auto broken = choices.ConsumeIntegralInRange<std::size_t>(0, 2 * frames.size());
    world.project->connected(kStranger);
    for (std::size_t at = 0; at < frames.size(); ++at) {
        Bytes message = encodeFrame(frames[at]);
        if (at == broken) mutator.change(message);
        world.project->received(kStranger, message);
        if (choices.ConsumeBool()) serve(world);
    }
    serve(world);
    checkReasonBeforeClosed(world);
    checkBystander(world);
    if (choices.ConsumeBool()) world.project->disconnected(kStranger);
    checkBystanderWorks(world);
    return 0;
}

// The seeds contain only choices: one for each kind of fault in each message.
std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all{{}};
    for (std::uint8_t kind = 0; kind < 6; ++kind)
        for (std::uint8_t message = 0; message < 15; ++message)
            all.push_back(
                {0, message, kind, message, kind, 1});  // FuzzedDataProvider reads from the end
    return all;
}
