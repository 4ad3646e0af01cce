"""One page that is connected: what it has to receive. On the thread of the event loop."""

from __future__ import annotations

import asyncio
import collections
import typing

from . import wire

if typing.TYPE_CHECKING:
    from .access import Person
    from .editing import Editor
    from .picture import Picture

# A page that has more than this to receive gets the whole scene later in place of it.
MOST_BYTES = 16 << 20
# While more than this waits, batches are left out; one with the state of then follows.
_LATE_BYTES = 512 << 10
_LATE_BATCHES = 6
# Messages that are no frames are never dropped: a page that does not read so many answers is disconnected.
MOST_ANSWERS = 4096

SIGN_IN, TOO_SLOW = 4401, 4413


class _Waiting(typing.NamedTuple):
    """`slot`: of a message that a newer one of its kind replaces while it waits; the text is kept there."""

    frame: str | bytes
    can_be_dropped: bool
    slot: str = ""


class Viewer:
    """Frames of the picture can be dropped, because later ones tell the same. Answers cannot."""

    def __init__(self, number: int, person: "Person", picture: "Picture"):
        self.number, self.person, self.picture = number, person, picture
        self.id = f"viewer-{number}"
        self.selection: list[str] = []
        self.camera: list[float] | None = None
        self.time: float | None = None
        self.editor: Editor | None = None
        self.requests = 0  # that wait for an answer
        self.waiting_bytes = 0
        self.is_gone = False
        self.closing: tuple[int, str] = (1000, "")
        self.is_behind = True  # until the scene begins
        self.missed: int | None = None  # the version of the scene before the first batch that was left out
        self._asked = False
        self._waiting: collections.deque[_Waiting] = collections.deque()
        self._latest: dict[str, str] = {}
        self._batches = self._answers = 0
        self._some = asyncio.Event()

    def tell(self, message: dict | str) -> None:
        """Sends an answer, or anything else that must arrive."""
        self._put(_Waiting(message if isinstance(message, str) else wire.text(message), False))

    def tell_latest(self, slot: str, text: str) -> None:
        """Sends a message of which only the newest counts."""
        is_waiting = slot in self._latest
        self._latest[slot] = text
        if not is_waiting:
            self._put(_Waiting("", False, slot))

    def show(self, frames: typing.Sequence[str | bytes], version: int | None = None) -> None:
        """Sends frames of the picture, unless it is behind. `version`: of the scene before them; None if they must not be left
        out."""
        if self.is_behind:
            return
        for frame in frames:
            late = self._batches >= _LATE_BATCHES or self.waiting_bytes > _LATE_BYTES
            if version is not None and isinstance(frame, bytes) and (late or self.missed is not None):
                self.missed = version if self.missed is None else min(self.missed, version)
            else:
                self._put(_Waiting(frame, True))
        if self.waiting_bytes > MOST_BYTES:
            self.restart()

    def restart(self) -> None:
        """Asks for the whole scene, of the present picture, when what waits is sent."""
        self._drop_frames()
        self.is_behind, self._asked = True, False
        self._some.set()

    def begin_scene(self) -> None:
        """From now on it gets frames: those before belong to another state."""
        self._drop_frames()
        self.is_behind = self._asked = False

    def expel(self, why: str) -> None:
        """Ends the connection, because the user has to sign in."""
        self.tell({"type": "signIn", "message": why})
        self.closing = (SIGN_IN, why)
        self._put(_Waiting("", False, "close"))

    def leave(self) -> None:
        self.is_gone = True
        self._some.set()

    async def send_all(self, send: typing.Callable[[dict], typing.Awaitable[None]]) -> None:
        """Sends what waits until the page has gone."""
        while not self.is_gone:
            while self._waiting and not self.is_gone:
                await self._send_next(send)
            self._some.clear()
            self._ask()
            if not self.is_gone:
                await self._some.wait()

    async def _send_next(self, send: typing.Callable[[dict], typing.Awaitable[None]]) -> None:
        frame, can_be_dropped, slot = self._waiting.popleft()
        size = len(frame)
        if slot == "close":
            return self.leave()
        if slot:
            frame = self._latest.pop(slot)
        if isinstance(frame, bytes):
            self._batches -= 1
            await send({"type": "websocket.send", "bytes": frame})
        else:
            self._answers -= not can_be_dropped
            await send({"type": "websocket.send", "text": frame})
        self.waiting_bytes = max(0, self.waiting_bytes - size)

    def _drop_frames(self) -> None:
        self._waiting = collections.deque(one for one in self._waiting if not one.can_be_dropped)
        self.waiting_bytes = sum(len(one.frame) for one in self._waiting)
        self._batches, self.missed = 0, None

    def _put(self, one: _Waiting) -> None:
        if self.is_gone:
            return
        self._waiting.append(one)
        self.waiting_bytes += len(one.frame)
        if isinstance(one.frame, bytes):
            self._batches += 1
        elif not one.can_be_dropped:
            self._answers += 1
            if self._answers > MOST_ANSWERS:
                self.closing = (TOO_SLOW, "the page does not read its messages")
                self.leave()
        self._some.set()

    def _ask(self) -> None:
        """Asks for what it has not got."""
        if self.is_behind and not self._asked:
            self._asked = True
            self.picture.call(self.picture.stream, self)
        elif self.missed is not None and not self.is_behind:
            version, self.missed = self.missed, None
            self.picture.call(self.picture.catch_up, self, version)
