// Tests importing, saving and listing the files of a folder.
#include "files/LayerFiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include "usdlive/common/protocol/ServerControl.h"
#include "usdlive/common/usd/SdfLayerStore.h"

using namespace usdlive;
using namespace usdlive::server;
using namespace pxr;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
namespace fs = std::filesystem;

namespace {

class FakeBlobs : public BlobStore, public BlobSink, public BlobSource {
public:
    bool has(const Hash& hash) const override {
        if (onQuery) onQuery();
        return all.contains(hash);
    }
    Result<std::uint64_t> size(const Hash& hash) const override {
        return read(hash, 0, SIZE_MAX).map([](const Bytes& bytes) { return bytes.size(); });
    }
    Result<bool> write(const Hash& hash, std::uint64_t, std::uint64_t, ByteView part,
                       const BlobWriter&) override {
        if (isFull) return fail(ErrorCode::StorageFull, "full");
        all[hash] = Bytes(part.begin(), part.end());
        return true;
    }
    Result<Bytes> read(const Hash& hash, std::uint64_t offset, std::size_t count) const override {
        const auto found = all.find(hash);
        if (found == all.end()) return fail(ErrorCode::BlobNotFound, "not here");
        const auto part = ByteView(found->second).subspan(std::min(offset, found->second.size()));
        return Bytes(part.begin(), part.begin() + std::ptrdiff_t(std::min(count, part.size())));
    }
    void forget(std::uint64_t) override {}
    Result<std::vector<Hash>> list() const override { return std::vector<Hash>(); }
    void drop(std::span<const Hash>) override {}
    Result<Purged> purge(std::size_t) override { return Purged(); }
    void keepBlob(const Hash& hash, SharedBytes bytes) override { all[hash] = *bytes; }
    SharedBytes blob(const Hash& hash) override {
        return all.contains(hash) ? std::make_shared<const Bytes>(all[hash]) : nullptr;
    }

    std::map<Hash, Bytes> all;
    bool isFull = false;
    std::function<void()> onQuery;  // called while a layer with big values is read
};

constexpr const char* kText = "#usda 1.0\n\ndef \"A\"\n{\n    double x = 1\n}\n\n";

class LayerFilesTest : public testing::Test {
protected:
    LayerFilesTest() {
        char name[] = "/tmp/usdlive-files-XXXXXX";
        root = fs::canonical(mkdtemp(name));
        folder = root / "project";
        fs::create_directories(folder / "shot");
        open();
    }
    ~LayerFilesTest() override { fs::remove_all(root); }

