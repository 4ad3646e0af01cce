"""The events of a context's stage."""

from __future__ import annotations

import asyncio
import typing
import weakref

from usdlive.omni._events import EventStream, IEvent

from ._enums import StageEventType

Heard = tuple[int, dict[str, typing.Any]]


class StageEvents:
    """What changes the context's state is told at once, so that a blocking call tells it in order and who
    hears SAVING can still cancel; what can happen often or follows later is queued for the frame."""

    def __init__(self, context_name: str):
        self.stream = EventStream(f"omni.usd:{context_name}:stage")
        self._hearing = self.stream.create_subscription_to_pop(self._on_event, order=1000)
        self._waiting: dict[asyncio.Task, asyncio.Future[Heard]] = {}
        # Several events may come in one frame, before a task that waits for the next one runs again. It then
        # finds the others here; what it has not asked for until the frame after is dropped.
        self._unheard: weakref.WeakKeyDictionary[asyncio.Task, list[tuple[int, Heard]]] = (
            weakref.WeakKeyDictionary())
        self._frame = 0

    def tell(self, kind: StageEventType, **payload: typing.Any) -> None:
        self.stream.dispatch(kind, payload=payload)

    def tell_later(self, kind: StageEventType, **payload: typing.Any) -> None:
        self.stream.push(kind, payload=payload)

    def pump(self) -> None:
        """Once per frame."""
        self._frame += 1
        for task, events in list(self._unheard.items()):
            kept = [(frame, heard) for frame, heard in events if frame >= self._frame - 1]
            if kept:
                self._unheard[task] = kept
            else:
                del self._unheard[task]
        self.stream.pump()

    async def next(self) -> Heard:
        task = asyncio.current_task()
        unheard = self._unheard.pop(task, [])
        if unheard:
            (_, heard), self._unheard[task] = unheard[0], unheard[1:]
            await asyncio.sleep(0)
            return heard
        waited: asyncio.Future[Heard] = asyncio.get_running_loop().create_future()
        self._waiting[task] = waited
        try:
            return await waited
        finally:
            self._waiting.pop(task, None)

    async def next_of(self, kind: StageEventType) -> None:
        while (await self.next())[0] != kind:
            pass

    def _on_event(self, event: IEvent) -> None:
        heard = (int(event.type), event.payload)
        for events in self._unheard.values():
            events.append((self._frame, heard))
        waiting, self._waiting = self._waiting, {}
        for task, waited in waiting.items():
            if not waited.done():
                waited.set_result(heard)
                self._unheard[task] = []
