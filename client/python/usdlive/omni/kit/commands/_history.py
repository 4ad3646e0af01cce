"""The history of executed commands in each context, with undo and redo."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import logging
import typing
import weakref

from usdlive.omni._registers import Kept
from usdlive.omni.usd import StageEventType, UsdContext
from usdlive.omni.usd._errors import OUTSIDE, reason

from ._command import Command, CommandFailed, RecordedCommand

_log = logging.getLogger("usdlive.omni.kit.commands")

_STEPS_KEPT = 200  # per context; older ones cannot be undone


@dataclasses.dataclass(frozen=True)
class UndoResult:
    """The result of undo or redo. True if there was something to undo (or redo) and it succeeded. `kept`: parts
    that another user has changed since, and that were not changed back. `error`: the reason of a failure."""

    done: bool
    name: str = ""
    kept: tuple[Kept, ...] = ()
    error: str = ""

    def __bool__(self) -> bool:
        return self.done


@dataclasses.dataclass
class Entry:
    """A command, or a group of commands without one."""

    name: str
    command: Command | None = None
    kwargs: dict[str, typing.Any] = dataclasses.field(default_factory=dict)
    children: list["Entry"] = dataclasses.field(default_factory=list)

    def is_undoable(self) -> bool:
        return bool(self.children) or hasattr(self.command, "undo")

    def undo(self) -> list[Kept]:
        kept = self.undo_children()
        if hasattr(self.command, "undo"):
            kept += [item for item in self.command.undo() or () if isinstance(item, Kept)]
        return kept

    def undo_children(self) -> list[Kept]:
        return [kept for child in reversed(self.children) for kept in child.undo()]


class History:
    def __init__(self, context: UsdContext | None):
        self.undo_steps: collections.deque[Entry] = collections.deque(maxlen=_STEPS_KEPT)
        self.redo_steps: list[Entry] = []
        self._open: list[Entry] = []  # running commands, and the group around them
        if context is not None:
            itself = weakref.ref(self)
            self._closing = context.get_stage_event_stream().create_subscription_to_pop_by_type(
                StageEventType.CLOSED, lambda _: (history := itself()) and history.clear())

    def run(self, entry: Entry, do: typing.Callable[[], typing.Any] | None = None) -> typing.Any:
        """Executes the command. If it fails, undoes the commands that it has executed itself."""
        if _groups.depth and not self._open:
            self._open.append(Entry("group"))
            _groups.histories.append(self)
        self._open.append(entry)
        try:
            result = (do or entry.command.do)()
        except BaseException:
            self._open.pop()
            entry.undo_children()
            if isinstance(entry.command, RecordedCommand):
                entry.command.roll_back()
            raise
        self._open.pop()
        self._keep(entry)
        return result

    def close_group(self) -> None:
        self._keep(self._open.pop())

    def _keep(self, entry: Entry) -> None:
        if not entry.is_undoable() or _disabled.depth:
            return
        if self._open:
            self._open[-1].children.append(entry)
            return
        self.undo_steps.append(entry)
        if not _redoing.depth:
            self.redo_steps.clear()

    def undo(self) -> UndoResult:
        if not self.undo_steps or self._open:
            return UndoResult(False)
        entry = self.undo_steps.pop()
        try:
            kept = tuple(entry.undo())
        except Exception as error:  # an error of one command must not stop the others
            _log.exception("%s could not be undone", entry.name)
            return UndoResult(False, entry.name, error=str(error))
        self.redo_steps.append(entry)
        for item in kept:
            _log.warning("Undoing %s did not restore %s", entry.name, item)
        return UndoResult(True, entry.name, kept)

    def redo(self) -> UndoResult:
        if not self.redo_steps or self._open:
            return UndoResult(False)
        entry = self.redo_steps.pop()
        try:
            with _redoing.counted():
                kept = tuple(self._again(entry))
        except Exception as error:  # noqa: BLE001
            log_failure(entry.name, error)
            return UndoResult(False, entry.name, error=str(error))
        for item in kept:
            _log.warning("Redoing %s did not change %s", entry.name, item)
        return UndoResult(True, entry.name, kept)

    def _again(self, entry: Entry) -> list[Kept]:
        if (command := entry.command) is not None:
            redo = command.redo if isinstance(command, RecordedCommand) else None
            result = self.run(Entry(entry.name, command, entry.kwargs), redo)
            return result if redo else []
        self._open.append(group := Entry(entry.name))
        try:
            return [kept for child in entry.children for kept in self._again(child)]
        finally:
            self._open.pop()
            self._keep(group)

    def clear(self) -> None:
        self.undo_steps.clear()
        self.redo_steps.clear()


class _Depth:
    def __init__(self) -> None:
        self.depth = 0
        self.histories: list[History] = []

    @contextlib.contextmanager
    def counted(self) -> typing.Iterator[None]:
        self.depth += 1
        try:
            yield
        finally:
            self.depth -= 1


# A group includes everything that is executed meanwhile, in any context, like in Kit.
_groups, _disabled, _redoing = _Depth(), _Depth(), _Depth()
_histories: weakref.WeakKeyDictionary[UsdContext, History] = weakref.WeakKeyDictionary()
_without_context = History(None)


def history_of(context: UsdContext | None) -> History:
    if context is None:
        return _without_context
    if context not in _histories:
        _histories[context] = History(context)
    return _histories[context]


def begin_group() -> None:
    _groups.depth += 1


def end_group() -> None:
    """Does nothing without a begin_group()."""
    if not _groups.depth:
        return
    _groups.depth -= 1
    if _groups.depth == 0:
        histories, _groups.histories = _groups.histories, []
        for history in histories:
            history.close_group()


def begin_disabled() -> None:
    _disabled.depth += 1


def end_disabled() -> None:
    """Does nothing without a begin_disabled()."""
    _disabled.depth = max(0, _disabled.depth - 1)


def log_failure(name: str, error: BaseException) -> None:
    if isinstance(error, (CommandFailed, *OUTSIDE)):
        _log.error("%s: %s", name, reason(error))
    else:
        _log.error("%s failed", name, exc_info=error)
