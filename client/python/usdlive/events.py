"""The events of a live project, as plain values. `Live.events()` yields them, and handlers receive them."""

from __future__ import annotations

import dataclasses
import time
import typing


@dataclasses.dataclass(frozen=True)
class Edit:
    """One change of one register or of the namespace.

    `kind` is create, delete, move, place, set or erase. `part` is the changed part of the field: a dictionary
    key path, the time of a sample, a list item or a map key. None is the whole field.
    """

    kind: str
    layer: str
    path: str
    field: str | None = None
    part: str | float | None = None
    new_path: str | None = None


@dataclasses.dataclass(frozen=True)
class Connected:
    """`store`: the random identity of the project's history, which stays with its folder; "" if it is not known.
    `left_history`: True after `join_other_history()`, when the editor has left its history for that of the server."""

    project: str
    epoch: int
    revision: int
    resumed: bool
    store: str = ""
    left_history: bool = False


@dataclasses.dataclass(frozen=True)
class Disconnected:
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class LayersChanged:
    """Layers were added to the project, or removed from it. `Live.layers()` returns all."""

    added: tuple[str, ...]
    removed: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class FilesChanged:
    """Files of the project that are not live were added, changed or removed: textures, packages and others that
    asset paths name. A layer that only value clips name is one of them when it changes. Loaded layers that were made from them are reloaded, except layers with unsaved edits, and stages
    resolve their asset paths again."""

    files: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class PathOutside:
    """An own edit wrote a path that others cannot open: an absolute path of a file that is not in the project, a relative
    path that leaves the project, a `file:` address, a drive (`C:/...`), or the identifier of an anonymous layer. `prim` is
    "/" for a sublayer; `property` is empty for arcs and metadata. At most 1,000 are reported per frame."""

    layer: str
    prim: str
    property: str
    path: str


@dataclasses.dataclass(frozen=True)
class Joining:
    """A layer is being received. `specs` of `specs_total` have arrived."""

    layer: str
    specs: int
    specs_total: int


@dataclasses.dataclass(frozen=True)
class Joined:
    layer: str
    revision: int


@dataclasses.dataclass(frozen=True)
class JoinFailed:
    """A layer that a stage uses could not be joined. It has no content and refuses edits. Unless the project does not have
    it (`layerNotFound`), it is joined again in pauses of some seconds, and becomes live when its file is mended."""

    layer: str
    code: str
    message: str

    def __str__(self) -> str:
        return f"{self.layer} has no content here and refuses edits: {self.message}"


@dataclasses.dataclass(frozen=True)
class LayerOpened:
    """A layer that `Live.request_open_layer()` asked for is open, with the layers that it uses."""

    request: int
    layer: str


@dataclasses.dataclass(frozen=True)
class LayerOpenFailed:
    """It is not opened; `layerNotOpen`: it was closed meanwhile."""

    request: int
    layer: str
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class Unsent:
    """Edits that the server has not acknowledged. `time`: of the newest, in seconds since 1970. `file`: the
    journal that keeps them. `other_project`: they were made in another project of the same name, and cannot be
    sent to this one."""

    id: str
    time: float
    transactions: int
    edits: int
    layers: tuple[str, ...]
    file: str
    other_project: bool = False

    def __str__(self) -> str:
        ago = max(0.0, time.time() - self.time)
        for unit, seconds in (("days", 86400), ("hours", 3600), ("minutes", 60), ("seconds", 1)):
            if ago >= 2 * seconds or seconds == 1:
                break
        edits = f"{self.edits} edit" + ("" if self.edits == 1 else "s")
        kept = f"; they are kept in {self.file}" if self.file else ""
        of = " of another project with this name" if self.other_project else ""
        return f"{edits}{of} of {ago / seconds:.0f} {unit} ago, on {', '.join(self.layers)}, were not sent{kept}"


@dataclasses.dataclass(frozen=True)
class Committed:
    """A user's edits were committed, possibly one's own (see `client`). `time`: seconds since 1970.
    `conflated`: the number of earlier commits that this one includes, because this client has fallen behind.
    Its edits are then of several users ("") and without registers that were written again. `missed`: one's own
    commit from while the connection was lost. It arrives after Connected, although it is older. `label`: that of
    the author's undo group, or ""."""

    revision: int
    user: str
    client: str
    time: float
    label: str
    edits: tuple[Edit, ...]
    conflated: int = 0
    missed: bool = False


