// Tests finding, hashing and reading the files of a project.
#include "usdlive/server/files/AssetFiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <fstream>

using namespace usdlive;
using namespace usdlive::server;
using testing::ElementsAre;
namespace fs = std::filesystem;

namespace {

using AssetReason = AssetRefusal::Reason;

class AssetFilesTest : public testing::Test {
protected:
    AssetFilesTest() {
        char name[] = "/tmp/usdlive-assets-XXXXXX";
        root = fs::canonical(mkdtemp(name));
        folder = root / "project";
        fs::create_directories(folder);
        files = std::make_unique<AssetFiles>(folder);
    }
    ~AssetFilesTest() override { fs::remove_all(root); }

    void put(const fs::path& path, const std::string& content) {
        fs::create_directories((folder / path).parent_path());
        std::ofstream(folder / path, std::ios::binary) << content;
    }
    std::vector<AssetFile> all() {
        return *files->list(std::chrono::steady_clock::now() + std::chrono::seconds(20));
    }
    std::vector<std::string> paths() {
        std::vector<std::string> names;
        for (const AssetFile& file : all()) names.push_back(file.path);
        return names;
    }
    static std::string textOf(const OpenedAsset& asset) {
        Bytes bytes(asset.trace().size);
        EXPECT_TRUE(asset.read(0, bytes));
        return {bytes.begin(), bytes.end()};
    }
    AssetReason whyNot(const std::string& path) {
        const auto opened = files->open(path);
        EXPECT_FALSE(opened) << path;
        return opened ? AssetReason::Unreadable : opened.error().reason;
    }

    fs::path root, folder;
    std::unique_ptr<AssetFiles> files;
};

}  // namespace

TEST_F(AssetFilesTest, AS1ListsAllFilesWithTheirHashes) {
    put("tex/brick.png", "brick");
    put("shot.usda", "#usda 1.0\n");
    put("empty.bin", "");
    const auto found = all();
    EXPECT_THAT(paths(), ElementsAre("empty.bin", "shot.usda", "tex/brick.png"));
    EXPECT_EQ(found[0].hash, sha256(asBytes("")));
    EXPECT_EQ(found[2].hash, sha256(asBytes("brick")));
    EXPECT_EQ(found[2].trace.size, 5U);
    EXPECT_EQ(textOf(**files->open("tex/brick.png")), "brick");
    EXPECT_EQ(textOf(**files->open("empty.bin")), "");
}

TEST_F(AssetFilesTest, AS1WithoutTimeTheListHasNoNewHashes) {
    put("a.png", "a");
    const auto now = std::chrono::steady_clock::now();
    EXPECT_FALSE((*files->list(now)).front().hash);
    (void)all();
    // A hash is remembered when the file was not written just now.
    const fs::file_time_type::duration hour = std::chrono::hours(1);
    fs::last_write_time(folder / "a.png", fs::file_time_type::clock::now() - hour);
    EXPECT_TRUE(all().front().hash);
    EXPECT_FALSE((*files->list(now)).front().hash) << "its attributes were changed just now";
}

TEST_F(AssetFilesTest, AS2HiddenFilesAreNotServed) {
    put(".usdlive/store/head", "secret");
    put(".hidden.png", "secret");
    put("a/.b/c.png", "secret");
    EXPECT_THAT(paths(), ElementsAre());
    for (const char* path : {".usdlive/store/head", ".hidden.png", "a/.b/c.png"})
        EXPECT_EQ(whyNot(path), AssetReason::Outside) << path;
}

TEST_F(AssetFilesTest, AS2LinksInsideTheProjectResolveAndOthersDoNot) {
    put("tex/brick.png", "brick");
    put(".usdlive/key", "secret");
    std::ofstream(root / "outside.png") << "secret";
    fs::create_symlink("brick.png", folder / "tex/same.png");
    fs::create_directory_symlink(folder / "tex", folder / "images");
    fs::create_symlink("../outside.png", folder / "out.png");
    fs::create_directory_symlink(root, folder / "up");
    fs::create_symlink(".usdlive/key", folder / "key.png");
    fs::create_symlink("nowhere.png", folder / "broken.png");
    EXPECT_THAT(paths(), ElementsAre("images/brick.png", "images/same.png", "tex/brick.png",
                                     "tex/same.png"));
    EXPECT_EQ(textOf(**files->open("images/same.png")), "brick");
    EXPECT_EQ(whyNot("out.png"), AssetReason::Outside);
    EXPECT_EQ(whyNot("up/outside.png"), AssetReason::Outside);
    EXPECT_EQ(whyNot("up/project/tex/brick.png"), AssetReason::Outside) << "out and back in";
    EXPECT_EQ(whyNot("../outside.png"), AssetReason::Outside);
    EXPECT_EQ(whyNot("key.png"), AssetReason::Outside);
    EXPECT_EQ(whyNot("broken.png"), AssetReason::NotFound);
    EXPECT_EQ(whyNot("tex"), AssetReason::NotFound) << "a folder is not a file";
    ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
    EXPECT_EQ(whyNot("pipe"), AssetReason::NotFound);
}

TEST_F(AssetFilesTest, AS3AChangedFileHasAnotherHash) {
    put("a.png", "one");
    EXPECT_EQ((*files->open("a.png"))->hash(), sha256(asBytes("one")));
    put("a.png", "two");  // has the same size and nearly the same time
    EXPECT_EQ((*files->open("a.png"))->hash(), sha256(asBytes("two")));
    EXPECT_EQ(all().front().hash, sha256(asBytes("two")));
}

TEST_F(AssetFilesTest, AS3AFileThatIsWrittenWhileItIsReadIsNoticed) {
    put("a.png", std::string(1'000, 'a'));
    const auto opened = *files->open("a.png");
    Bytes part(10);
    EXPECT_TRUE(opened->read(0, part));
    put("a.png", std::string(500, 'b'));
    EXPECT_EQ(opened->read(100, part).error().reason, AssetReason::Changed);
}

TEST_F(AssetFilesTest, AS3AFileThatIsReplacedWhileItIsReadIsReadToItsEnd) {
    put("a.png", "old content");
    const auto opened = *files->open("a.png");
    put("b.png", "new content");
    fs::rename(folder / "b.png", folder / "a.png");
    EXPECT_EQ(textOf(*opened), "old content");
    EXPECT_EQ(textOf(**files->open("a.png")), "new content");
}
