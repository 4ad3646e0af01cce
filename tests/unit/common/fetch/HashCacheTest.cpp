// Tests the cache of fetched files, which processes share.
#include "usdlive/common/fetch/HashCache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <thread>

#include "unit/SmallDisk.h"
#include "usdlive/common/core/Hash.h"

using namespace usdlive::fetch;
using testing::HasSubstr;
using usdlive::test::SmallDisk;
namespace fs = std::filesystem;

namespace {

const std::string kOrigin = "localhost:7447";

std::string hashOfText(const std::string& text) {
    return usdlive::sha256(usdlive::asBytes(text)).hex();
}

/// Adds a text to a sink as if it had arrived. Returns why the download ends.
std::string put(BodySink& sink, std::string_view text) {
    while (!text.empty()) {
        const std::span<char> space = sink.space();
        const std::size_t size = text.copy(space.data(), space.size());
        if (const auto problem = sink.add(size); !problem.empty()) return problem;
        text.remove_prefix(size);
    }
    return {};
}

std::string read(const OpenFile& file) {
    std::string text(4 << 20, '\0');
    text.resize(std::fread(text.data(), 1, text.size(), file.get()));
    return text;
}

class HashCacheTest : public testing::Test {
protected:
    HashCacheTest() {
        char name[] = "/tmp/usdlive-cache-XXXXXX";
        folder = mkdtemp(name);
    }
    ~HashCacheTest() override { fs::remove_all(folder); }

    HashCache::Download downloadOf(const std::string& text) {
        return [this, text](BodySink& sink) -> Fetched<std::string> {
            ++downloads;
            const std::size_t half = text.size() / 2;
            for (const auto& part : {text.substr(0, half), text.substr(half)})
                if (const auto problem = put(sink, part); !problem.empty()) return failed(problem);
            return hashOfText(text);
        };
    }
    std::string get(HashCache& cache, const std::string& text) {
        const auto file = cache.file(kOrigin, hashOfText(text), downloadOf(text));
        return file ? read(*file) : "failed: " + file.error().cause;
    }
    fs::path fileOf(const std::string& text) const {
        const std::string hash = hashOfText(text);
        return folder / "files" / hash.substr(0, 2) / hash;
    }
    std::size_t count(const char* part) const {
        return std::size_t(std::distance(fs::recursive_directory_iterator(folder / part), {}));
    }

