// Starts, pins and kills the programs that the benchmarks measure.
#include "ChildProcess.h"

#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <filesystem>
#include <system_error>

namespace usdlive::bench {

namespace {

void pin(const std::vector<int>& cores) {
    if (cores.empty()) return;
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const int core : cores) CPU_SET(core, &set);
    ::sched_setaffinity(0, sizeof set, &set);
}

}  // namespace

Cores shareCores() {
    cpu_set_t set;
    CPU_ZERO(&set);
    ::sched_getaffinity(0, sizeof set, &set);
    Cores cores;
    for (int core = 0; core < CPU_SETSIZE; ++core)
        if (CPU_ISSET(core, &set))
            (cores.server.empty() ? cores.server : cores.load).push_back(core);
    if (cores.load.empty()) cores.load = cores.server;
    return cores;
}

void pinThisThread(const std::vector<int>& cores) { pin(cores); }

ChildProcess::ChildProcess(const std::vector<std::string>& command, const std::vector<int>& cores) {
    std::vector<char*> arguments;
    for (const std::string& argument : command)
        arguments.push_back(const_cast<char*>(argument.c_str()));
    arguments.push_back(nullptr);
    const pid_t parent = ::getpid();
    pid_ = ::fork();
    if (pid_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
    if (pid_ > 0) return;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(1);
    pin(cores);
    ::dup2(STDERR_FILENO, STDOUT_FILENO);  // stdout of this program is read by programs
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
}

void ChildProcess::kill() {
    if (pid_ < 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
}

bool ChildProcess::isRunning() {
    int status = 0;
    if (pid_ > 0 && ::waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = -1;
        succeeded_ = WIFEXITED(status) && WEXITSTATUS(status) == 0;
    }
    return pid_ > 0;
}

double ChildProcess::cpuSeconds() const {
    clockid_t clock;
    timespec time{};
    if (const int error = ::clock_getcpuclockid(pid_, &clock))
        throw std::system_error(error, std::generic_category(), "clock_getcpuclockid");
    ::clock_gettime(clock, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) / 1e9;
}

double ownCpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

std::string besideThisProgram(const std::string& name) {
    return std::filesystem::read_symlink("/proc/self/exe").parent_path() / name;
}

}  // namespace usdlive::bench