    void open() { files = *createLayerFiles(folder, blobs); }
    fs::path put(const fs::path& path, const std::string& content = kText) {
        fs::create_directories((folder / path).parent_path());
        std::ofstream(folder / path) << content;
        return folder / path;
    }
    static std::string contentOf(const fs::path& path) {
        std::ifstream in(path, std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
    static bool isCrate(const fs::path& path) { return contentOf(path).starts_with("PXR-USDC"); }
    static std::string textOf(const fs::path& path) {
        std::string text;
        if (const auto layer = SdfLayer::OpenAsAnonymous(path)) layer->ExportToString(&text);
        return text;
    }
    LayerDoc someDoc() {
        LayerDoc doc;
        EXPECT_TRUE(doc.apply("/New", CreateSpec{SpecKind::Prim}));
        const auto def = *usd::encodeValue(VtValue(SdfSpecifierDef), blobs);
        EXPECT_TRUE(doc.apply("/New", SetField{"specifier", {}, def}));
        return doc;
    }
    // Returns a big doc that cannot be compressed.
    LayerDoc bigDoc() {
        std::mt19937_64 random{7};
        VtArray<double> noise(60'000);
        for (double& number : noise) number = double(random()) / 3e18;
        LayerDoc doc = someDoc();
        EXPECT_TRUE(doc.apply("/New.x", CreateSpec{SpecKind::Attribute}));
        EXPECT_TRUE(
            doc.apply("/New.x", SetField{"typeName", {}, FieldValue(tokenValue("double[]"))}));
        EXPECT_TRUE(
            doc.apply("/New.x", SetField{"default", {}, *usd::encodeValue(VtValue(noise), blobs)}));
        return doc;
    }
    std::vector<std::string> everythingIn(const fs::path& path) {
        std::vector<std::string> names;
        for (const auto& entry : fs::directory_iterator(path))
            names.push_back(entry.path().filename());
        std::ranges::sort(names);
        return names;
    }
    ErrorCode importError(const std::string& name) {
        const auto doc = files->import(LayerId{name});
        EXPECT_FALSE(doc);
        message = doc ? "" : doc.error().message;
        return doc ? ErrorCode{} : doc.error().code;
    }
    ErrorCode saveError(const std::string& name, const LayerDoc& doc) {
        const auto saved = files->save(LayerId{name}, doc);
        EXPECT_FALSE(saved);
        message = saved ? "" : saved.error().message;
        return saved ? ErrorCode{} : saved.error().code;
    }

    fs::path root, folder;
    FakeBlobs blobs;
    std::unique_ptr<LayerFiles> files;
    std::string message;
};

// No file of this process can become longer while this exists. (A forked child with a limit of its
// own can hang: it inherits the locks of OpenUSD's threads, but not the threads.)
class FullDisk {
public:
    explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
        getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit limit{bytes, before_.rlim_max};
        setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~FullDisk() {
        setrlimit(RLIMIT_FSIZE, &before_);
        std::signal(SIGXFSZ, handler_);
    }
    FullDisk(const FullDisk&) = delete;
    FullDisk& operator=(const FullDisk&) = delete;

private:
    rlimit before_{};
    void (*handler_)(int);
};

// A process of root has the rights of nobody while this exists.
class RightsOfNobody {
public:
    RightsOfNobody() {
        constexpr uid_t kNobody = 65534;
        EXPECT_TRUE(before_ != 0 || seteuid(kNobody) == 0);
    }
    ~RightsOfNobody() { EXPECT_EQ(seteuid(before_), 0); }
    RightsOfNobody(const RightsOfNobody&) = delete;
    RightsOfNobody& operator=(const RightsOfNobody&) = delete;

private:
    const uid_t before_ = geteuid();
};

}  // namespace

TEST_F(LayerFilesTest, ListsLayersAndNothingElse) {
    for (const char* name : {"b.usda", "a.usd", "shot/c.usdc", "shot/deep/d.USDA"}) put(name);
    for (const char* name : {"x.usdz", "notes.txt", ".hidden.usda", ".git/e.usda",
                             ".usdlive/f.usda", "col:on.usda", "back\\slash.usda", "\xff.usda"})
        put(name);
    fs::create_symlink(root, folder / "outside");
    fs::create_symlink(folder, folder / "loop");
    const auto listed = files->list();
    ASSERT_TRUE(listed) << listed.error().message;
    std::vector<LayerId> names;
    for (const LayerFile& file : *listed) names.push_back(file.layer);
    EXPECT_THAT(names, ElementsAre(LayerId{"a.usd"}, LayerId{"b.usda"}, LayerId{"shot/c.usdc"},
                                   LayerId{"shot/deep/d.USDA"}));
}

TEST_F(LayerFilesTest, FI5FollowsLinksInsideTheProject) {
    put("v3/hall.usda");
    put("b.usda");
    fs::create_symlink("v3", folder / "latest");
    fs::create_symlink("b.usda", folder / "link.usda");
    fs::create_symlink("../v3", folder / "v3" / "again");
    std::vector<std::string> names;
    const auto listed = files->list();
    for (const LayerFile& file : *listed) names.push_back(file.layer.value);
    EXPECT_THAT(names, ElementsAre("b.usda", "latest/hall.usda", "link.usda", "v3/hall.usda"));
    ASSERT_TRUE(files->import(LayerId{"latest/hall.usda"}));
    for (const char* name : {"latest/hall.usda", "link.usda"}) {
        const auto saved = files->save(LayerId{name}, someDoc());
        ASSERT_TRUE(saved) << saved.error().message;
    }
    EXPECT_TRUE(fs::is_symlink(folder / "link.usda")) << "the target of the link is written";
    EXPECT_EQ(contentOf(folder / "b.usda"), contentOf(folder / "v3/hall.usda"));
    EXPECT_NE(contentOf(folder / "b.usda"), kText);
}

TEST_F(LayerFilesTest, FI5ListsSkippedFilesWithTheReason) {
    for (const char* name :
         {"ok.usda", "x.usdz", "X.USDZ", "notes.txt", ".git/e.usda", "col:on.usda", "\xff.usda"})
        put(name);
    fs::create_symlink(root, folder / "outside");
    fs::create_symlink(root / "texture.png", folder / "texture.png");
    fs::create_symlink(folder, folder / "loop");
    fs::create_symlink(folder / "not there.usda", folder / "dangling.usda");
    fs::create_symlink(folder / ".git", folder / "hidden");
    std::map<std::string, std::string> skipped;
    const auto found = files->skipped();
    for (const auto& [path, reason] : *found) skipped[path] = reason;
    EXPECT_EQ(skipped.size(), 8u);
    EXPECT_THAT(skipped["x.usdz"], HasSubstr("package"));
    EXPECT_THAT(skipped["X.USDZ"], HasSubstr("package"));
    EXPECT_THAT(skipped["col:on.usda"], HasSubstr("colon"));
    EXPECT_THAT(skipped["\xEF\xBF\xBD.usda"], HasSubstr("UTF-8"));
    EXPECT_THAT(skipped["outside"], HasSubstr("out of the project"));
    EXPECT_THAT(skipped["loop"], HasSubstr("back to a folder"));
    EXPECT_THAT(skipped["dangling.usda"], HasSubstr("nowhere"));
    EXPECT_THAT(skipped["hidden"], HasSubstr("hidden"));
}

TEST_F(LayerFilesTest, FI5ListsNoMoreLayersThanClientsAccept) {
    const std::string below(200, 'd'), name(200, 'n');
    const std::size_t fits = kMaxLayerNameBytes / (4 * 201 + 205);
    const fs::path deep = folder / below / below / below / below;
    fs::create_directories(deep);
    std::ofstream(deep / "first");
    for (std::size_t number = 0; number < fits + 50; ++number) {
        const std::string digits = std::to_string(number);
        const fs::path file = deep / (digits + name.substr(digits.size()) + ".usda");
        fs::create_hard_link(deep / "first", file);
    }
    std::size_t bytes = 0;
    const auto listed = *files->list();
    for (const LayerFile& file : listed) bytes += file.layer.value.size();
    EXPECT_LE(bytes, kMaxLayerNameBytes);
    EXPECT_GT(bytes, kMaxLayerNameBytes - 2'000);
    const auto skipped = files->skipped();
    EXPECT_GE(listed.size() + skipped->size(), fits + 50);
    ASSERT_FALSE(skipped->empty());
    EXPECT_THAT(skipped->front().reason, HasSubstr("too many layers"));
}

TEST_F(LayerFilesTest, FI5ManyLinksToOneAnotherEnd) {
    constexpr int kFolders = 12;  // there are 12! ways through them
    for (int i = 0; i < kFolders; ++i) put("f" + std::to_string(i) + "/a.usda");
    for (int i = 0; i < kFolders; ++i)
        for (int j = 0; j < kFolders; ++j)
            if (i != j)
                fs::create_symlink("../f" + std::to_string(j),
                                   folder / ("f" + std::to_string(i)) / ("to" + std::to_string(j)));
    const auto listed = files->list();
    ASSERT_TRUE(listed);
    EXPECT_GE(listed->size(), std::size_t(kFolders));
    EXPECT_LE(listed->size(), 10'000u + kFolders);
    const auto skipped = files->skipped();
    EXPECT_TRUE(std::ranges::any_of(*skipped, [](const SkippedFile& one) {
        return one.reason.find("over links") != std::string::npos;
    }));
}

TEST_F(LayerFilesTest, FI6CreatesAnEmptyLayerOnce) {
    put("there.usda");
    ASSERT_TRUE(files->create(LayerId{"new/fx.usda"}));
    ASSERT_TRUE(files->create(LayerId{"fx.usdc"}));
    EXPECT_EQ(files->import(LayerId{"new/fx.usda"})->doc, LayerDoc());
    EXPECT_EQ(files->import(LayerId{"fx.usdc"})->doc, LayerDoc());
    for (const char* name : {"new/fx.usda", "there.usda"})
        EXPECT_EQ(files->create(LayerId{name}).error().code, ErrorCode::LayerExists);
    EXPECT_EQ(contentOf(folder / "there.usda"), kText);
    fs::create_symlink(root, folder / "up");
    EXPECT_EQ(files->create(LayerId{"up/fx.usda"}).error().code, ErrorCode::InvalidLayerName);
}

TEST_F(LayerFilesTest, LN1NeverLeavesTheProject) {
    std::ofstream(root / "secret.usda") << kText;
    fs::create_symlink(root / "secret.usda", folder / "out.usda");
    fs::create_symlink(root, folder / "up");
    fs::create_symlink(root / "nowhere", folder / "nowhere");
    fs::create_symlink(root / "not there.usda", folder / "dangling.usda");
    for (const char* name :
         {"../secret.usda", "/etc/x.usda", "shot/../../secret.usda", "out.usda", "up/secret.usda",
          "up/new.usda", "dangling.usda", "nowhere/new.usda"}) {
        SCOPED_TRACE(name);
        const auto path = files->resolve(LayerId{name});
        ASSERT_FALSE(path);
        EXPECT_EQ(path.error().code, ErrorCode::InvalidLayerName);
        EXPECT_EQ(importError(name), ErrorCode::InvalidLayerName);
        EXPECT_EQ(saveError(name, someDoc()), ErrorCode::InvalidLayerName);
    }
    EXPECT_EQ(contentOf(root / "secret.usda"), kText);
    EXPECT_EQ(*files->resolve(LayerId{"shot/new.usda"}), folder / "shot/new.usda");
}

TEST_F(LayerFilesTest, ServesAFolderThatIsALink) {
    put("b.usda");
    fs::create_symlink(folder, root / "link");
    const auto linked = createLayerFiles(root / "link", blobs);
    ASSERT_TRUE(linked);
    EXPECT_EQ((*linked)->folder(), folder);
    EXPECT_TRUE((*linked)->import(LayerId{"b.usda"}));
    EXPECT_FALSE(createLayerFiles(root / "missing", blobs));
    EXPECT_FALSE(createLayerFiles(put("file.usda"), blobs));
}

TEST_F(LayerFilesTest, ImportsTheCurrentContentOfTheFile) {
    const auto path = put("a.usda");
    const auto open = SdfLayer::FindOrOpen(path);
    open->SetField(SdfPath("/A.x"), SdfFieldKeys->Default, 2.0);  // changes it in memory only
    const auto doc = files->import(LayerId{"a.usda"});
    ASSERT_TRUE(doc) << doc.error().message;
    EXPECT_EQ(*doc->doc.field("/A.x", "default"), FieldValue(doubleValue(1)));
    put("a.usda", "#usda 1.0\ndef \"Changed\" {\n}\n");
    EXPECT_TRUE(files->import(LayerId{"a.usda"})->doc.has("/Changed"));
}

TEST_F(LayerFilesTest, ImportReportsWhyAFileCannotBeRead) {
    put("bad.usda", "#usda 1.0\ndef \"A\" {\n    nonsense\n}\n");
    put("empty.usda", "");
    put("cut.usdc", "PXR-USDC and then nothing");
    put("harm.usda", "#usda 1.0\n(\n    timeCodesPerSecond = 0\n)\n");
    fs::create_directories(folder / "folder.usda");
    testing::internal::CaptureStderr();
    EXPECT_EQ(importError("bad.usda"), ErrorCode::LayerUnreadable);
    EXPECT_THAT(message, testing::AllOf(HasSubstr("bad.usda"), HasSubstr("nonsense")));
    EXPECT_EQ(importError("empty.usda"), ErrorCode::LayerUnreadable);
    EXPECT_EQ(importError("cut.usdc"), ErrorCode::LayerUnreadable);
    EXPECT_EQ(importError("folder.usda"), ErrorCode::LayerUnreadable);
    EXPECT_EQ(importError("harm.usda"), ErrorCode::LayerUnreadable);
    EXPECT_THAT(message, HasSubstr("timeCodesPerSecond"));
    EXPECT_EQ(importError("none.usda"), ErrorCode::LayerNotFound);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(LayerFilesTest, AFileThatChangesWhileItIsImportedIsReadAgain) {
    const LayerId layer{"big.usdc"};
    ASSERT_TRUE(files->save(layer, bigDoc()));
    int changes = 0, most = 2;
    blobs.onQuery = [&] {
        if (changes == most) return;
        const auto time = fs::file_time_type() + std::chrono::seconds(++changes);
        fs::last_write_time(folder / "big.usdc", time);
    };
    const auto read = files->import(layer);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(changes, 2);
    EXPECT_EQ(read->file, **files->stamp(layer)) << "the content is that of the stamp";

    most = 1000;
    EXPECT_EQ(importError("big.usdc"), ErrorCode::LayerUnreadable);
    EXPECT_THAT(message, HasSubstr("being written"));
    EXPECT_LT(changes, 10) << "but not for ever";
}

TEST_F(LayerFilesTest, V9BigValuesGoToTheBlobStoreAndComeBack) {
    ASSERT_TRUE(files->save(LayerId{"big.usdc"}, bigDoc()));
    blobs.all.clear();
    const auto doc = files->import(LayerId{"big.usdc"});
    ASSERT_TRUE(doc);
    EXPECT_TRUE(doc->doc == bigDoc());
    EXPECT_EQ(blobs.all.size(), 1U);

    const LayerDoc kept = doc->doc;
    blobs.all.clear();
    EXPECT_EQ(saveError("big.usdc", kept), ErrorCode::SaveFailed);
    blobs.isFull = true;
    EXPECT_EQ(importError("big.usdc"), ErrorCode::StorageFull);
}

TEST_F(LayerFilesTest, SavesInTheFormatTheFileHas) {
    put("text.usd");
    const auto binary = folder / "binary.usd";
    ASSERT_TRUE(files->save(LayerId{"binary.usd"}, someDoc()));
    EXPECT_TRUE(isCrate(binary));  // like every new .usd
    for (const char* name : {"text.usd", "new.usda", "new.usdc", "binary.usd"})
        ASSERT_TRUE(files->save(LayerId{name}, someDoc())) << name;
    EXPECT_FALSE(isCrate(folder / "text.usd"));
    EXPECT_FALSE(isCrate(folder / "new.usda"));
    EXPECT_TRUE(isCrate(folder / "new.usdc"));
    EXPECT_TRUE(isCrate(binary));
    for (const char* name : {"text.usd", "new.usda", "new.usdc", "binary.usd"})
        EXPECT_TRUE(files->import(LayerId{name})->doc == someDoc()) << name;
}

// Their text is written and parsed in parts; the result must not show this.
TEST_F(LayerFilesTest, BigArraysAreSavedAsTextAndReadBack) {
    LayerDoc doc = bigDoc();
    VtArray<GfVec3f> points(20'000, GfVec3f(1.5F, -0.0F, 1e-30F));
    points.back() = GfVec3f(std::numeric_limits<float>::infinity(), 0, 3);
    VtArray<int> indices(10'000, -7);
    const auto add = [&](const std::string& name, const char* type, const VtValue& value) {
        const std::string path = "/New." + name;
        ASSERT_TRUE(doc.apply(path, CreateSpec{SpecKind::Attribute}));
        ASSERT_TRUE(doc.apply(path, SetField{"typeName", {}, FieldValue(tokenValue(type))}));
        ASSERT_TRUE(doc.apply(path, SetField{"default", {}, *usd::encodeValue(value, blobs)}));
    };
    add("points", "point3f[]", VtValue(points));
    add("indices", "int[]", VtValue(indices));
    const SdfTimeSampleMap samples{{1, VtValue(points)}, {2.5, VtValue(SdfValueBlock())}};
    ASSERT_TRUE(doc.apply("/New.points",
                          SetField{"timeSamples", {}, *usd::encodeValue(VtValue(samples), blobs)}));
    ASSERT_TRUE(files->save(LayerId{"a.usda"}, doc));
    const auto read = files->import(LayerId{"a.usda"});
    ASSERT_TRUE(read);
    for (const char* path : {"/New.points", "/New.indices", "/New.x"})
        for (const char* field : {"typeName", "default", "timeSamples"}) {
            const FieldValue* saved = doc.field(path, field);
            const FieldValue* found = read->doc.field(path, field);
            ASSERT_EQ(saved == nullptr, found == nullptr) << path << field;
            EXPECT_TRUE(!saved || *saved == *found) << path << field;
        }
    const auto text = contentOf(folder / "a.usda");
    EXPECT_EQ(text, textOf(folder / "a.usda"));
    EXPECT_THAT(text, testing::Not(HasSubstr("usdlive")));

    // NaNs, and a text that looks like the placeholder of an array: OpenUSD writes all of it.
    points.front()[1] = std::numeric_limits<float>::quiet_NaN();
    add("others", "point3f[]", VtValue(points));
    ASSERT_TRUE(files->save(LayerId{"a.usda"}, doc));
    add("trap", "string", VtValue(std::string("usdlive-array-0-")));
    ASSERT_TRUE(files->save(LayerId{"b.usda"}, doc));
    EXPECT_THAT(textOf(folder / "b.usda"), HasSubstr("usdlive-array-0-"));
}

TEST_F(LayerFilesTest, AnArrayThatDoesNotFitItsAttributeLeavesTheFileWhole) {
    const auto path = put("a.usda");
    LayerDoc doc = bigDoc();
    ASSERT_TRUE(doc.apply("/New.x", SetField{"typeName", {}, FieldValue(tokenValue("point3f[]"))}));
    testing::internal::CaptureStderr();
    EXPECT_EQ(saveError("a.usda", doc), ErrorCode::SaveFailed);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    EXPECT_EQ(contentOf(path), kText);
}

TEST_F(LayerFilesTest, SavesIntoNewFolders) {
    ASSERT_TRUE(files->save(LayerId{"new/deep/a.usda"}, someDoc()));
    EXPECT_THAT(everythingIn(folder / "new/deep"), ElementsAre("a.usda"));
}

TEST_F(LayerFilesTest, SavingKeepsThePermissions) {
    const auto path = put("a.usda");
    fs::permissions(path, fs::perms(0640));
    ASSERT_TRUE(files->save(LayerId{"a.usda"}, someDoc()));
    EXPECT_EQ(fs::status(path).permissions(), fs::perms(0640));
    ASSERT_TRUE(files->save(LayerId{"b.usdc"}, someDoc()));
    EXPECT_EQ(fs::status(folder / "b.usdc").permissions(), fs::perms(0644));
}

TEST_F(LayerFilesTest, AFailedSaveLeavesTheFileWhole) {
    const auto path = put("a.usda");
    LayerDoc doc = someDoc();
    // This value is written as text that cannot be read.
    ASSERT_TRUE(doc.apply("/New", SetField{"customData", DictionaryKey{{"k"}},
                                           FieldValue(Value(ValueType::Opaque, Bytes{}))}));
    testing::internal::CaptureStderr();
    EXPECT_EQ(saveError("a.usda", doc), ErrorCode::SaveFailed);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    EXPECT_THAT(message, HasSubstr("a.usda"));
    EXPECT_EQ(contentOf(path), kText);
    EXPECT_THAT(everythingIn(folder), ElementsAre("a.usda", "shot"));
}

TEST_F(LayerFilesTest, AFullDiskLeavesTheFileWhole) {
    const LayerDoc doc = bigDoc();
    for (const char* name : {"a.usda", "a.usdc"}) {
        SCOPED_TRACE(name);
        ASSERT_TRUE(files->save(LayerId{name}, someDoc()));
        const std::string before = contentOf(folder / name);
        {
            const FullDisk disk(100'000);
            EXPECT_EQ(saveError(name, doc), ErrorCode::SaveFailed);
        }
        EXPECT_LT(message.size(), 2000U);
        EXPECT_EQ(contentOf(folder / name), before);
    }
    EXPECT_THAT(everythingIn(folder), ElementsAre("a.usda", "a.usdc", "shot"));
}

TEST_F(LayerFilesTest, AReadOnlyFileStaysUnchanged) {
    const auto path = put("shot/a.usda");
    fs::permissions(root, fs::perms(0755));
    const auto saveIsRefused = [&](const fs::path& guarded, fs::perms perms) {
        fs::permissions(guarded, perms);
        {
            const RightsOfNobody rights;
            EXPECT_EQ(saveError("shot/a.usda", someDoc()), ErrorCode::SaveFailed);
        }
        fs::permissions(guarded, fs::perms(0777));
    };
    fs::permissions(folder / "shot", fs::perms(0777));
    fs::permissions(path, fs::perms(0666));
    saveIsRefused(folder / "shot", fs::perms(0555));
    saveIsRefused(path, fs::perms(0444));
    EXPECT_EQ(contentOf(path), kText);
    EXPECT_THAT(everythingIn(folder / "shot"), ElementsAre("a.usda"));
}

TEST_F(LayerFilesTest, RemovesFilesOfAnInterruptedSave) {
    put("shot/.usdlive-save-abc123.usda");
    put("shot/.usdlive-save-abc123.xY12ab");
    put(".usdlive-other");
    open();
    EXPECT_THAT(everythingIn(folder / "shot"), IsEmpty());
    EXPECT_THAT(everythingIn(folder), ElementsAre(".usdlive-other", "shot"));
}

TEST_F(LayerFilesTest, SavedFilesAreReadAsTheyWere) {
    put("a.usda",
        "#usda 1.0\n(\n    customLayerData = {\n        int a = 1\n    }\n)\n\ndef \"A\" (\n"
        "    references = @x.usd@\n)\n{\n    rel r = </A>\n}\n\n");
    const std::string before = textOf(folder / "a.usda");
    const auto doc = files->import(LayerId{"a.usda"});
    ASSERT_TRUE(doc);
    ASSERT_TRUE(files->save(LayerId{"a.usda"}, doc->doc));
    EXPECT_EQ(contentOf(folder / "a.usda"), before);
    ASSERT_TRUE(files->save(LayerId{"b.usdc"}, doc->doc));
    EXPECT_EQ(textOf(folder / "b.usdc"), before);
}
