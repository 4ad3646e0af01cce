"""Kit's `omni.kit.app`: frames. A frame ticks what is live, distributes edits and delivers events."""

from __future__ import annotations

import asyncio
import time

from usdlive.omni._events import EventStream

_FRAME_SECONDS = 1 / 60

# Where parts of a frame stand among the subscribers of the update stream; a script's own have order 0.
ORDER_LIVE = -300  # what others did arrives, what was authored is sent
ORDER_LAYERS = -200  # edits of the delegate layer are distributed, states are looked at, events queued
ORDER_EVENTS = -100  # queued events are delivered


class App:
    """There is one, get_app(). Used from the thread that owns the stages."""

    def __init__(self) -> None:
        self._updates = EventStream("omni.kit.app:update")
        self._last = time.monotonic()
        self._next: asyncio.Future[float] | None = None

    def get_update_event_stream(self) -> EventStream:
        """An event for each frame, whose payload has `dt`, seconds since the one before."""
        return self._updates

    def update(self) -> float:
        """One frame, now. Returns the seconds since the one before."""
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        self._updates.dispatch(0, payload={"dt": elapsed})
        return elapsed

    async def next_update_async(self) -> float:
        """Waits for the next frame. All that wait share one, and as long as somebody does there are 60 a
        second, or as many as the work in them allows."""
        loop = asyncio.get_running_loop()
        if self._next is None or self._next.get_loop() is not loop:
            self._next = loop.create_future()
            wait = max(0.0, self._last + _FRAME_SECONDS - time.monotonic())
            loop.call_later(wait, self._frame, self._next)
        return await asyncio.shield(self._next)

    def _frame(self, waited: "asyncio.Future[float]") -> None:
        if self._next is waited:
            self._next = None  # who waits from within the frame waits for the one after
        elapsed = self.update()
        if not waited.done():
            waited.set_result(elapsed)


_app = App()


def get_app() -> App:
    return _app
