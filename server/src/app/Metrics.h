// The values of /metrics.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "project/Project.h"
#include "transport/HttpServer.h"

namespace usdlive::server {

/// The present values of a project, collected from its parts.
struct Figures {
    ProjectCounters project;
    /// Keyed by name.
    std::vector<std::pair<std::string_view, TransportCounters>> transports;
    std::size_t sessions = 0;
    Revision durableRevision = 0;
    std::size_t appendQueueBytes = 0;
    std::uint64_t storageFreeBytes = 0;
    bool storageHasSpace = true;
    BlobStore::Purged removedBlobs;
};

/// The metrics of one project at one moment.
struct MetricFamilies;

/// Measures the appends of one project over time. All other values are passed as Figures.
class Metrics {
public:
    Metrics();
    ~Metrics();
    /// May be called from any thread.
    void appended(std::size_t commits, std::chrono::nanoseconds time);
    [[nodiscard]] std::shared_ptr<const MetricFamilies> collect(const Figures& figures) const;

private:
    struct Histograms;
    const std::unique_ptr<Histograms> histograms_;
};

/// Keyed by name. With an empty name, the metrics get no label for the project.
using MetricsOfProjects =
    std::vector<std::pair<std::string, std::shared_ptr<const MetricFamilies>>>;
/// Returns the page of `GET /metrics`, in Prometheus' text format.
[[nodiscard]] std::string metricsPage(const HttpCounters& http, std::uint64_t refusedSignIns,
                                      const MetricsOfProjects& projects);

}  // namespace usdlive::server
