// The live sessions of a project on the disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "app/ProjectPlace.h"
#include "storage/RocksCommitStore.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// A merge of a live session and the main line, in one of both directions (LV7).
struct LineMergeRecord {
    bool isIntoMain = false;  ///< the main line has received what the session had; else reversed
    Revision from = 0;        ///< the newest revision that was merged, of the line that gave
    Revision into = 0;        ///< a revision of the line that received, before the merge's commit
    /// Whose commit after `into` is the merge: without that commit, there was none. Empty: nothing
    /// had to be changed.
    ClientId client;
    std::int64_t timeMs = 0;  ///< when it was noted, in milliseconds since 1970
};

/// A live session without its history.
struct LiveSessionRecord {
    std::string name;
    UserName creator;
    std::int64_t timeMs = 0;  ///< when it was created, in milliseconds since 1970
    Revision revision = 0;    ///< the newest one that it shares with the main line
    Revision begin = 0;       ///< its own revision that has the content of `revision`
    bool isEnded = false;     ///< nobody can connect to it; its history is kept
    Revision merged = 0;      ///< revision of the main line that has its changes; 0: none
    std::vector<LineMergeRecord> merges = {};  ///< in the order in which they were noted
};

/// The folders `.usdlive/sessions/NAME` of a project. Each has the file `session.json`, a store and
/// big values. Any thread, but one at a time for a name. All functions read or write the disk.
class LiveSessionFolder {
public:
    static constexpr std::size_t kMostNameBytes = 100;
    /// A project may have this many live sessions, with those that were ended.
    static constexpr std::size_t kMost = 200;
    static constexpr std::size_t kMostMerges = 1'000;

    explicit LiveSessionFolder(std::filesystem::path project) : project_(std::move(project)) {}

    /// Error: InvalidArgument says what is wrong with the name.
    [[nodiscard]] static Result<void> checkName(std::string_view name);

    /// Returns all live sessions whose record can be read, by name.
    [[nodiscard]] std::vector<LiveSessionRecord> list() const;
    /// Removes those whose creation or removal was interrupted. Call it while neither is under way.
    void removeUnfinished() const;

    /// Makes a line of history that shares everything up to `wanted.revision` with the main line;
    /// 0: up to now. `copyStore` copies the store of the main line into a new folder. Files are
    /// shared, not copied, where the disk can. After an error nothing is left. Errors:
    /// InvalidArgument (the name, or it exists; the revision), HistoryReplaced, TransactionTooLarge
    /// (too much has changed since the revision), those of the store.
    using CopyStore = std::function<Result<void>(const std::filesystem::path& folder)>;
    [[nodiscard]] Result<LiveSessionRecord> create(LiveSessionRecord wanted,
                                                   const CopyStore& copyStore,
                                                   const RocksCommitStoreOptions& options) const;
    /// Replaces the record. Error: StorageFailed, StorageFull.
    [[nodiscard]] Result<void> write(const LiveSessionRecord& record) const;
    /// Removes a live session with its history. Its store must be closed.
    [[nodiscard]] Result<void> remove(const std::string& name) const;

private:
    [[nodiscard]] std::filesystem::path sessions() const {
        return project_ / ".usdlive" / "sessions";
    }

    std::filesystem::path project_;
};

}  // namespace usdlive::server
