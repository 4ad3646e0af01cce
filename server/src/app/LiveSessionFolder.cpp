// Makes, lists and removes the live sessions of a project on the disk.
#include "app/LiveSessionFolder.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>

#include "app/CopiedFolder.h"
#include "app/Faults.h"
#include "project/RestoredLayers.h"
#include "usdlive/common/core/OwnedFile.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::json;

// A session that is being made or removed. No live session can have such a name.
constexpr const char* kUnfinished = ".part";
constexpr const char* kRecord = "session.json";
constexpr mode_t kReadable = 0644;

std::string textOf(const LiveSessionRecord& record) {
    Json merges = Json::array();
    for (const LineMergeRecord& one : record.merges)
        merges.push_back({{"intoMain", one.isIntoMain},
                          {"from", one.from},
                          {"into", one.into},
                          {"client", one.client.value},
                          {"time", one.timeMs}});
    const Json json{{"creator", record.creator.value},
                    {"time", record.timeMs},
                    {"revision", record.revision},
                    {"begin", record.begin},
                    {"ended", record.isEnded},
                    {"merged", record.merged},
                    {"merges", merges}};
    return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::optional<LiveSessionRecord> recordIn(const fs::path& folder) {
    std::ifstream file(folder / kRecord, std::ios::binary);
    const std::string text(std::istreambuf_iterator<char>(file), {});
    const Json json = Json::parse(text, nullptr, false);
    if (!json.is_object()) return std::nullopt;
    try {
        LiveSessionRecord record{
            folder.filename().string(),          {json.at("creator").get<std::string>()},
            json.at("time").get<std::int64_t>(), json.at("revision").get<Revision>(),
            json.at("begin").get<Revision>(),    json.at("ended").get<bool>(),
            json.at("merged").get<Revision>()};
        for (const Json& one : json.at("merges"))
            record.merges.push_back({one.at("intoMain").get<bool>(),
                                     one.at("from").get<Revision>(),
                                     one.at("into").get<Revision>(),
                                     {one.at("client").get<std::string>()},
                                     one.at("time").get<std::int64_t>()});
        return record;
    } catch (const Json::exception&) {
        return std::nullopt;
    }
}

bool isUnfinished(const fs::path& folder) {
    return folder.filename().string().ends_with(kUnfinished);
}

/// Removes a folder at the end of its scope, unless it was renamed.
class Unfinished {
public:
    explicit Unfinished(fs::path path) : path_(std::move(path)) {}
    ~Unfinished() {
        std::error_code ignored;
        fs::remove_all(path_, ignored);
    }
    Unfinished(const Unfinished&) = delete;
    Unfinished& operator=(const Unfinished&) = delete;

private:
    const fs::path path_;
};

/// Gives the copied store an identity of its own, and the content of the revision from which the
/// live session is. Its layers are saved as they are: a live session has no files.
Result<void> takeOver(const fs::path& folder, RocksCommitStoreOptions options,
                      LiveSessionRecord& wanted) {
    options.isNewLine = true;
    const auto opened = createRocksCommitStore(folder, options);
    if (!opened) return tl::unexpected(opened.error());
    CommitStore& store = **opened;
    if (wanted.revision == 0) wanted.revision = store.head().revision;
    const Restoring by{
        wanted.creator, wanted.timeMs,
        "Begin of " + wanted.name + " at revision " + std::to_string(wanted.revision)};
    const auto newest = restoreLayers(store, wanted.revision, by);
    if (!newest) return tl::unexpected(newest.error());
    wanted.begin = *newest;
    const auto layers = store.layers();
    if (!layers) return tl::unexpected(layers.error());
    for (const LayerId& layer : *layers)
        if (auto set = store.setSaved(layer, {*newest, {}, {}}); !set)
            return tl::unexpected(set.error());
    return {};
}

}  // namespace

