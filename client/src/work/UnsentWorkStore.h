// The unsent transactions of a user in a project.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "transport/Connection.h"
#include "work/Journal.h"
#include "work/UnsentSender.h"

namespace usdlive::client {

/// The edits of an earlier connection, and the source of their big values.
struct LeftEdits {
    LostWork work;
    std::unique_ptr<BlobSource> blobs;
};

/// The unsent transactions of one user in one project: those of this connection, in its journal,
/// and those of earlier connections. Used by one thread.
class UnsentWorkStore {
public:
    using Connector = std::function<Result<std::unique_ptr<Connection>>()>;
    /// `options` are those of this connection's session. Without a `folder` nothing is kept.
    /// Without a `connector` the transactions of earlier connections cannot be sent. `store` is the
    /// identity of the project's store.
    UnsentWorkStore(std::filesystem::path folder, StoreId store, Connector connector,
                    Session::Options options, BlobCache& blobs);

    void pending(const PendingWork& work);
    void answered(std::uint64_t sequence);
    /// Waits until the pending transactions of this connection are on the disk, and returns them;
    /// nothing if all were answered.
    [[nodiscard]] std::optional<UnsentWork> keep();
    [[nodiscard]] std::optional<Error> takeError();
    /// Returns the big values that the journal has not written yet.
    [[nodiscard]] std::set<Hash> neededBlobs();

    /// Returns the unsent transactions of earlier connections. `damaged` receives the reasons why
    /// journals cannot be read.
    [[nodiscard]] std::vector<UnsentWork> left(std::vector<Error>& damaged) const;
    /// Sends the transactions of an earlier connection. `lost` receives the refused and dropped
    /// edits, also if the others could not be sent; their big values are kept in this connection's
    /// cache.
    Result<SentWork> send(const ClientId& work, double timeoutMs, std::vector<LostWork>& lost);
    /// Returns the transactions of an earlier connection. No other process sends them as long as
    /// the result exists.
    [[nodiscard]] Result<LeftEdits> edits(const ClientId& work);
    Result<void> discard(const ClientId& work);

private:
    [[nodiscard]] Result<LeftJournal> open(const ClientId& work) const;

    const std::filesystem::path folder_;
    const StoreId store_;
    const Connector connector_;
    const Session::Options options_;
    BlobCache& blobs_;
    std::unique_ptr<Journal> journal_;
};

}  // namespace usdlive::client
