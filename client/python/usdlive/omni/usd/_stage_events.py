"""The events of a context's stage."""

from __future__ import annotations

import asyncio
import typing
import weakref

from usdlive.omni._events import EventStream, IEvent

from ._enums import StageEventType

_Event = tuple[int, dict[str, typing.Any]]


class StageEvents:
    """Sends changes of the context's state at once, so that a blocking call sends them in order and a
    subscriber to SAVING can still cancel. Queues events that may be frequent or follow later for the frame."""

    def __init__(self, context_name: str):
        self.stream = EventStream(f"omni.usd:{context_name}:stage")
        self._subscription = self.stream.create_subscription_to_pop(self._on_event, order=1000)
        self._waiting: dict[asyncio.Task, asyncio.Future[_Event]] = {}
        # Several events may be sent in one frame, before a task that waits for the next one runs
        # again. It gets the others from here. Events that it does not request until the next frame
        # are dropped.
        self._unread: weakref.WeakKeyDictionary[asyncio.Task, list[tuple[int, _Event]]] = (
            weakref.WeakKeyDictionary())
        self._frame = 0

    def send(self, kind: StageEventType, **payload: typing.Any) -> None:
        self.stream.dispatch(kind, payload=payload)

    def queue(self, kind: StageEventType, **payload: typing.Any) -> None:
        self.stream.push(kind, payload=payload)

    def pump(self) -> None:
        """Called once per frame."""
        self._frame += 1
        for task, events in list(self._unread.items()):
            kept = [(frame, event) for frame, event in events if frame >= self._frame - 1]
            if kept:
                self._unread[task] = kept
            else:
                del self._unread[task]
        self.stream.pump()

    async def next(self) -> _Event:
        task = asyncio.current_task()
        unread = self._unread.pop(task, [])
        if unread:
            (_, event), self._unread[task] = unread[0], unread[1:]
            await asyncio.sleep(0)
            return event
        waited: asyncio.Future[_Event] = asyncio.get_running_loop().create_future()
        self._waiting[task] = waited
        try:
            return await waited
        finally:
            self._waiting.pop(task, None)

    async def next_of(self, kind: StageEventType) -> None:
        while (await self.next())[0] != kind:
            pass

    def _on_event(self, event: IEvent) -> None:
        item = (int(event.type), event.payload)
        for events in self._unread.values():
            events.append((self._frame, item))
        waiting, self._waiting = self._waiting, {}
        for task, waited in waiting.items():
            if not waited.done():
                waited.set_result(item)
                self._unread[task] = []
