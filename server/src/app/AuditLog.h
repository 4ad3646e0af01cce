// Writes the audit log while the server runs.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "app/LogLimit.h"
#include "app/Workers.h"
#include "auth/AuditFile.h"
#include "transport/Log.h"

namespace usdlive::server {

/// The audit log of this process (AU1-AU4). Nothing waits for it: a worker writes what was
/// recorded. While that fails, up to kMostWaiting events are kept and tried again with the next
/// one; the log says so, and later a record counts the events that were lost. Any thread.
class AuditLog {
public:
    static constexpr std::size_t kMostWaiting = 10'000;

    /// `workers` and `log` must outlive this object.
    AuditLog(const std::filesystem::path& folder, Workers& workers, Log& log);
    /// Writes what waits.
    ~AuditLog();
    AuditLog(const AuditLog&) = delete;
    AuditLog& operator=(const AuditLog&) = delete;

    /// Begins to record. Before that, and in a server that asks nobody to sign in, nothing is.
    void begin();
    /// Sets the time of the event and records it. Of the same events of one user and address only
    /// some are recorded (LogLimit); the next record says how many were left out.
    void record(AuditEvent event);

private:
    struct State;
    static void write(State& state);

    const std::shared_ptr<State> state_;
    const std::shared_ptr<WorkerShare> worker_;
};

}  // namespace usdlive::server
