// Starts threads. No other place of usdlive does.
#pragma once

#include <pthread.h>

#include <functional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

namespace usdlive {

/// The system allows no further thread. what() names the thread and the reason, and says what to
/// do.
class ThreadRefused : public std::runtime_error {
public:
    ThreadRefused(const std::string& name, const std::system_error& why)
        : std::runtime_error("cannot start the thread \"" + name + "\": " + why.code().message() +
                             ". The limit of threads of this user, container or machine is "
                             "reached: raise it (ulimit -u, pids_limit), or end other programs") {}
};

/// Starts a thread. Tools such as top and gdb show the first 15 bytes of its name. Throws
/// ThreadRefused.
[[nodiscard]] inline std::thread startThread(const std::string& name, std::function<void()> run) {
    constexpr std::size_t kShown = 15;
    try {
        return std::thread([shown = name.substr(0, kShown), run = std::move(run)] {
            ::pthread_setname_np(::pthread_self(), shown.c_str());
            run();
        });
    } catch (const std::system_error& why) {
        throw ThreadRefused(name, why);
    }
}

}  // namespace usdlive
