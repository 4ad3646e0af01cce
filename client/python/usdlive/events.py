"""What happens to a live project, as plain values. `Live.events()` yields them, handlers get them."""

from __future__ import annotations

import dataclasses


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
class Committed:
    """Somebody's edits (also one's own, by `client`) are in the project. `time` in seconds since 1970."""

    revision: int
    user: str
    client: str
    time: float
    edits: tuple[Edit, ...]


@dataclasses.dataclass(frozen=True)
class Lost:
    """Work of one's own that is not in the project, and why (M12). `refused`: a whole transaction."""

    code: str
    message: str
    refused: bool
    edits: tuple[Edit, ...]


@dataclasses.dataclass(frozen=True)
class PreviewChanged:
    client: str
    gesture: int
    withdrawn: bool


@dataclasses.dataclass(frozen=True)
class Saved:
    """Layers are in their files; `failed` has (layer, code, message)."""

    revision: int
    saved: tuple[str, ...]
    failed: tuple[tuple[str, str, str], ...]


@dataclasses.dataclass(frozen=True)
class ServerError:
    code: str
    message: str


Event = (
    Connected | Disconnected | LayersChanged | Joining | Joined | JoinFailed | Committed | Lost
    | PreviewChanged | Saved | ServerError
)

_TYPES = {
    kind.__name__: kind
    for kind in (Connected, Disconnected, LayersChanged, Joining, Joined, JoinFailed, Committed,
                 Lost, PreviewChanged, Saved, ServerError)
}


def _from_dictionary(values: dict) -> Event:
    """An event as the extension gives it."""
    kind = _TYPES[values.pop("event")]
    if "edits" in values:
        values["edits"] = tuple(Edit(**edit) for edit in values["edits"])
    return kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})
