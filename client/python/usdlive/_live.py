"""A connection to a project, for Python."""

from __future__ import annotations

import asyncio
import atexit
import collections
import contextlib
import os
import time
import typing
import warnings
import weakref

from pxr import Sdf, Usd

from . import _usdlive, events
from ._errors import Error


def connect(url: str, *, user: str = "", application: str = "python", cache_folder: str = "",
            timeout: float = 10.0, cache_mib: int = 4096) -> "Live":
    """Connects to a server and waits, at most `timeout` seconds, until it answers. A server that cannot be
    reached at all is an error after a second.

    `url`: `ws://host:port`, `usdlive://host:port` or `host:port`, which mean the same (the port is 7447
    where none is given), or `dds://project` for a project served over DDS. `user` is shown to others;
    empty is the system's user name. Layers stand below `cache_folder`; empty is a temporary folder that
    is removed with the connection. Of big values the folder holds `cache_mib` MiB, and removes those used
    longest ago; values that the server does not have yet come on top. Raises an Error: `notConnected`,
    `invalidArgument`."""
    if cache_mib < 0:
        raise ValueError(f"cache_mib is {cache_mib}: it has to be 0 or more")
    return Live(_usdlive.Client(url, user, application, os.fspath(cache_folder), timeout * 1000.0,
                                cache_mib << 20))


_open: "weakref.WeakSet[Live]" = weakref.WeakSet()


class Sent(typing.NamedTuple):
    """What became of unsent work, in transactions: committed now, committed before (only the
    acknowledgement had been lost), and pieces of work that were refused or dropped."""

    committed: int
    before: int
    lost: int


class _MutenessOfStage:
    """Mutes on one stage what is muted for everybody, and nothing else: what its user mutes or unmutes
    himself stays until the layer says something new."""

    def __init__(self, stage: Usd.Stage, root: str):
        self.stage = weakref.ref(stage)
        self._root = root
        self._muted: frozenset[str] = frozenset()

    def update(self, client: "_usdlive.Client") -> bool:
        """False when the stage is gone."""
        stage = self.stage()
        if stage is None:
            return False
        muted = frozenset(client.globally_muted(self._root))
        if muted != self._muted:
            before, self._muted = self._muted, muted
            root = stage.GetRootLayer()
            folder = (root.realPath or root.identifier).removesuffix(self._root)
            stage.MuteAndUnmuteLayers([folder + layer for layer in sorted(muted - before)],
                                      [folder + layer for layer in sorted(before - muted)])
        return True