@dataclasses.dataclass(frozen=True)
class Lost:
    """One's own work that is not in the project, with the reason (M12). With the code `deletedUnseen` it was there, and
    somebody who had not seen it deleted what it was written to (M17). `refused`: a whole transaction.
    `index`: the constant number for `Live.lost_work_as_layer()`. `count`: the number of refusals that this
    event stands for. A tool that writes to a locked layer every frame causes one event per second, for the
    newest refusal. All refused work is kept."""

    code: str
    message: str
    refused: bool
    edits: tuple[Edit, ...]
    index: int = 0
    count: int = 1

    def __str__(self) -> str:
        layers = ", ".join(sorted({edit.layer for edit in self.edits}))
        return f"edits of {layers or 'a layer'} are not in the project: {self.message}"


@dataclasses.dataclass(frozen=True)
class PreviewChanged:
    client: str
    gesture: int
    withdrawn: bool


class Failure(typing.NamedTuple):
    """Why a layer was not saved or reloaded."""

    layer: str
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class Saved:
    """Layers were written to their files, except the `failed` ones. `request`: the number that
    `Live.request_save()` returned."""

    revision: int
    saved: tuple[str, ...]
    failed: tuple[Failure, ...]
    request: int = 0


@dataclasses.dataclass(frozen=True)
class Reloaded:
    """Layers were replaced by the content of their files, with commits up to `revision`. `failed` as in Saved."""

    revision: int
    reloaded: tuple[str, ...]
    failed: tuple[Failure, ...]
    request: int = 0


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A named revision of the project. `time`: seconds since 1970."""

    name: str
    revision: int
    user: str
    time: float


@dataclasses.dataclass(frozen=True)
class CheckpointMade:
    request: int
    checkpoint: Checkpoint


@dataclasses.dataclass(frozen=True)
class CheckpointsListed:
    request: int
    checkpoints: tuple[Checkpoint, ...]


@dataclasses.dataclass(frozen=True)
class LayerMade:
    """A new layer was created in the project. `request`: the number of its request, for the connection that
    created it."""

    request: int
    layer: str


class SkippedFile(typing.NamedTuple):
    path: str
    reason: str


@dataclasses.dataclass(frozen=True)
class SkippedListed:
    """The files that are not served, at most 1,000 of `count`."""

    request: int
    count: int
    files: tuple[SkippedFile, ...]


@dataclasses.dataclass(frozen=True)
class Uploaded:
    """A file is in the project, and everybody can open it. `request`: the number that `Live.request_upload()`
    returned."""

    request: int
    path: str


@dataclasses.dataclass(frozen=True)
class UploadFailed:
    """A file is not in the project, with the reason; the project is unchanged."""

    request: int
    path: str
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class Answered:
    """The answer to a request that has no class of its own here. `type` and `fields` are those of PROTOCOL.md,
    with names in snake_case and times in seconds: `("historyCompacted", {"base": 7, ...})`."""

    request: int
    type: str
    fields: dict[str, typing.Any]


@dataclasses.dataclass(frozen=True)
class Progress:
    """The progress of a slow operation, about twice a second. `task`: "import" (the server reads the file of
    `layer`; sent once), "save" (`done` of `total` layers, now `layer`; `request` as in `Saved`), "upload"
    (bytes of big values; for a file, `request` is the number of `Live.request_upload()`) or "fetch" (specs).
    `total`: 0 if unknown. A layer that is being received sends `Joining` instead."""

    task: str
    layer: str
    done: int
    total: int
    request: int


@dataclasses.dataclass(frozen=True)
class ServerError:
    """An error of the server. `request`: the number of the failed request, or None if there was none."""

    code: str
    message: str
    request: int | None = None


@dataclasses.dataclass(frozen=True)
class LayerState:
    """The state of a layer besides its content. `revision`: the newest one that had changed it, `saved`: the
    one in its file; both 0 if unknown. `dirty`: it differs from its file. `outdated`: the file was changed by
    another program than the server. `globally_muted`: on the stages of a layer that somebody has opened.
    `writable` and `owner`: of the file on the server. `holder`: of the lock, "" if the lock names none.
    `locked_at`: seconds since 1970, 0.0 if unknown. `editors`: the users who have it open."""

    layer: str
    revision: int = 0
    saved: int = 0
    dirty: bool = False
    outdated: bool = False
    globally_muted: bool = False
    writable: bool = True
    owner: str = ""
    locked: bool = False
    holder: str = ""
    locked_at: float = 0.0
    editors: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Presence:
    """The selection, camera and time of a user. `camera`: a matrix of 16 numbers by rows, or None. `data`: free
    text (JSON). `colour`: the user's colour, the same on every client (red, green and blue from 0 to 1)."""

    client: str
    user: str
    application: str
    selection: tuple[str, ...] = ()
    camera: tuple[float, ...] | None = None
    time: float | None = None
    edit_target: str = ""
    data: str = ""
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclasses.dataclass(frozen=True)
class OtherHistory:
    """The other history that `Live.other_history` has found: the server has another one than this editor shows. A
    store is the random identity of a project's history, "" if it is not known. `str()` returns a text for the user that says
    what was expected and found, and what to do."""

    expected_project: str
    expected_store: str
    found_project: str
    found_store: str
    other_project: bool  # False: the same project, whose history lacks commits that this editor has received
    message: str

    def __str__(self) -> str:
        return self.message


