// Tests the same through a session of the real project (F4): it is answered or closed, and the
// other sessions continue.
#include <gtest/gtest.h>

#include <limits>

#include "Cost.h"
#include "unit/server/project/FakeHost.h"

namespace usdlive::bombs {
namespace {

using namespace server;
using namespace server::projecttest;

class ProjectBombs : public ::testing::Test {
protected:
    void SetUp() override {
        world.join(1);
        world.join(2);
        world.receive(1, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
    }
    void TearDown() override {
        EXPECT_FALSE(world.host.closed.contains(1));
        world.submit(1, 1, {create("/Mine")}, world.project->durableRevision());
        world.store();
        EXPECT_TRUE(world.project->layer({"a.usda"})->has("/Mine"));
    }

    /// Measures the cost of receiving a frame, and returns the code of the answer.
    ErrorCode answer(const Frame& frame, std::size_t mostBytes) {
        world.host.sent[2].clear();
        const Bytes message = encodeFrame(frame);
        const Cost cost = costOf([&] { world.project->received(2, message); });
        EXPECT_LE(cost.bytes, mostBytes);
        EXPECT_LE(cost.time.count(), 50 * kSlowness);
        if (world.silent(2)) return ErrorCode::Internal;
        const Frame answered = world.next(2);
        if (const auto* refusal = std::get_if<RefusalFrame>(&answered)) return refusal->error.code;
        const auto message2 = decodeControl(std::get<ControlFrame>(answered).json);
        return *errorFromName(std::get<ErrorMessage>(*message2).code);
    }
    static Frame submission(Edit edit) {
        return SubmitFrame{{{World::client(2), 1}, 0, 0, {std::move(edit)}}};
    }

    World world;
};

TEST_F(ProjectBombs, APathTooDeepIsRefused) {
    std::string path;
    for (int level = 0; level < 100'000; ++level) path += "/a";
    EXPECT_EQ(answer(submission(create(path)), 4 * path.size() + 64 * 1024),
              ErrorCode::InvalidPath);
    EXPECT_TRUE(world.host.closed.contains(2));
}

TEST_F(ProjectBombs, ANameOfAFieldTooLongIsRefused) {
    const std::string name(8 << 20, 'f');
    EXPECT_EQ(
        answer(submission({{"a.usda"}, {"/A", {}}, SetField{name, {}, doubleValue(1)}}), 64 * 1024),
        ErrorCode::MalformedFrame);
}

TEST_F(ProjectBombs, JsonTooDeepIsRefused) {
    const std::string json(100'000, '[');
    EXPECT_EQ(answer(ControlFrame{json}, 4 * json.size()), ErrorCode::MalformedControl);
}

TEST_F(ProjectBombs, NanTimesAreRefused) {
    for (const double time :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        const Edit sample{
            {"a.usda"}, {"/A.x", {}}, SetField{"timeSamples", SampleTime{time}, doubleValue(1)}};
        EXPECT_EQ(answer(submission(sample), 64 * 1024), ErrorCode::InvalidValue);
        world.project->disconnected(2);
        world.join(2);
    }
}

TEST_F(ProjectBombs, D1AnInvalidFrameRateIsRefusedAndTheSessionContinues) {
    const Edit rate{
        {"a.usda"},
        {"/", {}},
        SetField{"timeCodesPerSecond", {}, doubleValue(std::numeric_limits<double>::quiet_NaN())}};
    EXPECT_EQ(answer(submission(rate), 64 * 1024), ErrorCode::ForbiddenValue);
    EXPECT_FALSE(world.host.closed.contains(2));
}

TEST_F(ProjectBombs, NansAreOrdinaryValues) {
    const Value never = doubleValue(std::numeric_limits<double>::quiet_NaN());
    EXPECT_EQ(
        answer(submission({{"a.usda"}, {"/A.x", {}}, SetField{"default", {}, never}}), 64 * 1024),
        ErrorCode::Internal);  // there is no answer before it is durable
    world.store();
    EXPECT_EQ(*world.project->layer({"a.usda"})->field("/A.x", "default")->as<Value>(), never);
}

// This many items may be in a scene. The transaction is encoded once more, as the commit.
TEST_F(ProjectBombs, AListOfAMillionItemsHasAProportionalCost) {
    ListOp list;
    list.itemType = ValueType::Int;
    for (std::uint32_t item = 0; item < 1'000'000; ++item)
        list[ListName::Appended].emplace_back(
            ValueType::Int,
            Bytes{std::uint8_t(item), std::uint8_t(item >> 8), std::uint8_t(item >> 16), 0});
    const Bytes message =
        encodeFrame(submission({{"a.usda"}, {"/A", {}}, SetField{"inactiveIds", {}, list}}));
    const Cost cost = costOf([&] { world.project->received(2, message); });
    const ByteView frame = ByteView(message).subspan(sizeof(std::uint32_t));  // after its length
    const Cost coding = costOf([&] { (void)encodeFrame(*decodeFrame(frame)); });
    EXPECT_LE(cost.bytes, 20 * message.size());
    EXPECT_LE(cost.time, 5 * coding.time);
    world.store();
    EXPECT_TRUE(world.project->layer({"a.usda"})->field("/A", "inactiveIds"));
}

}  // namespace
}  // namespace usdlive::bombs
