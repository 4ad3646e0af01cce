// Tests finding, hashing and reading the files of a project.
#include "files/AssetFiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <fstream>

#include "storage/BlobStore.h"

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
        return **files->list(std::chrono::steady_clock::now() + std::chrono::seconds(20));
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
    EXPECT_FALSE((*files->list(now))->front().hash);
    (void)all();
    // A hash is remembered when the file was not written just now.
    const fs::file_time_type::duration hour = std::chrono::hours(1);
    fs::last_write_time(folder / "a.png", fs::file_time_type::clock::now() - hour);
    EXPECT_TRUE(all().front().hash);
    fs::last_write_time(folder / "a.png", fs::file_time_type::clock::now() - hour);
    EXPECT_FALSE((*files->list(now))->front().hash) << "its attributes were changed just now";
}

TEST_F(AssetFilesTest, AListIsUsedAgainUntilSomethingChanges) {
    put("tex/brick.png", "brick");
    put("tex/deep/a.png", "a");
    fs::create_directory_symlink("tex", folder / "link");
    const auto list = [&] {
        return *files->list(std::chrono::steady_clock::now() + std::chrono::seconds(20));
    };
    EXPECT_EQ(list(), list());
    const std::vector<std::function<void()>> changes{
        [&] { put("tex/brick.png", "wall."); },
        [&] { put("tex/deep/b.png", "b"); },
        [&] { fs::remove(folder / "link"); },
        [&] { put("tex/new/c.png", "c"); },
        [&] { put("tex/new/d.png", "d"); },
        [&] { fs::rename(folder / "tex/deep", folder / "deep"); },
        [&] { put("deep/e.png", "e"); },
        [&] { fs::remove(folder / "tex/brick.png"); },
        [&] { fs::remove_all(folder / "tex/new"); },
        [&] { fs::create_symlink("deep/e.png", folder / "f.png"); },
        [&] { fs::rename(folder, root / "elsewhere"), fs::create_directory(folder); },
    };
    for (std::size_t i = 0; i < changes.size(); ++i) {
        const auto before = list();
        changes[i]();
        const auto now = list();
        EXPECT_NE(*now, *before) << i;
        EXPECT_EQ(*now, **AssetFiles(folder).list(std::chrono::steady_clock::now() +
                                                  std::chrono::seconds(20)))
            << i;
        EXPECT_EQ(list(), now) << i;
    }
    EXPECT_TRUE(list()->empty());
}