    std::size_t filesIn(const char* part) const {
        std::size_t files = 0;
        for (const auto& entry : fs::recursive_directory_iterator(folder / part))
            files += entry.is_regular_file() ? 1 : 0;
        return files;
    }
    static bool comesTrue(const std::function<bool()>& condition) {
        for (int left = 2'000; left > 0; --left) {
            if (condition()) return true;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        return false;
    }

    fs::path folder;
    int downloads = 0;
};

constexpr std::uint64_t kPlenty = 1 << 30;

}  // namespace

TEST_F(HashCacheTest, FetchesAFileOnce) {
    HashCache cache({folder, kPlenty}), other({folder, kPlenty});
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(get(other, "brick"), "brick");
    EXPECT_EQ(downloads, 1);
    EXPECT_EQ(get(cache, ""), "");
    EXPECT_EQ(count("new"), 0U);
}

TEST_F(HashCacheTest, FindsAFileByAKey) {
    HashCache cache({folder, kPlenty});
    EXPECT_EQ(read(*cache.keyedFile(kOrigin, "12-ab/shot.usda", downloadOf("#usda"))), "#usda");
    EXPECT_EQ(read(*HashCache({folder, kPlenty})
                        .keyedFile(kOrigin, "12-ab/shot.usda", downloadOf("other"))),
              "#usda");
    EXPECT_FALSE(cache.isKeyedReady(kOrigin, "13-cd/shot.usda"));
    EXPECT_EQ(read(*cache.keyedFile(kOrigin, "13-cd/shot.usda", downloadOf("other"))), "other");
    EXPECT_TRUE(cache.isKeyedReady(kOrigin, "13-cd/shot.usda"));
    EXPECT_EQ(downloads, 2);
}

TEST_F(HashCacheTest, KeepsNothingThatHasAnotherContent) {
    HashCache cache({folder, kPlenty});
    const auto file = cache.file(kOrigin, hashOfText("expected"), downloadOf("changed"));
    ASSERT_FALSE(file);
    EXPECT_THAT(file.error().cause, HasSubstr("changed while"));
    const auto ended = cache.file(kOrigin, hashOfText("expected"), [](BodySink& sink) {
        (void)put(sink, "exp");
        return Fetched<std::string>(failed("the connection ended"));
    });
    EXPECT_EQ(ended.error().cause, "the connection ended");
    EXPECT_EQ(count("new"), 0U);
    EXPECT_FALSE(fs::exists(fileOf("expected")));
}

// It is of use at once, but only for its process and origin.
TEST_F(HashCacheTest, ALargeFileIsHashedLater) {
    const std::string large(3 << 20, 'x');
    HashCache cache({folder, kPlenty});
    EXPECT_EQ(get(cache, large), large);
    EXPECT_EQ(get(cache, large), large);
    EXPECT_EQ(downloads, 1);
    EXPECT_FALSE(fs::exists(fileOf(large)));
    EXPECT_FALSE(cache.find("other:7447", hashOfText(large)));
    EXPECT_TRUE(comesTrue([&] { return fs::exists(fileOf(large)) && filesIn("unchecked") == 0; }));
    EXPECT_EQ(read(cache.find("other:7447", hashOfText(large))), large);
    EXPECT_EQ(filesIn("new"), 0U);
}

TEST_F(HashCacheTest, ALargeFileThatAProcessHasLeftIsHashedBeforeItIsUsed) {
    const std::string large(3 << 20, 'x'), changed(3 << 20, 'y');
    const auto leave = [&](const std::string& text) {
        HashCache cache({folder, kPlenty});
        EXPECT_TRUE(cache.file(kOrigin, hashOfText(large), [&](BodySink& sink) {
            (void)put(sink, text);
            return Fetched<std::string>(hashOfText(large));
        }));
    };
    leave(large);
    EXPECT_FALSE(fs::exists(fileOf(large)));
    HashCache cache({folder, kPlenty});
    EXPECT_FALSE(cache.isReady(kOrigin, hashOfText(large)));
    EXPECT_EQ(get(cache, large), large);
    EXPECT_EQ(downloads, 0);
    EXPECT_TRUE(fs::exists(fileOf(large)));
    EXPECT_EQ(filesIn("unchecked"), 0U);
    fs::remove(fileOf(large));
    leave(changed);
    HashCache next({folder, kPlenty});
    EXPECT_FALSE(next.find(kOrigin, hashOfText(large)));
    EXPECT_EQ(filesIn("unchecked"), 0U);
    EXPECT_EQ(get(next, large), large);
    EXPECT_EQ(downloads, 1);
}

TEST_F(HashCacheTest, ALargeFileWithAnotherContentIsRemovedAndReported) {
    const std::string large(3 << 20, 'x'), changed(3 << 20, 'y');
    std::atomic<int> wrong = 0;
    HashCache cache({folder, kPlenty});
    cache.onWrongFile = [&](const std::string& hash, const std::string& origin) {
        wrong += hash == hashOfText(large) && origin == kOrigin ? 1 : 100;
    };
    const auto file = cache.file(kOrigin, hashOfText(large), [&](BodySink& sink) {
        (void)put(sink, changed);
        return Fetched<std::string>(hashOfText(large));
    });
    EXPECT_EQ(read(*file), changed);
    EXPECT_FALSE(cache.find("other:7447", hashOfText(large)));
    EXPECT_EQ(filesIn("unchecked"), 1U);
    EXPECT_TRUE(comesTrue([&] { return filesIn("unchecked") == 0 && wrong == 1; }));
    EXPECT_FALSE(fs::exists(fileOf(large)));
    EXPECT_EQ(get(cache, large), large);
}

// A server could send the right content first, and another one while it is hashed.
TEST_F(HashCacheTest, AFileThatComesWhileAnotherOfItsNameIsHashedGetsNoName) {
    const std::string large(200 << 20, 'x'), changed(1 << 20, 'y');
    const std::string hash = hashOfText(large);
    std::atomic<int> wrong = 0;
    HashCache cache({folder, kPlenty});
    cache.onWrongFile = [&](const std::string&, const std::string&) { ++wrong; };
    const auto fetch = [&](const std::string& key, const std::string& text) {
        return bool(cache.keyedFile(kOrigin, key, [&](BodySink& sink) {
            (void)put(sink, text);
            return Fetched<std::string>(hash);
        }));
    };
    ASSERT_TRUE(fetch("first", large));
    // The thread begins after half a second.
    std::this_thread::sleep_for(std::chrono::milliseconds(550));
    ASSERT_TRUE(fetch("second", changed));
    EXPECT_TRUE(comesTrue([&] { return wrong == 1 || filesIn("files") == 1; }));
    for (const std::string& origin : {std::string("other:7447"), kOrigin})
        if (const auto found = cache.find(origin, hash)) {
            char byte = 0;
            ASSERT_EQ(std::fread(&byte, 1, 1, found.get()), 1U);
            EXPECT_EQ(byte, 'x');
        }
}

TEST_F(HashCacheTest, AServerNamesNoPath) {
    HashCache cache({folder, kPlenty});
    for (const std::size_t size : {std::size_t(5), std::size_t(3) << 20})
        for (const char* name : {"", "../../../tmp/evil", "xyz"}) {
            const auto file = cache.keyedFile(kOrigin, "key", [&](BodySink& sink) {
                (void)put(sink, std::string(size, 'x'));
                return Fetched<std::string>(name);
            });
            EXPECT_FALSE(file) << name;
        }
    EXPECT_EQ(filesIn("files") + filesIn("unchecked") + filesIn("keys") + filesIn("new"), 0U);
}

TEST_F(HashCacheTest, HashesFilesOfAnEarlierStartOfTheMachine) {
    HashCache cache({folder, kPlenty});
    (void)get(cache, "brick");
    (void)get(cache, "stone");
    std::ofstream(fileOf("brick")) << "bricX";  // an interrupted write may leave that
    for (const char* text : {"brick", "stone"})
        fs::last_write_time(fileOf(text), fs::file_time_type::clock::now() - std::chrono::years(9));
    EXPECT_FALSE(cache.isReady(kOrigin, hashOfText("stone")));
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(get(cache, "stone"), "stone");
    EXPECT_TRUE(cache.isReady(kOrigin, hashOfText("stone")));
    EXPECT_EQ(downloads, 3) << "only the damaged file was fetched again";
}

// Every file of the cache, damaged in every way, in the process that wrote it and in others.
TEST_F(HashCacheTest, ADamagedFileIsFetchedAgain) {
    using Damage = std::function<void(const fs::path&)>;
    const auto replacedBy = [](auto make) {
        return [make](const fs::path& file) {
            fs::remove(file);
            make(file);
        };
    };
    const fs::path other = folder / "other";
    std::ofstream(other) << "a file of somebody else";
    const std::map<std::string, Damage> damages{
        {"a flipped bit",
         [](const fs::path& file) {
             std::fstream stream(file, std::ios::in | std::ios::out);
             stream.seekg(1);
             const char flipped = char(stream.get() ^ 1);
             stream.seekp(1);
             stream.put(flipped);
         }},
        {"a flipped bit that leaves the time",
         [](const fs::path& file) {
             const auto time = fs::last_write_time(file);
             std::fstream stream(file, std::ios::in | std::ios::out);
             stream.put('!');
             stream.close();
             fs::last_write_time(file, time);
         }},
        {"no content", [](const fs::path& file) { fs::resize_file(file, 0); }},
        {"one byte less",
         [](const fs::path& file) { fs::resize_file(file, fs::file_size(file) - 1); }},
        {"one byte more",
         [](const fs::path& file) { fs::resize_file(file, fs::file_size(file) + 1); }},
        {"another text", [](const fs::path& file) { std::ofstream(file) << "another text"; }},
        {"gone", [](const fs::path& file) { fs::remove(file); }},
        {"a folder", replacedBy([](const fs::path& file) { fs::create_directory(file); })},
        {"a link", replacedBy([&](const fs::path& file) { fs::create_symlink(other, file); })},
        {"a link to nothing",
         replacedBy([](const fs::path& file) { fs::create_symlink("nothing", file); })},
        {"a pipe", replacedBy([](const fs::path& file) { ::mkfifo(file.c_str(), 0600); })},
    };
    const std::string small = "#usda 1.0 small", large(3 << 20, 'x');
    for (const std::string& text : {small, large})
        for (const auto& [name, damage] : damages)
            for (const char* part : {"files", "keys"})
                for (const bool isSameProcess : {true, false}) {
                    SCOPED_TRACE(name + " in " + part + (isSameProcess ? ", same" : ", other") +
                                 " process, size " + std::to_string(text.size()));
                    const bool isSilent = name == "a flipped bit that leaves the time";
                    if (isSilent && text == large && std::string_view(part) == "files") continue;
                    fs::remove_all(folder / "files");
                    fs::remove_all(folder / "keys");
                    const auto isRead = [&](HashCache& from) {
                        const auto file = from.keyedFile(kOrigin, "12-ab/s.usda", downloadOf(text));
                        return file && read(*file) == text;
                    };
                    HashCache first({folder, kPlenty}), cache({folder, kPlenty});
                    EXPECT_TRUE(isRead(first) && isRead(cache));
                    ASSERT_TRUE(fs::exists(fileOf(text)));
                    const std::string key = hashOfText("12-ab/s.usda");
                    damage(part == std::string_view("files")
                               ? fileOf(text)
                               : folder / "keys" / key.substr(0, 2) / key);
                    HashCache next({folder, kPlenty});
                    EXPECT_TRUE(isRead(isSameProcess ? cache : next));
                    EXPECT_TRUE(isRead(next));
                }
    std::ifstream untouched(other);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(untouched), {}),
              "a file of somebody else");
}

