#include "usdlive/server/app/Metrics.h"

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

MetricFamily histogram(const char* name, const char* help, const prometheus::Histogram& values) {
    return {name, help, MetricType::Histogram, {values.Collect()}};
}

}  // namespace

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

std::string Metrics::page(const Figures& figures) const {
    const auto& [project, transport, sessions, revision, appendQueue, free, hasSpace] = figures;
    const std::vector<MetricFamily> families{
        gauge("usdlive_sessions", "Sessions that are open", sessions),
        gauge("usdlive_connections", "Connections, HTTP and WebSocket", transport.connections),
        counter("usdlive_connections_total", "Connections accepted", transport.accepted),
        counter("usdlive_turned_away_total", "Connections hung up on, being too many",
                transport.turnedAway),
        counter("usdlive_slow_readers_total", "Sessions cut because they did not read",
                transport.slowReaders),
        counter("usdlive_commits_total", "Transactions committed", project.commits),
        counter("usdlive_edits_total", "Edits committed", project.edits),
        counter("usdlive_dropped_edits_total", "Edits dropped, their spec being deleted",
                project.dropped),
        counter("usdlive_refused_transactions_total", "Transactions refused", project.refused),
        counter("usdlive_duplicate_transactions_total", "Transactions that came twice",
                project.duplicates),
        counter("usdlive_previews_total", "Previews of gestures passed on", project.previews),
        counter("usdlive_delivered_commits_total", "Commits handed to sessions", project.delivered),
        counter("usdlive_sent_frames_total", "Frames sent", transport.framesOut),
        counter("usdlive_sent_messages_total", "WebSocket messages sent", transport.messagesOut),
        counter("usdlive_sent_bytes_total", "Bytes of messages sent", transport.bytesOut),
        counter("usdlive_received_messages_total", "WebSocket messages received",
                transport.messagesIn),
        counter("usdlive_received_bytes_total", "Bytes of messages received", transport.bytesIn),
        gauge("usdlive_queue_bytes", "Bytes that wait to be sent, of all sessions",
              transport.queuedBytes),
        gauge("usdlive_append_queue_bytes", "Bytes of commits that wait for the store",
              appendQueue),
        gauge("usdlive_durable_revision", "The newest revision that is safe on disk", revision),
        gauge("usdlive_storage_free_bytes", "Free space of the disk the store is on", free),
        gauge("usdlive_storage_has_space", "0 while edits are refused for lack of space",
              hasSpace ? 1 : 0),
        histogram("usdlive_append_seconds", "Time of one group's append and sync",
                  histograms_->appendSeconds),
        histogram("usdlive_append_commits", "Commits in one group", histograms_->appendCommits),
    };
    return prometheus::TextSerializer().Serialize(families);
}

}  // namespace usdlive::server
