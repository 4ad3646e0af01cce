#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <string>

namespace usdlive {

/// A distinct string type per kind of id, so that a layer is never passed where a user is meant.
template <class Tag>
struct Id {
    std::string value;

    auto operator<=>(const Id&) const = default;
    [[nodiscard]] bool empty() const { return value.empty(); }
};

/// A layer, named by its path relative to the project: `shot/anim.usda`. Never absolute, never
/// `..`; see isLayerId() in core/LayerPath.h.
using LayerId = Id<struct LayerIdTag>;

/// One running client, chosen by itself at random (32 hexadecimal digits). It stays the same over
/// reconnects, so that a transaction sent twice is known again (M9).
using ClientId = Id<struct ClientIdTag>;

/// Who a person says they are. Shown to others; not proof of anything.
using UserName = Id<struct UserNameTag>;

/// Counts the commits of a project: 1, 2, 3 ... 0 is the state before the first.
using Revision = std::uint64_t;

/// Grows each time a server process takes a project over.
using Epoch = std::uint64_t;

}  // namespace usdlive

template <class Tag>
struct std::hash<usdlive::Id<Tag>> {
    std::size_t operator()(const usdlive::Id<Tag>& id) const noexcept {
        return std::hash<std::string>{}(id.value);
    }
};
