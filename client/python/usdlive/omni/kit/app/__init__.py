"""Kit's `omni.kit.app`: frames. A frame ticks live connections, distributes edits and delivers events."""

from __future__ import annotations

import asyncio
import time

from usdlive.omni._events import EventStream

_FRAME_SECONDS = 1 / 60

# The order of a frame's parts among the subscribers of the update stream. A script's own
# subscribers have order 0.
ORDER_LIVE = -300  # edits of others arrive, own edits are sent
# Edits of the delegate layer are distributed, states are checked, events are queued.
ORDER_LAYERS = -200
ORDER_EVENTS = -100  # queued events are delivered


class App:
    """The application; there is one, get_app(). Use it on the thread that owns the stages."""

    def __init__(self) -> None:
        self._updates = EventStream("omni.kit.app:update")
        self._last = time.monotonic()
        self._next: asyncio.Future[float] | None = None

    def get_update_event_stream(self) -> EventStream:
        """Returns the stream with one event per frame. Its payload has `dt`, the seconds since the previous
        frame."""
        return self._updates

    def update(self) -> float:
        """Runs one frame. Returns the seconds since the previous frame."""
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        self._updates.dispatch(0, payload={"dt": elapsed})
        return elapsed

    async def next_update_async(self) -> float:
        """Waits for the next frame. All waiting tasks share it. While tasks wait, there are 60 frames a second,
        or as many as their work allows."""
        loop = asyncio.get_running_loop()
        if self._next is None or self._next.get_loop() is not loop:
            self._next = loop.create_future()
            wait = max(0.0, self._last + _FRAME_SECONDS - time.monotonic())
            loop.call_later(wait, self._frame, self._next)
        return await asyncio.shield(self._next)

    def _frame(self, waited: "asyncio.Future[float]") -> None:
        if self._next is waited:
            self._next = None  # a task that waits within this frame gets the next one
        elapsed = self.update()
        if not waited.done():
            waited.set_result(elapsed)


_app = App()


def get_app() -> App:
    return _app
