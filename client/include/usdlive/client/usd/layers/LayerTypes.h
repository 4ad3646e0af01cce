// The types of the layers API: edit modes, events, errors and results.
#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace usdlive::layers {

/// The edit modes. Values and names are those of Kit (omni.kit.usd.layers).
enum class LayerEditMode { Normal, AutoAuthoring, SpecsLinking };

enum class LayerErrorType {
    ReadOnly = 1,  ///< Kit's Success (0) is a result without an error here
    NotFound,
    AlreadyExists,
    InvalidStage,
    InvalidParam,
    LiveSessionInvalid,
    LiveSessionVersionMismatch,
    LiveSessionBaseLayerMismatch,
    LiveSessionAlreadyJoined,
    LiveSessionNoMergePermission,
    LiveSessionNotSupported,
    LiveSessionNotJoined,
    Unknown,
};

enum class LayerEventType {
    InfoChanged,
    MutenessScopeChanged,
    MutenessStateChanged,
    LockStateChanged,
    DirtyStateChanged,
    OutdateStateChanged,
    PrimSpecsChanged,
    SublayersChanged,
    SpecsLockingChanged,
    SpecsLinkingChanged,
    EditTargetChanged,
    EditModeChanged,
    DefaultLayerChanged,
    LiveSessionStateChanged,
    LiveSessionListChanged,
    LiveSessionUserJoined,
    LiveSessionUserLeft,
    LiveSessionMergeStarted,
    LiveSessionMergeEnded,
    UsedLayersChanged,
    LiveSessionJoining,
    LayerFilePermissionChanged,
    AutoReloadLayersChanged = 1000,  ///< Kit has it in Python only, without a number
    EditsRefused,  ///< not in Kit: edits that could not be distributed were taken back
};

/// Returns the end of the event's name, for example `info_changed`. Empty for no event.
[[nodiscard]] std::string_view eventSuffix(LayerEventType type);
[[nodiscard]] std::optional<LayerEventType> eventOfSuffix(std::string_view suffix);

/// A change since the previous frame. The type determines which members are set.
struct LayerEvent {
    using Entries = std::vector<std::pair<std::string, std::vector<std::string>>>;

    LayerEventType type{};
    std::string layer;                ///< identifier
    std::vector<std::string> values;  ///< identifiers, or tokens (InfoChanged)
    std::vector<pxr::SdfPath> paths;  ///< paths of specs
    Entries entries;                  ///< SpecsLinkingChanged: layer, paths
};

/// The reason why a call was refused. Nothing was changed.
struct LayerError {
    LayerErrorType type{};
    std::string text;  ///< one sentence that names what failed and where; never empty
};

template <class T>
using LayerResult = tl::expected<T, LayerError>;

/// `return fail(LayerErrorType::NotFound, "the stage does not use a layer " + id);`
[[nodiscard]] inline tl::unexpected<LayerError> fail(LayerErrorType type, std::string text) {
    return tl::unexpected(LayerError{type, std::move(text)});
}

/// An edit of the delegate layer that was taken back.
struct RefusedEdit {
    pxr::SdfPath path;
    std::string field;  ///< empty: the spec itself
    std::string layer;  ///< identifier of the layer for which it was meant
    LayerErrorType type = LayerErrorType::ReadOnly;
    std::string reason;
};

}  // namespace usdlive::layers
