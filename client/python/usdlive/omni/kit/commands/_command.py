"""The base classes of commands."""

from __future__ import annotations

import abc
import typing

from pxr import Sdf, Usd

from usdlive.omni._registers import Kept, Record, Recorder
from usdlive.omni.usd import UsdContext, get_context, get_context_from_stage


class CommandFailed(Exception):
    """Raised in do() with the reason why the command failed."""


class Command(abc.ABC):
    """A command. Its arguments are those of its constructor. do() returns the result. A command that can be
    undone also has undo(). Redo calls do() again. `FooCommand` is executed as "Foo" or "FooCommand"."""

    @abc.abstractmethod
    def do(self) -> typing.Any: ...


def context_of(usd_context: str | UsdContext | Usd.Stage | None) -> UsdContext | None:
    """Returns the context for an argument of Kit's commands: a name, a context, or its stage."""
    if isinstance(usd_context, UsdContext):
        return usd_context
    if isinstance(usd_context, Usd.Stage):
        return get_context_from_stage(usd_context)
    return get_context(usd_context or "")


class RecordedCommand(Command):
    """A command that edits layers in edit() and calls the recorder before each edit. undo() restores the
    earlier content; in a live layer only where nobody else has written since. It returns the parts that were
    not restored."""

    def __init__(self, usd_context: str | UsdContext = ""):
        self._usd_context = usd_context
        self._record = Record()

    @abc.abstractmethod
    def edit(self, recorder: Recorder) -> typing.Any: ...

    @property
    def context(self) -> UsdContext:
        context = context_of(self._usd_context)
        if context is None:
            raise CommandFailed(f"there is no context {self._usd_context!r}")
        return context

    @property
    def stage(self) -> Usd.Stage:
        stage = self.context.get_stage()
        if stage is None:
            raise CommandFailed("no stage is open")
        return stage

    def do(self) -> typing.Any:
        recorder = Recorder()
        try:
            with self.context.recording(recorder):
                return self.edit(recorder)
        finally:
            self._record = recorder.finish()

    def redo(self) -> list[Kept]:
        """Calls do() again. In a live layer, what somebody else has written since the first time stays. Returns
        these parts."""
        earlier = self._record
        self.do()
        with self.context.recording(None), Sdf.ChangeBlock():
            return self._record.keep_others(earlier, self.context.is_live_layer)

    def roll_back(self) -> None:
        """Undoes everything after a do() that failed."""
        self._record.undo()

    def undo(self) -> list[Kept]:
        with self.context.recording(None), Sdf.ChangeBlock():
            return self._record.undo(self.context.is_live_layer)
