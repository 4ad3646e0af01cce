"""A live project whose layers are read and written through the `pxr` of this process."""

from __future__ import annotations

import atexit
import collections
import contextlib
import functools
import math
import os
import pathlib
import shutil
import tempfile
import time
import typing
import warnings

from pxr import Sdf, Tf, Usd

from .. import _session, events
from .._connection import Connection
from .._errors import Error
from .._forked import keep_if_forked
from .._past import ReadOnly, open_at
from . import values
from ._content import Memory, Reader, Writer, assets_of, child_names, object_at, stays, write

_SILENCE = 30.0  # seconds without an answer
_NAMESPACE = ("move", "place")
_SLICE = 4  # prims that are compared together, beside those that stages have named
_SWEEP = 0.001  # seconds of each tick for such a comparison
_SEAL = 0.05  # seconds for it where the editor's edits are to be complete
_SMALL = 1_000  # a layer of so many specs is compared at once
_ARGUMENTS = ":SDF_FORMAT_ARGS:"  # behind the path of a file


class NotInPortable(Error, AttributeError):
    """The portable backend does not have this part of the API."""


def _not_here(name: str) -> NotInPortable:
    return NotInPortable("unsupportedValue", f"the portable backend of usdlive has no {name!r} yet. Use the fast one, in a process "
                                             "with the usd-core for which usdlive was built, or the command usdlive")


class _Opening(typing.NamedTuple):
    """A request to open a layer."""

    layer: str
    end: typing.Callable[["events.LayerOpened | events.LayerOpenFailed"], None]


class _LiveLayer:
    """A live layer, and where the editor has perhaps written in it."""

    def __init__(self, name: str, layer: Sdf.Layer):
        self.name, self.layer, self.memory = name, layer, Memory()
        self.filled = self.dirty = self.again = False
        self.size = 0  # specs, when it was filled
        self.named: set[str] = set()  # the files that it uses, relative to the project
        self.hints: set[str] = set()  # paths of prims and variants that stages have seen a change of
        self.sweep: typing.Iterator[list[str]] | None = None  # the comparison of all, in slices
        self._open, self._permitted = False, True  # for edits: by the server, by the editor itself
        layer.SetPermissionToEdit(False)

    def written(self) -> None:
        self.dirty = True

    def permit(self, may_write: bool) -> None:
        """Closes the layer to edits, or opens it if the editor has not closed it itself."""
        if may_write == self._open:
            return
        self._keep_setting()
        self._open = may_write
        self._restore_setting()

    @contextlib.contextmanager
    def writable(self) -> typing.Iterator[None]:
        """Permits writes of the content of the project."""
        self._keep_setting()
        self.layer.SetPermissionToEdit(True)
        try:
            yield
        finally:
            self._restore_setting()

    def _keep_setting(self) -> None:
        # A muted layer never permits edits, so the editor's own setting is unknown.
        if self._open:
            self._permitted = self.layer.IsMuted() or self.layer.permissionToEdit

    def _restore_setting(self) -> None:
        self.layer.SetPermissionToEdit(self._open and self._permitted)

    def end(self) -> None:
        self.layer.SetPermissionToEdit(False)

    def begin_sweep(self) -> None:
        """A write during a sweep begins another one after it."""
        if self.sweep is None:
            self.sweep = self.slices()
        else:
            self.again = True

    def next_slice(self) -> list[str]:
        """The prims and variants to compare next; empty at the end of the sweep."""
        while self.sweep is not None:
            part = next(self.sweep, None)
            if part is not None:
                return part
            self.sweep = self.slices() if self.again else None
            self.again = False
        return []

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
                waiting += [f"{below}{separator}{name}" for name in child_names(spec, "primChildren")]
                for name in () if path == "/" else child_names(spec, "variantSetChildren"):
                    variants = self.layer.GetObjectAtPath(f"{below}{{{name}=}}")
                    waiting += [f"{below}{{{name}={variant}}}" for variant in child_names(variants, "variantChildren")]


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

    @contextlib.contextmanager
    def apply(self, live: _LiveLayer) -> typing.Iterator[None]:
        """While the content of the project is written into a layer, its notices are no edits, and it may be written."""
        self.applying = True
        try:
            with live.writable():
                yield
        finally:
            self.applying = False

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


