"""A connection to a project, for Python."""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
import typing

from pxr import Sdf, Usd

from . import _usdlive, events
from ._errors import Error


def connect(url: str, *, user: str = "", application: str = "python", cache_folder: str = "",
            timeout: float = 10.0) -> "Live":
    """Connects to the server at `url` (`ws://host:port`) and waits, at most `timeout` seconds, until it
    answers. `user` is shown to others; empty is the system's user name. Layers stand below
    `cache_folder`; empty is a temporary folder that goes with the connection."""
    return Live(_usdlive.Client(url, user, application, os.fspath(cache_folder), timeout * 1000.0))


class Live:
    """One project, live. Use it on the thread that owns the stage and call `tick()` once per frame."""

    def __init__(self, client: "_usdlive.Client"):
        self._client = client
        self._handlers: list[typing.Callable[[events.Event], None]] = []

    # -- layers and stages

    def layers(self) -> list[str]:
        """What the project has, by path relative to it."""
        return self._client.layers()

    def open_layer(self, layer: str) -> Sdf.Layer:
        """A layer of the project, live, with all layers of the project it uses. Blocks until it is here."""
        return Sdf.Layer.Find(self._client.open_layer(layer))

    def open_stage(self, layer: str, load: "Usd.Stage.InitialLoadSet" = Usd.Stage.LoadAll) -> Usd.Stage:
        """An ordinary `Usd.Stage` on a layer of the project, whose layers are live."""
        return Usd.Stage.Open(self.open_layer(layer), load)

    def attach(self, stage: Usd.Stage, project_folder: str = "") -> list[str]:
        """Makes the layers of a stage live that is open already from the folder the server serves (or a
        copy of it). `project_folder` is found from the root layer's path when not given. Returns the
        layers that are live now; refuses when one of them has unsaved edits."""
        folder = os.fspath(project_folder) or self._project_folder(stage.GetRootLayer())
        return self._client.attach(folder)

    def _project_folder(self, root: Sdf.Layer) -> str:
        names = set(self.layers())
        folder = os.path.dirname(root.realPath)
        while folder and root.realPath:
            if os.path.relpath(root.realPath, folder).replace(os.sep, "/") in names:
                return folder
            parent = os.path.dirname(folder)
            if parent == folder:
                break
            folder = parent
        raise Error("invalidArgument", f"{root.identifier} is no layer of this project; "
                    "pass project_folder")

    def layer_name(self, layer: Sdf.Layer) -> str | None:
        """The name in the project of a live layer; None for others."""
        return self._client.layer_name(layer.identifier)

    def close_layer(self, layer: str) -> None:
        """Ends being live; the layer keeps its content."""
        self._client.close_layer(layer)

    # -- editing

    def tick(self, budget_ms: float = 4.0) -> bool:
        """Sends what was authored, applies what has arrived within about `budget_ms`, calls the
        handlers. True when more has arrived than could be applied."""
        _, more, happened = self._client.tick(budget_ms)
        self._tell(happened)
        return more

    def flush(self, timeout: float = 10.0) -> bool:
        """Ticks until all that was authored is committed; False when `timeout` seconds were not enough."""
        done, happened = self._client.flush(timeout * 1000.0)
        self._tell(happened)
        return done

    def begin_gesture(self) -> None:
        """Until `end_gesture()`, others see what is authored at once, and it is committed once."""
        self._client.begin_gesture()

    def end_gesture(self) -> None:
        self._client.end_gesture()

    @contextlib.contextmanager
    def gesture(self) -> typing.Iterator[None]:
        """`with live.gesture(): ...` for begin and end."""
        self.begin_gesture()
        try:
            yield
        finally:
            self.end_gesture()

    def save(self, *layers: str) -> None:
        """Asks the server to write these layers (none: all that changed) to their files. The answer is
        an `events.Saved`."""
        self._client.save(list(layers))

    def lost_work_as_layer(self, index: int, layer: str) -> Sdf.Layer:
        """The refused or dropped work number `index` (in the order of the `events.Lost`) on `layer`, as
        an anonymous layer (M12)."""
        return Sdf.Layer.Find(self._client.lost_work_as_layer(index, layer))

    # -- what happens

    def add_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """`handler(event)` is called from `tick()` and `flush()` for everything that happens."""
        self._handlers.append(handler)

    def remove_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        self._handlers.remove(handler)

    async def events(self, interval: float | None = 1 / 60) -> typing.AsyncIterator[events.Event]:
        """Yields what happens from now on. Ticks by itself every `interval` seconds while somebody waits
        for the next event; None: only when `tick()` is called elsewhere."""
        queue: list[events.Event] = []
        self.add_handler(queue.append)
        try:
            while True:
                while queue:
                    yield queue.pop(0)
                if interval is None:
                    await asyncio.sleep(1 / 120)
                else:
                    more = self.tick()
                    await asyncio.sleep(0 if more else interval)
        finally:
            self.remove_handler(queue.append)

    def wait(self, condition: typing.Callable[[], bool], timeout: float = 10.0) -> bool:
        """Ticks until `condition()` is true; False when `timeout` seconds were not enough."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            if not self.tick():
                time.sleep(0.002)
        return True

    def _tell(self, happened: list[dict]) -> None:
        for event in map(events._from_dictionary, happened):
            for handler in tuple(self._handlers):
                handler(event)

    # -- state

    @property
    def connected(self) -> bool:
        return self._client.connected

    @property
    def revision(self) -> int:
        """Of what is confirmed and applied here."""
        return self._client.revision

    @property
    def pending(self) -> int:
        """Transactions of one's own that the server has not acknowledged."""
        return self._client.pending

    @property
    def id(self) -> str:
        """This client's id; `events.Committed.client` of one's own work."""
        return self._client.id

    @property
    def cache_folder(self) -> str:
        return self._client.cache_folder

    def close(self) -> None:
        """Leaves the project. Layers stay, with their content, no longer live."""
        self._client.close()

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
