"""A thread that owns a connection to the server, and works off calls between its ticks."""

from __future__ import annotations

import concurrent.futures
import contextlib
import queue
import threading
import time
import typing

import usdlive

_CALLS_OF_A_TICK = 64


class Owner(threading.Thread):
    """Connects when it starts. A connection belongs to its thread: others use `call()`.

    A subclass says what happens in a frame."""

    def __init__(self, name: str, connect: typing.Callable[[], usdlive.Live]):
        super().__init__(name=f"usdlive page {name}", daemon=True)
        self._connect = connect
        self._calls: queue.SimpleQueue[tuple[typing.Callable[[], typing.Any], concurrent.futures.Future]] = queue.SimpleQueue()
        self._ends = threading.Event()
        self._awake = threading.Event()
        self._why: Exception = usdlive.Error("notConnected", "this connection was closed")
        self.ready: concurrent.futures.Future = concurrent.futures.Future()  # done when it is connected
        self.live: usdlive.Live | None = None

    def call(self, function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> concurrent.futures.Future:
        """Calls it on this thread. Calls are done in order. Any thread."""
        future: concurrent.futures.Future = concurrent.futures.Future()
        if self._ends.is_set():
            future.set_exception(self._why)
            return future
        self._calls.put((lambda: function(*arguments), future))
        self._awake.set()
        return future

    def close(self) -> None:
        """Ends the thread without waiting for it. Any thread."""
        self._ends.set()
        self._awake.set()

    def run(self) -> None:
        try:
            self.live = self._connect()
            self.begin()
        except Exception as failed:
            self._why = failed
            self._ends.set()
            self.ready.set_exception(failed)
            self._refuse_calls()
            if self.live is not None:
                self._leave()
            return
        self.ready.set_result(None)
        try:
            self._frames()
        finally:
            self._ends.set()
            self._refuse_calls()
            with contextlib.suppress(Exception):
                self.end()
            self._leave()

    def _frames(self) -> None:
        begin = time.perf_counter()
        while not self._ends.is_set():
            self._work_off()
            pause = self.frame()
            now = time.perf_counter()
            begin = max(begin + pause, now) if pause else now
            if begin > now and self._calls.empty():
                self._awake.wait(begin - now)
            self._awake.clear()

    def _work_off(self) -> None:
        for _ in range(_CALLS_OF_A_TICK):
            try:
                function, future = self._calls.get_nowait()
            except queue.Empty:
                return
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(function())
            except BaseException as failed:
                future.set_exception(failed)

    def _refuse_calls(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                future = self._calls.get_nowait()[1]
                if future.set_running_or_notify_cancel():
                    future.set_exception(self._why)

    def _leave(self) -> None:
        with contextlib.suppress(Exception):
            self.live.close(timeout=1.0)

    def begin(self) -> None:
        """Called once, when it is connected. What this raises ends the thread."""

    def frame(self) -> float:
        """Called again and again. Returns the pause until the next call, in seconds."""
        raise NotImplementedError

    def end(self) -> None:
        """Called once, before the connection is closed."""