class Live:
    """One project, live. Use it on the thread that owns the stage and call `tick()` once per frame."""

    def __init__(self, client: "_usdlive.Client"):
        self._client = client
        _open.add(self)
        self._handlers: list[typing.Callable[[events.Event], None]] = []
        self._followed: list[_MutenessOfStage] = []
        self._untold: collections.deque[dict] = collections.deque()  # events that handlers have not seen

    # -- layers and stages

    def layers(self) -> list[str]:
        """What the project has, by path relative to it."""
        return self._client.layers()

    def open_layer(self, layer: str, payloads: bool = True) -> Sdf.Layer:
        """A layer of the project, live, with all layers of the project it uses; without `payloads`, those
        that only payloads bring in are left out until a stage loads them. Blocks until it is here."""
        return Sdf.Layer.Find(self._client.open_layer(layer, payloads))

    def create_layer(self, layer: str) -> Sdf.Layer:
        """Makes a new, empty layer of the project, for everybody, and opens it:

            effects = live.create_layer("effects/fx.usda")
            stage.GetRootLayer().subLayerPaths.insert(0, "effects/fx.usda")

        `layer` is a path relative to the project that ends in .usda, .usdc or .usd (binary). Its file is in the
        project's folder at once. Raises an Error: `invalidLayerName`; `layerExists`; `notConnected`, because
        only the server knows which names are free; `invalidArgument` from a notice handler within `tick()`."""
        return Sdf.Layer.Find(self._client.create_layer(layer))

    def skipped_files(self, timeout: float = 10.0) -> list[tuple[str, str]]:
        """(path, reason) of files in the project's folder that look like layers and are not served; at most
        1,000."""
        return list(self._answer(self._client.list_skipped(), events.SkippedListed, timeout).files)

    def open_stage(self, layer: str, load: "Usd.Stage.InitialLoadSet" = Usd.Stage.LoadAll,
                   follow_muteness: bool = True) -> Usd.Stage:
        """An ordinary `Usd.Stage` on a layer of the project, whose layers are live. Opened with `LoadNone`,
        it joins no layer that only payloads bring in; `stage.Load()` brings it in with the next ticks.
        With `follow_muteness`, layers that are muted for everybody (`mute`) are muted on it."""
        stage = Usd.Stage.Open(self.open_layer(layer, load == Usd.Stage.LoadAll), load)
        if follow_muteness:
            self._follow(stage, layer)
        return stage

    def attach(self, stage: Usd.Stage, project_folder: str = "", follow_muteness: bool = True) -> list[str]:
        """Makes the layers of a stage live that is open already from the folder the server serves (or a
        copy of it). `project_folder` is found from the root layer's path when not given. Returns the
        layers that are live now; refuses when one of them has unsaved edits."""
        folder = os.fspath(project_folder) or self._project_folder(stage.GetRootLayer())
        attached = self._client.attach(folder)
        root = self.layer_name(stage.GetRootLayer())
        if follow_muteness and root is not None:
            self._follow(stage, root)
        return attached

    def _follow(self, stage: Usd.Stage, root: str) -> None:
        self._followed.append(_MutenessOfStage(stage, root))
        self._followed[-1].update(self._client)

    def _unfollow(self, stage: Usd.Stage) -> None:
        """From now on somebody else says what is muted on it (omni.kit.usd.layers, by its scope)."""
        self._followed = [one for one in self._followed if one.stage() != stage]

    def _follow_muteness(self) -> None:
        if self._client.closed:  # by a notice handler
            return
        self._followed = [one for one in self._followed if one.update(self._client)]

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
        handlers. True when there is more to apply, or to call the handlers for, than fitted in. The
        content of a big layer is made beside, and comes with a later tick."""
        start = time.perf_counter()
        _, more, happened = self._client.tick(budget_ms)
        self._follow_muteness()
        return self._tell(happened, start + budget_ms / 1000) or more

    def flush(self, timeout: float = 10.0) -> bool:
        """Ticks until all that was authored is committed; False when `timeout` seconds were not enough."""
        done, happened = self._client.flush(timeout * 1000.0)
        self._follow_muteness()
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

    def save(self, *layers: str, force: bool = False, timeout: float = 60.0) -> events.Saved:
        """Writes these layers (none: all that changed) to their files, with all that was authored here, and
        returns what was written. A file that somebody else has changed meanwhile is left as it is, and the
        layer is among the `failed` with `layerOutdated`, unless `force`. Raises an Error when nothing was
        written, or when the server did not say within `timeout` seconds that it was."""
        self._client.may_wait("save")
        end = time.monotonic() + timeout
        if not self.flush(timeout):
            raise Error("notConnected", f"nothing was saved: {self._unconfirmed(timeout)}")
        left = max(0.0, end - time.monotonic())
        return self._answer(self.request_save(*layers, force=force), events.Saved, left)

    def request_save(self, *layers: str, force: bool = False) -> int:
        """Without waiting: writes what is confirmed. The answer is an `events.Saved`, or an
        `events.ServerError`, whose `request` is the number that this returns."""
        return self._client.save(list(layers), force)

    def reload(self, *layers: str) -> int:
        """Asks the server to take the files of these layers (none: of all that are outdated) as commits:
        everybody has then what is in them. The answer is an `events.Reloaded` with the number that this
        returns."""
        return self._client.reload(list(layers))

    def _unconfirmed(self, timeout: float) -> str:
        why = "" if self.connected else ", and there is no connection to the server"
        return f"{self.pending} transactions were not confirmed within {timeout:g} s{why}"

    # -- checkpoints

    def create_checkpoint(self, name: str, timeout: float = 10.0) -> events.Checkpoint:
        """Names what the project is now, with all that was authored here, and waits until that is stored.
        Raises an Error: `checkpointExists` when another has the name."""
        if not self.flush(timeout):
            raise Error("notConnected", self._unconfirmed(timeout))
        return self._answer(self.request_checkpoint(name), events.CheckpointMade, timeout).checkpoint

    def checkpoints(self, timeout: float = 10.0) -> list[events.Checkpoint]:
        """By revision."""
        request = self.request_checkpoints()
        return list(self._answer(request, events.CheckpointsListed, timeout).checkpoints)

    def request_checkpoint(self, name: str) -> int:
        """Without waiting: names what is confirmed. The answer is an `events.CheckpointMade`, or an
        `events.ServerError`, whose `request` is the number that this returns."""
        return self._client.create_checkpoint(name)

    def request_checkpoints(self) -> int:
        """Likewise, answered by an `events.CheckpointsListed`."""
        return self._client.list_checkpoints()

    def _answer(self, request: int, kind: type, timeout: float) -> typing.Any:
        answers: list[events.Event] = []

        def hear(event: events.Event) -> None:
            if isinstance(event, (kind, events.ServerError)) and event.request == request:
                answers.append(event)

        self.add_handler(hear)
        try:
            if not self.wait(lambda: bool(answers), timeout):
                raise Error("notConnected", f"the server did not answer within {timeout:g} s")
        finally:
            self.remove_handler(hear)
        if isinstance(answers[0], events.ServerError):
            raise Error(answers[0].code, answers[0].message)
        return answers[0]

    # -- locks, states and people

    def lock(self, layer: str) -> None:
        """Locks a live layer in one's own name: the server then refuses everybody else's edits of it, and
        saving it. Sent with the next tick; refused (`events.Lost`, code `locked`) when somebody else has it.
        While the lock stands, `permissionToEdit` of the layer is False for others, but for administrators:
        `pxr` raises where they write."""
        self._client.set_locked(layer, True)

    def unlock(self, layer: str) -> None:
        """Ends the lock; for its holder, an administrator, and whoever takes it when the holder is away."""
        self._client.set_locked(layer, False)

    def mute(self, root: str, layer: str) -> None:
        """Mutes a layer for everybody, on the stages whose root layer is `root`, which is live. It is
        stored in the root layer, as Kit does, and travels with it."""
        self._client.set_globally_muted(root, layer, True)

    def unmute(self, root: str, layer: str) -> None:
        self._client.set_globally_muted(root, layer, False)

    def globally_muted(self, root: str) -> list[str]:
        """What is muted for everybody on the stages of this root layer."""
        return self._client.globally_muted(root)

    def layer_states(self) -> dict[str, events.LayerState]:
        """By layer; those of which there is nothing to say are left out."""
        return {d["layer"]: events.LayerState(**d) for d in self._client.layer_states()}

    def show_presence(self, selection: typing.Iterable[object] = (), camera: object = None,
                      time: float | None = None, edit_target: str = "", data: str = "") -> None:
        """Shows the others where one is: selected paths, a camera's matrix (`Gf.Matrix4d` or 16 numbers by
        rows), the time code, the edit target, and free text (JSON). At most 20 times a second is sent."""
        numbers: list[float] = []
        for row in camera if camera is not None else ():
            numbers.extend(map(float, row) if hasattr(row, "__len__") else (float(row),))
        self._client.show_presence([str(path) for path in selection], numbers, time, edit_target, data)

    def hide_presence(self) -> None:
        """The others see one gone within 3 seconds."""
        self._client.hide_presence()

    def presences(self) -> list[events.Presence]:
        """Where the others are."""
        return [events.Presence(**d) for d in self._client.presences()]

    def follow(self, user: str, function: typing.Callable[[events.Presence | None], None]
               ) -> typing.Callable[[], None]:
        """`function(presence)` for where somebody is, now and whenever it changes, from `tick()`: to look
        through their camera, or select what they do. None: they are gone. Of several clients of one user the
        one that moved last is followed. Returns what ends it."""
        followed: list[str] = []  # the client

        def moved(presence: events.Presence) -> None:
            followed[:] = [presence.client]
            function(presence)

        def happened(event: events.Event) -> None:
            if not isinstance(event, events.PresenceChanged):
                return
            for presence in event.shown:
                if presence.user == user:
                    moved(presence)
            if followed and followed[0] in event.gone:
                followed.clear()
                function(None)

        for presence in self.presences():
            if presence.user == user:
                moved(presence)
        self.add_handler(happened)
        return lambda: self.remove_handler(happened)

    def unsent_work(self) -> list["UnsentWork"]:
        """Work that earlier connections of this user to this project could not send, because their process,
        the server or the network ended first; the oldest first. It is kept until it is sent or discarded."""
        return [UnsentWork(self._client, events.Unsent(**one)) for one in self._client.unsent_work()]

    def lost_work_as_layer(self, index: int, layer: str) -> Sdf.Layer:
        """The refused or dropped work number `index` (that of its `events.Lost`) on `layer`, as an
        anonymous layer (M12)."""
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

    def _tell(self, happened: list[dict], end: float = float("inf")) -> bool:
        """Calls the handlers for one event at least, and until `end`. True when events are left for the next time."""
        self._untold.extend(happened)
        while self._untold:
            event = events._from_dictionary(self._untold.popleft())
            for handler in tuple(self._handlers):
                handler(event)
            if time.perf_counter() >= end:
                break
        return bool(self._untold)

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
        """Transactions of one's own that the server has not acknowledged, and a frame of edits whose big arrays
        are still being encoded."""
        return self._client.pending

    @property
    def id(self) -> str:
        """This client's id; `events.Committed.client` of one's own work."""
        return self._client.id

    @property
    def cache_folder(self) -> str:
        return self._client.cache_folder

    @property
    def closed(self) -> bool:
        return self._client.closed

    def close(self, timeout: float = 5.0) -> events.Unsent | None:
        """Leaves the project when all that was authored is committed, or `timeout` seconds are over. Returns
        None, or what was not sent and where it is kept, with a RuntimeWarning: `unsent_work()` of a later
        connection sends it. Layers stay, with their content, no longer live. Called by a notice handler
        within `tick()`, it is done when the tick ends."""
        unsent, happened = self._client.close(timeout * 1000.0)
        self._tell(happened)
        if unsent is None:
            return None
        left = events.Unsent(**unsent)
        warnings.warn(str(left), RuntimeWarning, stacklevel=2)
        return left

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, raised: type | None, *_: object) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore" if raised is None else "default", RuntimeWarning)
            unsent = self.close()
        if unsent is not None and raised is None:
            raise Error("notConnected", str(unsent))


class UnsentWork:
    """Work of an earlier connection that was not sent; `str()` of it is a sentence for its user."""

    def __init__(self, client: "_usdlive.Client", about: events.Unsent):
        self._client = client
        self.about = about

    def __str__(self) -> str:
        return str(self.about)

    def send(self, timeout: float = 60.0) -> Sent:
        """Commits it, where its specs stand now. Each edit is committed once, also when only its
        acknowledgement had been lost, and when this is called again after an Error. What is refused or
        dropped is told by `events.Lost` with the next tick."""
        return Sent(*self._client.send_unsent(self.about.id, timeout * 1000.0))

    def as_layer(self, layer: str) -> Sdf.Layer:
        """What it does to `layer`, as an anonymous layer; the work is still there afterwards."""
        return Sdf.Layer.Find(self._client.unsent_as_layer(self.about.id, layer))

    def discard(self) -> None:
        """Deletes it for good."""
        self._client.discard_unsent(self.about.id)


@atexit.register
def _close_all() -> None:
    """What is open when the interpreter exits says what it leaves unsent, too."""
    for live in list(_open):
        if not live.closed:
            with contextlib.suppress(Error):  # it belongs to another thread: the journal has its work
                live.close(timeout=2.0)
