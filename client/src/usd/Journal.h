#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <vector>

#include "session/Session.h"
#include "usd/RecordFile.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Work as a journal keeps it. Paths are as the editor saw them at `revision`, after the work
/// before.
struct JournaledWork {
    std::uint64_t sequence = 0;
    std::int64_t timeMs = 0;  ///< milliseconds since 1970
    Revision revision = 0;
    Hash hash;  ///< the chain hash of that revision
    std::vector<AuthoredEdit> edits;
};

/// Keeps one's own pending transactions on the disk, so that what the server has not acknowledged
/// survives the end of the process.
///
/// A thread of its own writes and syncs: about a quarter of a second after the work was made, and
/// nothing of work that is acknowledged before. The file and the folder of its big values are
/// removed when nothing is pending. Belongs to the thread that makes the work.
class Journal {
public:
    /// `folder`: see journalFolder(). It is made when there is something to keep.
    Journal(std::filesystem::path folder, ClientId client, usd::BlobSource& blobs);
    /// Writes what is pending.
    ~Journal();

    void pending(const PendingWork& work);
    void answered(std::uint64_t sequence);

    /// Returns when everything so far is on the disk, or could not be written.
    void flush();
    /// Big values of work that is not on the disk yet: `blobs` has to give them until then.
    [[nodiscard]] std::set<Hash> neededBlobs();
    /// What is pending: nothing when all of it was answered.
    [[nodiscard]] std::optional<UnsentWork> summary();
    /// Why the journal cannot be written; once for each time that it begins to fail.
    [[nodiscard]] std::optional<Error> takeError();

private:
    struct Place {
        std::uint64_t at = 0;  // in the file
        std::uint64_t bytes = 0;
    };

    void run();
    void write(std::map<std::uint64_t, JournaledWork>& works, std::set<std::uint64_t>& answered);
    Result<void> writeBatch(const std::map<std::uint64_t, JournaledWork>& works,
                            const std::set<std::uint64_t>& answered);
    Result<void> openFile();
    Result<void> keepBlobs(const JournaledWork& work);
    void name(std::uint64_t sequence, std::set<Hash> named);
    void removeUnnamed();
    void removeBlob(const Hash& hash);
    Result<void> compact();
    void removeAll();

    const std::filesystem::path folder_;
    const ClientId client_;
    usd::BlobSource& blobs_;

    std::mutex mutex_;  // guards all below, up to the next comment
    std::condition_variable changed_;
    std::map<std::uint64_t, JournaledWork> works_;  // to be written
    std::set<std::uint64_t> answered_;              // that are in the file, or being written
    std::map<std::uint64_t, UnsentWork> pending_;   // what each holds, for summary()
    std::set<Hash> writing_;                        // big values of what is being written
    bool busy_ = false;
    bool hurry_ = false;
    bool stopping_ = false;
    std::optional<Error> error_;

    // The thread's own.
    RecordFile file_;
    std::map<std::uint64_t, Place> places_;
    std::set<Hash> kept_;                            // big values beside the file
    std::map<std::uint64_t, std::set<Hash>> named_;  // that are named, by which work
    std::map<Hash, std::size_t> names_;              // and by how many
    bool failing_ = false;
    std::thread thread_;
};

/// Where the journals of a user for a project are: `root`/`project`/`user`.
[[nodiscard]] std::filesystem::path journalFolder(const std::filesystem::path& root,
                                                  const std::string& project, const UserName& user);
/// A place for state that outlives a connection: $XDG_STATE_HOME/usdlive, else
/// ~/.local/state/usdlive; empty when there is neither.
[[nodiscard]] std::filesystem::path stateFolder();

/// The journal of a connection that has ended, held against other processes.
class LeftJournal {
public:
    /// StorageLocked: its connection, or somebody who sends it, is still there.
    [[nodiscard]] static Result<LeftJournal> open(const std::filesystem::path& folder,
                                                  const ClientId& client);
    /// Those that no process uses, and that hold work; the oldest first. `damaged`: why others
    /// cannot be read.
    [[nodiscard]] static std::vector<UnsentWork> list(const std::filesystem::path& folder,
                                                      std::vector<Error>& damaged);

    [[nodiscard]] const std::map<std::uint64_t, JournaledWork>& works() const { return works_; }
    [[nodiscard]] UnsentWork summary() const;
    [[nodiscard]] std::filesystem::path blobFolder() const;
    /// These are done; `renumbered` is in the place of one of them. Returns when that is on the
    /// disk.
    Result<void> answered(const std::vector<std::uint64_t>& sequences,
                          std::optional<JournaledWork> renumbered = std::nullopt);
    void remove();

private:
    ClientId client_;
    RecordFile file_;
    std::map<std::uint64_t, JournaledWork> works_;
};

}  // namespace usdlive::client