class PortableLive(Connection):
    """A live project. Use it on the thread that owns the stage, and call `tick()` once per frame.

    It has the part of the API of `usdlive.Live` that docs/embedding.md lists, with the same meaning. The rest raises an Error
    (`unsupportedValue`) that says so. Layers are files without content in the cache folder; no other file of the project
    is found."""

    backend = "portable"

    def __init__(self, client: "_session.Session", url: str):
        super().__init__(client, url)
        self._folder = pathlib.Path(os.path.realpath(client.cache_folder))
        self._make_places(self.layers())
        self._layers: dict[str, _LiveLayer] = {}
        self._notices = _Notices(self._layers)
        self._answers: dict[int, events.Event | None] = {}
        self._failed: dict[str, events.JoinFailed] = {}
        self._happened: collections.deque[events.Event] = collections.deque()  # handlers were not called yet
        self._opening: dict[int, _Opening] = {}  # by the number of the request
        self._openings = 1 << 32  # the number of the last request; those of the session are smaller
        self._ticking = False
        self._gestures = 0  # open ones, each inside the one before
        self._past: list[ReadOnly] = []

    def __getattr__(self, name: str) -> typing.NoReturn:
        raise _not_here(name)

    # -- layers and stages

    def identifier(self, layer: str) -> str:
        """Returns the identifier that a layer of the project has in this process."""
        return str(self._folder / layer)

    def open_layer(self, layer: str, payloads: bool = True) -> Sdf.Layer:
        """Opens a layer of the project live, with all layers of the project that it uses. Blocks until it has arrived. This
        backend also opens layers that only payloads use, whatever `payloads` is."""
        self._may_wait("open_layer")
        ends: list[events.LayerOpened | events.LayerOpenFailed] = []
        request = self._begin_opening(layer, ends.append)
        try:
            self._wait(lambda: bool(ends), f"{layer} did not arrive")
        except Error:
            self._opening.pop(request, None)
            self._forget(layer)
            raise
        return self._opened_by(ends[0])

    def request_open_layer(self, layer: str, payloads: bool = True) -> int:
        """Begins to open a layer and returns at once; ticks do the work, also while there is no connection. The answer is an
        `events.LayerOpened`, after which `opened_layer()` returns the layer, or an `events.LayerOpenFailed`, with the number
        that this returns. `close_layer()` cancels it. `payloads`: see `open_layer()`."""
        self._client.check_caller("request_open_layer")
        return self._begin_opening(layer, self._happened.append)

    def opened_layer(self, layer: str) -> Sdf.Layer | None:
        """The live layer with all its content; None when it is not open, or still opening."""
        self._client.check_caller("opened_layer")
        live = self._layers.get(layer)
        return live.layer if live is not None and live.filled else None

    def layer_name(self, layer: Sdf.Layer) -> str | None:
        """Returns the project's name of a live layer, or None for other layers."""
        self._client.check_caller("layer_name")
        return next((name for name, live in self._layers.items() if live.layer == layer), None)

    def open_stage(self, layer: str, load: Usd.Stage.InitialLoadSet = Usd.Stage.LoadAll, follow_muteness: bool = True, *,
                   at: int | str | None = None) -> Usd.Stage:
        """Opens a `Usd.Stage` on a layer of the project; its layers are live. With `follow_muteness`, layers that are muted
        for everybody (`mute`) are muted on this stage. Keep this object as long as you edit it.

        With `at`, a revision or the name of a checkpoint, opens the stage as it was then. Its layers are files in a temporary
        folder that is removed at the end of the process; they refuse edits and are not live. Blocks until all layers that
        they use are here, also those of payloads. Raises an Error: `futureRevision` and `historyReplaced` (`usdlive compact`)
        say which revisions there are; `invalidArgument` (no such checkpoint); `layerNotFound`; `notConnected`."""
        if at is not None:
            return self._past_stage(layer, at, load, follow_muteness)
        return self._stage(self.open_layer(layer), layer, load, follow_muteness)

    def _stage(self, root: Sdf.Layer, layer: str, load: Usd.Stage.InitialLoadSet, follow_muteness: bool) -> Usd.Stage:
        stage = Usd.Stage.Open(root, load)
        keep_if_forked(stage)
        if follow_muteness:
            self._follow(stage, layer)
        return stage

    def _past_stage(self, layer: str, at: int | str, load: Usd.Stage.InitialLoadSet, follow_muteness: bool) -> Usd.Stage:
        self._may_wait("open_stage")
        revision = self._revision_at(at)
        self._client.check_readable(layer, revision)
        folder = _past_folder()
        waiting, others = [layer], set(self.layers()) - {layer}
        while waiting:
            name = waiting.pop()
            try:
                used = self._write_past(name, revision, folder / name)
            except Error as error:
                if name == layer or error.code == "notConnected":
                    raise
                continue  # OpenUSD says what it cannot find
            new = others.intersection(os.path.relpath(one, folder).replace(os.sep, "/") for one in used)
            waiting += new
            others -= new
        stage = open_at(str(folder / layer), load, follow_muteness)
        self._past = [one for one in self._past if one.stage() is not None] + [ReadOnly(stage)]
        return stage

    def _write_past(self, name: str, revision: int, place: pathlib.Path) -> list[str]:
        """Writes a layer as it was at a revision to a file, and returns the files that it uses."""
        content, assets = _layer_of(self._client.content_at(name, revision), place.suffix)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            content.Export(str(place))
        except (OSError, Tf.ErrorException) as error:
            raise Error("invalidArgument", f"cannot write the file {place}: {error}") from None
        return [os.path.normpath(os.path.join(place.parent, asset.split(_ARGUMENTS)[0])) for asset in assets if asset]

    def create_layer(self, layer: str) -> Sdf.Layer:
        """Creates a new, empty layer of the project for all users, and opens it."""
        self.ask("createLayer", timeout=_SILENCE, layer=layer)
        return self.open_layer(layer)

    def close_layer(self, layer: str) -> None:
        """Ends the live connection of the layer, which keeps its content and refuses edits from then on. Own edits of it are
        sent by later ticks, as those of open layers are."""
        self._may_wait("close_layer")
        if layer not in self._layers:
            raise Error("layerNotOpen", f"{layer} is not open")
        if self._layers[layer].filled:
            self._tick(0.0, math.inf)  # takes all that the editor wrote
        self._forget(layer)

    # -- editing

    def tick(self, budget_ms: float = 4.0) -> bool:
        """Sends one's own edits, applies received edits, and calls the handlers. Returns True if more is left for the next
        tick. The session works for about `budget_ms`. Edits that a stage of this process shows are sent at once; others in
        a big layer when the comparison of the whole layer, which ticks do in slices, has come to them. `flush()` sends all."""
        return self._tick(budget_ms, _SWEEP)

    def _tick(self, budget_ms: float, patience: float, call: typing.Callable[[], None] | None = None) -> bool:
        """`call` is made after the editor's edits were captured, and before received ones are applied."""
        if self._ticking:
            return False  # called by a notice handler
        self._ticking = True
        try:
            self._capture(patience)
            if call is not None:
                call()
            more = self._client.advance(budget_ms)
            self._take_events()
            for live in list(self._layers.values()):
                self._apply(live)
            self._update_muteness()
            self._end_openings()
        finally:
            self._ticking = False
        self._notify()
        return more or any(live.sweep is not None for live in self._layers.values())

    def _take_events(self) -> None:
        new = [events._from_dictionary(one) for one in self._client.take_events()]
        for event in new:
            self._note(event)
            self._happened.append(event)
        # Once, however many events say so: each may concern every layer.
        if any(isinstance(event, (events.Connected, events.RightsChanged, events.LayerStatesChanged)) for event in new):
            for live in self._layers.values():
                if live.filled:
                    live.permit(self._client.may_write(live.name))

    def _notify(self) -> None:
        """Calls the handlers. An exception of one loses no events: the next tick goes on."""
        while self._happened:
            event = self._happened.popleft()
            for handler in (*self._answered, *self._handlers):
                handler(event)
            if not self._handlers and isinstance(event, (events.Lost, events.JoinFailed)):
                warnings.warn(str(event), RuntimeWarning, stacklevel=4)

    def flush(self, timeout: float = 10.0) -> bool:
        """Calls `tick()` until all own edits are committed. Returns False after `timeout` seconds."""
        self._may_wait("flush")
        self._tick(4.0, math.inf)
        return self.wait(lambda: self.pending == 0, timeout)

    def begin_gesture(self) -> None:
        self._may_wait("begin_gesture")
        self._gestures += 1
        if self._gestures == 1:
            self._tick(0.0, _SEAL)  # earlier writes do not belong to it
            self._client.begin_gesture()

    def end_gesture(self) -> None:
        self._may_wait("end_gesture")
        if self._gestures == 1:
            self._tick(0.0, _SEAL)
            self._client.end_gesture()
        self._gestures = max(0, self._gestures - 1)

    def _edit(self, function: str, *arguments: object) -> None:
        self._call(function, *arguments)

    def _identifier_on(self, layer: str, root: str) -> str:
        return self.identifier(layer)

    def without_waiting(self, compose: typing.Callable[[], object]) -> None:
        """Calls a function of yours that lets stages compose something. With this backend, nothing waits for the server then."""
        compose()

    def _seal(self) -> None:
        if not self._ticking:
            self._capture(_SEAL)

    def _call(self, function: str, *arguments: object) -> typing.Any:
        self._may_wait(function)
        results: list[object] = []
        refused: list[Error] = []

        def call() -> None:
            try:
                results.append(getattr(self._client, function)(*arguments))
            except Error as error:
                refused.append(error)

        self._tick(0.0, _SEAL, call)
        if refused:
            raise refused[0]
        return results[0]

    def wait(self, condition: typing.Callable[[], bool], timeout: float = 10.0) -> bool:
        """Calls `tick()` until `condition()` is true. Returns False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            if not self.tick():
                self._client.wait(2.0)
        return True

    def save(self, *layers: str, force: bool = False, timeout: float = 60.0) -> events.Saved:
        """Commits all own edits, writes these layers (default: all changed layers) to their files, and returns the result.
        A file that somebody else has changed is not overwritten unless `force`."""
        self._may_wait("save")
        end = time.monotonic() + timeout
        if not self.flush(timeout):
            raise Error("notConnected", f"nothing was saved: {self._unconfirmed(timeout)}")
        return self._answer(self.request_save(*layers, force=force), end - time.monotonic())

    def request_save(self, *layers: str, force: bool = False) -> int:
        self._tick(0.0, _SEAL)  # earlier writes are saved, too
        return super().request_save(*layers, force=force)

    # -- unsent and lost work

    def _unsent_as_layer(self, work: str, layer: str) -> Sdf.Layer:
        return _layer_of(self._client.unsent_as_layer(work, layer, _name_of_type))[0]

    def lost_work_as_layer(self, index: int, layer: str) -> Sdf.Layer:
        """Returns refused or dropped work as an anonymous layer (M12): number `index` (see `events.Lost`) on `layer`. A
        value that cannot be shared is kept as text in the custom data of its spec (`lost:FIELD`; of the root in
        `customLayerData`). All lost work can be read until the connection is closed."""
        return _layer_of(self._client.lost_work_as_layer(index, layer, _name_of_type))[0]

    def close(self, timeout: float = 5.0) -> events.Unsent | None:
        """Leaves the project when all own edits are committed, or after `timeout` seconds. Returns None, or the
        unsent work and where it is kept, with a RuntimeWarning; `unsent_work()` of a later connection can send
        it, with any backend. Layers keep their content and refuse edits."""
        if self.closed:
            return None
        self._may_wait("close")
        self._gestures = min(self._gestures, 1)
        self.end_gesture()
        self.flush(timeout)
        unsent = self._client.leave()
        self._take_events()
        for layer in list(self._layers):
            self._forget(layer)
        self._notices.end()
        self._client.close()
        self._end_openings()
        self._notify()
        return self._left(unsent)

    def __del__(self) -> None:
        super().__del__()
        if self.__dict__.get("_process") != os.getpid() or "_gestures" not in self.__dict__ or self.closed:
            return
        with contextlib.suppress(Error):  # it belongs to another thread
            self._capture(math.inf)  # the journal keeps it
        for live in self._layers.values():
            live.end()

    # -- opening

    def _begin_opening(self, layer: str, end: typing.Callable[["events.LayerOpened | events.LayerOpenFailed"], None]) -> int:
        """`end` is called by a tick."""
        self._openings += 1
        self._opening[self._openings] = _Opening(layer, end)
        try:
            self._open(layer)
        except Error as error:
            self._failed[layer] = events.JoinFailed(layer, error.code, error.message)
        return self._openings

    def _end_openings(self) -> None:
        over: set[str] = set()
        for request, (layer, end) in list(self._opening.items()):
            failed = self._failed.get(layer)
            if failed is not None:
                over.add(layer)
                end(events.LayerOpenFailed(request, layer, failed.code, failed.message))
            elif layer not in self._layers:
                end(events.LayerOpenFailed(request, layer, "layerNotOpen", f"{layer} was closed while it was being opened"))
            elif self._is_whole(layer, set()):
                end(events.LayerOpened(request, layer))
            else:
                continue
            del self._opening[request]
        for layer in over:
            del self._failed[layer]
            self._forget(layer)

    def _open(self, name: str) -> None:
        if name in self._layers:
            return
        if name not in self.layers():
            raise Error("layerNotFound", f"the project has no layer {name}")
        self._failed.pop(name, None)
        self._make_places([name])
        self._layers[name] = _LiveLayer(name, self._placeholder(name))
        self._client.open(name)

    def _placeholder(self, name: str) -> Sdf.Layer:
        """The layer of this process, at the place that other layers name by a relative path."""
        try:
            layer = Sdf.Layer.FindOrOpen(self.identifier(name))
        except Tf.ErrorException:
            layer = None
        if layer is None:
            raise Error("invalidArgument", f"this OpenUSD cannot open {self.identifier(name)}: it does not know the format, or the "
                                           "cache folder cannot be read")
        return layer

    def _make_places(self, names: typing.Iterable[str]) -> None:
        """Makes files without content for layers of the project, so that OpenUSD finds those that the editor names."""
        for name in names:
            place = self._folder / name
            content = _empty_file(place.suffix)
            if content is None or place.exists():
                continue
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
            except OSError as error:
                raise Error("invalidArgument", f"cannot make the file {place}: {error.strerror}. Name a cache folder that can be "
                                               "written") from None

    def _name(self, live: _LiveLayer, assets: typing.Iterable[str]) -> None:
        """Notes the files that a layer uses, and opens the layers of the project among them."""
        names = set()
        for asset in assets:
            place = os.path.normpath(os.path.join(os.path.dirname(live.layer.realPath), asset.split(_ARGUMENTS)[0]))
            if asset:
                names.add(os.path.relpath(place, self._folder).replace(os.sep, "/"))
        live.named |= names
        if names:
            self._open_used(names)

    def _open_used(self, names: typing.Iterable[str]) -> None:
        for name in set(self.layers()).intersection(names) - self._failed.keys():
            try:
                self._open(name)
            except Error as error:
                self._failed[name] = events.JoinFailed(name, error.code, error.message)
                self._happened.append(self._failed[name])

    def _is_whole(self, name: str, seen: set[str]) -> bool:
        seen.add(name)
        live = self._layers.get(name)
        if live is None or not live.filled:
            return name in self._failed
        return all(other in seen or other not in self._layers or self._is_whole(other, seen) for other in live.named)

    def _forget(self, name: str) -> None:
        live = self._layers.pop(name, None)
        if live is not None:
            self._client.close_layer(name)
            live.end()

    # -- waiting

    def _may_wait(self, function: str) -> None:
        self._client.check_caller(function)
        if self._ticking:
            raise Error("invalidArgument", f"{function}() waits for the server and was called by a notice handler while tick() "
                                           "applies edits. Call it after tick() has returned")

    def _wait(self, condition: typing.Callable[[], bool], what: str, timeout: float = _SILENCE) -> None:
        if not self.wait(condition, timeout):
            raise Error("notConnected", f"{what}: the server at {self._url} did not answer within {timeout:g} seconds")

    def _answer(self, request: int, timeout: float) -> typing.Any:
        self._answers[request] = None
        try:
            self._wait(lambda: self._answers[request] is not None, "there is no answer", timeout)
            answer = self._answers[request]
        finally:
            del self._answers[request]
        if isinstance(answer, events.ServerError):
            raise Error(answer.code, answer.message)
        return answer

    def _note(self, event: events.Event) -> None:
        request = getattr(event, "request", None)
        if request in self._answers and not isinstance(event, events.Progress):
            self._answers[request] = event
        if isinstance(event, events.JoinFailed):
            self._failed[event.layer] = event
        if isinstance(event, events.Connected):
            self._make_places(self.layers())
        if isinstance(event, events.LayersChanged):
            self._make_places(event.added)
            for live in list(self._layers.values()):
                self._open_used(live.named.intersection(event.added))

    # -- what the editor wrote

    def _capture(self, patience: float) -> None:
        """Compares what stages have named, then the rest of the layers that were written, for `patience` seconds. What is
        left is compared by later ticks."""
        for live in list(self._layers.values()):
            if live.filled and (live.dirty or live.sweep is not None):
                self._capture_layer(live, patience)
        self._client.submit()

    def _capture_layer(self, live: _LiveLayer, patience: float) -> None:
        refused: dict[tuple[str, str], str] = {}
        reader = Reader(live.layer, live.memory, lambda path: self._client.has(live.name, path),
                        lambda path, field, why: refused.update({(path, field): why}))
        whole = patience == math.inf
        if whole or live.dirty and live.size <= _SMALL and not live.hints:
            seen = reader.all(exact=not whole)
            live.size = len(seen)
            live.end_sweep()
        else:
            seen = reader.at(live.hints, exact=True)
            if live.dirty:
                live.begin_sweep()
            end = time.perf_counter() + patience
            while part := live.next_slice():
                seen = reader.at(part, exact=False)
                if time.perf_counter() > end:
                    break
        self._name(live, reader.assets)
        live.dirty = False
        live.hints.clear()

        def keeps(path: str, field: str, data: bytes) -> bool:
            return (path, field) in refused or stays(live.layer, path, field, data)

        answers = [("unsupportedValue", path, field, why) for (path, field), why in refused.items()]
        for path, field, code, message in self._client.capture(live.name, seen, keeps):
            answers.append((code, path, field, message))
        for code, path, field, why in answers:
            spec = object_at(live.layer, path)
            text = str(spec.GetInfo(field)) if spec is not None and field and spec.HasInfo(field) else ""
            self._client.lose(live.name, path, field, code, f"{live.name} <{path}>{' ' if field else ''}{field}: {why}", text)
        if refused:
            self._revert(live, refused)

    def _revert(self, live: _LiveLayer, refused: typing.Iterable[tuple[str, str]]) -> None:
        with self._notices.apply(live):
            for path, field in refused:
                spec = object_at(live.layer, path)
                if spec is not None:
                    write(spec, path, field, self._client.held(live.name, path, field), live.memory)

    # -- what others wrote

    def _apply(self, live: _LiveLayer) -> None:
        changes = self._client.take_changes(live.name)
        if not changes:
            return
        if changes[0][0] == "replaced":
            return self._fill(live)
        # Before OpenUSD looks for them.
        self._name(live, set().union(*(assets_of({change[2]: change[3]}) for change in changes
                                       if change[0] == "field" and change[3] is not None)))
        with self._notices.apply(live):
            _write_changes(live, changes)

    def _fill(self, live: _LiveLayer) -> None:
        live.memory.clear()
        content = self._client.content(live.name)
        scratch, assets = _layer_of(content, os.path.splitext(live.name)[1], live.memory)
        live.size = len(content)
        self._name(live, assets)
        with self._notices.apply(live):
            live.layer.TransferContent(scratch)
        live.filled, live.dirty = True, False
        live.end_sweep()
        live.hints.clear()
        live.permit(self._client.may_write(live.name))


def _past_folder() -> pathlib.Path:
    """A folder for a stage of the past, which may load payloads as long as the process runs."""
    folder = os.path.realpath(tempfile.mkdtemp(prefix="usdlive-past-"))
    process = os.getpid()
    atexit.register(lambda: os.getpid() == process and shutil.rmtree(folder, ignore_errors=True))
    return pathlib.Path(folder)


@functools.cache
def _empty_file(extension: str) -> bytes | None:
    """The bytes of a layer's file without content; None if this OpenUSD cannot write such files."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder, "empty").with_suffix(extension)
        try:
            Sdf.Layer.CreateAnonymous(extension).Export(str(path))
        except Tf.ErrorException:
            return None
        return path.read_bytes() if path.exists() else None


def _layer_of(content: list[tuple[str, int, dict[str, bytes]]], extension: str = ".usda",
              memory: Memory | None = None) -> tuple[Sdf.Layer, set[str]]:
    """Returns an anonymous layer with this content, and the asset paths of the layers that it uses."""
    layer = Sdf.Layer.CreateAnonymous(extension)
    with Sdf.ChangeBlock():
        assets = Writer(layer, Memory() if memory is None else memory).fill(content)
    return layer, assets


def _name_of_type(data: bytes) -> str:
    """The name of the type that an attribute with this encoded value can have, or "" where this OpenUSD has none."""
    try:
        return str(Sdf.GetValueTypeNameForValue(values.decode(data)))
    except (values.Unsupported, Tf.ErrorException):
        return ""


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
