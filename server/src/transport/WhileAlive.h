// Handlers that do nothing after their owner is destroyed.
#pragma once

#include <memory>
#include <utility>

namespace usdlive::server {

/// Returns a handler that does nothing after the owner of `life` is destroyed.
template <class Function>
auto whileAlive(const std::shared_ptr<int>& life, Function function) {
    return
        [alive = std::weak_ptr(life), function = std::move(function)](auto... arguments) mutable {
            if (!alive.expired()) function(std::move(arguments)...);
        };
}

}  // namespace usdlive::server
