// Reads the history of a project.
#pragma once

#include <functional>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::client {

/// Reads the history of a project over a connection, and waits for the answers. One thread.
class HistoryReader {
public:
    virtual ~HistoryReader() = default;
    /// Returns the newest revision that this connection knows.
    [[nodiscard]] virtual Revision newest() const = 0;
    /// Returns the revision up to which commits were replaced by the content of the layers when the
    /// connection was made; 0: none.
    [[nodiscard]] virtual Revision base() const = 0;
    /// Returns commits of the past, the oldest first. Precondition: `from` and `to` exist.
    [[nodiscard]] virtual Result<std::vector<Commit>> readLog(Revision from, Revision to) = 0;

    /// A layer at a revision.
    struct Content {
        LayerDoc doc;
        Revision revision = 0;
    };
    /// Returns a layer as it was at a revision; 0: as it is now.
    [[nodiscard]] virtual Result<Content> readLayer(const LayerId& layer, Revision revision) = 0;
};

/// Chooses the result if the history begins after the oldest commit that was asked for, because a
/// base was made since the connection.
enum class AtBase {
    Fail,  ///< the error is HistoryReplaced; some commits were visited
    End    ///< the first commit that is there is the last one that is visited
};

/// Calls `visit` with the commits from `newest` back to `oldest`, until it returns false. Reads
/// them in pages.
[[nodiscard]] Result<void> readBackward(HistoryReader& reader, Revision newest, Revision oldest,
                                        const std::function<bool(const Commit&)>& visit,
                                        AtBase atBase = AtBase::Fail, Revision page = 1'000);

}  // namespace usdlive::client
