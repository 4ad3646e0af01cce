"""Edits of layers and their undo with pxr's layers and paths. The extension decides what is written."""

from __future__ import annotations

import dataclasses
import typing

from pxr import Sdf

from usdlive import _usdlive

_content = _usdlive.content

PathLike = Sdf.Path | str


@dataclasses.dataclass(frozen=True)
class Kept:
    """A part of an undo that was skipped, because another user has written there since."""

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
    """Returns a reference that keeps the layer alive, unlike the handles of a stage and of Sdf.Layer.Find()."""
    return Sdf.Layer.FindOrOpen(layer.identifier) or layer


def remove_spec(layer: Sdf.Layer, path: PathLike) -> None:
    _content.remove_spec(layer.identifier, str(path))


def children_of(layer: Sdf.Layer, path: PathLike) -> list[str]:
    return _content.prim_children(layer.identifier, str(path))


def arrange(layer: Sdf.Layer, parent: PathLike, order: list[str], names: typing.Collection[str]) -> None:
    """Moves each existing child in `names` behind the siblings that precede it in `order`."""
    _content.arrange(layer.identifier, str(parent), order, list(names))


def make_like(layer: Sdf.Layer, wanted: Sdf.Layer, root: PathLike = "/") -> None:
    """Writes the differences at and below `root` and nothing else, so that concurrent edits are kept and a live
    layer sends only the differences. (Sdf.Layer.TransferContent bypasses a layer's delegate.)"""
    _content.make_like(layer.identifier, wanted.identifier, str(root))


class Record:
    """Recorded edits and their undo."""

    def __init__(self, record: typing.Any = None):
        self._record = record or _content.Record()

    def undo(self, is_shared: typing.Callable[[Sdf.Layer], bool] = lambda _: False) -> list[Kept]:
        """Undoes the edits. In a shared layer, restores only content that nobody else has written since, and
        returns the rest. In other layers, restores the earlier state regardless of later edits."""
        return [Kept(*kept) for kept in self._record.undo(self._shared(is_shared))]

    def is_followed(self, layer: Sdf.Layer) -> bool:
        """Returns whether another user has written the layer, which was touched, since the edits."""
        return self._record.is_followed(layer.identifier)

    def keep_others(self, earlier: Record, is_shared: typing.Callable[[Sdf.Layer], bool]) -> list[Kept]:
        """Call it when these edits are those of `earlier`, made again. Reverts those where somebody else has
        written in a shared layer since `earlier`, and returns them."""
        return [Kept(*kept) for kept in self._record.keep_others(earlier._record, self._shared(is_shared))]

    def _shared(self, is_shared: typing.Callable[[Sdf.Layer], bool]) -> list[str]:
        return [layer for layer in self._record.layers() if is_shared(Sdf.Layer.Find(layer))]


class Recorder:
    """Records edits. Call `touch()` before you write. The cost grows with the content of the touched parts."""

    def __init__(self) -> None:
        self.native = _content.Recorder()

    def touch(self, layer: Sdf.Layer, path: PathLike = "/", deep: bool = False) -> None:
        """Remembers the fields of the spec at `path`, also if it is absent; with `deep` also everything below."""
        self.native.touch(layer.identifier, str(path), deep)

    def touch_with_ancestors(self, layer: Sdf.Layer, path: PathLike) -> None:
        """Remembers everything from the first missing ancestor of `path` on, for a spec that will be created
        with its ancestors."""
        self.native.touch_with_ancestors(layer.identifier, str(path))

    def finish(self) -> Record:
        return Record(self.native.finish())
