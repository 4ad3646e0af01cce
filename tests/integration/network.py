"""Two network namespaces and a link between them, which loses, delays and cuts frames on request. This kernel
has no netem: the link is a program of ours between two TAP devices."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time

INTERFACE = "usdlive0"
CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000


class Refused(Exception):
    """The kernel, or the rights of the user, do not allow it."""


class Namespace:
    """A separate network with one device, whose frames `tap` reads and writes."""

    def __init__(self, address: str):
        self.address = address
        self.holder = subprocess.Popen(["unshare", "--net", "sh", "-c", "echo ready; exec sleep infinity"],
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if self.holder.stdout.readline() != "ready\n":
            raise Refused("no network namespace can be made: " + self.holder.stderr.read().strip())
        self.enter = ["nsenter", f"--net=/proc/{self.holder.pid}/ns/net", "--"]
        self.tap = self._open_tap()
        self._ip("link", "set", "lo", "up")
        self._ip("addr", "add", f"{address}/24", "dev", INTERFACE)
        self._ip("link", "set", INTERFACE, "up")

    def _ip(self, *arguments: str) -> None:
        ran = subprocess.run([*self.enter, "ip", *arguments], capture_output=True, text=True)
        if ran.returncode != 0:
            raise Refused(f"ip {' '.join(arguments)}: {ran.stderr.strip()}")

    def _open_tap(self) -> int:
        """A device belongs to the namespace of the thread that opens it."""
        opened: list[int | OSError] = []

        def work():
            try:
                with open(f"/proc/{self.holder.pid}/ns/net") as namespace:
                    if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET) != 0:
                        raise OSError(ctypes.get_errno(), "setns")
                tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
                fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH", INTERFACE.encode(), IFF_TAP | IFF_NO_PI))
                opened.append(tap)
            except OSError as refusal:
                opened.append(refusal)

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        if isinstance(opened[0], OSError):
            raise Refused(f"no TAP device can be made: {opened[0]}")
        return opened[0]

    def move(self, address: str) -> None:
        """The device gets another address, as with a new lease."""
        self._ip("addr", "del", f"{self.address}/24", "dev", INTERFACE)
        self._ip("addr", "add", f"{address}/24", "dev", INTERFACE)
        self.address = address

    def close(self) -> None:
        with contextlib.suppress(AttributeError):
            os.close(self.tap)
        self.holder.kill()
        self.holder.wait()


class Line(threading.Thread):
    """Carries frames between two namespaces. `loss` is a fraction of all frames, `delay` and `jitter` are
    seconds; frames overtake one another. While it is cut it carries nothing."""

    MOST_ON_THE_WAY = 20_000

    def __init__(self, one: Namespace, other: Namespace, seed: int):
        super().__init__(daemon=True)
        self.taps = {one.tap: other.tap, other.tap: one.tap}
        self.random = random.Random(seed)
        self.loss = self.delay = self.jitter = 0.0
        self.is_cut = False
        self.carried = self.lost = 0
        self.on_the_way: list[tuple[float, int, int, bytes]] = []
        self.done = threading.Event()
        self.failure: BaseException | None = None
        self.start()

    def run(self):
        try:
            while not self.done.is_set():
                wait = self.on_the_way[0][0] - time.monotonic() if self.on_the_way else 0.1
                for tap in select.select(list(self.taps), [], [], min(max(wait, 0), 0.1))[0]:
                    self._take(tap)
                now = time.monotonic()
                while self.on_the_way and self.on_the_way[0][0] <= now:
                    _, _, tap, frame = heapq.heappop(self.on_the_way)
                    with contextlib.suppress(BlockingIOError):
                        os.write(tap, frame)
        except BaseException as failure:  # raised again by end()
            self.failure = failure

    def _take(self, tap: int) -> None:
        for _ in range(64):
            try:
                frame = os.read(tap, 65536)
            except BlockingIOError:
                return
            if self.is_cut or self.random.random() < self.loss or len(self.on_the_way) >= self.MOST_ON_THE_WAY:
                self.lost += 1
                continue
            self.carried += 1
            due = time.monotonic() + self.delay + self.random.uniform(-self.jitter, self.jitter)
            heapq.heappush(self.on_the_way, (due, self.carried, self.taps[tap], frame))

    def end(self) -> None:
        self.done.set()
        self.join(10)
        if self.failure:
            raise self.failure
