"""What happens to a live project, as plain values. `Live.events()` yields them, handlers get them."""

from __future__ import annotations

import dataclasses
import time


@dataclasses.dataclass(frozen=True)
class Edit:
    """One change of one register or of the namespace.

    `kind` is create, delete, move, place, set or erase. `part` says which part of a field is meant: a
    dictionary key path, the time of a sample, a list item or a map key; None is the whole field.
    """

    kind: str
    layer: str
    path: str
    field: str | None = None
    part: str | float | None = None
    new_path: str | None = None


@dataclasses.dataclass(frozen=True)
class Connected:
    project: str
    epoch: int
    revision: int
    resumed: bool


@dataclasses.dataclass(frozen=True)
class Disconnected:
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class LayersChanged:
    """The project has other layers than before: these are all of them now."""

    layers: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Joining:
    """A layer is on its way; `specs` of `specs_total` are here."""

    layer: str
    specs: int
    specs_total: int


@dataclasses.dataclass(frozen=True)
class Joined:
    layer: str
    revision: int


@dataclasses.dataclass(frozen=True)
class JoinFailed:
    layer: str
    code: str
    message: str


@dataclasses.dataclass(frozen=True)
class Unsent:
    """Edits that the server has not acknowledged. `time` of the newest, in seconds since 1970; `file`: the
    journal that keeps them."""

    id: str
    time: float
    transactions: int
    edits: int
    layers: tuple[str, ...]
    file: str

    def __str__(self) -> str:
        ago = max(0.0, time.time() - self.time)
        for unit, seconds in (("days", 86400), ("hours", 3600), ("minutes", 60), ("seconds", 1)):
            if ago >= 2 * seconds or seconds == 1:
                break
        edits = f"{self.edits} edit" + ("" if self.edits == 1 else "s")
        kept = f"; they are kept in {self.file}" if self.file else ""
        return f"{edits} of {ago / seconds:.0f} {unit} ago, on {', '.join(self.layers)}, were not sent{kept}"


@dataclasses.dataclass(frozen=True)
class Committed:
    """Somebody's edits (also one's own, by `client`) are in the project. `time` in seconds since 1970.
    `conflated`: so many commits before this one are in it, too, because this client fell behind: the edits
    are then of several users ("") and without what was written again. `missed`: a commit of one's own
    that was made while the connection was lost; it comes after Connected, though it is older."""

    revision: int
    user: str
    client: str
    time: float
    edits: tuple[Edit, ...]
    conflated: int = 0
    missed: bool = False


@dataclasses.dataclass(frozen=True)
class Lost:
    """Work of one's own that is not in the project, and why (M12). `refused`: a whole transaction.
    `index`: for `Live.lost_work_as_layer()`; it never changes. `count`: what is refused again and
    again (a tool that writes one attribute every frame into a locked layer) is told once a second;
    this is the newest of so many. All of them are kept."""

    code: str
    message: str
    refused: bool
    edits: tuple[Edit, ...]
    index: int = 0
    count: int = 1


@dataclasses.dataclass(frozen=True)
class PreviewChanged:
    client: str
    gesture: int
    withdrawn: bool


@dataclasses.dataclass(frozen=True)
class Saved:
    """Layers are in their files; `failed` has (layer, code, message). `request`: the number that
    `Live.request_save()` returned."""

    revision: int
    saved: tuple[str, ...]
    failed: tuple[tuple[str, str, str], ...]
    request: int = 0


@dataclasses.dataclass(frozen=True)
class Reloaded:
    """Layers are as their files were, by commits up to `revision`; `failed` as in Saved."""

    revision: int
    reloaded: tuple[str, ...]
    failed: tuple[tuple[str, str, str], ...]
    request: int = 0


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A named revision of the project. `time` in seconds since 1970."""

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
    """A new layer is in the project; `request` is of the connection that made it."""

    request: int
    layer: str


@dataclasses.dataclass(frozen=True)
class SkippedListed:
    """(path, reason) of files that are not served, at most 1,000 of `count`."""

    request: int
    count: int
    files: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class Progress:
    """How far something is that takes long, about twice a second. `task`: "import" (the server reads the file of
    `layer`, told once), "save" (`done` of `total` layers, now `layer`; `request` as of `Saved`), "upload" (bytes of
    big values) or "fetch" (specs). `total` 0: not known. A layer on its way here is told by `Joining`."""

    task: str
    layer: str
    done: int
    total: int
    request: int


@dataclasses.dataclass(frozen=True)
class ServerError:
    """`request`: the number of the request it answers, None where it answers none."""

    code: str
    message: str
    request: int | None = None


@dataclasses.dataclass(frozen=True)
class LayerState:
    """What is known of a layer beside its content. `revision`: the newest that had changed it when this
    was told, `saved`: the one in its file; 0 when unknown. `dirty`: differs from its file. `outdated`: the
    file was changed behind the server. `globally_muted`: on the stages of a layer that somebody has opened.
    `writable` and `owner` are the file's, for the server. `holder`: of the lock, "" where nobody is named.
    `locked_at` in seconds since 1970, 0.0 when unknown. `editors`: who has it open."""

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
    """Where somebody is. `camera`: a matrix of 16 numbers by rows, or None; `data`: free text (JSON);
    `colour`: the user's, the same everywhere (red, green and blue from 0 to 1)."""

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
class LayerStatesChanged:
    layers: tuple[LayerState, ...]


@dataclasses.dataclass(frozen=True)
class PresenceChanged:
    """Others are elsewhere, or gone (by client)."""

    shown: tuple[Presence, ...]
    gone: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class UnsentFound:
    """There is work that an earlier connection (or this one, which was closed meanwhile) could not send. It is
    kept on this machine: see `Live.unsent_work()`."""

    work: tuple[Unsent, ...]


Event = (
    Connected | Disconnected | LayersChanged | Joining | Joined | JoinFailed | Committed | Lost
    | PreviewChanged | Saved | Reloaded | CheckpointMade | CheckpointsListed | ServerError
    | LayerStatesChanged | PresenceChanged | UnsentFound | LayerMade | SkippedListed | Progress
)

_TYPES = {
    kind.__name__: kind
    for kind in (Connected, Disconnected, LayersChanged, Joining, Joined, JoinFailed, Committed,
                 Lost, PreviewChanged, Saved, Reloaded, CheckpointMade, CheckpointsListed, ServerError,
                 LayerStatesChanged, PresenceChanged, UnsentFound, LayerMade, SkippedListed, Progress)
}


def _from_dictionary(values: dict) -> Event:
    """An event as the extension gives it."""
    kind = _TYPES[values.pop("event")]
    if "edits" in values:
        values["edits"] = tuple(Edit(**edit) for edit in values["edits"])
    if kind is LayerStatesChanged:
        values["layers"] = [LayerState(**state) for state in values["layers"]]
    if kind is CheckpointMade:
        values["checkpoint"] = Checkpoint(**values["checkpoint"])
    if kind is CheckpointsListed:
        values["checkpoints"] = [Checkpoint(**one) for one in values["checkpoints"]]
    if kind is UnsentFound:
        values["work"] = [Unsent(**one) for one in values["work"]]
    if kind is PresenceChanged:
        values["shown"] = [Presence(**presence) for presence in values["shown"]]
    return kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})