// The key of another layer, as after a mistake with a copy of the folder.
TEST_F(HashCacheTest, AKeyOfAnotherFileIsNotBelieved) {
    HashCache cache({folder, kPlenty});
    for (const char* text : {"one", "two"})
        EXPECT_EQ(read(*cache.keyedFile(kOrigin, text, downloadOf(text))), text);
    const auto keyFile = [&](const std::string& key) {
        const std::string hash = hashOfText(key);
        return folder / "keys" / hash.substr(0, 2) / hash;
    };
    fs::copy_file(keyFile("one"), keyFile("two"), fs::copy_options::overwrite_existing);
    EXPECT_EQ(read(*cache.keyedFile(kOrigin, "two", downloadOf("two"))), "two");
    std::ofstream(keyFile("two")) << hashOfText("one") << "\n";
    EXPECT_EQ(read(*cache.keyedFile(kOrigin, "two", downloadOf("two"))), "two");
}

TEST_F(HashCacheTest, RemovesTheFilesThatWereNotUsedForTheLongestTime) {
    constexpr std::size_t kFiles = 40, kSize = 100'000;
    HashCache cache({folder, kFiles / 2 * kSize});
    for (std::size_t i = 0; i < kFiles; ++i) {
        const std::string text(kSize, char('A' + i));
        EXPECT_EQ(get(cache, text), text);
        // The first file is always in use.
        fs::last_write_time(fileOf(text), fs::file_time_type::clock::now() -
                                              std::chrono::minutes(i == 0 ? 0 : 60 - i));
    }
    std::uint64_t bytes = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "files"))
        if (entry.is_regular_file()) bytes += entry.file_size();
    EXPECT_LE(bytes, kFiles / 2 * kSize * 17 / 16 + kSize);
    EXPECT_GE(bytes, kFiles / 4 * kSize);
    EXPECT_TRUE(fs::exists(fileOf(std::string(kSize, 'A'))));
    EXPECT_FALSE(fs::exists(fileOf(std::string(kSize, 'B'))));
}

