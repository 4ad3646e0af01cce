#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "usdlive/server/project/Project.h"
#include "usdlive/server/transport/WebSocketServer.h"

namespace usdlive::server {

/// What the moment looks like, asked of those who know.
struct Figures {
    ProjectCounters project;
    /// By name.
    std::vector<std::pair<std::string_view, TransportCounters>> transports;
    std::size_t sessions = 0;
    Revision durableRevision = 0;
    std::size_t appendQueueBytes = 0;
    std::uint64_t storageFreeBytes = 0;
    bool storageHasSpace = true;
    BlobStore::Purged removedBlobs;
};

/// The page of `GET /metrics`. Holds what is measured over time; everything else comes as Figures.
class Metrics {
public:
    Metrics();
    ~Metrics();
    /// Any thread.
    void appended(std::size_t commits, std::chrono::nanoseconds time);
    /// Prometheus' text format.
    [[nodiscard]] std::string page(const Figures& figures) const;

private:
    struct Histograms;
    const std::unique_ptr<Histograms> histograms_;
};

}  // namespace usdlive::server
