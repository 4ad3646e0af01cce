// Work that did not get into the project: kept, and reported to the editor.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <filesystem>
#include <set>

#include "usd/EditorEvents.h"
#include "usd/LostEvents.h"
#include "usd/LostWorkStore.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Keeps all lost work of one client (M12) and reports it by events, at a rate that an editor can
/// show.
class LostWorkReports {
public:
    LostWorkReports(std::filesystem::path folder, EditorEvents& events)
        : events_(events), store_(std::move(folder)) {}

    void add(LostWork work);
    /// Reports what has waited long enough. Called in each tick.
    void reportDue(std::int64_t nowMs);
    /// Reports everything that waits, for an editor that leaves.
    void reportAll();

    [[nodiscard]] std::uint64_t count() const { return store_.size(); }
    [[nodiscard]] Result<LostWork> at(std::uint64_t index) const { return store_.at(index); }
    /// The edits of one layer as a layer; `known`: that layer in the project, or nullptr.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> asLayer(std::uint64_t index, const LayerId& layer,
                                                      const LayerDoc* known,
                                                      usd::BlobSource& blobs) const;
    /// Big values that lost work names.
    [[nodiscard]] const std::set<Hash>& blobs() const { return blobs_; }
    /// A new file name for content of a layer that cannot be kept as edits.
    [[nodiscard]] std::filesystem::path fileFor(const LayerId& layer) {
        return store_.fileFor(layer);
    }

private:
    EditorEvents& events_;
    LostWorkStore store_;
    LostEvents collapsed_;
    std::set<Hash> blobs_;
};

}  // namespace usdlive::client
