"""A live project whose layers are read and written through the `pxr` of this process."""

from __future__ import annotations

import collections
import os
import pathlib
import shutil
import tempfile
import time
import typing
import warnings

from pxr import Sdf, Tf, Usd

from .. import _session, events
from .._errors import Error
from ._content import Memory, Reader, Writer, object_at, stays, write

_SILENCE = 30.0  # seconds without an answer
_NAMESPACE = ("move", "place")
_SLICE = 50  # prims of a layer that one tick compares beside those that stages have named


class NotInPortable(Error, AttributeError):
    """The portable backend does not have this part of the API."""


class _LiveLayer:
    """A live layer, and where the editor has perhaps written in it."""

    def __init__(self, name: str, layer: Sdf.Layer):
        self.name, self.layer, self.memory = name, layer, Memory()
        self.filled = self.dirty = self.again = False
        self.hints: set[str] = set()  # paths of prims and variants that stages have seen a change of
        self.sweep: typing.Iterator[list[str]] | None = None  # the comparison of all, in slices
        layer.SetPermissionToEdit(False)

    def written(self) -> None:
        self.dirty = True

    def end(self) -> None:
        self.layer.SetPermissionToEdit(False)

    def next_slice(self) -> list[str]:
        """The prims and variants to compare next. A write during a sweep begins another one after it."""
        if self.sweep is None and self.dirty:
            self.sweep = self.slices()
        elif self.dirty:
            self.again = True
        found: list[str] = []
        while self.sweep is not None and len(found) < _SLICE:
            part = next(self.sweep, None)
            found += part or []
            if part is None:
                self.sweep = self.slices() if self.again else None
                self.again = False
        return found

    def end_sweep(self) -> None:
        self.sweep, self.again = None, False

    def slices(self) -> typing.Iterator[list[str]]:
        """The paths of all prims and variants of the layer, some at a time."""
        waiting = ["/"]
        while waiting:
            now, waiting = waiting[-_SLICE:], waiting[:-_SLICE]
            yield now
            for path in now:
                spec = object_at(self.layer, path)
                if spec is None:
                    continue
                below = "" if path == "/" else path
                separator = "" if path.endswith("}") else "/"
                children = self.layer.rootPrims if path == "/" else spec.nameChildren
                waiting += [f"{below}{separator}{child.name}" for child in children]
                for variants in () if path == "/" else spec.variantSets:
                    waiting += [f"{below}{{{variants.name}={variant.name}}}" for variant in variants.variants]