TEST_F(HashCacheTest, AnOpenFileCanBeReadAfterItWasRemoved) {
    HashCache cache({folder, kPlenty});
    const auto file = cache.file(kOrigin, hashOfText("brick"), downloadOf("brick"));
    fs::remove_all(folder / "files");
    EXPECT_EQ(read(*file), "brick");
    EXPECT_EQ(get(cache, "brick"), "brick") << "the cache creates its folders again";
}

TEST_F(HashCacheTest, AFolderThatWasRemovedIsCreatedAgain) {
    HashCache cache({folder, kPlenty});
    std::vector<std::string> problems;
    cache.onProblem = [&](const std::string& problem) { problems.push_back(problem); };
    EXPECT_EQ(get(cache, "brick"), "brick");
    fs::remove_all(folder);
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_TRUE(fs::exists(folder / "files"));
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(downloads, 2);
    EXPECT_THAT(problems, testing::IsEmpty());
}

TEST_F(HashCacheTest, WhatTheFolderDoesNotTakeIsKeptToALimit) {
    const fs::path blocked = folder / "file";
    std::ofstream(blocked) << "no folder";
    HashCache cache({blocked / "cache", kPlenty});
    const std::string large(100 * 1024 * 1024, 'x');
    for (const std::string first : {"a", "b", "c"})
        EXPECT_TRUE(cache.file(kOrigin, hashOfText(first + large), downloadOf(first + large)));
    EXPECT_FALSE(cache.isReady(kOrigin, hashOfText("a" + large))) << "the oldest";
    EXPECT_TRUE(cache.isReady(kOrigin, hashOfText("b" + large)));
    EXPECT_TRUE(cache.isReady(kOrigin, hashOfText("c" + large)));
    for (int reader = 0; reader < 2; ++reader) {
        const auto file = cache.find(kOrigin, hashOfText("c" + large));
        ASSERT_TRUE(file);
        EXPECT_TRUE(read(file).starts_with("cxx")) << "each reader begins at the start";
    }
}

