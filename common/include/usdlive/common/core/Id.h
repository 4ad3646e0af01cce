// Distinct types for ids: layers, clients, users and revisions.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <string>

namespace usdlive {

/// A distinct string type for each kind of id, so that the compiler rejects a layer where a user is
/// expected.
template <class Tag>
struct Id {
    std::string value;

    auto operator<=>(const Id&) const = default;
    [[nodiscard]] bool empty() const { return value.empty(); }
};

/// A layer, named by its path relative to the project: `shot/anim.usda`. Never absolute and never
/// with `..`; see parseLayerId() in core/LayerPath.h.
using LayerId = Id<struct LayerIdTag>;

/// One running client. The client chooses it at random (32 hexadecimal digits) and keeps it over
/// reconnects, so that the server recognizes a transaction that is sent twice (M9).
using ClientId = Id<struct ClientIdTag>;

/// The name that a person gives for themselves. It is shown to others and proves nothing.
using UserName = Id<struct UserNameTag>;

/// Counts the commits of a project: 1, 2, 3 ... 0 is the state before the first commit.
using Revision = std::uint64_t;

/// Increases each time a server process opens the project.
using Epoch = std::uint64_t;

}  // namespace usdlive

template <class Tag>
struct std::hash<usdlive::Id<Tag>> {
    std::size_t operator()(const usdlive::Id<Tag>& id) const noexcept {
        return std::hash<std::string>{}(id.value);
    }
};