Result<void> LiveSessionFolder::checkName(std::string_view name) {
    const auto refuse = [&](const std::string& why) {
        return fail(ErrorCode::InvalidArgument,
                    "a live session cannot have the name \"" + std::string(name) + "\": " + why);
    };
    if (name.empty()) return refuse("it is empty");
    if (name.size() > kMostNameBytes)
        return refuse("it has more than " + std::to_string(kMostNameBytes) + " bytes");
    if (!isUtf8(name)) return refuse("it is not UTF-8");
    if (name.front() == '.') return refuse("it begins with a dot");
    if (name.ends_with(kUnfinished)) return refuse("it ends with .part");
    const bool hasOther = std::ranges::any_of(name, [](char one) {
        return static_cast<unsigned char>(one) < ' ' || one == '\x7f' ||
               std::string_view("/\\?#&").find(one) != std::string_view::npos;
    });
    if (hasOther) return refuse("it has a control character or one of / \\ ? # &");
    return {};
}

std::vector<LiveSessionRecord> LiveSessionFolder::list() const {
    std::vector<LiveSessionRecord> all;
    std::error_code error;
    for (fs::directory_iterator entry(sessions(), error), end; !error && entry != end;
         entry.increment(error)) {
        auto record = isUnfinished(entry->path()) ? std::nullopt : recordIn(entry->path());
        if (record) all.push_back(std::move(*record));
    }
    std::ranges::sort(all, {}, &LiveSessionRecord::name);
    return all;
}

void LiveSessionFolder::removeUnfinished() const {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(sessions(), error)) {
        std::error_code ignored;
        if (isUnfinished(entry.path())) fs::remove_all(entry.path(), ignored);
    }
}

Result<LiveSessionRecord> LiveSessionFolder::create(LiveSessionRecord wanted,
                                                    const CopyStore& copyStore,
                                                    const RocksCommitStoreOptions& options) const {
    if (auto valid = checkName(wanted.name); !valid) return tl::unexpected(valid.error());
    const fs::path folder = sessions() / wanted.name;
    std::error_code error;
    if (fs::exists(fs::symlink_status(folder, error)))
        return fail(ErrorCode::InvalidArgument,
                    "there is a live session " + wanted.name + "; choose another name");
    if (list().size() >= kMost)
        return fail(ErrorCode::InvalidArgument, "a project can have " + std::to_string(kMost) +
                                                    " live sessions; delete one first");
    const fs::path draft = folder.string() + kUnfinished;
    const Unfinished unfinished(draft);
    fs::remove_all(draft, error);
    fs::create_directories(draft, error);
    if (error) return cannotCopy(draft, error);
    faultPoint("live-session-before");
    // The store is first: it names the big values that are copied after it.
    if (auto copied = copyStore(draft / "store"); !copied) return tl::unexpected(copied.error());
    const fs::path blobs = project_ / ".usdlive" / "blobs";
    Copied count;
    if (fs::exists(blobs, error))
        if (auto copied = copyFolder(blobs, draft / "blobs", true, count,
                                     [](const fs::path& name) { return name == "unfinished"; });
            !copied)
            return tl::unexpected(copied.error());
    if (auto taken = takeOver(draft / "store", options, wanted); !taken)
        return tl::unexpected(taken.error());
    if (auto written = replaceFile(draft / kRecord, textOf(wanted), kReadable); !written)
        return tl::unexpected(written.error());
    faultPoint("live-session-after");
    fs::rename(draft, folder, error);
    if (error) return cannotCopy(folder, error);
    return wanted;
}

Result<void> LiveSessionFolder::write(const LiveSessionRecord& record) const {
    return replaceFile(sessions() / record.name / kRecord, textOf(record), kReadable);
}

Result<void> LiveSessionFolder::remove(const std::string& name) const {
    const fs::path folder = sessions() / name;
    const fs::path draft = folder.string() + kUnfinished;
    std::error_code error;
    fs::rename(folder, draft, error);  // so that it is removed as a whole
    if (!error) fs::remove_all(draft, error);
    if (!error) return {};
    return fail(ErrorCode::StorageFailed,
                "cannot remove " + folder.string() + ": " + error.message());
}

}  // namespace usdlive::server
