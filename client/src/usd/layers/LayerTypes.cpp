// The names of layer events.
#include "usdlive/client/usd/layers/LayerTypes.h"

#include <array>

namespace usdlive::layers {

namespace {

using Name = std::pair<LayerEventType, std::string_view>;
using enum LayerEventType;

constexpr std::array kNames{
    Name{InfoChanged, "info_changed"},
    Name{MutenessScopeChanged, "muteness_scope_changed"},
    Name{MutenessStateChanged, "muteness_state_changed"},
    Name{LockStateChanged, "lock_state_changed"},
    Name{DirtyStateChanged, "dirty_state_changed"},
    Name{OutdateStateChanged, "outdate_state_changed"},
    Name{PrimSpecsChanged, "prim_specs_changed"},
    Name{SublayersChanged, "sublayers_changed"},
    Name{SpecsLockingChanged, "specs_locking_changed"},
    Name{SpecsLinkingChanged, "specs_linking_changed"},
    Name{EditTargetChanged, "edit_target_changed"},
    Name{EditModeChanged, "edit_mode_changed"},
    Name{DefaultLayerChanged, "default_layer_changed"},
    Name{LiveSessionStateChanged, "live_session_state_changed"},
    Name{LiveSessionListChanged, "live_session_list_changed"},
    Name{LiveSessionUserJoined, "live_session_user_joined"},
    Name{LiveSessionUserLeft, "live_session_user_left"},
    Name{LiveSessionMergeStarted, "live_session_merge_started"},
    Name{LiveSessionMergeEnded, "live_session_merge_ended"},
    Name{UsedLayersChanged, "used_layers_changed"},
    Name{LiveSessionJoining, "live_session_joining"},
    Name{LayerFilePermissionChanged, "layer_file_permission_changed"},
    Name{AutoReloadLayersChanged, "auto_reload_layers_changed"},
    Name{EditsRefused, "edits_refused"},
};

}  // namespace

std::string_view eventSuffix(LayerEventType type) {
    for (const auto& [known, suffix] : kNames)
        if (known == type) return suffix;
    return {};
}

std::optional<LayerEventType> eventOfSuffix(std::string_view suffix) {
    for (const auto& [type, known] : kNames)
        if (known == suffix) return type;
    return std::nullopt;
}

}  // namespace usdlive::layers
