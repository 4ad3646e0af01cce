// Starts child processes on chosen processor cores.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace usdlive::bench {

/// Separate cores for the measured and the measuring processes, so that neither takes the other's
/// time. With one core, both are the same.
struct Cores {
    std::vector<int> server, load;
};
[[nodiscard]] Cores shareCores();
void pinThisThread(const std::vector<int>& cores);

/// Another program, pinned to some cores. It is killed with its owner, and when the owner's process
/// dies.
class ChildProcess {
public:
    /// Throws when the program cannot be started. Without cores it is not pinned.
    ChildProcess(const std::vector<std::string>& command, const std::vector<int>& cores);
    ~ChildProcess() { kill(); }
    ChildProcess(const ChildProcess&) = delete;
    ChildProcess& operator=(const ChildProcess&) = delete;

    /// Kills the process (SIGKILL) and waits until it has ended.
    void kill();
    [[nodiscard]] bool isRunning();
    /// True if the process has ended by itself with exit status 0.
    [[nodiscard]] bool succeeded() const { return succeeded_; }
    [[nodiscard]] pid_t pid() const { return pid_; }
    /// The user and system time of all its threads, in seconds, to the nanosecond.
    [[nodiscard]] double cpuSeconds() const;

private:
    pid_t pid_ = -1;
    bool succeeded_ = false;
};

/// The CPU time of all threads of this process, in seconds.
[[nodiscard]] double ownCpuSeconds();

/// The path of a file in the folder of this program.
[[nodiscard]] std::string besideThisProgram(const std::string& name);

}  // namespace usdlive::bench
