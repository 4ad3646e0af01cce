// The actions in a project that access rules distinguish, beside the kinds of opinion.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive {

enum class ProjectAction : std::uint8_t {
    Save,         ///< write a layer to its file
    Reload,       ///< commit the content of a layer's file
    Lock,         ///< lock a layer or specs, and end the own lock
    TakeOver,     ///< end the lock of somebody else
    Mute,         ///< mute and unmute a layer for everybody
    Upload,       ///< store a file that is no layer
    CreateLayer,  ///< create an empty layer
    Checkpoint,   ///< name a revision of the project
    Compact,      ///< replace old commits of the project
};

inline constexpr std::array<std::string_view, 9> kProjectActionNames{
    "save", "reload", "lock", "takeOver", "mute", "upload", "createLayer", "checkpoint", "compact"};

[[nodiscard]] constexpr std::string_view nameOf(ProjectAction action) {
    return kProjectActionNames[std::size_t(action)];
}
[[nodiscard]] constexpr std::optional<ProjectAction> projectActionNamed(std::string_view name) {
    for (std::size_t index = 0; index < kProjectActionNames.size(); ++index)
        if (kProjectActionNames[index] == name) return ProjectAction(index);
    return std::nullopt;
}

/// AC3: returns the least role that may do it if no rule decides.
[[nodiscard]] constexpr Role roleFor(ProjectAction action) {
    if (action == ProjectAction::Checkpoint) return Role::Reviewer;
    const bool isForAdmins = action == ProjectAction::TakeOver || action == ProjectAction::Compact;
    return isForAdmins ? Role::Admin : Role::Editor;
}
/// Returns whether the action concerns the whole project, and not one layer or file.
[[nodiscard]] constexpr bool concernsProject(ProjectAction action) {
    return action == ProjectAction::Checkpoint || action == ProjectAction::Compact;
}
/// Returns whether the action is done by edits of a layer's custom data (LK1, LK5, MU1).
[[nodiscard]] constexpr bool isDoneByEdits(ProjectAction action) {
    return action == ProjectAction::Lock || action == ProjectAction::TakeOver ||
           action == ProjectAction::Mute;
}

/// Returns what an edit of the spec at `path` does if it changes only locks (Lock) or mutes (Mute).
/// Returns nothing for an edit that changes something else, too.
[[nodiscard]] std::optional<ProjectAction> projectActionOf(std::string_view path,
                                                           const EditAction& action);

}  // namespace usdlive