TEST_F(HashCacheTest, WithoutAFolderFilesAreInMemory) {
    const fs::path blocked = folder / "file";
    std::ofstream(blocked) << "no folder";
    HashCache cache({blocked / "cache", kPlenty});
    std::vector<std::string> problems;
    cache.onProblem = [&](const std::string& problem) { problems.push_back(problem); };
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(downloads, 1);
    EXPECT_TRUE(cache.isReady(kOrigin, hashOfText("brick"))) << "so that a stage can open it again";
    const auto keyed = cache.keyedFile(kOrigin, "key", downloadOf("wood"));
    ASSERT_TRUE(keyed);
    EXPECT_TRUE(cache.isKeyedReady(kOrigin, "key"));
    EXPECT_EQ(read(cache.findKeyed(kOrigin, "key")), "wood");
    EXPECT_EQ(downloads, 2);
    ASSERT_EQ(problems.size(), 1U);
    EXPECT_THAT(problems.front(), HasSubstr((blocked / "cache").string()));
}

TEST_F(HashCacheTest, AFileThatFillsTheDiskContinuesInMemory) {
    const SmallDisk disk("size=1m");
    if (!disk) GTEST_SKIP() << "cannot mount a small disk";
    HashCache cache({disk.path(), kPlenty});
    std::vector<std::string> problems;
    cache.onProblem = [&](const std::string& problem) { problems.push_back(problem); };
    std::string text(3 << 20, '\0');
    for (std::size_t i = 0; i < text.size(); ++i) text[i] = char(i * 31 / 7);
    EXPECT_EQ(get(cache, text), text);
    ASSERT_EQ(problems.size(), 1U);
    EXPECT_THAT(problems.front(), HasSubstr("takes no more: No space left"));
    EXPECT_TRUE(fs::is_empty(disk.path() / "new"));
    EXPECT_EQ(get(cache, "brick"), "brick") << "there is space for small files";
    EXPECT_EQ(get(cache, "brick"), "brick");
    EXPECT_EQ(downloads, 2);
}

// A cache that was filled before, for example in the image of a container.
TEST_F(HashCacheTest, AReadOnlyDiskServesWhatItHas) {
    const SmallDisk disk("size=1m");
    if (!disk) GTEST_SKIP() << "cannot mount a small disk";
    const fs::path cacheFolder = disk.path() / "cache";
    EXPECT_EQ(get(*std::make_unique<HashCache>(HashCache::Options{cacheFolder, kPlenty}), "brick"),
              "brick");
    ASSERT_TRUE(disk.makeReadOnly());
    // One with folders, and one without.
    for (const fs::path& place : {cacheFolder, disk.path() / "other"}) {
        HashCache cache({place, kPlenty});
        std::vector<std::string> problems;
        cache.onProblem = [&](const std::string& problem) { problems.push_back(problem); };
        downloads = 0;
        EXPECT_EQ(get(cache, "brick"), "brick");
        EXPECT_EQ(downloads, place == cacheFolder ? 0 : 1);
        for (int time = 0; time < 2; ++time) {
            EXPECT_EQ(get(cache, "stone"), "stone");
            EXPECT_EQ(read(*cache.keyedFile(kOrigin, "12-ab/shot.usda", downloadOf("#usda"))),
                      "#usda");
        }
        ASSERT_EQ(problems.size(), 1U);
        EXPECT_THAT(problems.front(),
                    HasSubstr(place.string() + " cannot be written: Read-only file system"));
    }
}

