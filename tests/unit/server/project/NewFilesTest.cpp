// Tests requests to add files that are no layers (FI7).
#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

class NewFiles : public ::testing::Test {
protected:
    NewFiles() {
        world.join(1);
        world.join(2);
    }
    void upload(UploadFile request = {}) {
        request.request = 5;
        if (request.path.empty()) request.path = kTexture;
        world.receive(1, ControlMessage(request));
    }
    ErrorMessage refusal() { return world.nextControl<ErrorMessage>(1); }

    static constexpr const char* kTexture = "tex/brick.png";
    World world;
};

TEST_F(NewFiles, FI7TheAnswerSaysWhetherTheServerNeedsTheContent) {
    upload({.hash = sha256(asBytes("brick")), .size = 5});
    ASSERT_EQ(world.host.storing.size(), 1u);
    EXPECT_EQ(world.host.storing[0].job.path, kTexture);
    EXPECT_EQ(world.host.storing[0].job.hash, sha256(asBytes("brick")));
    EXPECT_FALSE(world.host.storing[0].job.overwrite);
    EXPECT_TRUE(world.silent(1));
    const std::size_t logged = world.host.logged.size();
    world.project->fileStored(1, 5, kTexture, false);
    EXPECT_EQ(world.nextControl<FileUploaded>(1), (FileUploaded{5, kTexture, false}));
    EXPECT_EQ(world.host.logged.size(), logged) << "nothing was changed";
    world.project->fileStored(1, 5, kTexture, true);
    EXPECT_EQ(world.nextControl<FileUploaded>(1), (FileUploaded{5, kTexture, true}));
    EXPECT_EQ(world.host.logged.back(), "user1: file uploaded, tex/brick.png");
    EXPECT_TRUE(world.silent(2));
}

TEST_F(NewFiles, FI7NamesLimitsAndTheStoreAreCheckedBeforeAnythingIsSent) {
    for (const char* path : {"../a.png", "/a.png", ".usdlive/a", "a.usda", "a//b"}) {
        upload({.path = path});
        const auto refused = refusal();
        EXPECT_EQ(refused.code, errorName(ErrorCode::InvalidFileName)) << path;
        EXPECT_EQ(refused.request, 5u);
        EXPECT_FALSE(refused.closing);
    }
    upload({.size = std::uint64_t(1) << 60});
    EXPECT_EQ(refusal().code, errorName(ErrorCode::BlobTooLarge));
    world.project->setSpace(false);
    upload();
    EXPECT_EQ(refusal().code, errorName(ErrorCode::StorageFull));
    EXPECT_TRUE(world.host.storing.empty());
}

TEST_F(NewFiles, FI7AFileThatCannotBeWrittenIsRefusedAndALeftSessionIsNot) {
    upload({.overwrite = true});
    EXPECT_TRUE(world.host.storing.at(0).job.overwrite);
    world.project->fileStored(1, 5, kTexture, fail(ErrorCode::SaveFailed, "read-only"));
    EXPECT_EQ(refusal().code, errorName(ErrorCode::SaveFailed));
    EXPECT_EQ(world.host.logged.back(), "user1: upload refused, read-only");
    world.project->disconnected(1);
    world.project->fileStored(1, 5, kTexture, true);
    EXPECT_TRUE(world.silent(2));
}

}  // namespace
}  // namespace usdlive::server::projecttest
