// Checks that a client is used from one thread only, in the process that made it.
#pragma once

#include <unistd.h>

#include <atomic>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// The thread to which a client belongs: the first one that calls claim(). The copy of a client in
/// a process that fork() made belongs to no thread: its connection and its other threads are not
/// there.
class CallerThread {
public:
    /// Claims the client for the caller's thread. Returns an error if it belongs to another thread.
    [[nodiscard]] std::optional<Error> claim(std::string_view function) const {
        if (isForked()) return forked(function);
        const auto self = std::this_thread::get_id();
        if (owner_.load(std::memory_order_relaxed) == self) return std::nullopt;
        std::thread::id nobody;
        if (owner_.compare_exchange_strong(nobody, self)) return std::nullopt;
        return elsewhere(function);
    }
    /// Does the same without a claim: any thread may call `function` while the client belongs to no
    /// thread.
    [[nodiscard]] std::optional<Error> check(std::string_view function) const {
        if (isForked()) return forked(function);
        const auto owner = owner_.load();
        if (owner == std::thread::id() || owner == std::this_thread::get_id()) return std::nullopt;
        return elsewhere(function);
    }

    /// Returns whether this is another process than the one that made the client.
    [[nodiscard]] bool isForked() const { return process_ != ::getpid(); }

private:
    static Error forked(std::string_view function) {
        return {ErrorCode::InvalidArgument,
                std::string(function) +
                    "() was called in a process that fork() made. A connection belongs to the "
                    "process that made it, and its layers refuse edits here: connect again"};
    }
    static Error elsewhere(std::string_view function) {
        return {ErrorCode::InvalidArgument,
                std::string(function) +
                    "() was called on another thread than the one that uses this connection. "
                    "Layers belong to one thread: call it there"};
    }

    const pid_t process_ = ::getpid();
    mutable std::atomic<std::thread::id> owner_{};
};

}  // namespace usdlive::client
