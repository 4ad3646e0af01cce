"""A connection to a project."""

from __future__ import annotations

import collections
import os
import time
import typing
import warnings

from pxr import Sdf, Usd

from . import _usdlive, events
from ._asynchronous import connecting
from ._connection import Connection
from ._errors import Error
from ._foreign_files import ForeignFiles
from ._forked import keep_if_forked
from ._past import ReadOnly, open_at
from ._player import Player
from .portable.connecting import connect as connect_portable
from .portable.connecting import connect_async as connect_portable_async
from .portable.connecting import joined


def connect(url: str, *, user: str = "", application: str = "python", cache_folder: str = "",
            timeout: float = 10.0, cache_mib: int = 4096, addresses: bool = True, token: str = "",
            backend: str | None = None) -> "Live":
    """Connects to a server and waits for its answer, at most `timeout` seconds. A server that cannot be reached
    is an error after one second.

    `url`: `ws://host:port`, or `wss://host:port` for an encrypted connection (the default port is 7447);
    `usdlive://host:port` or `host:port`, which is encrypted if an earlier connection to this server was;
    `dds://project` for a project served over DDS; or an invitation (`usdlive user add`), which is exchanged for a token
    that all programs of this account use from then on. `user`: the name shown to others; the default is the name with
    which the user joined the server, or the system's user name. `cache_folder`: the folder for layers and big values;
    the default is a temporary folder that is removed with the connection. It keeps `cache_mib` MiB of big values and
    removes those that were used longest ago; values that the server does not have yet are kept in addition. With
    `addresses`, the identifiers of live layers are `usdlive://` addresses, so that all files that they name are found
    as in the project's folder: textures, `.usdz` packages and others, which are fetched when they are first read.
    Without, they are paths of files without content in the cache folder, and no other file is found. `token`: signs in with it,
    in a process that acts for several users; otherwise with the token that this user's programs know for the server; `user` is
    then the name of the token's user. `backend`: "portable" returns a `usdlive.portable.PortableLive`, as a process with
    another OpenUSD gets it; `Live.backend` says which one is used. Raises an Error:
    `notConnected`, `invalidArgument`.
    """
    if cache_mib < 0:
        raise ValueError(f"cache_mib is {cache_mib}: it must be 0 or more")
    if backend not in (None, "fast"):
        return typing.cast(Live, connect_portable(url, user=user, application=application, cache_folder=cache_folder,
                                                  timeout=timeout, cache_mib=cache_mib, token=token, backend=backend))
    url = joined(url)
    client = _usdlive.Client(url, user, application, os.fspath(cache_folder), timeout * 1000.0, cache_mib << 20,
                             addresses, token)
    _warn_once(client.files_problem())
    return Live(client, url, user)


async def connect_async(url: str, **options: typing.Any) -> "Live":
    """`connect()` while the event loop goes on: another thread waits for the server. Takes the same `options`."""
    if options.get("backend") not in (None, "fast"):
        options.pop("addresses", None)
        return typing.cast(Live, await connect_portable_async(url, **options))
    return await connecting(lambda: connect(url, **options), lambda live: live.close(timeout=0))


def _held(identifier: str) -> Sdf.Layer:
    """Returns a loaded layer. `Sdf.Layer.Find()` would not keep it alive when it is no longer live, and OpenUSD ends the
    process when it gets such a layer."""
    return Sdf.Layer.FindOrOpen(identifier)


def _path_in(folder: str, layer: Sdf.Layer) -> str:
    return os.path.relpath(layer.realPath or "/", folder).replace(os.sep, "/")


_warned: set[str] = set()


def _warn_once(problem: str | None) -> None:
    if problem is not None and problem not in _warned:
        _warned.add(problem)
        warnings.warn(problem, RuntimeWarning, stacklevel=3)


