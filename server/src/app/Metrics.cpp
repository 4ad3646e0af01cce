// Collects a project's metrics and writes them in Prometheus' text format.
#include "app/Metrics.h"

#include <prometheus/histogram.h>
#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <vector>

namespace usdlive::server {

namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

MetricFamily counter(const char* name, const char* help, std::uint64_t value) {
    ClientMetric metric;
    metric.counter.value = double(value);
    return {name, help, MetricType::Counter, {metric}};
}

MetricFamily gauge(const char* name, const char* help, std::uint64_t value) {
    ClientMetric metric;
    metric.gauge.value = double(value);
    return {name, help, MetricType::Gauge, {metric}};
}

using Transports = std::vector<std::pair<std::string_view, TransportCounters>>;

/// Returns a metric with one value for each transport, labelled with its name.
MetricFamily ofTransports(const char* name, const char* help, MetricType type,
                          const Transports& transports, std::uint64_t TransportCounters::* member) {
    MetricFamily family{name, help, type, {}};
    for (const auto& [transport, counters] : transports) {
        ClientMetric metric;
        metric.label = {{"transport", std::string(transport)}};
        (type == MetricType::Gauge ? metric.gauge.value : metric.counter.value) =
            double(counters.*member);
        family.metric.push_back(std::move(metric));
    }
    return family;
}

/// The metric for ignored samples (DD13).
MetricFamily ignoredSamples(const Transports& transports) {
    MetricFamily family{"usdlive_ignored_samples_total",
                        "DDS samples ignored because they are invalid",
                        MetricType::Counter,
                        {}};
    for (std::size_t index = 0; index < kIgnoreReasons; ++index) {
        ClientMetric metric;
        metric.label = {{"reason", std::string(nameOf(IgnoreReason(index)))}};
        for (const auto& [transport, counters] : transports)
            metric.counter.value += double(counters.ignored[index]);
        family.metric.push_back(std::move(metric));
    }
    return family;
}

MetricFamily histogram(const char* name, const char* help, const prometheus::Histogram& values) {
    return {name, help, MetricType::Histogram, {values.Collect()}};
}

}  // namespace

struct MetricFamilies {
    std::vector<MetricFamily> all;
};

struct Metrics::Histograms {
    prometheus::Histogram appendSeconds{{50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3,
                                         20e-3, 50e-3, 100e-3, 200e-3, 500e-3, 1, 5}};
    prometheus::Histogram appendCommits{{1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024}};
};

Metrics::Metrics() : histograms_(std::make_unique<Histograms>()) {}
Metrics::~Metrics() = default;

void Metrics::appended(std::size_t commits, std::chrono::nanoseconds time) {
    histograms_->appendSeconds.Observe(std::chrono::duration<double>(time).count());
    histograms_->appendCommits.Observe(double(commits));
}

std::shared_ptr<const MetricFamilies> Metrics::collect(const Figures& figures) const {
    const auto& [project, transports, sessions, revision, appendQueue, free, hasSpace, removed] =
        figures;
    const auto total = [&](const char* name, const char* help, auto member) {
        return ofTransports(name, help, MetricType::Counter, figures.transports, member);
    };
    const auto now = [&](const char* name, const char* help, auto member) {
        return ofTransports(name, help, MetricType::Gauge, figures.transports, member);
    };
    using Of = TransportCounters;
    return std::make_shared<const MetricFamilies>(MetricFamilies{{
        gauge("usdlive_sessions", "Sessions that are open", sessions),
        now("usdlive_connections", "Connections of sessions", &Of::connections),
        total("usdlive_connections_total", "Sessions accepted", &Of::accepted),
        total("usdlive_turned_away_total", "Sessions refused because there were too many",
              &Of::turnedAway),
        total("usdlive_slow_readers_total", "Sessions closed because they read too slowly",
              &Of::slowReaders),
        ignoredSamples(transports),
        counter("usdlive_commits_total", "Transactions committed", project.commits),
        counter("usdlive_edits_total", "Edits committed", project.edits),
        counter("usdlive_dropped_edits_total", "Edits dropped because their spec was deleted",
                project.dropped),
        counter("usdlive_refused_transactions_total", "Transactions refused", project.refused),
        counter("usdlive_duplicate_transactions_total", "Transactions received more than once",
                project.duplicates),
        counter("usdlive_previews_total", "Previews of gestures passed on", project.previews),
        counter("usdlive_unloaded_layers_total", "Layers unloaded because no session had them open",
                project.unloaded),
        counter("usdlive_delivered_commits_total", "Commits handed to sessions", project.delivered),
        total("usdlive_sent_frames_total", "Frames sent", &Of::framesOut),
        total("usdlive_sent_messages_total", "Messages sent: of a WebSocket, or samples of DDS",
              &Of::messagesOut),
        total("usdlive_sent_bytes_total", "Bytes of messages sent", &Of::bytesOut),
        total("usdlive_received_messages_total", "Messages received", &Of::messagesIn),
        total("usdlive_received_bytes_total", "Bytes of messages received", &Of::bytesIn),
        now("usdlive_queue_bytes", "Bytes that wait to be sent, of all sessions", &Of::queuedBytes),
        gauge("usdlive_append_queue_bytes", "Bytes of commits that wait for the store",
              appendQueue),
        gauge("usdlive_durable_revision", "The newest revision that is on the disk", revision),
        gauge("usdlive_storage_free_bytes", "Free space of the store's disk", free),
        gauge("usdlive_storage_has_space", "0 while edits are refused for lack of space",
              hasSpace ? 1 : 0),
        counter("usdlive_removed_blobs_total", "Unused big values removed", removed.values),
        counter("usdlive_removed_blob_bytes_total", "Bytes of unused big values removed",
                removed.bytes),
        histogram("usdlive_append_seconds", "Time of one group's append and sync",
                  histograms_->appendSeconds),
        histogram("usdlive_append_commits", "Commits in one group", histograms_->appendCommits),
    }});
}

std::string metricsPage(const HttpCounters& http, std::uint64_t refusedSignIns,
                        const MetricsOfProjects& projects) {
    std::vector<MetricFamily> all{
        gauge("usdlive_http_connections", "Open connections, including sessions", http.connections),
        counter("usdlive_http_connections_total", "Connections accepted", http.accepted),
        counter("usdlive_http_turned_away_total", "Connections refused because there were too many",
                http.turnedAway),
        counter("usdlive_refused_sign_ins_total", "Requests without a known token", refusedSignIns),
    };
    const std::size_t own = all.size();
    for (const auto& [project, metrics] : projects) {
        // Every project has the same families in the same order.
        for (std::size_t index = 0; index < metrics->all.size(); ++index) {
            const MetricFamily& family = metrics->all[index];
            if (own + index == all.size())
                all.push_back({family.name, family.help, family.type, {}});
            for (ClientMetric metric : family.metric) {
                if (!project.empty()) metric.label.push_back({"project", project});
                all[own + index].metric.push_back(std::move(metric));
            }
        }
    }
    return prometheus::TextSerializer().Serialize(all);
}

}  // namespace usdlive::server
