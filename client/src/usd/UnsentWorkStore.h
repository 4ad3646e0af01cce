#pragma once

#include <pxr/usd/sdf/layer.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "transport/Connection.h"
#include "usd/Journal.h"
#include "usd/UnsentSender.h"

namespace usdlive::client {

/// Unsent work of one user in one project: this connection's, which a journal keeps, and what
/// earlier connections have left. One thread.
class UnsentWorkStore {
public:
    using Connector = std::function<Result<std::unique_ptr<Connection>>()>;
    /// `options` are those of this connection's session. Without a `folder` nothing is kept;
    /// without a `connector` nothing that was left can be sent.
    UnsentWorkStore(std::filesystem::path folder, Connector connector, Session::Options options,
                    BlobCache& blobs);

    void pending(const PendingWork& work);
    void answered(std::uint64_t sequence);
    /// What of this connection is pending, when it is on the disk; nothing when all was answered.
    [[nodiscard]] std::optional<UnsentWork> keep();
    [[nodiscard]] std::optional<Error> takeError();
    /// Big values that the journal still has to write.
    [[nodiscard]] std::set<Hash> neededBlobs();

    /// What others have left; `damaged`: why a journal cannot be read.
    [[nodiscard]] std::vector<UnsentWork> left(std::vector<Error>& damaged) const;
    /// Sends it. `lost` gets what is refused or dropped, also when the rest could not be sent; its
    /// big values are kept in this connection's cache.
    Result<SentWork> send(const ClientId& work, double timeoutMs, std::vector<LostWork>& lost);
    /// Its edits of one layer; `known`: that layer in the project, or nullptr.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> asLayer(const ClientId& work, const LayerId& layer,
                                                      const LayerDoc* known);
    Result<void> discard(const ClientId& work);

private:
    [[nodiscard]] Result<LeftJournal> open(const ClientId& work) const;

    const std::filesystem::path folder_;
    const Connector connector_;
    const Session::Options options_;
    BlobCache& blobs_;
    std::unique_ptr<Journal> journal_;
};

}  // namespace usdlive::client
