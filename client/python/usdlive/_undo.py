"""The results of undo and redo."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class UndoKept:
    """Something that an undo or redo has left as it is. `field` is None for the spec itself; `part` as in
    `events.Edit`. `author` has written it since; "" if nobody has, or if it is not known."""

    layer: str
    path: str
    field: str | None
    part: str | float | None
    author: str
    reason: str

    def __str__(self) -> str:
        return f"{self.layer} {self.path}{' ' + self.field if self.field else ''}: {self.reason}"


@dataclasses.dataclass(frozen=True)
class UndoResult:
    """The result of `Live.undo()` or `Live.redo()`. It is false if there was no step: `done` is False then."""

    done: bool
    label: str
    kept: tuple[UndoKept, ...] = ()

    def __bool__(self) -> bool:
        return self.done


@dataclasses.dataclass(frozen=True)
class UndoStack:
    """The labels of the steps that can be undone and redone. The last of each is the next one."""

    undo: tuple[str, ...]
    redo: tuple[str, ...]
