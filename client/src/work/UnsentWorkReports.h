// Keeps the unsent edits of a client in the project that it has joined, and reports those of
// earlier connections.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <vector>

#include "link/EditorEvents.h"
#include "work/LostWorkReports.h"
#include "work/UnsentWorkStore.h"

namespace usdlive::client {

/// The unsent edits of one client. Reports by events what earlier connections of the user have left
/// in the project, and what cannot be read or written. Used by the thread of the client.
class UnsentWorkReports {
public:
    /// `stateFolder` is that of folderOfState(); if it is empty, nothing is kept. `options` are
    /// those of the client's session. `blobs` and `events` outlive this object.
    UnsentWorkReports(std::filesystem::path stateFolder, Session::Options options, BlobCache& blobs,
                      EditorEvents& events);

    /// Keeps unsent edits from now on in the folder of the project. Without a `connector` those of
    /// earlier connections cannot be sent.
    void start(UnsentWorkStore::Connector connector, const Welcome& welcome);
    /// Call it with each welcome. After another project was joined (ID4), its unsent edits are kept
    /// in a journal of its own.
    void welcomed(const Welcome& welcome);

    void pending(const PendingWork& work) {
        if (store_) store_->pending(work);
    }
    void answered(std::uint64_t sequence) {
        if (store_) store_->answered(sequence);
    }
    /// Returns the big values that the journal has not written yet.
    [[nodiscard]] std::set<Hash> neededBlobs() {
        return store_ ? store_->neededBlobs() : std::set<Hash>();
    }
    /// Reports that the journal cannot be written. Called in each tick.
    void reportErrors();
    /// Returns the pending transactions of the session after they were written to the disk; nothing
    /// if there are none.
    [[nodiscard]] std::optional<UnsentWork> keep(const Session& session);

    /// Returns the unsent transactions of earlier connections. Reports journals that cannot be
    /// read. Precondition of this and the following functions: start() was called.
    [[nodiscard]] std::vector<UnsentWork> left();
    /// Sends them. Refused and dropped edits become lost work, also if the others could not be
    /// sent.
    Result<SentWork> send(const ClientId& work, double timeoutMs, LostWorkReports& lost);
    [[nodiscard]] Result<LeftEdits> edits(const ClientId& work) { return store_->edits(work); }
    Result<void> discard(const ClientId& work) { return store_->discard(work); }

private:
    void open(const Welcome& welcome);

    const std::filesystem::path stateFolder_;
    const Session::Options options_;
    BlobCache& blobs_;
    EditorEvents& events_;
    UnsentWorkStore::Connector connector_;
    StoreId project_;                       // the project of store_
    std::optional<UnsentWorkStore> store_;  // set by start()
};

/// Returns the folder for state that outlives a connection: `chosen`; if it is empty, one below
/// `cacheFolder`; if the editor has named neither, stateFolder().
[[nodiscard]] std::filesystem::path folderOfState(const std::filesystem::path& chosen,
                                                  const std::filesystem::path& cacheFolder);

}  // namespace usdlive::client