class Live(Connection):
    """A live project. Use it on the thread that owns the stage, and call `tick()` once per frame."""

    backend = "fast"

    def __init__(self, client: "_usdlive.Client", url: str, user: str):
        super().__init__(client, url)
        self._user = user
        self._foreign_files: list[ForeignFiles] = []
        self._past: list[ReadOnly] = []
        # Events for which handlers were not called yet.
        self._undelivered: collections.deque[dict] = collections.deque()

    # -- layers and stages

    def identifier(self, layer: str) -> str:
        """Returns the identifier that a layer of the project has in this process; `Sdf.Layer.Find()` finds it by this
        when it is open. Do not write it into a layer: others find the layer by a relative path."""
        return self._client.identifier_of(layer, "")

    def open_layer(self, layer: str, payloads: bool = True) -> Sdf.Layer:
        """Opens a layer of the project live, with all layers of the project that it uses. Without `payloads`,
        layers used only by payloads are skipped until a stage loads them. Blocks until the layer has arrived."""
        return _held(self._client.open_layer(layer, payloads))

    def request_open_layer(self, layer: str, payloads: bool = True) -> int:
        """Begins to open a layer and returns at once: ticks do the work, within their budgets, also while there is
        no connection. The answer is an `events.LayerOpened`, after which `opened_layer()` returns the layer, or an
        `events.LayerOpenFailed`, with the number that this returns. `close_layer()` cancels it."""
        return self._client.request_open_layer(layer, payloads)

    def opened_layer(self, layer: str) -> Sdf.Layer | None:
        """The live layer with all its content; None when it is not open, or still opening."""
        identifier = self._client.opened_layer(layer)
        return None if identifier is None else _held(identifier)

    def create_layer(self, layer: str) -> Sdf.Layer:
        """Creates a new, empty layer of the project for all users, and opens it:

            effects = live.create_layer("effects/fx.usda")
            stage.GetRootLayer().subLayerPaths.insert(0, "effects/fx.usda")

        `layer` is a path relative to the project that ends in .usda, .usdc or .usd (binary). Its file is
        created in the project's folder at once. Raises an Error: `invalidLayerName`; `layerExists`;
        `notConnected`, because only the server knows which names are free; `invalidArgument` inside a notice
        handler during `tick()`.
        """
        return _held(self._client.create_layer(layer))

    def open_stage(self, layer: str, load: "Usd.Stage.InitialLoadSet" = Usd.Stage.LoadAll,
                   follow_muteness: bool = True, *, at: int | str | None = None) -> Usd.Stage:
        """Opens a `Usd.Stage` on a layer of the project; its layers are live. With `LoadNone`, layers used only
        by payloads are not joined; `stage.Load()` joins them in the next ticks. With `follow_muteness`, layers
        that are muted for everybody (`mute`) are muted on this stage. All files that the layers name are found as in
        the project's folder, unless `connect()` has warned that they are not; `events.FilesChanged` says when they
        change. Layers that only value clips name are such files: they are not live unless you open them. A layer that
        the server cannot read has no content and refuses edits until its file is mended; `events.JoinFailed` says why.
        Keep this object as long as you edit the stage: without it the layers are no longer live, and refuse edits.

        With `at`, a revision or the name of a checkpoint, opens the stage as it was then, with all layers of the project
        that it uses:

            before = live.open_stage("shot.usda", at="before lunch")

        Its layers refuse edits, are not live and stay as they are, also when this connection is closed. A layer that nobody
        had used by then is as it was when it was first used. Files that are no layers, such as textures, have no history:
        they are as they are now. Blocks until the server has sent what the stage composes; payloads that are loaded later are fetched then. Raises an
        Error: `futureRevision` and `historyReplaced` (`usdlive compact`) say which revisions there are; `invalidArgument` (no
        such checkpoint; a notice handler during `tick()`); `layerNotFound`; `notConnected`; `invalidConfiguration` if
        `connect()` has warned that files are not found, or without `addresses`."""
        if at is not None:
            return self._past_stage(layer, at, load, follow_muteness)
        return self._stage(self.open_layer(layer, load == Usd.Stage.LoadAll), layer, load, follow_muteness)

    def _stage(self, root: Sdf.Layer, layer: str, load: "Usd.Stage.InitialLoadSet", follow_muteness: bool) -> Usd.Stage:
        stage = Usd.Stage.Open(root, load)
        keep_if_forked(stage)
        if follow_muteness:
            self._follow(stage, layer)
        return stage

    def player(self, layer: str, at: int | str | None = None,
               load: "Usd.Stage.InitialLoadSet" = Usd.Stage.LoadAll) -> Player:
        """Opens a stage on a layer of the project as it was at a revision or checkpoint, by default as it is now, that can be
        moved through the history:

            player = live.player("shot.usda")
            player.seek("before lunch")

        Waits for the content. All layers that it uses are read, also those of payloads that are not loaded. Raises an Error:
        those of `open_stage(at=)`, without `invalidConfiguration`: without addresses, only layers are found."""
        return Player(self, layer, 0 if at is None else self._revision_at(at), load)

    def _past_stage(self, layer: str, at: int | str, load: "Usd.Stage.InitialLoadSet", follow_muteness: bool) -> Usd.Stage:
        stage = open_at(self._client.address_at(layer, self._revision_at(at)), load, follow_muteness)
        self._past = [one for one in self._past if one.stage() is not None] + [ReadOnly(stage)]
        return stage

    def attach(self, stage: Usd.Stage, project_folder: str = "", follow_muteness: bool = True) -> list[str]:
        """Makes the layers of an open stage live. The stage was opened from the folder that the server serves,
        or from a copy. The default of `project_folder` is derived from the root layer's path. Returns the
        layers that are live now. Those that the server cannot read now refuse edits and become live later
        (`events.JoinFailed`). Fails if one of the layers has unsaved edits. Files of the folder that are no USD, such
        as .obj, are reloaded when they change on the disk."""
        folder = os.fspath(project_folder) or self._project_folder(stage.GetRootLayer())
        attached = self._client.attach(folder)
        top = stage.GetRootLayer()
        if not attached and self.layer_name(top) is None and _path_in(os.path.realpath(folder), top) in self.layers():
            raise Error("invalidArgument", f"{top.identifier} was not made live, because this connection has the layer open by "
                        "another identifier. Use open_stage(), or close_layer() it first")
        self._foreign_files = [one for one in self._foreign_files if one.stage() != stage]  # replaces the entry of an earlier attach()
        self._foreign_files.append(ForeignFiles(stage, folder))
        keep_if_forked(stage)
        root = self.layer_name(stage.GetRootLayer())
        if follow_muteness and root is not None:
            self._follow(stage, root)
        return attached

    def _update_stages(self) -> None:
        if self._client.closed:  # by a notice handler
            return
        self._update_muteness()
        self._foreign_files = [one for one in self._foreign_files if one.update()]

    def _project_folder(self, root: Sdf.Layer) -> str:
        if root.realPath.startswith("usdlive://"):
            if self.layer_name(root) is not None:
                return self.cache_folder  # its layers are live already
            raise Error("invalidArgument", f"{root.identifier} is already live through another connection of this "
                        "process, or was opened by its address. Use that one, or open the stage from the project's "
                        "folder")
        names = set(self.layers())
        folder = os.path.dirname(root.realPath)
        while folder and root.realPath:
            if _path_in(folder, root) in names:
                return folder
            parent = os.path.dirname(folder)
            if parent == folder:
                break
            folder = parent
        raise Error("invalidArgument", f"{root.identifier} is not a layer of this project; "
                    "pass project_folder")

    def layer_name(self, layer: Sdf.Layer) -> str | None:
        """Returns the project's name of a live layer, or None for other layers."""
        return self._client.layer_name(layer.identifier)

    def write_origin(self, prim: Usd.Prim, layer: str = "", checkpoint: str = "") -> None:
        """Writes to a prim where it comes from, as UsdliveSessionAPI: the project, the newest confirmed revision,
        the user and the time, and the names of a layer and a checkpoint. For files that leave the project, such as
        a flattened stage: their receiver can find the project, and what changed there since. Raises an Error if the
        project has no such layer or checkpoint; asks the server for the checkpoint."""
        if layer and layer not in self.layers():
            raise Error("layerNotFound", f"the project has no layer {layer}")
        if checkpoint and checkpoint not in {one.name for one in self.checkpoints()}:
            raise Error("invalidArgument", f"the project has no checkpoint '{checkpoint}'")
        from . import schemas  # generated: it needs the plug-ins
        origin = schemas.SessionAPI.apply(prim)
        origin.project, origin.revision = self._url, self.revision
        origin.user = self.user
        origin.time = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        for name, value in (("layer", layer), ("checkpoint", checkpoint)):
            if value:
                setattr(origin, name, value)

    def close_layer(self, layer: str) -> None:
        """Ends the live connection of the layer, which keeps its content. From then on it refuses edits, which nobody would
        get, unless it is a file of an attached folder. `layer.SetPermissionToEdit(True)` makes it a copy of your own. Raises an
        Error if the layer is not open."""
        self._client.close_layer(layer)

    # -- editing

    def tick(self, budget_ms: float = 4.0) -> bool:
        """Sends one's own edits, applies received edits for about `budget_ms`, and calls the handlers. Returns
        True if edits or events are left for the next tick. The content of a big layer is prepared on another
        thread and arrives in a later tick."""
        start = time.perf_counter()
        _, more, happened = self._client.tick(budget_ms)
        return self._notify(happened, start + budget_ms / 1000) or more

    def _identifier_on(self, layer: str, root: str) -> str:
        return self._client.identifier_of(layer, root)

    def without_waiting(self, compose: typing.Callable[[], object]) -> None:
        """Calls a function of yours within a frame that lets stages compose something, for example
        `live.without_waiting(lambda: stage.UnmuteLayer(layer))`. As in `tick()`, packages and value clips that have to
        be fetched are fetched in the background, where providers of payloads are asked as well. A later tick composes
        them."""
        self._client.without_waiting(compose)

    def flush(self, timeout: float = 10.0) -> bool:
        """Calls `tick()` until all own edits are committed. Returns False after `timeout` seconds."""
        done, happened = self._client.flush(timeout * 1000.0)
        self._notify(happened)
        return done

    def begin_gesture(self) -> None:
        self._client.begin_gesture()

    def end_gesture(self) -> None:
        self._client.end_gesture()

    def _call(self, function: str, *arguments: object) -> typing.Any:
        result, happened = getattr(self._client, function)(*arguments)
        self._notify(happened)
        return result

    def _may_wait(self, function: str) -> None:
        self._client.may_wait(function)

    def _edit(self, function: str, *arguments: object) -> None:
        getattr(self._client, function)(*arguments)

    def save(self, *layers: str, force: bool = False, timeout: float = 60.0) -> events.Saved:
        """Commits all own edits, writes these layers (default: all changed layers) to their files, and returns
        the result. A file that somebody else has changed is not overwritten unless `force`; its layer is in
        `failed` with `layerOutdated`. Raises an Error if the request was refused, or if the server did not answer
        within `timeout` seconds."""
        self._client.may_wait("save")
        end = time.monotonic() + timeout
        if not self.flush(timeout):
            raise Error("notConnected", f"nothing was saved: {self._unconfirmed(timeout)}")
        left = max(0.0, end - time.monotonic())
        return self._answer(self.request_save(*layers, force=force), left)

    def _answer(self, request: int, timeout: float) -> typing.Any:
        answers: list[events.Event] = []

        def receive(event: events.Event) -> None:
            if isinstance(event, (*events.ANSWERS, events.ServerError)) and event.request == request:
                answers.append(event)

        self._answered.append(receive)
        try:
            if not self.wait(lambda: bool(answers), timeout):
                raise Error("notConnected", f"the server did not answer within {timeout:g} s")
        finally:
            self._answered.remove(receive)
        if isinstance(answers[0], events.ServerError):
            raise Error(answers[0].code, answers[0].message)
        return answers[0]

    # -- lost work

    def _unsent_as_layer(self, work: str, layer: str) -> Sdf.Layer:
        return _held(self._client.unsent_as_layer(work, layer))

    def lost_work_as_layer(self, index: int, layer: str) -> Sdf.Layer:
        """Returns refused or dropped work as an anonymous layer (M12): number `index` (see `events.Lost`) on `layer`. A
        value that no edit can express is kept as text in the custom data of its spec (`lost:FIELD`; of the root in
        `customLayerData`). All lost work can be read until the connection is closed."""
        return _held(self._client.lost_work_as_layer(index, layer))

    # -- events

    def wait(self, condition: typing.Callable[[], bool], timeout: float = 10.0) -> bool:
        """Calls `tick()` until `condition()` is true. Returns False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            if not self.tick():
                time.sleep(0.002)
        return True

    def _notify(self, happened: list[dict], end: float = float("inf")) -> bool:
        """Updates the stages, and calls the handlers for at least one event, and until `end`. Returns True if events
        are left."""
        self._undelivered.extend(happened)  # first: an exception loses no events
        self._update_stages()
        while self._undelivered:
            event = events._from_dictionary(self._undelivered.popleft())
            for handler in (*self._answered, *self._handlers):
                handler(event)
            if not self._handlers and isinstance(event, (events.Lost, events.JoinFailed)):
                warnings.warn(str(event), RuntimeWarning, stacklevel=4)
            if time.perf_counter() >= end:
                break
        return bool(self._undelivered)

    # -- state

    def close(self, timeout: float = 5.0) -> events.Unsent | None:
        """Leaves the project when all own edits are committed, or after `timeout` seconds. Returns None, or the
        unsent work and where it is kept, with a RuntimeWarning; `unsent_work()` of a later connection can send
        it. Layers keep their content, are no longer live and refuse edits, as after `close_layer()`. Inside a notice
        handler during `tick()`, the connection is closed at the end of the tick."""
        unsent, happened = self._client.close(timeout * 1000.0)
        self._notify(happened)
        return self._left(unsent)
