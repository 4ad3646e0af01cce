// The roles of users in a project, and their names.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace usdlive {

/// A role says what a user may do in a project: all that the roles before it may, and more.
enum class Role : std::uint8_t {
    None,      ///< nothing: the project cannot be read
    Viewer,    ///< read, follow, be seen
    Reviewer,  ///< create checkpoints
    Editor,    ///< edit, save, reload, lock, mute, create layers, upload files
    Admin,     ///< edit what others have locked, replace the history
};

inline constexpr std::array<std::string_view, 5> kRoleNames{"none", "viewer", "reviewer", "editor",
                                                            "admin"};

[[nodiscard]] constexpr std::string_view nameOf(Role role) { return kRoleNames[std::size_t(role)]; }

[[nodiscard]] constexpr std::optional<Role> roleNamed(std::string_view name) {
    for (std::size_t index = 0; index < kRoleNames.size(); ++index)
        if (kRoleNames[index] == name) return Role(index);
    return std::nullopt;
}

}  // namespace usdlive