class _Notices:
    """Tells live layers what the editor writes. Sdf's notices name the layers, and those of stages the prims, where a stage
    shows them. A write that no stage shows is found by the comparison of the whole layer."""

    def __init__(self, layers: dict[str, _LiveLayer]):
        self._layers = layers
        self.applying = False
        self._keys = [Tf.Notice.RegisterGlobally(Sdf.Notice.LayersDidChange, self._layers_changed),
                      Tf.Notice.RegisterGlobally(Usd.Notice.ObjectsChanged, self._objects_changed)]

    def end(self) -> None:
        for key in self._keys:
            key.Revoke()

    def _layers_changed(self, notice: Sdf.Notice.LayersDidChange, _: object) -> None:
        if self.applying:
            return
        changed = set(notice.GetLayers())
        for live in self._layers.values():
            if live.layer in changed:
                live.written()

    def _objects_changed(self, notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> None:
        if self.applying:
            return
        dirty = [live for live in self._layers.values() if live.dirty]
        if not dirty:
            return
        by_layer = {live.layer: live for live in dirty}
        local = [live for live in dirty if stage.HasLocalLayer(live.layer)]
        for path in (*notice.GetResyncedPaths(), *notice.GetChangedInfoOnlyPaths()):
            prim_path = path.GetPrimPath() if path != Sdf.Path.absoluteRootPath else path
            for live in local:
                live.hints.add(str(prim_path))
            prim = stage.GetPrimAtPath(prim_path)
            for spec in prim.GetPrimStack() if prim else ():
                if spec.layer in by_layer:
                    by_layer[spec.layer].hints.add(str(spec.path))


class PortableLive:
    """A live project. Use it on the thread that owns the stage, and call `tick()` once per frame.

    It has the plain part of the API of `usdlive.Live`, with the same meaning. The rest raises an Error
    (`unsupportedValue`) that says so. Layers are files without content in the cache folder; no other file of the project
    is found. Unsent work is not kept when the process ends."""

    backend = "portable"

    def __init__(self, url: str, *, user: str = "", application: str = "python", cache_folder: str = "",
                 timeout: float = 10.0, cache_mib: int = 4096, token: str = ""):
        self._own_folder = None if cache_folder else tempfile.mkdtemp(prefix="usdlive-layers-")
        self._folder = pathlib.Path(os.path.realpath(os.fspath(cache_folder) or self._own_folder or ""))
        try:
            self._session = _session.Session(url, user, application, str(self._folder), timeout * 1000.0, cache_mib << 20, token)
        except Error:
            self._remove_folder()
            raise
        self._url = url
        self._layers: dict[str, _LiveLayer] = {}
        self._notices = _Notices(self._layers)
        self._handlers: list[typing.Callable[[events.Event], None]] = []
        self._answers: dict[int, events.Event | None] = {}
        self._failed: dict[str, events.JoinFailed] = {}
        self._ticking = False

    def __getattr__(self, name: str) -> typing.NoReturn:
        raise NotInPortable("unsupportedValue", f"the portable backend of usdlive has no {name!r} yet. Use the fast one, in a "
                                                "process with the usd-core for which usdlive was built, or the command usdlive")

    # -- layers and stages

    def layers(self) -> list[str]:
        """Returns the layers of the project, by path relative to it."""
        return self._session.project_layers()

    def identifier(self, layer: str) -> str:
        """Returns the identifier that a layer of the project has in this process."""
        return str(self._folder / layer)

    def open_layer(self, layer: str) -> Sdf.Layer:
        """Opens a layer of the project live, with all layers of the project that it uses. Blocks until it has arrived."""
        self._open(layer)
        try:
            self._wait(lambda: layer in self._failed or self._is_whole(layer, set()), f"{layer} did not arrive")
        except Error:
            self._forget(layer)
            raise
        failed = self._failed.pop(layer, None)
        if failed is not None:
            self._forget(layer)
            raise Error(failed.code, failed.message)
        return self._layers[layer].layer

    def opened_layer(self, layer: str) -> Sdf.Layer | None:
        """The live layer with all its content; None when it is not open, or still opening."""
        live = self._layers.get(layer)
        return live.layer if live is not None and live.filled else None

    def open_stage(self, layer: str) -> Usd.Stage:
        """Opens a `Usd.Stage` on a layer of the project; its layers are live. Keep this object as long as you edit it."""
        return Usd.Stage.Open(self.open_layer(layer))

    def create_layer(self, layer: str) -> Sdf.Layer:
        """Creates a new, empty layer of the project for all users, and opens it."""
        self._answer(self._session.create_layer(layer), _SILENCE)
        return self.open_layer(layer)

    def close_layer(self, layer: str) -> None:
        """Ends the live connection of the layer, which keeps its content and refuses edits from then on."""
        if layer not in self._layers:
            raise Error("layerNotOpen", f"{layer} is not open")
        self._forget(layer)

    # -- editing

    def tick(self, budget_ms: float = 4.0) -> bool:
        """Sends one's own edits, applies received edits, and calls the handlers. Returns True if more is left for the next
        tick. The session works for about `budget_ms`. Edits that a stage of this process shows are sent at once; others in
        a big layer when the comparison of the whole layer, which ticks do in slices, has come to them. `flush()` sends all."""
        return self._tick(budget_ms, whole=False)

    def _tick(self, budget_ms: float, whole: bool) -> bool:
        if self._ticking:
            return False  # called by a notice handler
        self._ticking = True
        happened: list[events.Event] = []
        try:
            happened += self._capture(whole)
            more = self._session.advance(budget_ms)
            happened += [event for event in map(events._from_dictionary, self._session.take_events()) if self._note(event)]
            for live in list(self._layers.values()):
                self._apply(live)
        finally:
            self._ticking = False
        for event in happened:
            for handler in list(self._handlers):
                handler(event)
            if not self._handlers and isinstance(event, (events.Lost, events.JoinFailed)):
                warnings.warn(str(event), RuntimeWarning, stacklevel=3)
        return more or any(live.sweep is not None for live in self._layers.values())

    def flush(self, timeout: float = 10.0) -> bool:
        """Calls `tick()` until all own edits are committed. Returns False after `timeout` seconds."""
        self._tick(4.0, whole=True)
        return self.wait(lambda: self.pending == 0, timeout)

    def wait(self, condition: typing.Callable[[], bool], timeout: float = 10.0) -> bool:
        """Calls `tick()` until `condition()` is true. Returns False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            if not self.tick():
                self._session.wait(2.0)
        return True

    def save(self, *layers: str, force: bool = False, timeout: float = 60.0) -> events.Saved:
        """Commits all own edits, writes these layers (default: all changed layers) to their files, and returns the result.
        A file that somebody else has changed is not overwritten unless `force`."""
        end = time.monotonic() + timeout
        if not self.flush(timeout):
            raise Error("notConnected", f"nothing was saved: the server has not confirmed all edits within {timeout:g} seconds")
        return typing.cast(events.Saved, self._answer(self._session.save(list(layers), force), end - time.monotonic()))

    # -- events and state

    def add_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """Calls `handler(event)` for every event, during `tick()`."""
        self._handlers.append(handler)

    def remove_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        self._handlers.remove(handler)

    @property
    def connected(self) -> bool:
        """False while the connection is lost, and when it was closed."""
        return not self._session.closed and self._session.connected

    @property
    def closed(self) -> bool:
        return self._session.closed

    @property
    def user(self) -> str:
        """The name that others see."""
        return self._session.user

    @property
    def role(self) -> str:
        """The role of this user in the project. Live layers refuse the edits of those who may not write."""
        return self._session.role

    @property
    def revision(self) -> int:
        """The newest revision that is confirmed and applied here."""
        return self._session.revision

    @property
    def pending(self) -> int:
        """The number of own transactions that the server has not acknowledged."""
        return self._session.pending

    @property
    def id(self) -> str:
        """This client's id, as in `events.Committed.client`."""
        return self._session.id

    @property
    def cache_folder(self) -> str:
        return str(self._folder)

    def close(self, timeout: float = 5.0) -> None:
        """Leaves the project when all own edits are committed, or after `timeout` seconds: then with a RuntimeWarning,
        because what was not sent is lost. Layers keep their content and refuse edits."""
        if self._session.closed:
            return
        if not self.flush(timeout):
            warnings.warn(f"{self.pending} edits were not sent to {self._url} and are lost", RuntimeWarning, stacklevel=2)
        for layer in list(self._layers):
            self._forget(layer)
        self._notices.end()
        self._session.close()
        self._remove_folder()

    def __enter__(self) -> "PortableLive":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- opening

    def _open(self, name: str) -> None:
        if name in self._layers:
            return
        if name not in self.layers():
            raise Error("layerNotFound", f"the project has no layer {name}")
        self._failed.pop(name, None)
        self._layers[name] = _LiveLayer(name, self._placeholder(name))
        self._session.open(name)

    def _placeholder(self, name: str) -> Sdf.Layer:
        """The layer of this process, at the place that other layers name by a relative path. Its file has no content."""
        path = self.identifier(name)
        layer = Sdf.Layer.Find(path)
        if layer is None and not os.path.exists(path):
            os.makedirs(os.path.dirname(path), exist_ok=True)
            layer = Sdf.Layer.CreateNew(path)
        layer = layer or Sdf.Layer.FindOrOpen(path)
        if layer is None:
            raise Error("invalidArgument", f"cannot make the file {path}. Name a cache folder that can be written")
        return layer

    def _used(self, live: _LiveLayer) -> list[str]:
        """The layers of the project that a layer names."""
        names, project = [], set(self.layers())
        for asset in live.layer.GetCompositionAssetDependencies():
            place = os.path.normpath(os.path.join(os.path.dirname(live.layer.realPath), asset.split(":SDF_FORMAT_ARGS:")[0]))
            name = os.path.relpath(place, self._folder).replace(os.sep, "/")
            if name in project:
                names.append(name)
        return names

    def _is_whole(self, name: str, seen: set[str]) -> bool:
        seen.add(name)
        live = self._layers.get(name)
        if live is None or not live.filled:
            return name in self._failed
        return all(other in seen or self._is_whole(other, seen) for other in self._used(live))

    def _forget(self, name: str) -> None:
        live = self._layers.pop(name, None)
        if live is not None:
            self._session.close_layer(name)
            live.end()

    def _remove_folder(self) -> None:
        if self._own_folder is not None:
            shutil.rmtree(self._own_folder, ignore_errors=True)

    # -- waiting

    def _wait(self, condition: typing.Callable[[], bool], what: str, timeout: float = _SILENCE) -> None:
        if self._ticking:
            raise Error("invalidArgument", "a call that waits for the server was made by a handler during tick(). Make it "
                                           "after tick() has returned")
        if not self.wait(condition, timeout):
            raise Error("notConnected", f"{what}: the server at {self._url} did not answer within {timeout:g} seconds")

    def _answer(self, request: int, timeout: float) -> events.Event:
        self._answers[request] = None
        try:
            self._wait(lambda: self._answers[request] is not None, "there is no answer", timeout)
            answer = self._answers[request]
        finally:
            del self._answers[request]
        if isinstance(answer, events.ServerError):
            raise Error(answer.code, answer.message)
        return typing.cast(events.Event, answer)

    def _note(self, event: events.Event) -> bool:
        request = getattr(event, "request", None)
        if request in self._answers and not isinstance(event, events.Progress):
            self._answers[request] = event
        if isinstance(event, events.JoinFailed):
            self._failed[event.layer] = event
        if isinstance(event, (events.Connected, events.RightsChanged)):
            for live in self._layers.values():
                if live.filled:
                    live.layer.SetPermissionToEdit(self._session.may_write(live.name))
        return True

    # -- what the editor wrote

    def _capture(self, whole: bool = False) -> list[events.Event]:
        """`whole`: compares all layers that were written, and leaves nothing to later ticks."""
        lost: list[events.Event] = []
        for live in self._layers.values():
            if live.filled and (live.dirty or live.sweep is not None):
                lost += self._capture_layer(live, whole)
        self._session.submit()
        return lost

    def _capture_layer(self, live: _LiveLayer, whole: bool) -> list[events.Event]:
        refused: dict[tuple[str, str], str] = {}
        reader = Reader(live.layer, live.memory, lambda path: self._session.has(live.name, path),
                        lambda path, field, why: refused.update({(path, field): why}))
        if whole or live.dirty and not live.hints:
            seen = reader.all(exact=not whole)
            live.end_sweep()
        else:
            reader.at(live.hints, exact=True)
            seen = reader.at(live.next_slice(), exact=False)
        live.dirty = False
        live.hints.clear()

        def keeps(path: str, field: str, data: bytes) -> bool:
            return (path, field) in refused or stays(live.layer, path, field, data)

        answers = [("unsupportedValue", path, field, why) for (path, field), why in refused.items()]
        for path, field, code, message in self._session.capture(live.name, seen, keeps):
            answers.append((code, path, field, message))
        if refused:
            self._revert(live, refused)
        return [events.Lost(code=code, message=f"{live.name} <{path}>{' ' if field else ''}{field}: {message}", refused=False,
                            edits=(events.Edit("set", live.name, path, field or None),))
                for code, path, field, message in answers]

    def _revert(self, live: _LiveLayer, refused: typing.Iterable[tuple[str, str]]) -> None:
        with _Applying(live, self._notices):
            for path, field in refused:
                spec = object_at(live.layer, path)
                if spec is not None:
                    write(spec, path, field, self._session.held(live.name, path, field), live.memory)

    # -- what others wrote

    def _apply(self, live: _LiveLayer) -> None:
        changes = self._session.take_changes(live.name)
        if not changes:
            return
        if changes[0][0] == "replaced":
            self._fill(live)
        else:
            with _Applying(live, self._notices):
                _write_changes(live, changes)
        for name in self._used(live):
            self._open(name)

    def _fill(self, live: _LiveLayer) -> None:
        scratch = Sdf.Layer.CreateAnonymous(os.path.splitext(live.name)[1])
        live.memory.clear()
        writer = Writer(scratch, live.memory)
        with Sdf.ChangeBlock():
            for path, kind, fields in self._session.content(live.name):
                if path != "/":
                    writer.create(path, kind)
                for field, data in fields.items():
                    writer.field(path, field, data)
        with _Applying(live, self._notices):
            live.layer.TransferContent(scratch)
        live.filled, live.dirty = True, False
        live.end_sweep()
        live.hints.clear()
        live.layer.SetPermissionToEdit(self._session.may_write(live.name))


class _Applying:
    """While the content of the project is written into a layer, its notices are no edits, and it may be written."""

    def __init__(self, live: _LiveLayer, notices: _Notices):
        self._live, self._notices = live, notices

    def __enter__(self) -> None:
        self._notices.applying = True
        self._permitted = self._live.layer.permissionToEdit
        self._live.layer.SetPermissionToEdit(True)

    def __exit__(self, *_: object) -> None:
        self._live.layer.SetPermissionToEdit(self._permitted)
        self._notices.applying = False


def _type_first(changes: list[tuple]) -> list[tuple]:
    """Moves the type of an attribute before its other fields, which Sdf converts to it."""
    ordered: list[tuple] = []
    for change in changes:
        at = len(ordered)
        if change[0] == "field" and change[2] == "typeName":
            while at > 0 and ordered[at - 1][:2] == change[:2]:
                at -= 1
        ordered.insert(at, change)
    return ordered


def _write_changes(live: _LiveLayer, changes: list[tuple]) -> None:
    """Writes consecutive changes in one change block. OpenUSD does not survive that for renames, which get one each."""
    writer = Writer(live.layer, live.memory)
    calls = {"create": writer.create, "delete": writer.delete, "move": writer.move, "place": writer.place, "field": writer.field}
    together: collections.deque[tuple] = collections.deque(_type_first(changes))
    while together:
        if together[0][0] in _NAMESPACE:
            what, *rest = together.popleft()
            calls[what](*rest)
            continue
        with Sdf.ChangeBlock():
            while together and together[0][0] not in _NAMESPACE:
                what, *rest = together.popleft()
                calls[what](*rest)
