// The journal of pending transactions on the disk.
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

#include "basics/RecordFile.h"
#include "session/Session.h"
#include "usdlive/common/layer/Blobs.h"

namespace usdlive::client {

/// A transaction in a journal. Its paths are valid at `revision`, after the earlier transactions of
/// the journal.
struct JournaledWork {
    std::uint64_t sequence = 0;
    std::int64_t timeMs = 0;  ///< milliseconds since 1970
    Revision revision = 0;
    Hash hash;      ///< hash of the chain at that revision
    StoreId store;  ///< the identity of the project's store (ID3); empty: unknown
    std::vector<AuthoredEdit> edits;
};

/// Keeps a client's pending transactions on the disk, so that unacknowledged edits survive the end
/// of the process.
///
/// A separate thread writes and syncs each transaction about a quarter of a second after it was
/// submitted, unless it is acknowledged earlier. The file and the folder of its big values are
/// removed when nothing is pending. Belongs to the thread that submits the transactions.
class Journal {
public:
    /// `folder` is a journalFolder(). It is created when it is first needed.
    Journal(std::filesystem::path folder, ClientId client, std::optional<Hash> secret,
            BlobSource& blobs);
    /// Writes the pending transactions.
    ~Journal();

    void pending(const PendingWork& work);
    void answered(std::uint64_t sequence);

    /// Waits until all transactions are on the disk, or could not be written.
    void flush();
    /// Returns the big values of transactions that are not on the disk yet. `blobs` must provide
    /// them until then.
    [[nodiscard]] std::set<Hash> neededBlobs();
    /// Returns the pending transactions; nothing if all were answered.
    [[nodiscard]] std::optional<UnsentWork> summary();
    /// Returns the reason why the journal cannot be written, once for each time when it begins to
    /// fail.
    [[nodiscard]] std::optional<Error> takeError();

private:
    struct Place {
        std::uint64_t at = 0;  // position in the file
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
    const std::optional<Hash> secret_;
    BlobSource& blobs_;

    std::mutex mutex_;  // guards the following members
    std::condition_variable changed_;
    std::map<std::uint64_t, JournaledWork> works_;  // transactions to be written
    // Answered transactions that are in the file or being written.
    std::set<std::uint64_t> answered_;
    std::map<std::uint64_t, UnsentWork> pending_;  // description of each transaction, for summary()
    std::set<Hash> writing_;  // big values of transactions that are being written
    bool busy_ = false;
    bool hurry_ = false;
    bool stopping_ = false;
    std::optional<Error> error_;

    // Used by the writing thread only.
    RecordFile file_;
    std::map<std::uint64_t, Place> places_;
    std::set<Hash> kept_;                            // big values in the folder
    std::map<std::uint64_t, std::set<Hash>> named_;  // big values that each transaction names
    std::map<Hash, std::size_t> names_;              // number of transactions that name each value
    bool failing_ = false;
    std::thread thread_;
};

/// Returns the folder of a user's journals for a project: `root`/`project`/`user`.
[[nodiscard]] std::filesystem::path journalFolder(const std::filesystem::path& root,
                                                  const std::string& project, const UserName& user);
/// Returns the folder for state that outlives a connection: $XDG_STATE_HOME/usdlive, or
/// ~/.local/state/usdlive, or an empty path if both are unset.
[[nodiscard]] std::filesystem::path stateFolder();

/// The journal of a connection that has ended, locked against other processes.
class LeftJournal {
public:
    /// Error: StorageLocked (its connection still exists, or another process is sending it).
    [[nodiscard]] static Result<LeftJournal> open(const std::filesystem::path& folder,
                                                  const ClientId& client);
    /// Returns the journals with transactions that no process uses, the oldest first, as seen from
    /// the project with this store. `damaged` receives the reasons why others cannot be read, or
    /// not to their end.
    [[nodiscard]] static std::vector<UnsentWork> list(const std::filesystem::path& folder,
                                                      const StoreId& store,
                                                      std::vector<Error>& damaged);

    [[nodiscard]] const std::map<std::uint64_t, JournaledWork>& works() const { return works_; }
    [[nodiscard]] UnsentWork summary() const;
    /// Returns whether a transaction was made in another project than that of the store (ID3).
    [[nodiscard]] bool isOfOther(const StoreId& store) const;
    /// Returns the secret of its client (ID5); nothing in a journal of an earlier version.
    [[nodiscard]] const std::optional<Hash>& secret() const { return secret_; }
    [[nodiscard]] std::filesystem::path blobFolder() const;
    /// Removes answered transactions. `renumbered` replaces one of them. Returns when the change is
    /// on the disk.
    Result<void> answered(const std::vector<std::uint64_t>& sequences,
                          std::optional<JournaledWork> renumbered = std::nullopt);
    /// A file that is damaged is renamed instead.
    void remove();

private:
    ClientId client_;
    std::optional<Hash> secret_;
    std::optional<Error> damage_;  // the journal is not read to its end
    RecordFile file_;
    std::map<std::uint64_t, JournaledWork> works_;
};

}  // namespace usdlive::client