TEST_F(HashCacheTest, ThreadsFetchTheSameFileOnce) {
    HashCache cache({folder, kPlenty});
    std::atomic<int> fetched = 0;
    const std::string text(100'000, 'x');
    std::vector<std::thread> threads;
    for (int i = 0; i < 8; ++i)
        threads.emplace_back([&] {
            const auto file = cache.file(kOrigin, hashOfText(text), [&](BodySink& sink) {
                ++fetched;
                std::this_thread::sleep_for(std::chrono::milliseconds(20));
                (void)put(sink, text);
                return Fetched<std::string>(hashOfText(text));
            });
            EXPECT_EQ(read(*file), text);
        });
    for (auto& thread : threads) thread.join();
    EXPECT_EQ(fetched, 1);
}

// Kills processes in the middle of a download. The next one neither waits for them nor finds parts.
TEST_F(HashCacheTest, AKilledProcessLeavesNoPartOfAFile) {
    const std::string text(100'000, 'x');
    for (int round = 0; round < 5; ++round) {
        const pid_t child = ::fork();
        if (child == 0) {
            HashCache cache({folder, kPlenty});
            (void)cache.file(kOrigin, hashOfText(text), [&](BodySink& sink) {
                (void)put(sink, std::string_view(text).substr(0, text.size() / 2));
                ::kill(::getpid(), SIGKILL);
                return Fetched<std::string>(failed("never"));
            });
            ::_exit(1);
        }
        int status = 0;
        ASSERT_EQ(::waitpid(child, &status, 0), child);
        ASSERT_TRUE(WIFSIGNALED(status));
        EXPECT_FALSE(fs::exists(fileOf(text)));
    }
    EXPECT_EQ(count("new"), 5U);
    HashCache cache({folder, kPlenty});
    EXPECT_EQ(get(cache, text), text);
    EXPECT_EQ(count("new"), 0U) << "the first check of the size removes what is left";
}

TEST_F(HashCacheTest, FindsNothingAndDoesNotWaitWhileAFileIsFetched) {
    HashCache cache({folder, 1 << 20});
    const std::string hash = hashOfText("brick");
    bool isFound = true;
    const auto file = cache.file(kOrigin, hash, [&](BodySink& sink) -> Fetched<std::string> {
        // The lock of the file is held here: waiting for it would take 30 s.
        isFound = bool(cache.find(kOrigin, hash));
        (void)put(sink, "brick");
        return hash;
    });
    ASSERT_TRUE(file);
    EXPECT_FALSE(isFound);
    EXPECT_EQ(read(cache.find(kOrigin, hash)), "brick");
}

TEST_F(HashCacheTest, KeepsTheNewestContentOfAKeyWithItsNote) {
    const std::string large(3 << 20, 'x');
    {
        HashCache cache({folder, kPlenty});
        EXPECT_FALSE(cache.noted("url"));
        cache.note("url", {"old", "1"});
        cache.note("url", {"new", "line\nline"});
        cache.note("same", {"new", ""});
        cache.note("large", {large, "2"});
        cache.note("long", {"text", std::string(HashCache::kMostNoteBytes + 1, 'n')});
    }
    HashCache cache({folder, kPlenty});
    const auto noted = cache.noted("url");
    ASSERT_TRUE(noted);
    EXPECT_EQ(noted->content, "new");
    EXPECT_EQ(noted->note, "line\nline");
    EXPECT_EQ(cache.noted("same").value().note, "");
    EXPECT_EQ(cache.noted("large").value().content, large);
    EXPECT_FALSE(cache.noted("long"));
    cache.forget("url");
    EXPECT_FALSE(cache.noted("url"));
    EXPECT_EQ(cache.noted("same").value().content, "new");
    EXPECT_EQ(count("new"), 0U);
}

TEST_F(HashCacheTest, ADamagedNoteOrContentIsAbsent) {
    HashCache cache({folder, kPlenty});
    for (const char* part : {"keys", "files"}) {
        cache.note("url", {"content", "note"});
        for (const auto& entry : fs::recursive_directory_iterator(folder / part)) {
            if (!entry.is_regular_file()) continue;
            std::fstream file(entry.path(), std::ios::in | std::ios::out);
            file.seekp(-1, std::ios::end);
            file << "?";
        }
        EXPECT_FALSE(cache.noted("url")) << part;
    }
}

TEST_F(HashCacheTest, NotesNothingInAFolderThatCannotBeUsed) {
    std::ofstream(folder / "file") << "text";
    HashCache cache({folder / "file" / "cache", kPlenty});
    cache.note("url", {"content", "note"});
    EXPECT_FALSE(cache.noted("url"));
}
