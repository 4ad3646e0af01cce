"""The part of the API that connections of both backends have in the same form."""

from __future__ import annotations

import abc
import atexit
import contextlib
import os
import typing
import warnings
import weakref

from pxr import Sdf, Usd

from . import events
from ._asynchronous import Asynchronous
from ._errors import Error
from ._history import LoggedCommit, Moment, Opinion, logged, milliseconds, opinion
from ._muteness import MutenessOfStage
from ._playhead import Playhead
from ._undo import UndoKept, UndoResult, UndoStack
from ._unsent import UnsentWork

opened: "weakref.WeakSet[Connection]" = weakref.WeakSet()


class _Shown(typing.NamedTuple):
    """The own presence, as `show_presence()` of the extensions takes it."""

    selection: list[str] = []
    camera: list[float] = []
    time: float | None = None
    edit_target: str = ""
    data: str = ""


def _file_name(path: str) -> str:
    try:
        path.encode()
    except UnicodeEncodeError:
        raise Error("invalidFileName", f"the file name {path!a} is not UTF-8") from None
    return path


class Connection(Asynchronous):
    """The part of `Live` and `PortableLive` over the functions that their extensions have under the same names."""

    def __init__(self, client: typing.Any, url: str):
        super().__init__()
        self._client, self._url = client, url
        self._process = os.getpid()
        self._handlers: list[typing.Callable[[events.Event], None]] = []
        self._followed: list[MutenessOfStage] = []
        self._presence: _Shown | None = None
        self._playhead: Playhead | None = None
        opened.add(self)

    @abc.abstractmethod
    def close(self, timeout: float = 5.0) -> events.Unsent | None:
        """Leaves the project."""

    # -- layers

    def layers(self) -> list[str]:
        """Returns the layers of the project, by path relative to it."""
        return self._client.layers()

    # -- calls that wait

    @abc.abstractmethod
    def flush(self, timeout: float = 10.0) -> bool:
        """Waits until all own edits are committed."""

    @abc.abstractmethod
    def _may_wait(self, function: str) -> None:
        """Raises an Error if the caller must not wait for the server here."""

    @abc.abstractmethod
    def _call(self, function: str, *arguments: object) -> typing.Any:
        """Calls a function of the client that waits, after which the layers are up to date, and returns its result."""

    def request(self, request: str, /, **fields: object) -> int:
        """Sends a request of PROTOCOL.md, for example `live.request("compactHistory", days=30)`, and returns its
        number. It ends with one event that has this number as `request`: the answer (`events.Answered`, or
        the class of `events` for it), or an `events.ServerError` (`unsupportedProtocol`: an older server, which does
        not know the request)."""
        return self._client.request(request, fields)

    def ask(self, request: str, /, *, timeout: float = 10.0, **fields: object) -> typing.Any:
        """Sends a request and waits for its answer. Raises an Error: the server's, or `notConnected`."""
        self._may_wait("ask")
        return self._answer(self.request(request, **fields), timeout)

    @abc.abstractmethod
    def _answer(self, request: int, timeout: float) -> typing.Any:
        """Waits for the answer to a request."""

    # -- files

    def request_save(self, *layers: str, force: bool = False) -> int:
        """Requests a save of the confirmed state without waiting. Returns a number. The answer is an
        `events.Saved` or an `events.ServerError` with this number as its `request`."""
        return self._client.save(list(layers), force)

    def reload(self, *layers: str, timeout: float = 60.0) -> events.Reloaded:
        """Lets the server commit the content of these layers' files (default: all outdated layers), so that all users get
        it, and returns the result when this editor shows it. Layers that could not be reloaded are in `failed`. Raises an
        Error if the request was refused, or if the server did not answer within `timeout` seconds."""
        self._may_wait("reload")
        return self._answer(self.request_reload(*layers), timeout)

    def request_reload(self, *layers: str) -> int:
        """Does the same without waiting. Returns a number. The answer is an `events.Reloaded` or an `events.ServerError`
        with this number as its `request`."""
        return self.request("reloadLayers", layers=layers)

    def skipped_files(self, timeout: float = 10.0) -> list[tuple[str, str]]:
        """Returns the files in the project's folder that look like layers but are not served, as (path,
        reason); at most 1,000."""
        return list(self.ask("listSkipped", timeout=timeout).files)

    def upload(self, file: "str | os.PathLike[str]", path: str, overwrite: bool = False) -> None:
        """Uploads a file of this machine that is no layer, such as a texture or a package, and waits until it is a
        file of the project that everybody can open:

            live.upload("/home/ada/brick.png", "tex/brick.png")

        `path` is its name relative to the project; folders are created as needed. If the project has another file of
        this name, it is replaced only with `overwrite`; the same content is a success. The server writes the whole
        file or nothing. Raises an Error: `invalidFileName`; `fileExists`; `notConnected`, also if the connection is
        lost meanwhile: upload it again, it continues where it was; `invalidArgument` if the file cannot be read, if it changes meanwhile, or
        inside a notice handler during `tick()`; `blobTooLarge` (`--max-blob-mib` of the server); `saveFailed` and
        `storageFull` if the server cannot write it.
        """
        self._edit("upload", os.fsencode(file), _file_name(path), overwrite)

    def request_upload(self, file: "str | os.PathLike[str]", path: str, overwrite: bool = False) -> int:
        """Begins an `upload()` and returns at once: ticks send the file, which another thread reads. The answer is
        an `events.Uploaded` or an `events.UploadFailed` with the number that this returns; `events.Progress` comes
        meanwhile if it takes long. Uploads are done one after the other."""
        return self._client.request_upload(os.fsencode(file), _file_name(path), overwrite)

    def _unconfirmed(self, timeout: float) -> str:
        why = "" if self.connected else f", and {self.other_history or 'there is no connection to the server'}"
        return f"{self.pending} transactions were not confirmed within {timeout:g} s{why}"

    # -- checkpoints

    def create_checkpoint(self, name: str, timeout: float = 10.0) -> events.Checkpoint:
        """Gives the present revision, including all own edits, a name. Waits until it is stored. Raises an
        Error: `checkpointExists` if the name is used."""
        if not self.flush(timeout):
            raise Error("notConnected", self._unconfirmed(timeout))
        return self.ask("createCheckpoint", timeout=timeout, name=name).checkpoint

    def checkpoints(self, timeout: float = 10.0) -> list[events.Checkpoint]:
        """Returns the checkpoints, by revision."""
        return list(self.ask("listCheckpoints", timeout=timeout).checkpoints)

    def _revision_at(self, at: int | str) -> int:
        """Returns the revision that a user means by a number or by the name of a checkpoint."""
        if isinstance(at, int):
            if at < 1:
                raise Error("invalidArgument", f"there is no revision {at}: revisions count from 1")
            return at
        if not isinstance(at, str):
            raise Error("invalidArgument", f"{at!r} is neither a revision (a whole number) nor the name of a checkpoint")
        for one in self.checkpoints():
            if one.name == at:
                return one.revision
        raise Error("invalidArgument", f"the project has no checkpoint '{at}'; checkpoints() lists them")

    def request_checkpoint(self, name: str) -> int:
        """Requests a checkpoint of the confirmed state without waiting. Returns a number. The answer is an
        `events.CheckpointMade` or an `events.ServerError` with this number as its `request`."""
        return self.request("createCheckpoint", name=name)

    def request_checkpoints(self) -> int:
        """Requests the checkpoints without waiting. The answer is an `events.CheckpointsListed`."""
        return self.request("listCheckpoints")

    # -- history

    def log(self, by: str | typing.Iterable[str] = (), since: Moment = None, until: Moment = None, path: str = "",
            kind: str | typing.Iterable[str] = (), layer: str = "", limit: int | None = None,
            label: str = "") -> typing.Iterator[LoggedCommit]:
        """Yields the commits of the past, the newest first, as `usdlive log` finds them:

            for commit in live.log(by="ann", since="2h", layer="shot.usda", path="/World/Chair"):
                print(commit.revision, commit.user, commit.edits)

        `by`: only commits of these users. `since`, `until`: a text as for the command ("30m", "2026-11-29 14:05"), seconds
        since 1970, a datetime, or a timedelta for a time before now. `path`: only edits of this spec of `layer` and of
        everything below it; it is followed through renames into the past. `kind`: only opinions of these kinds, as in
        `may_edit()`. With a path, a kind or a layer, commits have only the edits that fit. `label`: only commits with this text
        in their label, in any case. `limit`: the most commits.

        The iterator reads the history in pages, and each page waits for the server. Raises an Error: `invalidArgument` (an
        argument; a notice handler during `tick()`), `invalidPath`, `layerNotFound`, `notConnected`."""
        self._may_wait("log")
        if limit is not None and limit < 0:
            raise Error("invalidArgument", f"the limit is {limit}: it must be 0 or more")
        by, kind = ((one,) if isinstance(one, str) else tuple(one) for one in (by, kind))
        return self._pages({"users": list(by), "kinds": list(kind), "since": milliseconds(since), "until": milliseconds(until),
                            "layer": layer, "path": path, "label": label}, limit)

    def _pages(self, query: dict, limit: int | None) -> typing.Iterator[LoggedCommit]:
        left = float("inf") if limit is None else limit
        before, more = 0, True
        while more and left > 0:
            commits, before, query["path"], more = self._call("log", query, before, int(min(left, 500)))
            yield from map(logged, commits)
            left -= len(commits)

    def blame(self, layer: str, path: str, below: bool = False) -> list[Opinion]:
        """Returns who has made the opinions of a spec and its properties, when, and what was there before, as
        `usdlive blame` does:

            for one in live.blame("shot.usda", "/World/Ball"):
                print(one.path, one.field, one.value, "by", one.user, "was", one.before)

        `path` is a prim or property, or one and a field ("/World/Ball.radius.timeSamples"), which is looked at part by part.
        With `below`, also everything below the spec. Own edits count when they are committed. What was there before is
        known for the opinions of the newest 20 commits. Waits for the server. Raises an Error: `layerNotFound`,
        `specNotFound`, `notConnected`, `invalidArgument` (a notice handler during `tick()`)."""
        return [opinion(one) for one in self._call("blame", layer, path, below)]

    # -- locks, mutes and rights

    def lock(self, layer: str) -> None:
        """Locks a live layer in one's own name. The server then refuses edits and saves of the layer by others.
        Sent with the next tick; refused (`events.Lost`, code `locked`) if somebody else has locked it. While it
        is locked, the layer's `permissionToEdit` is False for others except administrators, so their writes
        raise an error in `pxr`."""
        self._may_wait("lock")
        self._edit("set_locked", layer, True)

    def unlock(self, layer: str) -> None:
        """Removes the lock. Allowed for its holder, for administrators, and for others while the holder is
        away."""
        self._may_wait("unlock")
        self._edit("set_locked", layer, False)

    def mute(self, root: str, layer: str) -> None:
        """Mutes a layer for everybody on the stages with the root layer `root`, which must be live. Stored in
        the root layer, as Kit does. Raises an Error if the project has no such layer."""
        self._may_wait("mute")
        self._edit("set_globally_muted", root, layer, True)

    def unmute(self, root: str, layer: str) -> None:
        self._may_wait("unmute")
        self._edit("set_globally_muted", root, layer, False)

    @abc.abstractmethod
    def _edit(self, function: str, *arguments: object) -> None:
        """Calls a function of the client that changes the project."""

    def globally_muted(self, root: str) -> list[str]:
        """Returns the layers that are muted for everybody on the stages of this root layer, which must be live."""
        if self.opened_layer(root) is None:
            raise Error("layerNotOpen", f"{root} is not open here")
        return self._client.globally_muted(root)

    def _follow(self, stage: Usd.Stage, root: str) -> None:
        self._unfollow(stage)
        self._followed.append(MutenessOfStage(stage, root))
        self._update_muteness()

    def _unfollow(self, stage: Usd.Stage) -> None:
        """Stops updating the stage's muteness, because omni.kit.usd.layers does it by its scope."""
        self._followed = [one for one in self._followed if one.stage() != stage]

    def _update_muteness(self) -> None:
        self._followed = [one for one in self._followed if one.update(self._client, self._identifier_on, self.without_waiting)]

    @abc.abstractmethod
    def _identifier_on(self, layer: str, root: str) -> str:
        """The identifier that a layer of the project has on stages with this root layer."""

    @abc.abstractmethod
    def without_waiting(self, compose: typing.Callable[[], object]) -> None:
        """Calls a function that lets stages compose something, which waits for nothing."""

    def layer_states(self) -> dict[str, events.LayerState]:
        """Returns the states by layer. Layers without a known state are left out."""
        return {d["layer"]: events.LayerState(**d) for d in self._client.layer_states()}

    def may_edit(self, layer: str, path: str = "/", kind: str | None = None) -> events.Permission:
        """Returns whether this user may write opinions of a kind at a prim or property now, by role, access rules and
        the layer's lock, so that an editor can grey out what is refused. Asks nobody and does not wait. `kind` is one of
        "transform", "geometry", "shading", "animation", "variants", "composition", "schema", "metadata", "namespace"
        and "property"; None means any one of them. After an `events.RightsChanged` or `events.LayerStatesChanged` the
        answer may be another one. Raises an Error for another kind, for a layer that the project does not have, and while
        the project is not known."""
        return events.Permission(*self._client.may_edit(layer, path, kind or ""))

    def may_do(self, action: str, layer: str | None = None) -> events.Permission:
        """Returns whether this user may do something else than edit now, by role, access rules and the layer's lock.
        Asks nobody and does not wait. `action` is "save", "reload", "lock", "takeOver" (end the lock of somebody else),
        "mute" (for everybody, in a root layer), "upload" (`layer` is a file of the project), "createLayer",
        "checkpoint" or "compact"; the last two concern the project, and there is no `layer`. After an
        `events.RightsChanged` or `events.LayerStatesChanged` the answer may be another one. Raises an Error for another
        action, for a layer that the project does not have (except for "upload" and "createLayer"), and while the project
        is not known."""
        return events.Permission(*self._client.may_do(action, layer))

    # -- undo

    def undo(self) -> UndoResult:
        """Takes back the newest step of one's own work: the edits of one `tick()`, of a gesture or of a group, in all live
        layers. Edits since the last tick are a step of their own. The stage shows the result at once. What others have
        written since stays, and is in the result's `kept`. The result is false if there is no step. Raises an Error while
        a gesture or a group is open."""
        return _undo_result(self._call("undo"))

    def redo(self) -> UndoResult:
        """Takes back the newest undo, in the same way. Own edits in between end what can be redone."""
        return _undo_result(self._call("redo"))

    def undo_stack(self) -> UndoStack:
        """Returns the labels of the steps that can be undone and redone."""
        undo, redo = self._client.undo_stack()
        return UndoStack(tuple(undo), tuple(redo))

    @contextlib.contextmanager
    def undo_group(self, label: str) -> typing.Iterator[None]:
        """The edits within are one step of the undo, over any number of ticks: `with live.undo_group("Move chairs"): ...`
        Groups nest: the outermost one counts. The history has the label, too (`live.log(label=...)`), at most 1,000 bytes
        of it."""
        self._seal()
        self._client.begin_undo_group(label)
        try:
            yield
        finally:
            self._seal()
            self._client.end_undo_group()

    def _seal(self) -> None:
        """Gives the client what the editor has written, if it does not see that itself."""

    @abc.abstractmethod
    def begin_gesture(self) -> None:
        """Starts a gesture. Until `end_gesture()`, others see the edits at once, and all are committed
        together. Gestures nest: the outermost one counts."""

    @abc.abstractmethod
    def end_gesture(self) -> None:
        """Ends a gesture."""

    @contextlib.contextmanager
    def gesture(self) -> typing.Iterator[None]:
        """Calls `begin_gesture()` and `end_gesture()`: `with live.gesture(): ...`"""
        self.begin_gesture()
        try:
            yield
        finally:
            self.end_gesture()

    # -- presence

    def show_presence(self, selection: typing.Iterable[object] = (), camera: object = None,
                      time: float | None = None, edit_target: str = "", data: str = "") -> None:
        """Sends one's presence to others: selected paths, a camera's matrix (`Gf.Matrix4d` or 16 numbers by
        rows), the time code, the edit target, and free text (JSON). Sent at most 20 times a second."""
        numbers: list[float] = []
        for row in camera if camera is not None else ():
            numbers.extend(map(float, row) if hasattr(row, "__len__") else (float(row),))
        before, self._presence = self._presence, _Shown([str(path) for path in selection], numbers, time, edit_target, data)
        try:
            self._show()
        except BaseException:
            self._presence = before
            raise

    def hide_presence(self) -> None:
        """Removes one's presence, and releases the playhead. Others see it within 3 seconds."""
        self._presence = None
        if self._playhead is not None:
            self._playhead.release()
        self._client.hide_presence()

    def _show(self) -> None:
        """Sends the own presence, with the playhead if this connection leads it."""
        shown = self._presence or _Shown()
        led = self._playhead.shown if self._playhead is not None else None
        if led is not None:
            shown = shown._replace(time=led.time, data=led.within(shown.data))
        self._client.show_presence(*shown)

    @property
    def playhead(self) -> Playhead:
        """The time that a group looks at together: one leads, the others follow, anybody takes over."""
        if self._playhead is None:
            self._playhead = Playhead(self)
        return self._playhead

    def presences(self) -> list[events.Presence]:
        """Returns the presences of others."""
        return [events.Presence(**d) for d in self._client.presences()]

    def follow(self, user: str, function: typing.Callable[[events.Presence | None], None]
               ) -> typing.Callable[[], None]:
        """Calls `function(presence)` with the presence of a user, now and after each change, during `tick()`.
        Use it to follow a camera or a selection. If the user has several clients, the one that changed last is followed;
        when it has left, the one that changed before. None means that the user has left with all clients. Returns a
        function that ends it."""
        shown: dict[str, events.Presence] = {}  # by client; the one that changed last is the last

        def moved(presence: events.Presence) -> None:
            if shown.get(presence.client) == presence:
                return
            shown.pop(presence.client, None)
            shown[presence.client] = presence
            function(presence)

        def happened(event: events.Event) -> None:
            if not isinstance(event, events.PresenceChanged):
                return
            for presence in event.shown:
                if presence.user == user:
                    moved(presence)
            followed = next(reversed(shown), None)
            for client in event.gone:
                shown.pop(client, None)
            now = next(reversed(shown), None)
            if now != followed:
                function(shown[now] if now else None)

        for presence in self.presences():
            if presence.user == user:
                moved(presence)
        self.add_handler(happened)
        return lambda: self.remove_handler(happened)

    # -- other histories, unsent and lost work

    @property
    def other_history(self) -> events.OtherHistory | None:
        """Not None while this connection has stopped because the server has another history than the editor shows:
        another project is served at the address, or an older copy of this one. An `events.ServerError` with the
        code `historyDiverged` reports it once. The layers stay as they are, edits are kept as without a
        connection, nothing is sent, and work continues when the right server is back."""
        found = self._client.other_history()
        return None if found is None else events.OtherHistory(**found)

    def join_other_history(self) -> None:
        """Decides to join the history that `other_history` describes, with the next connection. Then all open
        layers get its content. Everything that this editor was told is committed and that this history lacks
        becomes lost work (`events.Lost`). Unsent edits are sent if it is the same project; those made in another
        project become lost work, too. Returns at once; `events.Connected` reports the result. Raises an Error
        (`invalidArgument`) if the connection has not stopped."""
        self._client.join_other_history()

    def unsent_work(self) -> list[UnsentWork]:
        """Returns work that earlier connections of this user to this project could not send, because the
        process, the server or the network ended first; with any backend. Oldest first. It is kept until it is sent or
        discarded. Work in another project of the same name (`about.other_project`) cannot be sent to this one."""
        return [UnsentWork(self._client, events.Unsent(**one), self._unsent_as_layer) for one in self._client.unsent_work()]

    @abc.abstractmethod
    def _unsent_as_layer(self, work: str, layer: str) -> Sdf.Layer:
        """Returns the changes of a layer by unsent work as an anonymous layer."""

    # -- events

    def add_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """Calls `handler(event)` for every event, during `tick()` and `flush()`. Without a handler, `events.Lost` and
        `events.JoinFailed` become a RuntimeWarning."""
        self._handlers.append(handler)

    def remove_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        self._handlers.remove(handler)

    # -- state

    @property
    def connected(self) -> bool:
        """False while the connection is lost, and when it was closed."""
        return not self._client.closed and self._client.connected

    @property
    def closed(self) -> bool:
        return self._client.closed

    @property
    def user(self) -> str:
        """The name that others see."""
        return self._client.user

    @property
    def role(self) -> str:
        """The role of this user in the project: "viewer", "reviewer", "editor" or "admin". Live layers refuse the edits
        of viewers and reviewers: their `permissionToEdit` is False. Empty while the project is not known."""
        return self._client.role

    @property
    def revision(self) -> int:
        """The newest revision that is confirmed and applied here."""
        return self._client.revision

    @property
    def pending(self) -> int:
        """The number of own transactions that the server has not acknowledged. A frame of edits whose big
        arrays are being encoded counts, too."""
        return self._client.pending

    @property
    def id(self) -> str:
        """This client's id, as in `events.Committed.client`."""
        return self._client.id

    @property
    def cache_folder(self) -> str:
        return self._client.cache_folder

    # -- leaving

    def _left(self, unsent: dict | None) -> events.Unsent | None:
        """Warns of unsent work, and returns it."""
        if unsent is None:
            return None
        left = events.Unsent(**unsent)
        warnings.warn(str(left), RuntimeWarning, stacklevel=3)
        return left

    def __del__(self) -> None:
        # Without `_process`, it has not connected.
        if self.__dict__.get("_process") == os.getpid() and not self._client.closed:
            warnings.warn(f"the connection to {self._url} was not closed, and nothing refers to it any more. Its layers are no "
                          "longer live and refuse edits; what was not sent is kept, and unsent_work() of the next connection "
                          "returns it. Keep what usdlive.connect() returns as long as you edit", RuntimeWarning, stacklevel=1)

    def __enter__(self) -> typing.Self:
        return self

    def __exit__(self, raised: type | None, *_: object) -> None:
        """Closes the connection. Raises an Error (`notConnected`) if work was not sent, unless another exception is on
        its way."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore" if raised is None else "default", RuntimeWarning)
            unsent = self.close()
        if unsent is not None and raised is None:
            raise Error("notConnected", str(unsent))


def _undo_result(result: dict) -> UndoResult:
    kept = tuple(UndoKept(**one) for one in result.pop("kept"))
    return UndoResult(kept=kept, **result)


@atexit.register
def _close_all() -> None:
    """Closes open connections when the interpreter exits, so that they warn about unsent work."""
    for live in list(opened):
        if not live.closed:
            # It belongs to another thread; the journal keeps its work.
            with contextlib.suppress(Error):
                live.close(timeout=2.0)
