#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace usdlive::bench {

/// Cores for who is measured and for who measures, so that neither takes the other's time. With one
/// core only, both are that one.
struct Cores {
    std::vector<int> server, load;
};
[[nodiscard]] Cores shareCores();
void pinThisThread(const std::vector<int>& cores);

/// Another program, pinned to some cores. Killed with its owner, or when the owner itself dies.
class ChildProcess {
public:
    /// Throws when it cannot be started. No cores: not pinned.
    ChildProcess(const std::vector<std::string>& command, const std::vector<int>& cores);
    ~ChildProcess() { kill(); }
    ChildProcess(const ChildProcess&) = delete;
    ChildProcess& operator=(const ChildProcess&) = delete;

    /// kill -9, and waits until it is gone.
    void kill();
    [[nodiscard]] bool isRunning();
    /// It has ended by itself, with 0.
    [[nodiscard]] bool succeeded() const { return succeeded_; }
    [[nodiscard]] pid_t pid() const { return pid_; }
    /// User and system time of all its threads, in seconds, to the nanosecond.
    [[nodiscard]] double cpuSeconds() const;

private:
    pid_t pid_ = -1;
    bool succeeded_ = false;
};

/// Of all threads of this process.
[[nodiscard]] double ownCpuSeconds();

/// A file that stands beside this program.
[[nodiscard]] std::string besideThisProgram(const std::string& name);

}  // namespace usdlive::bench
