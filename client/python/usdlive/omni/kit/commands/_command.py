"""What a command is."""

from __future__ import annotations

import abc
import typing

from pxr import Sdf, Usd

from usdlive.omni._registers import Kept, Record, Recorder
from usdlive.omni.usd import UsdContext, get_context, get_context_from_stage


class CommandFailed(Exception):
    """Raised in do(): nothing comes of the command, and this is why."""


class Command(abc.ABC):
    """Its arguments are those of its constructor. do() gives the result; one that can be undone has an
    undo(), too. redo is do() again. `FooCommand` is executed as "Foo" or "FooCommand"."""

    @abc.abstractmethod
    def do(self) -> typing.Any: ...


def context_of(usd_context: str | UsdContext | Usd.Stage | None) -> UsdContext | None:
    """What Kit's commands take as a context: a name, the context, or its stage."""
    if isinstance(usd_context, UsdContext):
        return usd_context
    if isinstance(usd_context, Usd.Stage):
        return get_context_from_stage(usd_context)
    return get_context(usd_context or "")


class RecordedCommand(Command):
    """Writes layers in edit(), and tells the recorder before what it is about to write. undo() brings back
    what was there; in a live layer only where nobody else has written since. It gives what it left."""

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
            return self.edit(recorder)
        finally:
            self._record = recorder.finish()

    def roll_back(self) -> None:
        """After a do() that failed: all of it or nothing."""
        self._record.undo()

    def undo(self) -> list[Kept]:
        with Sdf.ChangeBlock():
            return self._record.undo(self.context.is_live_layer)
