"""Kit's UsdContext: one stage, its file operations and its events."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import logging
import threading
import typing
import weakref

from pxr import Sdf, Tf, Usd, UsdUtils

import usdlive
from usdlive.omni._events import EventStream
from usdlive.omni._layer_content import restore_edit_target, set_edit_target
from usdlive.omni._registers import Recorder, hold
from usdlive.omni.kit.app import ORDER_EVENTS, ORDER_LAYERS, ORDER_LIVE, get_app

from . import _saving
from ._enums import StageEventType, StageState, UsdContextInitialLoadSet
from ._errors import OUTSIDE, Failure, reason
from ._files import WRITABLE_EXTENSIONS, extension, is_read_only
from ._live_stage import LiveStage, join, make_live
from ._loading import Loading, open_root
from ._projects import is_live_address, live_address, local_path
from ._selection import Selection
from ._stage_events import StageEvents
from ._steps import Steps, run, run_async

_log = logging.getLogger("usdlive.omni.usd")

LOAD_ALL, LOAD_NONE = UsdContextInitialLoadSet.LOAD_ALL, UsdContextInitialLoadSet.LOAD_NONE
_DIAGNOSTICS_KEPT = 100  # more are only counted
_ASSET_ERRORS = ("ErrorInvalidAssetPath", "ErrorInvalidSublayerPath", "ErrorSublayerCycle")

Result = tuple[bool, str]
SaveResult = tuple[bool, str, list[str]]
OnFinish = typing.Callable[[bool, str], typing.Any]
OnSaveFinish = typing.Callable[[bool, str, list[str]], typing.Any]


@dataclasses.dataclass
class ContextSettings:
    """The settings of a context. `fail_stage_open_on_asset_errors` is Kit's `failStageOpenOnAssetErrors`: a
    stage does not open if one of its sublayers, references or payloads cannot be read. `user`: the name shown
    to others in a live project; the default is the system's user name. `connect_timeout`: the seconds that a
    server has to answer. `auto_reload_sublayers` and `auto_reload_non_sublayers`: reload outdated layers of the
    local stack, and other used layers, automatically; can be changed while a stage is open."""

    fail_stage_open_on_asset_errors: bool = False
    user: str = ""
    connect_timeout: float = 10.0
    auto_reload_sublayers: bool = False
    auto_reload_non_sublayers: bool = False


@dataclasses.dataclass
class _Opened:
    """An open stage and the objects that belong to it."""

    stage: Usd.Stage
    url: str
    load_set: UsdContextInitialLoadSet
    is_new: bool = False
    live: LiveStage | None = None
    owned: bool = True  # the context has opened it, so it is in the stage cache while it is open
    notice: Tf.Notice.Listener | None = None
    thread: int = dataclasses.field(default_factory=threading.get_ident)


_contexts: weakref.WeakSet[UsdContext] = weakref.WeakSet()  # all existing contexts
# Layers whose unsaved edits were discarded with a closed stage, by their identifiers. If a reference keeps such a layer
# alive, the next open reads its file again. A later layer of that file is another one.
_discarded: dict[str, weakref.ref[Sdf.Layer]] = {}


class UsdContext:
    """One stage with its operations and events. Use it on the stage's thread. Every operation has three forms:
    `x()` blocks, `x_async()` lets the event loop run, and `x_with_callback()` starts it and calls the callback
    at the end. None of them raises for an error of a file, a disk or a server: they return the reason. While
    one operation runs, others are refused."""

    def __init__(self, name: str = "", **settings: typing.Any):
        self.settings = ContextSettings(**settings)
        self._name = name
        self._opened: _Opened | None = None
        self._state = StageState.CLOSED
        self._last_url = ""
        self._operation = ""  # the running operation
        self._loading: Loading | None = None
        # The value of set_pending_edit(), which overrides the real state.
        self._pending_edit: bool | None = None
        self._was_dirty = self._edited_since_tick = False
        self._save_cancelled: bool | None = None  # None: there is no save to cancel
        self._diagnostics: list[str] = []
        self._events = StageEvents(name)
        self._selection = Selection(self.get_stage, self._mark_selection)
        self._selection_changed = self._hierarchy_changed = False
        self._tasks: set[asyncio.Task] = set()
        self._before_saving: list[typing.Callable[[Recorder | None], None]] = []
        self._layers_thread: int | None = None  # is set when the layers API is used
        self._recorder: Recorder | None = None  # is set while a command runs
        _contexts.add(self)
        updates = get_app().get_update_event_stream()
        self._frames = [
            updates.create_subscription_to_pop(lambda _: self._tick_live(), ORDER_LIVE, "omni.usd live"),
            updates.create_subscription_to_pop(lambda _: self._look(), ORDER_LAYERS, "omni.usd state"),
            updates.create_subscription_to_pop(lambda _: self._events.pump(), ORDER_EVENTS, "omni.usd"),
        ]

    # -- opening

    def new_stage(self, load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        """Opens an empty stage in memory. Save it with save_as_stage()."""
        return self._run("making a new stage", self._new(load_set))

    async def new_stage_async(self, load_set: UsdContextInitialLoadSet = LOAD_ALL) -> Result:
        return await self._run_async("making a new stage", self._new(load_set))

    def new_stage_with_callback(self, on_finish_fn: OnFinish | None = None,
                                load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        return self._start("making a new stage", self._new(load_set), on_finish_fn)

    def open_stage(self, url: str, load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        """Opens a file or the address of a live layer: `usdlive://host:port/path`, `dds://project/path`."""
        return self._run("opening a stage", self._open(url, load_set))

    async def open_stage_async(self, url: str, load_set: UsdContextInitialLoadSet = LOAD_ALL,
                               session_layer_url: str | None = None) -> Result:
        return await self._run_async("opening a stage", self._open(url, load_set, session_layer_url))

    def open_stage_with_callback(self, url: str, on_finish_fn: OnFinish | None = None,
                                 load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        return self._start("opening a stage", self._open(url, load_set), on_finish_fn)

    def open_stage_with_session_layer(self, url: str, session_layer_url: str,
                                      on_finish_fn: OnFinish | None = None,
                                      load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        """Opens a stage with that file as its session layer. Fails if the file cannot be opened."""
        return self._start("opening a stage", self._open(url, load_set, session_layer_url), on_finish_fn)

    def reopen_stage(self, load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        """Opens the same file again from the disk, with the same edit target. After close_stage(), opens the last open
        file."""
        return self._run("opening the stage again", self._reopen(load_set))

    async def reopen_stage_async(self, load_set: UsdContextInitialLoadSet = LOAD_ALL) -> Result:
        return await self._run_async("opening the stage again", self._reopen(load_set))

    def reopen_stage_with_callback(self, on_finish_fn: OnFinish | None = None,
                                   load_set: UsdContextInitialLoadSet = LOAD_ALL) -> bool:
        return self._start("opening the stage again", self._reopen(load_set), on_finish_fn)

    def attach_stage(self, stage: Usd.Stage | int, live: usdlive.Live | None = None) -> bool:
        """Uses a stage that is open already, given as such or by its id in UsdUtils.StageCache. close_stage()
        leaves it to its owner. `live`: the connection of its layers. The context ticks it from now on but does
        not close it with the stage."""
        return self._run("attaching a stage", self._attach(stage, live))

    async def attach_stage_async(self, stage: Usd.Stage | int, live: usdlive.Live | None = None) -> Result:
        return await self._run_async("attaching a stage", self._attach(stage, live))

    def attach_stage_with_callback(self, stage_id: Usd.Stage | int,
                                   on_finish_fn: OnFinish | None = None) -> bool:
        return self._start("attaching a stage", self._attach(stage_id, None), on_finish_fn)

    def close_stage(self) -> bool:
        """Leaves a live project when all own edits are confirmed. Returns False and keeps the stage open if the
        server does not confirm them. After set_pending_edit(False) they are discarded."""
        return self._run("closing the stage", self._close())

    async def close_stage_async(self) -> Result:
        return await self._run_async("closing the stage", self._close())

    def close_stage_with_callback(self, on_finish_fn: OnFinish | None = None) -> bool:
        return self._start("closing the stage", self._close(), on_finish_fn)

    # -- saving

    def save_stage(self) -> bool:
        """Saves the changed layers of the local layer stack: live layers on their server, others here. Skips
        locked layers, except live ones that one has locked oneself. A warning names the live layers that were skipped;
        the asynchronous forms return it as their text."""
        return self._run("saving", self._save(None))

    async def save_stage_async(self) -> SaveResult:
        return await self._run_async("saving", self._save(None), saving=True)

    def save_stage_with_callback(self, on_finish_fn: OnSaveFinish | None = None) -> bool:
        return self._start("saving", self._save(None), on_finish_fn, saving=True)

    def save_as_stage(self, url: str) -> bool:
        """Writes the root layer to another file and adjusts its relative asset paths. Saves the other changed
        layers to their own files. The context then uses the new root layer."""
        return self._run("saving", self._save_as(url))

    async def save_as_stage_async(self, url: str) -> SaveResult:
        return await self._run_async("saving", self._save_as(url), saving=True)

    def save_as_stage_with_callback(self, url: str, on_finish_fn: OnSaveFinish | None = None) -> bool:
        return self._start("saving", self._save_as(url), on_finish_fn, saving=True)

    def save_layers(self, new_root_layer_path: str, layer_identifiers: typing.Sequence[str]) -> bool:
        """Saves these layers of the local stack. With a path, also writes the root layer to it, like
        save_as_stage()."""
        return self._run("saving", self._save_layers(new_root_layer_path, layer_identifiers))

    async def save_layers_async(self, new_root_layer_path: str,
                                layer_identifiers: typing.Sequence[str]) -> SaveResult:
        return await self._run_async("saving", self._save_layers(new_root_layer_path, layer_identifiers),
                                     saving=True)

    def save_layers_with_callback(self, new_root_layer_path: str, layer_identifiers: typing.Sequence[str],
                                  on_finish_fn: OnSaveFinish | None = None) -> bool:
        return self._start("saving", self._save_layers(new_root_layer_path, layer_identifiers), on_finish_fn,
                           saving=True)

    def export_as_stage(self, url: str) -> bool:
        """Writes the composed stage, including the session layer, as one layer. The stage stays unchanged."""
        return self._run("exporting", self._export(url))

    async def export_as_stage_async(self, url: str) -> Result:
        return await self._run_async("exporting", self._export(url))

    def export_as_stage_with_callback(self, url: str, on_finish_fn: OnFinish | None = None) -> bool:
        return self._start("exporting", self._export(url), on_finish_fn)

    async def create_checkpoint_async(self, comment: str = "", force: bool = False) -> Result:
        """Gives the present revision of the stage's project a name (see `usdlive checkpoints`). A revision that
        has a name gets a second one only with `force`."""
        if not (self._opened and self._opened.live):
            return False, "only a live project has checkpoints"
        self._distribute()
        error = await run_async(self._opened.live.checkpoint(comment, force))
        return not error, error

    def try_cancel_save(self) -> bool:
        """Cancels a save from a subscriber to SAVING or SETTINGS_SAVING. The save then fails and writes
        nothing."""
        if self._save_cancelled is None:
            return False
        self._save_cancelled = True
        return True

    def call_before_saving(self, function: typing.Callable[[Recorder | None], None]) -> None:
        """Not in Kit: calls `function(recorder)` before edits are saved, sent or left, and before and after each
        command, so that edits waiting for the next frame are included. It records the layers that they go to."""
        self._before_saving.append(function)
        self._layers_thread = threading.get_ident()

    @contextlib.contextmanager
    def recording(self, recorder: Recorder | None) -> typing.Iterator[None]:
        """Not in Kit: the edits that wait for the next frame go to their layers at the beginning and at the end;
        those that are made meanwhile are recorded there."""
        self._distribute()
        outer, self._recorder = self._recorder, recorder
        try:
            yield
        finally:
            self._distribute()
            self._recorder = outer

    @property
    def recorder(self) -> Recorder | None:
        """Not in Kit: the recorder of the command that runs."""
        return self._recorder

    # -- queries

    def can_open_stage(self) -> bool:
        return not self._operation and self._state in (StageState.CLOSED, StageState.OPENED)

    def can_close_stage(self) -> bool:
        return not self._operation and self._state == StageState.OPENED

    def can_save_stage(self) -> bool:
        return self.can_close_stage() and self.is_writable() and not self.is_new_stage()

    def is_new_stage(self) -> bool:
        return self._opened is not None and self._opened.is_new

    def is_writable(self) -> bool:
        """Returns True if the root layer's file can be written."""
        if self._opened is None:
            return False
        root = self._opened.stage.GetRootLayer()
        if root.anonymous or self.is_live_layer(root):
            return root.permissionToEdit
        if extension(root.realPath) not in WRITABLE_EXTENSIONS or not root.permissionToSave:
            return False
        try:
            return not is_read_only(root.realPath)
        except OSError:
            return True  # the file is missing and can be written again

    def is_omni_stage(self) -> bool:
        """Returns True if the stage is live."""
        return self.live is not None

    def is_live_layer(self, layer: Sdf.Layer) -> bool:
        live = self._opened and self._opened.live
        return bool(live and live.name_of(layer))

    def is_live_layer_unsaved(self, layer: Sdf.Layer) -> bool:
        """Returns True if the server has, or will get, edits that are not in the layer's file."""
        return self.is_live_layer(layer) and self._opened.live.is_dirty([layer])

    @property
    def live(self) -> usdlive.Live | None:
        """The stage's connection to its project."""
        return self._opened.live.live if self._opened and self._opened.live else None

    def has_pending_edit(self) -> bool:
        if self._opened is None:
            return False
        return self._is_dirty() if self._pending_edit is None else self._pending_edit

    def set_pending_edit(self, edit: bool) -> None:
        """Overrides the state until the stage is saved; False is overridden by the next edit."""
        self._pending_edit = bool(edit)

    def get_stage(self) -> Usd.Stage | None:
        return self._opened.stage if self._opened else None

    def get_stage_id(self) -> int:
        """Returns the id in UsdUtils.StageCache, or -1 without a stage. An attached stage is inserted when its
        id is requested for the first time, and stays there, because removing it would close it."""
        return UsdUtils.StageCache.Get().Insert(self._opened.stage).ToLongInt() if self._opened else -1

    def get_stage_url(self) -> str:
        return self._opened.url if self._opened else ""

    def get_stage_state(self) -> StageState:
        return self._state

    def get_stage_loading_status(self) -> tuple[str, int, int]:
        """Returns (message, loaded layers, all layers) while a stage opens; ("", 0, 0) otherwise."""
        loading = self._loading
        return (loading.message, loading.loaded, loading.total) if loading else ("", 0, 0)

    def get_stage_streaming_status(self) -> bool:
        return False  # nothing is streamed to a renderer

    def get_asset_open_diagnostics(self) -> list[str]:
        """Returns the errors for assets of the stage that could not be opened; the first 100."""
        return self._diagnostics[:_DIAGNOSTICS_KEPT]

    def get_num_asset_open_diagnostics(self) -> int:
        return len(self._diagnostics)

    def get_name(self) -> str:
        return self._name

    def get_selection(self) -> Selection:
        return self._selection

    # -- events

    def get_stage_event_stream(self) -> EventStream:
        return self._events.stream

    def stage_event_name(self, event_type: StageEventType) -> str:
        """Returns Kit's name of the event: `omni.usd:<context>:stage:<event>`."""
        return f"omni.usd:{self._name}:stage:{StageEventType(event_type).name.lower()}"

    async def next_stage_event_async(self) -> tuple[int, dict]:
        """Waits for the next (event type, payload). A task that calls this again at once misses no event, even
        if there are several in a frame."""
        return await self._events.next()

    async def selection_changed_async(self) -> None:
        await self._events.next_of(StageEventType.SELECTION_CHANGED)

    # -- operations, as steps that use the stage and yield slow work

    def _new(self, load_set: UsdContextInitialLoadSet) -> Steps[Result]:
        self._check_thread()
        if self._opened:
            yield from self._close()
        self._begin_opening()
        stage = Usd.Stage.CreateInMemory(_load(load_set))
        return self._adopt(_Opened(stage, stage.GetRootLayer().identifier, load_set, is_new=True))

    def _open(self, url: str, load_set: UsdContextInitialLoadSet,
              session_layer_url: str | None = None) -> Steps[Result]:
        """Opens a stage. The present one is closed after the new one's layers have been read, and stays open if
        that fails."""
        self._check_thread()
        url = local_path(url)
        session_layer_url = local_path(session_layer_url) if session_layer_url else None
        self._loading = loading = Loading(url, load_set)
        replaced = self._opened is not None
        begun, live = False, None
        try:
            if not replaced:
                begun = self._begin_opening()
            address = live_address(url)
            if is_live_address(url) and address is None:
                raise Failure(f"{url} names no layer; expected usdlive://HOST:PORT/LAYER")
            if address:
                live = yield from join(address, self.settings.user, self.settings.connect_timeout)
            if not address or address.folder:
                root = yield loading.read
            else:
                root = yield from live.open_layer(address.layer, _load(load_set) == Usd.Stage.LoadAll,
                                                  self.settings.connect_timeout)
            session = yield (lambda: open_root(session_layer_url)) if session_layer_url else (lambda: None)
            text = ""
            self._check_not_shared(loading.layers.values())
            if replaced:
                _, text = yield from self._close()
                begun = self._begin_opening()
            _read_anew(loading.layers.values())
            stage = Usd.Stage.Open(root, session, _load(load_set)) if session else Usd.Stage.Open(
                root, _load(load_set))
            if address:
                make_live(live, address, stage)
            self._diagnose(stage)
            restore_edit_target(stage)
            name = url if is_live_address(url) else root.realPath or root.identifier
            done, _ = self._adopt(_Opened(stage, name, load_set, live=live))
            return done, text
        except BaseException as error:
            if live and not (self._opened and self._opened.live is live):
                live.live.close()
            if not begun:
                self._begin_opening()
            self._open_failed(error)
            raise
        finally:
            self._loading = None

    def _reopen(self, load_set: UsdContextInitialLoadSet) -> Steps[Result]:
        if self._opened and self._opened.is_new or not self._last_url:
            raise Failure("there is no file to open again; the stage was never saved")
        self._check_thread()
        url, target = self._last_url, ""
        if self._opened:
            target = self._name_of(self._opened.stage.GetEditTarget().GetLayer())
            self._check_not_shared(self._opened.stage.GetUsedLayers())
            used = [layer.identifier for layer in self._opened.stage.GetUsedLayers()]
            yield from self._close()
            # Other references may keep some of them, and Sdf would return them unchanged.
            held = [layer for identifier in used if (layer := Sdf.Layer.Find(identifier))]
            if not is_live_address(url):
                Sdf.Layer.ReloadLayers([layer for layer in held if not layer.anonymous], True)
        result = yield from self._open(url, load_set)
        stage = self._need_stage()
        for layer in stage.GetLayerStack(False):
            if target and self._name_of(layer) == target:
                set_edit_target(stage, layer.identifier)
        return result

    def _name_of(self, layer: Sdf.Layer | None) -> str:
        """Returns a name that the layer has again when its stage is opened again."""
        if not layer:
            return ""
        live = self._opened.live
        return live and live.name_of(layer) or layer.identifier

    def _attach(self, stage: Usd.Stage | int, live: usdlive.Live | None) -> Steps[Result]:
        self._check_thread()
        if not isinstance(stage, Usd.Stage):
            found = UsdUtils.StageCache.Get().Find(Usd.StageCache.Id.FromLongInt(int(stage)))
            if not found:
                raise Failure(f"there is no stage {stage} in the stage cache")
            stage = found
        if not stage:
            raise Failure("the stage has expired")
        if self._opened and self._opened.stage == stage:
            if live is None or live is self.live:
                return True, ""
            self._opened.owned = False
        if self._opened:
            yield from self._close()
        self._begin_opening()
        root = stage.GetRootLayer()
        self._diagnostics = []
        return self._adopt(_Opened(stage, root.realPath or root.identifier, LOAD_ALL, is_new=root.anonymous,
                                   live=LiveStage(live, owned=False) if live else None, owned=False))

    def _close(self) -> Steps[Result]:
        opened = self._opened
        if opened is None:
            raise Failure("no stage is open")
        self._check_thread()
        self._set_state(StageState.CLOSING, StageEventType.CLOSING)
        text, unsaved = "", []
        try:
            self._distribute()
            if opened.owned:  # otherwise the owner keeps using them
                unsaved = [layer for layer in opened.stage.GetUsedLayers() if layer.dirty
                           and not layer.anonymous and not self.is_live_layer(layer)]
            if opened.live:
                text = yield from opened.live.leave(discard=self._pending_edit is False)
        except usdlive.Error as error:  # the connection is closed
            text = reason(error)
        except BaseException:  # refused or cancelled
            self._state = StageState.OPENED
            raise
        self._selection.clear_selected_prim_paths()
        opened.notice.Revoke()
        _discarded.update((layer.identifier, weakref.ref(layer)) for layer in unsaved)
        self._opened = None
        self._pending_edit, self._was_dirty = None, False
        self._hierarchy_changed = False
        self._diagnostics = []
        self._set_state(StageState.CLOSED, StageEventType.CLOSED)
        # Last, because subscribers to CLOSED may still use the stage.
        if opened.owned and not any(other.get_stage() == opened.stage for other in _contexts):
            UsdUtils.StageCache.Get().Erase(opened.stage)
        return True, text

    def _save(self, layers: list[Sdf.Layer] | None, locks_of: list[Sdf.Layer] | None = None) -> Steps[SaveResult]:
        """Saves layers. `layers`: None for all changed ones. `locks_of`: the layers whose own locks are saved;
        None for all."""
        stage = self._need_stage()
        if self.is_new_stage() and layers is None:
            raise Failure("the stage has no file yet; use save_as_stage")
        live = self._opened.live
        self._send_saving()
        self._distribute()
        with self._sending_a_cancel():
            if layers is None:
                _saving.store_edit_target(stage, live)
            chosen = _saving.unsaved(stage, live) if layers is None else layers
            saved, problems, skipped = yield from _saving.save(chosen, live, unsaved_only=layers is None)
            problems += yield from _saving.save_locks(stage, live, locks_of)
        return self._send_saved(saved, problems, skipped)

    def _save_as(self, url: str, others: list[Sdf.Layer] | None = None) -> Steps[SaveResult]:
        stage, url = self._need_stage(), local_path(url)
        root = stage.GetRootLayer()
        if self.is_omni_stage():
            raise Failure("a live stage cannot move to another file; use export_as_stage to write a copy")
        _saving.check_new_root(url, stage)
        self._distribute()
        if not root.anonymous and Sdf.Layer.Find(url) == root:
            chosen = _saving.unsaved(stage, None) if others is None else others
            return (yield from self._save([root, *(layer for layer in chosen if layer != root)], others))
        self._send_saving()
        self._distribute()
        named = others
        others = [layer for layer in (_saving.unsaved(stage, None) if others is None else others)
                  if layer != root]
        with self._sending_a_cancel():
            if named is None:
                _saving.store_edit_target(stage, None)
            saved, problems, _ = yield from _saving.save(others, None)
            problems += yield from _saving.save_locks(stage, None, named)
            if problems:
                return self._send_saved(saved, problems)
            try:
                new_root = yield from _saving.write_root(root, url)
            except OUTSIDE as error:
                return self._send_saved(saved, [reason(error)])
        result = self._send_saved([*saved, new_root], [])
        yield from self._replace_root(new_root)
        return result

    def _save_layers(self, new_root: str, identifiers: typing.Sequence[str]) -> Steps[SaveResult]:
        stage = self._need_stage()
        layers = _saving.find_local(stage, self._opened.live, identifiers)
        if new_root:
            return (yield from self._save_as(new_root, layers))
        return (yield from self._save(layers, []))

    def _export(self, url: str) -> Steps[Result]:
        stage, url = self._need_stage(), local_path(url)
        _saving.check_new_root(url, stage, anything_used=True)
        self._distribute()
        yield from _saving.export(stage, url)
        return True, ""

    # -- helpers of the operations

    def _distribute(self) -> None:
        for function in self._before_saving:
            function(self._recorder)

    def _check_not_shared(self, layers: typing.Iterable[Sdf.Layer]) -> None:
        """Refuses to discard edits that are the unsaved work of another context."""
        # By name: two Python objects of one layer are equal, but have different hashes.
        own = {layer.identifier for layer in self._opened.stage.GetUsedLayers()} if self._opened else set()
        for layer in layers:
            if not layer.dirty or layer.anonymous or layer.identifier not in own and not _is_discarded(layer):
                continue
            for other in _contexts:
                if other.is_live_layer(layer):
                    break  # the server has its edits
                if other is not self and (stage := other.get_stage()) and layer in stage.GetUsedLayers():
                    raise Failure(f"{layer.identifier} has unsaved edits and is also open in the context "
                                  f"'{other.get_name()}'. Save it, or close it there, first")

    def _check_thread(self) -> None:
        """Refuses to open or leave a stage on another thread than the one that uses its connection or its layers."""
        if self._opened and self._opened.live and self._opened.thread != threading.get_ident():
            raise Failure(f"{self._opened.url} is live and used by the thread that opened it: close it there first, "
                          "for example with loop.call_soon_threadsafe()")
        if self._layers_thread not in (None, threading.get_ident()):
            raise Failure(f"the layers of the context '{self._name}' are used by another thread: open and close its "
                          "stages there, for example with loop.call_soon_threadsafe()")

    def _need_stage(self) -> Usd.Stage:
        if self._opened is None:
            raise Failure("no stage is open")
        return self._opened.stage

    def _begin_opening(self) -> bool:
        self._set_state(StageState.OPENING, StageEventType.OPENING)
        return True

    def _open_failed(self, error: BaseException) -> None:
        text = reason(error) if isinstance(error, OUTSIDE) else "it was cancelled"
        self._set_state(StageState.OPENED if self._opened else StageState.CLOSED, StageEventType.OPEN_FAILED,
                        error=text)

    def _adopt(self, opened: _Opened) -> Result:
        cache = UsdUtils.StageCache.Get()
        if opened.owned:
            opened.owned = not cache.GetId(opened.stage).IsValid()
            cache.Insert(opened.stage)
        opened.notice = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._on_objects_changed, opened.stage)
        self._opened = opened
        self._last_url = "" if opened.is_new else opened.url
        self._edited_since_tick = False
        self._pending_edit, self._was_dirty = None, self._is_dirty()
        self._set_state(StageState.OPENED, StageEventType.OPENED)
        self._events.queue(StageEventType.ASSETS_LOADING)
        self._events.queue(StageEventType.ASSETS_LOADED)
        return True, ""

    def _replace_root(self, root: Sdf.Layer) -> Steps[None]:
        """Replaces the root layer. Keeps the session layer, the edit target and the selection."""
        old = self._opened
        session, target, old_root = (hold(layer) for layer in (
            old.stage.GetSessionLayer(), old.stage.GetEditTarget().GetLayer(), old.stage.GetRootLayer()))
        selected = self._selection.get_selected_prim_paths()
        rules, muted = old.stage.GetLoadRules(), old.stage.GetMutedLayers()
        yield from self._close()
        self._begin_opening()
        stage = Usd.Stage.Open(root, session, Usd.Stage.LoadNone)
        stage.SetLoadRules(rules)
        stage.MuteAndUnmuteLayers([path for path in muted if Sdf.Layer.Find(path) != root], [])
        target = root if target == old_root else target
        if stage.HasLocalLayer(target):
            stage.SetEditTarget(stage.GetEditTargetForLocalLayer(target))
        self._diagnose(stage, may_fail=False)
        self._adopt(_Opened(stage, root.realPath or root.identifier, old.load_set))
        self._selection.set_selected_prim_paths(selected)

    def _diagnose(self, stage: Usd.Stage, may_fail: bool = True) -> None:
        self._diagnostics = [str(error) for error in stage.GetCompositionErrors()
                             if type(error).__name__ in _ASSET_ERRORS]
        if may_fail and self._diagnostics and self.settings.fail_stage_open_on_asset_errors:
            more = f" (and {len(self._diagnostics) - 1} more)" if len(self._diagnostics) > 1 else ""
            raise Failure(self._diagnostics[0] + more)

    def _send_saving(self) -> None:
        self._save_cancelled = False
        try:
            self._events.send(StageEventType.SAVING)
            self._events.send(StageEventType.SETTINGS_SAVING)
            cancelled = self._save_cancelled
        finally:
            self._save_cancelled = None
        if cancelled:
            self._events.send(StageEventType.SAVE_FAILED, error="saving was cancelled")
            raise Failure("saving was cancelled")

    @contextlib.contextmanager
    def _sending_a_cancel(self) -> typing.Iterator[None]:
        try:
            yield
        except GeneratorExit:
            self._events.send(StageEventType.SAVE_FAILED, error="it was cancelled")
            raise

    def _send_saved(self, saved: list[Sdf.Layer], problems: list[str],
                    skipped: typing.Sequence[str] = ()) -> SaveResult:
        text, identifiers = "; ".join([*problems, *skipped]), [layer.identifier for layer in saved]
        for one in skipped:
            _log.warning("%s", one)
        if problems:
            self._events.send(StageEventType.SAVE_FAILED, error=text)
        else:
            self._events.send(StageEventType.SAVED)
            self._pending_edit, self._edited_since_tick = None, False
        dirty = self.has_pending_edit()
        if not problems or dirty != self._was_dirty:
            self._events.send(StageEventType.DIRTY_STATE_CHANGED)
        self._was_dirty = dirty
        return not problems, text, identifiers

    def _set_state(self, state: StageState, event: StageEventType, **payload: typing.Any) -> None:
        self._state = state
        self._events.send(event, **payload)

    def _is_dirty(self) -> bool:
        layers = self._opened.stage.GetLayerStack(False)
        live = self._opened.live
        if live and (self._edited_since_tick or live.is_dirty(layers)):
            return True
        return any(layer.dirty and not (live and live.name_of(layer)) for layer in layers)

    # -- frames

    def _tick_live(self) -> None:
        if self._opened and self._opened.live:
            self._opened.live.tick()
            self._edited_since_tick = False  # from now on the connection knows

    def _look(self) -> None:
        """Called once per frame. Sends one event for repeated changes."""
        if self._selection_changed:
            self._selection_changed = False
            self._events.queue(StageEventType.SELECTION_CHANGED)
        if self._state != StageState.OPENED:
            return
        if self._hierarchy_changed:
            self._hierarchy_changed = False
            self._events.queue(StageEventType.HIERARCHY_CHANGED)
        dirty = self.has_pending_edit()
        if dirty != self._was_dirty and self._operation != "saving":
            self._was_dirty = dirty
            self._events.queue(StageEventType.DIRTY_STATE_CHANGED)

    def _on_objects_changed(self, notice: Usd.Notice.ObjectsChanged, _: object) -> None:
        if notice.GetResyncedPaths():
            self._hierarchy_changed = True
        self._edited_since_tick = True
        if self._pending_edit is False:
            self._pending_edit = None

    def _mark_selection(self) -> None:
        self._selection_changed = True

    # -- the three forms of an operation

    def _run(self, what: str, steps: Steps) -> bool:
        return run(self._guarded(what, steps, saving=False))[0]

    async def _run_async(self, what: str, steps: Steps, saving: bool = False) -> typing.Any:
        return await run_async(self._guarded(what, steps, saving))

    def _start(self, what: str, steps: Steps, on_finish: typing.Callable | None,
               saving: bool = False) -> bool:
        """Starts an operation. Returns True if it was started. Without an event loop it runs in the next frame."""
        if self._operation:
            steps.close()
            return False
        guarded = self._guarded(what, steps, saving)
        finish = on_finish or (lambda *_: None)
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            self._in_next_frame(lambda: finish(*run(guarded)))
            return True
        task = loop.create_task(run_async(guarded))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        task.add_done_callback(lambda done: None if done.cancelled() else finish(*done.result()))
        return True

    def _in_next_frame(self, function: typing.Callable[[], typing.Any]) -> None:
        def once(_: object) -> None:
            subscription.unsubscribe()
            function()

        subscription = get_app().get_update_event_stream().create_subscription_to_pop(once, ORDER_EVENTS)

    def _guarded(self, what: str, steps: Steps, saving: bool) -> Steps:
        """Runs one operation at a time. Converts errors from outside into the result tuple."""
        if self._operation:
            steps.close()
            text = f"the context is {self._operation}"
        else:
            self._operation = what
            try:
                return (yield from steps)
            except OUTSIDE as error:
                text = reason(error)
            finally:
                self._operation = ""
        _log.warning("%s failed: %s", what, text)
        return (False, text, []) if saving else (False, text)

    def _destroy(self) -> bool:
        """Ends the subscriptions of the context. Refused while an operation runs."""
        if self._operation or self.can_close_stage() and not self.close_stage():
            return False
        for frame in self._frames:
            frame.unsubscribe()
        return True


def _load(load_set: UsdContextInitialLoadSet) -> Usd.Stage.InitialLoadSet:
    return Usd.Stage.LoadNone if load_set == LOAD_NONE else Usd.Stage.LoadAll


def _is_discarded(layer: Sdf.Layer) -> bool:
    kept = _discarded.get(layer.identifier)
    return kept is not None and kept() is not None and not kept().expired


def _read_anew(layers: typing.Iterable[Sdf.Layer]) -> None:
    """Reads files again whose layers somebody still holds, so that they open as on the disk: those with edits of a
    closed stage, and those whose file has changed. Other edits stay."""
    files = [layer for layer in layers if not layer.anonymous]
    chosen = [layer for layer in files if _is_discarded(layer)]
    Sdf.Layer.ReloadLayers([layer for layer in chosen if layer.dirty], True)
    Sdf.Layer.ReloadLayers([layer for layer in files if not layer.dirty])
    for layer in chosen:
        del _discarded[layer.identifier]
