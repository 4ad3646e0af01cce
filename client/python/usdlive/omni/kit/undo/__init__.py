"""Kit's `omni.kit.undo`: undo and redo for each context."""

from __future__ import annotations

import contextlib
import typing

from usdlive.omni.kit.commands import UndoResult
from usdlive.omni.kit.commands._command import context_of
from usdlive.omni.kit.commands._history import (Entry, History, begin_disabled, begin_group, end_disabled,
                                                end_group, history_of)
from usdlive.omni.usd import UsdContext

__all__ = ["UndoResult", "begin_disabled", "begin_group", "can_redo", "can_undo", "clear_stack", "disabled",
           "end_disabled", "end_group", "get_redo_stack", "get_undo_stack", "group", "redo", "undo"]

Context = str | UsdContext


def _history(usd_context: Context) -> History:
    return history_of(context_of(usd_context))


def undo(usd_context: Context = "") -> UndoResult:
    """Undoes the last command or group. Keeps later edits of other users and names them in the result."""
    return _history(usd_context).undo()


def redo(usd_context: Context = "") -> UndoResult:
    """Executes again what was undone last. Not possible after a new command."""
    return _history(usd_context).redo()


def can_undo(usd_context: Context = "") -> bool:
    return bool(_history(usd_context).undo_steps)


def can_redo(usd_context: Context = "") -> bool:
    return bool(_history(usd_context).redo_steps)


def get_undo_stack(usd_context: Context = "") -> list[Entry]:
    return list(_history(usd_context).undo_steps)


def get_redo_stack(usd_context: Context = "") -> list[Entry]:
    return list(_history(usd_context).redo_steps)


def clear_stack(usd_context: Context = "") -> None:
    _history(usd_context).clear()


@contextlib.contextmanager
def group() -> typing.Iterator[None]:
    """Groups all commands that are executed meanwhile, so that they are undone together."""
    begin_group()
    try:
        yield
    finally:
        end_group()


@contextlib.contextmanager
def disabled() -> typing.Iterator[None]:
    """Excludes all commands that are executed meanwhile from undo."""
    begin_disabled()
    try:
        yield
    finally:
        end_disabled()
