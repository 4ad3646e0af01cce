"""A TCP line to a server with a rate in each direction, delay, jitter, a buffer and cuts, as on a mobile phone or a
cable modem. What it does depends on its seed and on the time only."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import random
import socket
import threading
import time

from conftest import unused_port

UP, DOWN = "up", "down"
# The system's buffers of the line's sockets. Those of the line itself are `Properties.buffer`.
SOCKET_BYTES = 16 * 1024


@dataclasses.dataclass
class Properties:
    up: float = 1.0  # Mbit/s
    down: float = 1.0
    delay: float = 0.02  # seconds, one way
    jitter: float = 0.0  # seconds; the order stays
    buffer: int = 64 * 1024  # bytes of each direction that wait in the line
    cuts: list[float] = dataclasses.field(default_factory=list)  # seconds after the start() of the cuts

    @staticmethod
    def random(seed: int) -> Properties:
        of = random.Random(seed)
        rate = lambda: round(10 ** of.uniform(-1, 1), 2)  # noqa: E731
        return Properties(rate(), rate(), of.uniform(0.001, 0.1), of.uniform(0, 0.05), of.randrange(8, 256) * 1024,
                          sorted(of.uniform(2, 20) for _ in range(of.choice([0, 0, 1, 2]))))


class Way:
    """One direction of a connection."""

    def __init__(self, line: ThinLine, name: str, source: socket.socket, target: socket.socket):
        self.line, self.name, self.source, self.target = line, name, source, target
        self.waiting: collections.deque[tuple[float, bytes]] = collections.deque()
        self.bytes = 0  # waiting
        self.free = self.due = 0.0
        self.ends = False

    def take(self, now: float) -> None:
        """Reads what the line has room for."""
        of = self.line.properties
        rate = getattr(of, self.name) * 125_000
        while not self.ends and self.bytes < of.buffer:
            try:
                data = self.source.recv(min(of.buffer - self.bytes, max(512, int(rate / 50))))
            except BlockingIOError:
                return
            self.ends = not data
            self.line.moved[self.name] += len(data)
            self.bytes += len(data)
            self.free = max(self.free, now) + len(data) / rate
            self.due = max(self.due, self.free + of.delay + self.line.random.uniform(0, of.jitter))
            self.waiting.append((self.due, data))

    def give(self, now: float) -> None:
        """Writes what has arrived at the other end."""
        while self.waiting and self.waiting[0][0] <= now:
            due, data = self.waiting[0]
            if not data:
                raise ConnectionError
            try:
                sent = self.target.send(data)
            except BlockingIOError:
                return
            self.bytes -= sent
            self.waiting[0] = (due, data[sent:])
            if sent == len(data):
                self.waiting.popleft()


class ThinLine(threading.Thread):
    STEP = 0.004

    def __init__(self, port: int, properties: Properties, seed: int = 1):
        super().__init__(daemon=True)
        self.target, self.properties, self.random = port, properties, random.Random(seed)
        self.port = unused_port()
        self.moved = {UP: 0, DOWN: 0}
        self.connections = self.cuts = 0
        self.ways: list[tuple[Way, Way]] = []
        self.cut_at: list[float] = []
        self.done = threading.Event()
        self.failure: BaseException | None = None
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BYTES)
        self.listener.bind(("127.0.0.1", self.port))
        self.listener.listen()
        self.listener.setblocking(False)
        self.start()

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def begin(self) -> None:
        """Counts from now on; the cuts happen."""
        self.moved = {UP: 0, DOWN: 0}
        self.cut_at = [time.monotonic() + after for after in self.properties.cuts]

    def run(self) -> None:
        try:
            while not self.done.is_set():
                self.accept()
                now = time.monotonic()
                if self.cut_at and now >= self.cut_at[0]:
                    self.cut_at.pop(0)
                    self.cut()
                for pair in list(self.ways):
                    try:
                        for way in pair:
                            way.take(now)
                            way.give(now)
                    except OSError:
                        self.close(pair)
                time.sleep(self.STEP)
        except BaseException as failure:  # raised again by end()
            self.failure = failure

    def accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            near = self.listener.accept()[0]
            far = socket.socket()
            far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BYTES)
            far.connect(("127.0.0.1", self.target))
            for end in (near, far):
                end.setblocking(False)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BYTES)
            self.connections += 1
            self.ways.append((Way(self, UP, near, far), Way(self, DOWN, far, near)))

    def close(self, pair: tuple[Way, Way]) -> None:
        self.ways.remove(pair)
        for way in pair:
            way.source.close()

    def cut(self) -> None:
        """Ends all connections; what is on its way is lost."""
        self.cuts += 1
        for pair in list(self.ways):
            for way in pair:
                way.source.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            self.close(pair)

    def end(self) -> None:
        self.done.set()
        self.join(10)
        self.listener.close()
        for pair in list(self.ways):
            self.close(pair)
        if self.failure:
            raise self.failure
