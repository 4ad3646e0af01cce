"""Edits of layers and their undo, by pxr's layers and paths. The extension decides what is written."""

from __future__ import annotations

import dataclasses
import typing

from pxr import Sdf

from usdlive import _usdlive

_content = _usdlive.content

PathLike = Sdf.Path | str


@dataclasses.dataclass(frozen=True)
class Kept:
    """What an undo left as it is, because another one has written it since."""

    layer: str
    path: str
    field: str | None
    part: tuple[str, ...] | float | None
    reason: str

    def __str__(self) -> str:
        where = f"{self.layer} <{self.path}>" + (f" {self.field}" if self.field else "")
        if self.part is not None:
            where += f" {':'.join(self.part) if isinstance(self.part, tuple) else self.part}"
        return f"{where}: {self.reason}"


def hold(layer: Sdf.Layer) -> Sdf.Layer:
    """A reference that keeps the layer: what a stage gives, and Sdf.Layer.Find(), does not."""
    return Sdf.Layer.FindOrOpen(layer.identifier) or layer


def remove_spec(layer: Sdf.Layer, path: PathLike) -> None:
    _content.remove_spec(layer.identifier, str(path))


def children_of(layer: Sdf.Layer, path: PathLike) -> list[str]:
    return _content.prim_children(layer.identifier, str(path))


def arrange(layer: Sdf.Layer, parent: PathLike, order: list[str], names: typing.Collection[str]) -> None:
    """Puts each of `names` that is there after the ones it followed in `order`."""
    _content.arrange(layer.identifier, str(parent), order, list(names))


def make_like(layer: Sdf.Layer, wanted: Sdf.Layer, root: PathLike = "/") -> None:
    """Writes what differs at `root` and below, and nothing else: what others do beside it stays, and a live
    layer sends only that. (Sdf.Layer.TransferContent writes past a layer's delegate.)"""
    _content.make_like(layer.identifier, wanted.identifier, str(root))


class Record:
    """What was written, and the way back."""

    def __init__(self, record: typing.Any = None):
        self._record = record or _content.Record()

    def undo(self, is_shared: typing.Callable[[Sdf.Layer], bool] = lambda _: False) -> list[Kept]:
        """In a layer that is shared, only what is still as it was written goes back; the rest is returned.
        In others the state before comes back, whatever was done since."""
        shared = [layer for layer in self._record.layers() if is_shared(Sdf.Layer.Find(layer))]
        return [Kept(*kept) for kept in self._record.undo(shared)]


class Recorder:
    """Told before something is written: `touch()` keeps what is there. Costs what the touched parts hold."""

    def __init__(self) -> None:
        self._recorder = _content.Recorder()

    def touch(self, layer: Sdf.Layer, path: PathLike = "/", deep: bool = False) -> None:
        """The fields of the spec at `path`, whether it is there or not; with `deep`, everything below."""
        self._recorder.touch(layer.identifier, str(path), deep)

    def touch_with_ancestors(self, layer: Sdf.Layer, path: PathLike) -> None:
        """For a spec that is going to be made with the ancestors it lacks: all from the first of those on."""
        self._recorder.touch_with_ancestors(layer.identifier, str(path))

    def finish(self) -> Record:
        return Record(self._recorder.finish())