@dataclasses.dataclass(frozen=True)
class LayerStatesChanged:
    layers: tuple[LayerState, ...]


@dataclasses.dataclass(frozen=True)
class PresenceChanged:
    """The presence of others has changed. `gone`: the ids of clients that left."""

    shown: tuple[Presence, ...]
    gone: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class UnsentFound:
    """There is work that an earlier connection, or this one before it was closed, could not send. It is kept on
    this machine; see `Live.unsent_work()`."""

    work: tuple[Unsent, ...]


@dataclasses.dataclass(frozen=True)
class RightsChanged:
    """An administrator has changed what this user may do: `may_edit()` and `may_do()` answer anew."""


@dataclasses.dataclass(frozen=True)
class Permission:
    """The answer of `may_edit()` and `may_do()`, which is true if the user may. Otherwise `why` is a sentence."""

    allowed: bool
    why: str

    def __bool__(self) -> bool:
        return self.allowed


Event = (
    Connected | Disconnected | LayersChanged | Joining | Joined | JoinFailed | Committed | Lost
    | PreviewChanged | Saved | Reloaded | CheckpointMade | CheckpointsListed | ServerError
    | LayerStatesChanged | PresenceChanged | UnsentFound | LayerMade | SkippedListed | Answered | Progress
    | LayerOpened | LayerOpenFailed | FilesChanged | PathOutside | Uploaded | UploadFailed | RightsChanged
)

_ANSWERS = {"layersSaved": Saved, "layersReloaded": Reloaded, "layerCreated": LayerMade, "skippedFiles": SkippedListed,
            "checkpointCreated": CheckpointMade, "checkpoints": CheckpointsListed}
ANSWERS = (*_ANSWERS.values(), Answered)

_TYPES = _ANSWERS | {
    kind.__name__: kind
    for kind in (Connected, Disconnected, LayersChanged, Joining, Joined, JoinFailed, Committed, Lost, PreviewChanged,
                 ServerError, LayerStatesChanged, PresenceChanged, UnsentFound, Progress, LayerOpened, LayerOpenFailed,
                 FilesChanged, PathOutside, Uploaded, UploadFailed, RightsChanged)
}

# The classes of what events contain, by field.
_PARTS = {
    Committed: {"edits": Edit},
    Lost: {"edits": Edit},
    LayerStatesChanged: {"layers": LayerState},
    Saved: {"failed": Failure},
    Reloaded: {"failed": Failure},
    SkippedListed: {"files": SkippedFile},
    CheckpointMade: {"checkpoint": Checkpoint},
    CheckpointsListed: {"checkpoints": Checkpoint},
    UnsentFound: {"work": Unsent},
    PresenceChanged: {"shown": Presence},
}


def _from_dictionary(values: dict) -> Event:
    """Returns an event from the extension's dictionary."""
    name = values.pop("event")
    kind = _TYPES.get(name)
    if kind is None:
        return Answered(values.pop("request"), name, values)
    for field, part in _PARTS.get(kind, {}).items():
        value = values[field]
        values[field] = part(**value) if isinstance(value, dict) else tuple(part(**one) for one in value)
    return kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})
