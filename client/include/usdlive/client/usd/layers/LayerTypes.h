#pragma once

#include <pxr/usd/sdf/path.h>

#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace usdlive::layers {

/// Values and names are Kit's (omni.kit.usd.layers).
enum class LayerEditMode { Normal, AutoAuthoring, SpecsLinking };

enum class LayerErrorType {
    ReadOnly = 1,  ///< 0 is Kit's Success; here a result without an error says so
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
    AutoReloadLayersChanged = 1000,  ///< Kit has it in Python only, without a number of its own
    EditsRefused,                    ///< ours: what could not be distributed went back
};

/// `info_changed`, the end of the event's name; empty for no event.
[[nodiscard]] std::string_view eventSuffix(LayerEventType type);
[[nodiscard]] std::optional<LayerEventType> eventOfSuffix(std::string_view suffix);

/// What happened since the frame before. Which members say something depends on the type.
struct LayerEvent {
    using Entries = std::vector<std::pair<std::string, std::vector<std::string>>>;

    LayerEventType type{};
    std::string layer;                ///< identifier
    std::vector<std::string> values;  ///< identifiers, or tokens (InfoChanged)
    std::vector<pxr::SdfPath> paths;  ///< of specs
    Entries entries;                  ///< SpecsLinkingChanged: layer, paths
};

/// Why a call was refused: nothing was changed.
struct LayerError {
    LayerErrorType type{};
    std::string text;  ///< one sentence that names what and where; never empty
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
    std::string layer;  ///< identifier of the one it was for
    LayerErrorType type = LayerErrorType::ReadOnly;
    std::string reason;
};

}  // namespace usdlive::layers