TEST_F(AssetFilesTest, AListWithoutAHashIsNotUsedAgain) {
    put("a.png", "a");
    const auto now = std::chrono::steady_clock::now();
    EXPECT_FALSE((*files->list(now))->front().hash);
    EXPECT_TRUE(all().front().hash);
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
    EXPECT_EQ(whyNot(std::string(300, 'n')), AssetReason::NotFound) << "no file can have this name";
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

namespace {

/// Stores files, and looks at the folder afterwards.
class StoredFilesTest : public AssetFilesTest {
protected:
    Hash keep(const std::string& content) {
        const Hash hash = sha256(asBytes(content));
        EXPECT_TRUE(*blobs->write(hash, content.size(), 0, asBytes(content)));
        return hash;
    }
    Result<bool> store(const std::string& path, const std::string& content, bool overwrite = false,
                       const std::function<void()>& ready = {}) {
        return files->store({path, keep(content), content.size(), overwrite}, *blobs, ready);
    }
    ErrorCode whyNotStored(const std::string& path, const std::string& content = "new",
                           bool overwrite = false) {
        const auto stored = store(path, content, overwrite);
        EXPECT_FALSE(stored) << path;
        if (stored) return ErrorCode::Internal;
        EXPECT_NE(stored.error().message.find(path.substr(path.rfind('/') + 1)), std::string::npos)
            << stored.error().message;
        return stored.error().code;
    }
    std::string contentOf(const fs::path& path) {
        std::ifstream file(folder / path, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    /// Returns the names of all files and folders, also hidden ones.
    std::vector<std::string> everything() {
        std::vector<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(folder))
            names.push_back(entry.path().lexically_relative(folder));
        std::ranges::sort(names);
        return names;
    }

    std::unique_ptr<BlobStore> blobs = createMemoryBlobStore();
};

}  // namespace

TEST_F(StoredFilesTest, FI7AFileIsWrittenWithItsFoldersAndListedWithItsHash) {
    EXPECT_TRUE(*store("tex/a/brick.png", "brick"));
    EXPECT_EQ(contentOf("tex/a/brick.png"), "brick");
    EXPECT_THAT(everything(), ElementsAre("tex", "tex/a", "tex/a/brick.png"));
    EXPECT_EQ(all().at(0).hash, sha256(asBytes("brick")));
    const auto status = fs::status(folder / "tex/a/brick.png").permissions();
    EXPECT_EQ(status & fs::perms::others_read, fs::perms::others_read);
    EXPECT_TRUE(*store("empty.bin", ""));
    EXPECT_EQ(contentOf("empty.bin"), "");
}

TEST_F(StoredFilesTest, FI7WithoutItsContentNothingIsWritten) {
    EXPECT_FALSE(*files->store({"tex/a.png", sha256(asBytes("a")), 1, false}, *blobs));
    EXPECT_TRUE(everything().empty());
    EXPECT_EQ(files->store({"tex/a.png", keep("abc"), 2, false}, *blobs).error().code,
              ErrorCode::BlobMismatch);
    EXPECT_TRUE(everything().empty());
}

TEST_F(StoredFilesTest, FI7AnotherFileIsReplacedOnlyOnRequest) {
    put("a.png", "old");
    fs::permissions(folder / "a.png", fs::perms(0640));
    EXPECT_TRUE(*store("a.png", "old")) << "it has this content already";
    EXPECT_EQ(whyNotStored("a.png"), ErrorCode::FileExists);
    EXPECT_EQ(contentOf("a.png"), "old");
    EXPECT_TRUE(*store("a.png", "new", true));
    EXPECT_EQ(contentOf("a.png"), "new");
    EXPECT_EQ(fs::status(folder / "a.png").permissions(), fs::perms(0640));
    EXPECT_EQ(all().at(0).hash, sha256(asBytes("new")));
}

TEST_F(StoredFilesTest, FI7AFileThatAppearsMeanwhileIsNotReplaced) {
    const auto stored = store("tex/a.png", "mine", false, [&] { put("tex/a.png", "theirs"); });
    EXPECT_EQ(stored.error().code, ErrorCode::FileExists);
    EXPECT_EQ(contentOf("tex/a.png"), "theirs");
    EXPECT_TRUE(*store("tex/b.png", "same", false, [&] { put("tex/b.png", "same"); }));
    EXPECT_THAT(everything(), ElementsAre("tex", "tex/a.png", "tex/b.png"));
}

TEST_F(StoredFilesTest, FI7NamesThatNoNewFileCanHaveAreRefused) {
    put("file", "");
    put("shot.usda", "#usda 1.0\n");
    put(".hidden/x.png", "");
    put("real/x.png", "");
    fs::create_directories(root / "outside");
    fs::create_directory_symlink(root / "outside", folder / "out");
    fs::create_directory_symlink(folder / ".hidden", folder / "hidden");
    fs::create_symlink(folder / "nowhere", folder / "broken");
    fs::create_symlink(root / "outside/new.png", folder / "new.png");
    fs::create_symlink("shot.usda", folder / "texture.png");
    const auto before = everything();
    for (const char* path :
         {"../a.png", "/a.png", ".usdlive/a", ".b.png", "a.usda", "file/a.png", "real", "out/a.png",
          "hidden/x.png", "broken", "broken/a.png", "new.png", "texture.png"})
        EXPECT_EQ(whyNotStored(path, "new", true), ErrorCode::InvalidFileName) << path;
    EXPECT_EQ(everything(), before);
    EXPECT_TRUE(fs::is_empty(root / "outside"));
    EXPECT_EQ(contentOf("shot.usda"), "#usda 1.0\n");
}

TEST_F(StoredFilesTest, FI7LinksInsideTheProjectAreFollowed) {
    put("real/x.png", "x");
    fs::create_directory_symlink("real", folder / "link");
    fs::create_symlink("real/x.png", folder / "latest.png");
    EXPECT_TRUE(*store("link/y.png", "y"));
    EXPECT_EQ(contentOf("real/y.png"), "y");
    EXPECT_TRUE(*store("latest.png", "new", true));
    EXPECT_EQ(contentOf("real/x.png"), "new");
    EXPECT_TRUE(fs::is_symlink(folder / "latest.png"));
}

TEST_F(StoredFilesTest, FI7AFolderThatBecomesALinkLeadsNowhereElse) {
    put("tex/a.png", "a");
    fs::create_directories(root / "outside");
    const auto stored = store("tex/b.png", "b", false, [&] {
        fs::rename(folder / "tex", folder / "before");
        fs::create_directory_symlink(root / "outside", folder / "tex");
    });
    EXPECT_TRUE(fs::is_empty(root / "outside"));
    EXPECT_TRUE(*stored);
    EXPECT_EQ(contentOf("before/b.png"), "b") << "it is in the folder that was checked";
}

TEST_F(StoredFilesTest, FI7ReadOnlyFilesStayAndAFailureLeavesNothingBehind) {
    put("a.png", "old");
    fs::permissions(folder / "a.png", fs::perms(0444));
    EXPECT_EQ(whyNotStored("a.png", "new", true), ErrorCode::SaveFailed);
    EXPECT_EQ(contentOf("a.png"), "old");
    EXPECT_THROW((void)store("new/b/c.png", "c", false, [] { throw std::runtime_error("fault"); }),
                 std::runtime_error);
    EXPECT_THAT(everything(), ElementsAre("a.png"));
    if (geteuid() == 0) return;  // root may write everywhere
    fs::permissions(folder, fs::perms(0555));
    EXPECT_EQ(whyNotStored("b.png"), ErrorCode::SaveFailed);
    fs::permissions(folder, fs::perms(0755));
}
