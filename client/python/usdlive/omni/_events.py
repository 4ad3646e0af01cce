"""Event streams like Kit's carb.events: pushed events are delivered once per frame, in order."""

from __future__ import annotations

import collections
import dataclasses
import itertools
import logging
import typing

_log = logging.getLogger("usdlive.omni")


@dataclasses.dataclass(frozen=True)
class IEvent:
    """An event. `type` is a number of the stream's own enumeration."""

    type: int
    payload: dict[str, typing.Any] = dataclasses.field(default_factory=dict)
    sender: int = 0


class Subscription:
    """Ends when it is deleted, as in Kit. Keep it as long as you need the events."""

    def __init__(self, stream: "EventStream", key: tuple[int, int], name: str):
        self._stream: EventStream | None = stream
        self._key = key
        self.name = name

    def unsubscribe(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            stream._subscribers.pop(self._key, None)

    def __del__(self) -> None:
        self.unsubscribe()


class EventStream:
    """A stream for one thread. An exception of a subscriber is logged, and the others still receive the event."""

    def __init__(self, name: str = ""):
        self.name = name
        self._subscribers: dict[tuple[int, int], typing.Callable[[IEvent], None]] = {}
        self._queue: collections.deque[IEvent] = collections.deque()
        self._numbers = itertools.count()

    def create_subscription_to_pop(self, function: typing.Callable[[IEvent], None], order: int = 0,
                                   name: str = "") -> Subscription:
        """Calls `function(event)` for each event from now on; lower `order` first."""
        key = (order, next(self._numbers))
        self._subscribers[key] = function
        return Subscription(self, key, name)

    def create_subscription_to_pop_by_type(self, event_type: int, function: typing.Callable[[IEvent], None],
                                           order: int = 0, name: str = "") -> Subscription:
        def filtered(event: IEvent) -> None:
            if event.type == int(event_type):
                function(event)

        return self.create_subscription_to_pop(filtered, order, name)

    def push(self, event_type: int, sender: int = 0, payload: dict[str, typing.Any] | None = None) -> None:
        """Queues an event for the next pump()."""
        self._queue.append(IEvent(int(event_type), dict(payload or {}), sender))

    def dispatch(self, event_type: int, sender: int = 0, payload: dict[str, typing.Any] | None = None) -> None:
        """Delivers an event at once, before queued ones."""
        self._deliver(IEvent(int(event_type), dict(payload or {}), sender))

    def pump(self) -> None:
        """Delivers the events pushed before this call. Events that subscribers push meanwhile are delivered by
        the next call."""
        for _ in range(len(self._queue)):
            self._deliver(self._queue.popleft())

    def _deliver(self, event: IEvent) -> None:
        for key in sorted(self._subscribers):
            function = self._subscribers.get(key)  # an earlier one may have unsubscribed it
            if function is None:
                continue
            try:
                function(event)
            except Exception:  # an error of one subscriber must not stop the others
                _log.exception("a subscriber of %r raised", self.name)
