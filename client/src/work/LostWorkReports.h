// Keeps lost edits, which are not in the project, and reports them to the editor.
#pragma once

#include <cstdint>
#include <filesystem>
#include <set>

#include "link/EditorEvents.h"
#include "work/LostEvents.h"
#include "work/LostWorkStore.h"

namespace usdlive::client {

/// Keeps all lost edits of one client (M12) and reports them by events at a limited rate.
class LostWorkReports {
public:
    LostWorkReports(std::filesystem::path folder, EditorEvents& events)
        : events_(events), store_(std::move(folder)) {}

    void add(LostWork work);
    /// Reports the events that are due. Called in each tick.
    void reportDue(std::int64_t nowMs);
    /// Reports all waiting events, for an editor that disconnects.
    void reportAll();

    [[nodiscard]] std::uint64_t count() const { return store_.size(); }
    [[nodiscard]] Result<LostWork> at(std::uint64_t index) const { return store_.at(index); }
    /// Returns the big values that lost edits name.
    [[nodiscard]] const std::set<Hash>& blobs() const { return blobs_; }
    /// Returns a new file name for content that cannot be kept as edits.
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
