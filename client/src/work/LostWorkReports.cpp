// Keeps lost edits and reports them to the editor.
#include "work/LostWorkReports.h"

#include "basics/Clocks.h"

namespace usdlive::client {

void LostWorkReports::add(LostWork work) {
    for (const auto& edit : work.edits)
        forEachBlob(edit.action, [&](const Value& blob) { blobs_.insert(blob.hash()); });
    if (const auto kept = store_.add(work); !kept) events_.report(kept.error());
    if (auto lost = collapsed_.add({std::move(work), store_.size() - 1}, steadyMs()))
        events_.push(std::move(*lost));
}

void LostWorkReports::reportDue(std::int64_t nowMs) {
    for (auto& lost : collapsed_.due(nowMs)) events_.push(std::move(lost));
}

void LostWorkReports::reportAll() {
    for (auto& lost : collapsed_.waiting()) events_.push(std::move(lost));
}

}  // namespace usdlive::client
