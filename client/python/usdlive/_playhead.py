"""A time that several people look at together."""

from __future__ import annotations

import json
import math
import secrets
import time
import typing

from . import events
from ._errors import Error

if typing.TYPE_CHECKING:
    from ._connection import Connection

KEY = "playhead"  # in the data of a presence
MOST_CLAIMS = 1 << 53  # a JSON number of every reader
GOES_ON = 0.25  # seconds; a leader that plays shows its time 20 times a second


class Led(typing.NamedTuple):
    """The playhead as its leader shows it. The highest claim leads; of two equal ones, the one with the greater key."""

    claim: int
    key: str
    user: str
    time: float
    rate: float

    def within(self, data: str) -> str:
        """Returns the data of a presence with this."""
        try:
            whole = json.loads(data or "{}")
        except (ValueError, RecursionError):
            whole = None
        if not isinstance(whole, dict):
            raise Error("invalidArgument", "while this connection leads the playhead, the data of its presence is a JSON object or "
                        f"empty, not {data[:100]!r}. Release the playhead, or show other data")
        return json.dumps({**whole, KEY: {"claim": self.claim, "key": self.key, "rate": self.rate}})


def _led(shown: events.Presence) -> Led | None:
    try:
        found = json.loads(shown.data)[KEY]
        claim, key, rate = found["claim"], found["key"], found["rate"]
        if type(claim) is not int or type(rate) not in (int, float) or not isinstance(key, str) or shown.time is None:
            return None
        rate = float(rate)
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    if not 0 < claim <= MOST_CLAIMS or not math.isfinite(shown.time + rate * GOES_ON):
        return None
    return Led(claim, key, shown.user, shown.time, rate)


def _finite(number: float, name: str) -> float:
    try:
        is_finite = math.isfinite(number)
    except OverflowError:  # an int that no float can hold
        is_finite = False
    if not is_finite:
        raise Error("invalidArgument", f"the {name} of the playhead is not a finite number")
    return float(number)


class Playhead:
    """A time that several people look at together: `live.playhead`. One leads, the others follow, and anybody takes over.

    The one who scrubs or plays calls `take()` when it begins and `show()` in each frame. The others set their time to
    `time` in each frame, after `tick()`. It is part of the presence (`show_presence()`), is sent at most 20 times a
    second, and ends when the leader releases it or has been silent for three seconds. To be used on the thread of
    `tick()`."""

    def __init__(self, connection: Connection):
        self._connection = connection
        self._shown: dict[str, Led] = {}  # by client; not the own one
        self._own: Led | None = None
        self._key = secrets.token_hex(8)
        self._claims = 0  # the highest claim seen
        self._arrived: tuple[Led | None, float] = (None, 0.0)
        for presence in connection.presences():
            self._note(presence)
        connection.add_handler(self._happened)

    @property
    def shown(self) -> Led | None:
        """The playhead as this connection shows it; None: it does not lead."""
        return None if self._connection.closed else self._own

    @property
    def leads(self) -> bool:
        """Whether this connection leads."""
        return self.shown is not None

    @property
    def leader(self) -> str | None:
        """The name of the user who leads, which may be one's own; None: nobody leads."""
        led = self._leading()
        return None if led is None else led.user

    @property
    def time(self) -> float | None:
        """The time code to show in this frame; None: nobody leads, and everybody may stay where they are. While the leader
        plays, it goes on between two messages, for at most a quarter of a second."""
        led = self._leading()
        if led is None or led is self._own:
            return None if led is None else led.time
        if self._arrived[0] != led:
            self._arrived = led, time.monotonic()
        return led.time + led.rate * min(time.monotonic() - self._arrived[1], GOES_ON)

    def take(self, time: float, *, rate: float = 0.0) -> None:
        """Begins to lead at a time code, also if somebody else leads. `rate`: time codes a second while it plays, negative
        backwards; 0: it stands. Raises an Error if a number is not finite, or if the `data` of the own presence is neither
        empty nor a JSON object, which the playhead becomes part of."""
        claim = min(self._claims + 1, MOST_CLAIMS)
        self._lead(Led(claim, self._key, self._connection.user, _finite(time, "time"), _finite(rate, "rate")))
        self._claims = claim
        self._give_way()

    def show(self, time: float, *, rate: float = 0.0) -> bool:
        """Shows another time or rate while this connection leads. Returns False, and does nothing, if it leads no longer,
        because somebody else has taken over: then stop to play, and follow."""
        time, rate = _finite(time, "time"), _finite(rate, "rate")
        if (own := self.shown) is None:
            return False
        self._lead(own._replace(time=time, rate=rate))
        return True

    def release(self) -> None:
        """Leads no longer. Nothing happens if this connection does not lead."""
        if self.leads:
            self._lead(None)

    def _lead(self, own: Led | None) -> None:
        before, self._own = self._own, own
        try:
            self._connection._show()
        except BaseException:
            self._own = before
            raise

    def _leading(self) -> Led | None:
        if self._connection.closed:
            return None
        return max(filter(None, (*self._shown.values(), self._own)), default=None, key=lambda led: led[:2])

    def _note(self, presence: events.Presence) -> None:
        led = _led(presence)
        if led is None:
            self._shown.pop(presence.client, None)
            return
        self._shown[presence.client] = led
        self._claims = max(self._claims, led.claim)

    def _happened(self, event: events.Event) -> None:
        if not isinstance(event, events.PresenceChanged):
            return
        for presence in event.shown:
            self._note(presence)
        for client in event.gone:
            self._shown.pop(client, None)
        self._give_way()

    def _give_way(self) -> None:
        if self.leads and self._leading() is not self._own:
            self._lead(None)
