// Queues the events of the audit log for a worker.
#include "app/AuditLog.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

namespace usdlive::server {

struct AuditLog::State {
    State(const std::filesystem::path& folder, Log& serverLog) : file(folder), log(serverLog) {}

    const AuditFile file;
    Log& log;

    std::mutex mutex;  // guards what follows
    bool isOn = false;
    bool isWriting = false;
    bool isFailing = false;
    std::vector<AuditEvent> waiting;
    std::size_t lost = 0;
    LogLimit limit;
};

AuditLog::AuditLog(const std::filesystem::path& folder, Workers& workers, Log& log)
    : state_(std::make_shared<State>(folder, log)), worker_(workers.files.share()) {}

AuditLog::~AuditLog() {
    worker_->stop();
    state_->isWriting = true;
    write(*state_);
}

void AuditLog::begin() {
    const std::lock_guard lock(state_->mutex);
    state_->isOn = true;
}

void AuditLog::record(AuditEvent event) {
    const std::lock_guard lock(state_->mutex);
    if (!state_->isOn) return;
    const auto leftOut = state_->limit.take(
        std::string(event.event) + '\n' + event.user + '\n' + event.from + '\n' + event.project,
        LogLimit::nowMs());
    if (!leftOut) return;
    if (*leftOut > 0)
        event.detail += (event.detail.empty() ? "" : "; ") + std::to_string(*leftOut) +
                        " such events before this one were left out";
    if (state_->waiting.size() < kMostWaiting) {
        event.timeMs = auditTime();
        state_->waiting.push_back(std::move(event));
    } else {
        ++state_->lost;
    }
    if (std::exchange(state_->isWriting, true)) return;
    worker_->post([state = state_] { write(*state); });
}

void AuditLog::write(State& state) {
    std::unique_lock lock(state.mutex);
    while (!state.waiting.empty()) {
        std::vector<AuditEvent> events = std::exchange(state.waiting, {});
        const std::size_t lost = state.lost;
        if (lost > 0)
            events.push_back({.event = "events lost",
                              .detail = std::to_string(lost) + " events were not recorded",
                              .timeMs = auditTime()});
        lock.unlock();
        const auto appended = state.file.append(events);
        lock.lock();
        if (!appended) {
            if (!std::exchange(state.isFailing, true))
                state.log.write(LogLevel::Error, "the audit log cannot be written",
                                {{"error", appended.error().message}});
            if (lost > 0) events.pop_back();
            std::ranges::move(state.waiting, std::back_inserter(events));
            if (events.size() > kMostWaiting) {
                state.lost += events.size() - kMostWaiting;
                events.resize(kMostWaiting);
            }
            state.waiting = std::move(events);
            break;
        }
        if (std::exchange(state.isFailing, false))
            state.log.write(LogLevel::Info, "the audit log is written again");
        state.lost -= lost;
    }
    state.isWriting = false;
}

}  // namespace usdlive::server
