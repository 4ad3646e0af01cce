"""Calls that wait while the event loop goes on, for both backends."""

from __future__ import annotations

import abc
import asyncio
import typing

from pxr import Sdf, Usd

from . import events
from ._errors import Error


async def connecting(connect: typing.Callable[[], typing.Any], close: typing.Callable[[typing.Any], object]) -> typing.Any:
    """Connects in another thread. If the task is cancelled meanwhile, the connection is closed."""
    future = asyncio.ensure_future(asyncio.to_thread(connect))
    try:
        return await asyncio.shield(future)
    except asyncio.CancelledError:
        future.add_done_callback(lambda done: done.cancelled() or done.exception() or close(done.result()))
        raise


class Asynchronous(abc.ABC):
    """Opens layers and stages, and yields events, in a coroutine. Ticks by itself, or leaves that to the caller."""

    def __init__(self) -> None:
        # Handlers of calls that wait for an answer.
        self._answered: list[typing.Callable[[events.Event], None]] = []

    @abc.abstractmethod
    def tick(self, budget_ms: float = 4.0) -> bool:
        """Sends and applies edits, and calls handlers. Returns True if more is left."""

    @abc.abstractmethod
    def request_open_layer(self, layer: str, payloads: bool = True) -> int:
        """Begins to open a layer."""

    @abc.abstractmethod
    def opened_layer(self, layer: str) -> Sdf.Layer | None:
        """Returns the live layer with all its content; None when it is not open, or still opening."""

    @property
    @abc.abstractmethod
    def closed(self) -> bool:
        """The connection was closed."""

    @abc.abstractmethod
    def add_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """Calls `handler(event)` for every event."""

    @abc.abstractmethod
    def remove_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """Takes it back."""

    @abc.abstractmethod
    def _stage(self, root: Sdf.Layer, layer: str, load: "Usd.Stage.InitialLoadSet", follow_muteness: bool) -> Usd.Stage:
        """Composes a stage of a layer that is open."""

    async def open_layer_async(self, layer: str, payloads: bool = True,
                               interval: float | None = 1 / 60) -> Sdf.Layer:
        """`open_layer()` while the event loop goes on. Ticks by itself every `interval` seconds; None: only when
        `tick()` is called elsewhere. Raises an Error when the layer cannot be opened. A task that is cancelled
        leaves the layer opening: `close_layer()` ends that."""
        ends: list[events.LayerOpened | events.LayerOpenFailed] = []

        def note(event: events.Event) -> None:
            if isinstance(event, (events.LayerOpened, events.LayerOpenFailed)) and event.request == request:
                ends.append(event)

        request = self.request_open_layer(layer, payloads)
        self._answered.append(note)
        try:
            while not ends:
                more = interval is not None and self.tick()
                if not ends:
                    await asyncio.sleep(0 if more else interval or 1 / 120)
                if not ends and self.closed:
                    raise Error("notConnected", f"{layer} was not opened: this connection was closed meanwhile")
        finally:
            self._answered.remove(note)
        return self._opened_by(ends[0])

    def _opened_by(self, end: "events.LayerOpened | events.LayerOpenFailed") -> Sdf.Layer:
        """Returns the layer whose opening has ended in this way, or raises the error."""
        if isinstance(end, events.LayerOpenFailed):
            raise Error(end.code, end.message)
        opened = self.opened_layer(end.layer)
        if opened is None:
            raise Error("layerNotOpen", f"{end.layer} was closed by an event handler")
        return opened

    async def open_stage_async(self, layer: str, load: "Usd.Stage.InitialLoadSet" = Usd.Stage.LoadAll,
                               follow_muteness: bool = True, interval: float | None = 1 / 60) -> Usd.Stage:
        """`open_stage()` while the event loop goes on, as `open_layer_async()` does. Composing the stage from its layers,
        when they are here, does not wait for anything."""
        root = await self.open_layer_async(layer, load == Usd.Stage.LoadAll, interval)
        return self._stage(root, layer, load, follow_muteness)

    async def events(self, interval: float | None = 1 / 60) -> typing.AsyncIterator[events.Event]:
        """Yields the events from now on, until the connection is closed. While the caller waits, calls `tick()` every
        `interval` seconds. With None, the caller has to call `tick()` elsewhere."""
        queue: list[events.Event] = []
        self.add_handler(queue.append)
        try:
            while True:
                while queue:
                    yield queue.pop(0)
                if self.closed:
                    return
                more = interval is not None and self.tick()
                await asyncio.sleep(0 if more else interval or 1 / 120)
        finally:
            self.remove_handler(queue.append)
