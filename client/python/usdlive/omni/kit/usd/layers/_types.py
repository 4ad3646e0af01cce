"""Kit's enumerations, with its names and values."""

from __future__ import annotations

import enum


class LayerEditMode(enum.IntEnum):
    NORMAL = 0
    AUTO_AUTHORING = 1
    SPECS_LINKING = 2


class LayerErrorType(enum.IntEnum):
    """The result of a context's last call. Kit misspells two of the names; both spellings work."""

    SUCCESS = 0
    READ_ONLY = 1
    NOT_FOUND = 2
    ALREADY_EXISTS = 3
    INVALID_STAGE = 4
    INVALID_PARAM = 5
    LIVE_SESSOIN_INVALID = 6
    LIVE_SESSION_INVALID = 6
    LIVE_SESSION_VERSION_MISMATCH = 7
    LIVE_SESSION_BASE_LAYER_MISMATCH = 8
    LIVE_SESSION_JOINED_ALREADY = 9
    LIVE_SESSION_ALREADY_JOINED = 9
    LIVE_SESSION_NO_MERGE_PERMISSION = 10
    LIVE_SESSION_NOT_SUPPORTED = 11
    LIVE_SESSION_NOT_JOINED = 12
    UNKNOWN = 13


class LayerEventType(enum.IntEnum):
    INFO_CHANGED = 0
    MUTENESS_SCOPE_CHANGED = 1
    MUTENESS_STATE_CHANGED = 2
    LOCK_STATE_CHANGED = 3
    DIRTY_STATE_CHANGED = 4
    OUTDATE_STATE_CHANGED = 5
    PRIM_SPECS_CHANGED = 6
    SUBLAYERS_CHANGED = 7
    SPECS_LOCKING_CHANGED = 8
    SPECS_LINKING_CHANGED = 9
    EDIT_TARGET_CHANGED = 10
    EDIT_MODE_CHANGED = 11
    DEFAULT_LAYER_CHANGED = 12
    LIVE_SESSION_STATE_CHANGED = 13
    LIVE_SESSION_LIST_CHANGED = 14
    LIVE_SESSION_USER_JOINED = 15
    LIVE_SESSION_USER_LEFT = 16
    LIVE_SESSION_MERGE_STARTED = 17
    LIVE_SESSION_MERGE_ENDED = 18
    USED_LAYERS_CHANGED = 19
    LIVE_SESSION_JOINING = 20
    LAYER_FILE_PERMISSION_CHANGED = 21
    AUTO_RELOAD_LAYERS_CHANGED = 1000
    #: Not in Kit: edits of the delegate or of locked specs were taken back; see
    #: `AutoAuthoring.refused_edits`.
    EDITS_REFUSED = 1001


_PREFIX = "omni.kit.usd.layers::layer:"


def layer_event_name(event_type: LayerEventType) -> str:
    return _PREFIX + LayerEventType(event_type).name.lower()


def layer_event_type(name: str) -> LayerEventType | None:
    """Returns the event type, or None if the name is not that of a layer event."""
    if not name.startswith(_PREFIX):
        return None
    return LayerEventType.__members__.get(name[len(_PREFIX):].upper())
