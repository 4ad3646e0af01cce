"""The layers of one context."""

from __future__ import annotations

import contextlib
import dataclasses
import time
import typing
import weakref

from pxr import Sdf, Tf, Usd

from usdlive import _usdlive, events
from usdlive.omni._events import EventStream, Subscription
from usdlive.omni._registers import Recorder
from usdlive.omni.kit.app import ORDER_EVENTS, ORDER_LAYERS, get_app
from usdlive.omni.usd import StageEventType

from ._host import StageHost
from ._live_syncing import LiveSyncing
from ._removal import shadow_removal, unshadow_removal
from ._types import LayerEditMode, LayerErrorType, LayerEventType, layer_event_name, layer_event_type

_NO_STAGE = (LayerErrorType.INVALID_STAGE, "the context has no stage")


class Context(typing.Protocol):
    """The part of a UsdContext that is used here."""

    def get_stage(self) -> Usd.Stage | None: ...
    def get_name(self) -> str: ...


@dataclasses.dataclass(frozen=True)
class RefusedEdit:
    """An edit that was taken back. `field` is empty if the spec itself is meant."""

    path: str
    field: str
    layer_identifier: str
    error_type: LayerErrorType
    reason: str


class _Part:
    def __init__(self, layers: "Layers"):
        self._layers = weakref.ref(layers)

    @property
    def usd_context(self) -> Context | None:
        layers = self._layers()
        return layers.usd_context if layers else None

    @property
    def _native(self) -> "_usdlive.Layers | None":
        layers = self._layers()
        return layers._native_layers() if layers else None


class LayersState(_Part):
    """The states of layers, by identifier."""

    def set_muteness_scope(self, global_scope: bool) -> None:
        """Global muteness is stored in the root layer and shared live; local muteness belongs to this process."""
        if native := self._native:
            native.set_muteness_scope(global_scope)

    def is_muteness_global(self) -> bool:
        native = self._native
        return bool(native) and native.is_muteness_global()

    def is_layer_locally_muted(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.is_layer_locally_muted(layer_identifier)

    def is_layer_globally_muted(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.is_layer_globally_muted(layer_identifier)

    def set_layer_global_muteness(self, layer_identifier: str, muted: bool) -> bool:
        """Not in Kit: writes the flag. In global scope the stage follows at once."""
        native = self._native
        return bool(native) and native.set_layer_global_muteness(layer_identifier, muted)

    def is_layer_writable(self, layer_identifier: str) -> bool:
        """Returns True if the layer is not read-only on disk, muted or locked."""
        native = self._native
        return bool(native) and native.is_layer_writable(layer_identifier)

    def is_layer_readonly_on_disk(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.is_layer_readonly_on_disk(layer_identifier)

    def is_layer_savable(self, layer_identifier: str) -> bool:
        """Returns True if the layer is writable and not anonymous."""
        native = self._native
        return bool(native) and native.is_layer_savable(layer_identifier)

    def set_layer_lock_state(self, layer_identifier: str, locked: bool) -> bool:
        """Locks or unlocks a sublayer. The root layer cannot be locked. Returns False, which Kit does not, and
        changes nothing if it is refused, for example because somebody else has locked the layer;
        get_last_error_string() has the reason."""
        native = self._native
        return bool(native) and native.set_layer_lock_state(layer_identifier, locked)

    def is_layer_locked(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.is_layer_locked(layer_identifier)

    def set_layer_name(self, layer_identifier: str, name: str) -> None:
        if native := self._native:
            native.set_layer_name(layer_identifier, name)

    def get_layer_name(self, layer_identifier: str) -> str:
        native = self._native
        return native.get_layer_name(layer_identifier) if native else ""

    def get_layer_owner(self, layer_identifier: str) -> str:
        """Returns the owner of the layer's file, or an empty text if it is unknown."""
        native = self._native
        return native.get_layer_owner(layer_identifier) if native else ""

    def is_layer_outdated(self, layer_identifier: str) -> bool:
        """Returns True if the file is newer than the layer in memory. For a live layer it is the server's file."""
        native = self._native
        return bool(native) and native.is_layer_outdated(layer_identifier)

    def get_local_layer_identifiers(self, include_session_layers: bool = False,
                                    include_anonymous_layers: bool = True,
                                    include_invalid_layers: bool = False) -> list[str]:
        native = self._native
        if not native:
            return []
        return native.local_layers(include_session_layers, include_anonymous_layers, include_invalid_layers)

    def get_dirty_layer_identifiers(self, not_in_session: bool = False) -> list[str]:
        native = self._native
        return native.dirty_layers() if native else []

    def get_all_outdated_layer_identifiers(self, not_in_session: bool = False,
                                           not_auto: bool = False) -> list[str]:
        native = self._native
        return native.outdated_layers(0, not_auto) if native else []

    def get_outdated_sublayer_identifiers(self, not_in_session: bool = False,
                                          not_auto: bool = False) -> list[str]:
        native = self._native
        return native.outdated_layers(1, not_auto) if native else []

    def get_outdated_non_sublayer_identifiers(self, not_in_session: bool = False,
                                              not_auto: bool = False) -> list[str]:
        native = self._native
        return native.outdated_layers(2, not_auto) if native else []

    def reload_all_outdated_layers(self, not_in_session: bool = True, not_auto: bool = False) -> None:
        """Discards unsaved edits of these layers."""
        if native := self._native:
            native.reload_outdated_layers(0, not_auto)

    def reload_outdated_sublayers(self, not_in_session: bool = True, not_auto: bool = False) -> None:
        if native := self._native:
            native.reload_outdated_layers(1, not_auto)

    def reload_outdated_non_sublayers(self, not_in_session: bool = True, not_auto: bool = False) -> None:
        if native := self._native:
            native.reload_outdated_layers(2, not_auto)

    def has_local_layer(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.has_local_layer(layer_identifier)

    def has_used_layer(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.has_used_layer(layer_identifier)

    def is_auto_reload_layer(self, layer_identifier: str) -> bool:
        """Returns True also for layers that the context's settings `auto_reload_sublayers` and
        `auto_reload_non_sublayers` include."""
        native = self._native
        return bool(native) and native.is_auto_reload_layer(layer_identifier)

    def add_auto_reload_layer(self, layer_identifier: str) -> bool:
        """Returns False if it was added before, or if the stage does not use the layer."""
        native = self._native
        return bool(native) and native.add_auto_reload_layer(layer_identifier)

    def remove_auto_reload_layer(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.remove_auto_reload_layer(layer_identifier)

    def get_auto_reload_layers(self) -> list[str]:
        native = self._native
        return native.auto_reload_layers() if native else []


class _Distributing(_Part):
    """A part whose edit mode distributes the edits of the delegate."""

    def suspend(self) -> None:
        """Keeps edits in the delegate until resume()."""
        if native := self._native:
            native.suspend()

    def resume(self) -> None:
        if native := self._native:
            native.resume()


class AutoAuthoring(_Distributing):
    """Collects edits in a delegate layer and moves them in each frame to the layers with the strongest
    opinions."""

    def is_enabled(self) -> bool:
        native = self._native
        return bool(native) and native.edit_mode() == LayerEditMode.AUTO_AUTHORING

    def set_default_layer(self, layer_identifier: str) -> None:
        """Sets the layer for new specs. Session layers and unknown layers are refused."""
        if native := self._native:
            native.set_default_layer(layer_identifier)

    def get_default_layer(self) -> str:
        native = self._native
        return native.default_layer() if native else ""

    def is_auto_authoring_layer(self, layer_identifier: str) -> bool:
        native = self._native
        return bool(native) and native.is_auto_authoring_layer(layer_identifier)

    def clearing(self, *specs: Sdf.Path | str, time: float | None = None) -> contextlib.AbstractContextManager[None]:
        """Not in Kit: while it lasts, opinions of these prims and properties can be cleared and removed in the edit
        target by functions that look only there. The strongest opinions of the layers are meant. Needed only for
        functions that are written in C++; pxr's own `Clear*` and `RemoveProperty` do it themselves. With `time`,
        only for the sample at this time."""
        layers = self._layers()
        return layers.clearing(specs, time) if self._native else contextlib.nullcontext()

    @property
    def refused_edits(self) -> list[RefusedEdit]:
        """Not in Kit: returns the edits that were taken back, with the reasons, oldest first."""
        native = self._native
        return [RefusedEdit(path, field, layer, LayerErrorType(error), reason)
                for path, field, layer, error, reason in (native.refused_edits() if native else [])]


class SpecsLinking(_Distributing):
    """The layers that receive the edits of specs in the mode SPECS_LINKING."""

    def is_enabled(self) -> bool:
        native = self._native
        return bool(native) and native.edit_mode() == LayerEditMode.SPECS_LINKING

    def link_spec(self, spec_path: str, layer_identifier: str, hierarchy: bool = False) -> list[str]:
        """Returns the specs whose links changed, like the other functions here."""
        native = self._native
        return native.link_spec(str(spec_path), layer_identifier, hierarchy) if native else []

    def unlink_spec(self, spec_path: str, layer_identifier: str, hierarchy: bool = False) -> list[str]:
        native = self._native
        return native.unlink_spec(str(spec_path), layer_identifier, hierarchy) if native else []

    def unlink_spec_from_all_layers(self, spec_path: str, hierarchy: bool = False) -> list[str]:
        native = self._native
        return native.unlink_spec_from_all_layers(str(spec_path), hierarchy) if native else []

    def unlink_specs_to_layer(self, layer_identifier: str) -> list[str]:
        native = self._native
        return native.unlink_specs_to_layer(layer_identifier) if native else []

    def unlink_all_specs(self) -> None:
        if native := self._native:
            native.unlink_all_specs()

    def get_spec_layer_links(self, spec_path: str, hierarchy: bool = False) -> dict[str, list[str]]:
        native = self._native
        return native.spec_links(str(spec_path), hierarchy) if native else {}

    def get_spec_links_for_layer(self, layer_identifier: str) -> list[str]:
        native = self._native
        return native.links_for_layer(layer_identifier) if native else []

    def get_all_spec_links(self) -> dict[str, list[str]]:
        native = self._native
        return native.all_links() if native else {}

    def is_spec_linked(self, spec_path: str, layer_identifier: str = "") -> bool:
        native = self._native
        return bool(native) and native.is_spec_linked(str(spec_path), layer_identifier)


class SpecsLocking(_Part):
    """The prims and properties that accept no edits."""

    def lock_spec(self, spec_path: str, hierarchy: bool = False) -> list[str]:
        """Returns the specs that were not locked before. A prim's properties are locked with it."""
        native = self._native
        return native.lock_spec(str(spec_path), hierarchy) if native else []

    def unlock_spec(self, spec_path: str, hierarchy: bool = False) -> list[str]:
        native = self._native
        return native.unlock_spec(str(spec_path), hierarchy) if native else []

    def unlock_all_specs(self) -> None:
        if native := self._native:
            native.unlock_all_specs()

    def get_all_locked_specs(self) -> list[str]:
        native = self._native
        return native.all_locked_specs() if native else []

    def is_spec_locked(self, spec_path: str) -> bool:
        native = self._native
        return bool(native) and native.is_spec_locked(str(spec_path))


class Layers:
    """Follows the context's stage. There is one for each context, get_layers(). Use it on the thread that owns
    the stage."""

    def __init__(self, context: Context):
        self._context = weakref.ref(context)
        self._stage: Usd.Stage | None = None
        self._native: _usdlive.Layers | None = None
        self._live: object | None = None
        self._muting: Tf.Notice.Listener | None = None
        self._identifiers: dict[str, str] = {}  # live layers by their names in the project
        # The mode that a new root layer continues.
        self._resumed: tuple[Sdf.Layer, int, str] | None = None
        self._error: tuple[int, str] | None = None
        self._name = context.get_name()
        _all_layers.add(self)
        self._stream = EventStream(f"omni.kit.usd.layers:{self._name}")
        self._state = LayersState(self)
        self._auto_authoring = AutoAuthoring(self)
        self._linking = SpecsLinking(self)
        self._locking = SpecsLocking(self)
        updates = get_app().get_update_event_stream()
        this = weakref.ref(self)
        self._live_handler = lambda event: (layers := this()) and layers._on_live_event(event)
        self._subscriptions: list[Subscription] = [
            updates.create_subscription_to_pop(lambda _: this()._update(), ORDER_LAYERS, self._stream.name),
            updates.create_subscription_to_pop(lambda _: this()._deliver(), ORDER_EVENTS, self._stream.name),
        ]
        # Subscribes before other subscribers see the opening of a stage, so that no event is
        # missed.
        if context.get_stage():
            self._native_layers()
        if stage_events := getattr(context, "get_stage_event_stream", None):
            self._subscriptions.append(stage_events().create_subscription_to_pop_by_type(
                StageEventType.OPENED, lambda _: this()._native_layers(), order=-1))
            self._subscriptions.append(stage_events().create_subscription_to_pop_by_type(
                StageEventType.CLOSED, lambda _: this()._native_layers(), order=-1))
        if before_saving := getattr(context, "call_before_saving", None):
            before_saving(lambda recorder: (layers := this()) and layers._distribute(recorder))

    # -- parts

    def get_layers_state(self) -> LayersState:
        return self._state

    def get_auto_authoring(self) -> AutoAuthoring:
        return self._auto_authoring

    def get_specs_linking(self) -> SpecsLinking:
        return self._linking

    def get_specs_locking(self) -> SpecsLocking:
        return self._locking

    def get_live_syncing(self) -> LiveSyncing:
        return LiveSyncing(self)

    @property
    def usd_context(self) -> Context | None:
        return self._context()

    # -- modes and errors

    def get_edit_mode(self) -> LayerEditMode:
        native = self._native_layers()
        return LayerEditMode(native.edit_mode()) if native else LayerEditMode.NORMAL

    def set_edit_mode(self, edit_mode: LayerEditMode) -> None:
        if native := self._native_layers():
            self._enter_mode(native, edit_mode)

    def _enter_mode(self, native: "_usdlive.Layers", edit_mode: int) -> None:
        native.set_edit_mode(int(edit_mode))
        if native.edit_mode() != LayerEditMode.NORMAL:
            shadow_removal(self._stage, self)
        else:
            unshadow_removal(self._stage)

    def get_last_error_type(self) -> LayerErrorType:
        return LayerErrorType(self._last_error()[0])

    def get_last_error_string(self) -> str:
        return self._last_error()[1]

    def _last_error(self) -> tuple[int, str]:
        if self._error:
            return self._error
        return self._native.last_error() if self._native else (LayerErrorType.SUCCESS, "")

    # -- events

    def get_event_stream(self) -> EventStream:
        return self._stream

    def get_event_key(self) -> str:
        """Returns the key that identifies this context's events."""
        return self._name

    def send_event(self, name: str, payload: dict | None = None) -> None:
        """Queues an event of this context, by its name or type, for the frame."""
        kind = layer_event_type(name) if isinstance(name, str) else LayerEventType(name)
        if kind is None:
            self._error = (LayerErrorType.INVALID_PARAM, f"there is no layer event '{name}'")
            return
        self._stream.push(kind, payload={"name": layer_event_name(kind), **(payload or {})})

    def deliver_queued_events(self) -> None:
        """Delivers queued events now instead of with the frame."""
        self._queue_events()
        self._stream.pump()

    # -- the stage

    def _native_layers(self) -> "_usdlive.Layers | None":
        """Returns the layers for the context's present stage."""
        context = self._context()
        stage = context.get_stage() if context else None
        if stage is None:
            self._drop()
            self._error = _NO_STAGE
            return None
        self._error = None
        live = getattr(context, "live", None)
        client = live._client if live is not None else None
        if stage is not self._stage:
            scope = bool(self._native) and self._native.is_muteness_global()
            self._drop()
            self._stage = stage
            self._native = _usdlive.Layers(StageHost(stage), "", client)
            self._follow_live(live, stage)
            self._native.set_muteness_scope(scope)
            self._resume_mode(stage)
            native = self._native
            self._muting = Tf.Notice.Register(Usd.Notice.LayerMutingChanged,
                                              lambda *_: native.muteness_changed(), stage)
        elif live is not self._live:
            self._follow_live(live, stage)
            self._native.set_client(client)
        return self._native

    def _follow_live(self, live: object | None, stage: Usd.Stage | None) -> None:
        if self._live is not None:
            self._live.remove_handler(self._live_handler)
        self._live, self._identifiers = live, {}
        if live is not None:
            live._unfollow(stage)
            live.add_handler(self._live_handler)

    def _on_live_event(self, event: events.Event) -> None:
        """Reports edits that the server refused like those that a local lock refused."""
        if isinstance(event, events.Lost) and self._native:
            kind = LayerErrorType.READ_ONLY if event.code == "locked" else LayerErrorType.UNKNOWN
            self._native.refuse(int(kind), event.message,
                                [(edit.path, edit.field or "", self._identifier_of(edit.layer))
                                 for edit in event.edits])

    def _identifier_of(self, name: str) -> str:
        if name not in self._identifiers and self._stage:
            self._identifiers = {self._live.layer_name(layer) or "": layer.identifier
                                 for layer in self._stage.GetUsedLayers()}
        return self._identifiers.get(name, name)

    def _resume_mode(self, stage: Usd.Stage) -> None:
        """Continues the mode on a stage that was saved as another file. It has the same session layer."""
        resumed, self._resumed = self._resumed, None
        if resumed and resumed[0] == stage.GetSessionLayer():
            self._enter_mode(self._native, resumed[1])
            self._native.set_default_layer(resumed[2])

    def _distribute(self, recorder: Recorder | None = None) -> None:
        """Called before edits are saved, sent or left, and before and after each command. A recorder gets the edits
        of the layers that receive them, instead of those of the delegate."""
        if native := self._native_layers():
            native.distribute(recorder.native if recorder else None)
            self._queue_events()

    @contextlib.contextmanager
    def clearing(self, specs: typing.Iterable[Sdf.Path | str], time: float | None = None) -> typing.Iterator[None]:
        native = self._native
        native.begin_clearing([str(spec) for spec in specs], time)
        try:
            yield
        finally:
            native.end_clearing()

    def distribute_now(self) -> None:
        """Distributes the edits before the frame, unless it is suspended. A command that runs records them, and
        would distribute them at its end, also while it is suspended."""
        recorder = getattr(self._context(), "recorder", None)
        if self._native and (recorder or not self._native.is_suspended()):
            self._distribute(recorder)

    def _drop(self) -> None:
        if not self._native:
            return
        self._queue_events()
        mode, default = self._native.edit_mode(), self._native.default_layer()
        if mode != LayerEditMode.NORMAL:
            if self._stage:  # not a stage that its owner has closed
                self._enter_mode(self._native, LayerEditMode.NORMAL)
                self._resumed = (self._stage.GetSessionLayer(), mode, default)
            self._queue_events()
        if self._muting:
            self._muting.Revoke()
        self._follow_live(None, None)
        self._native = self._stage = self._muting = None

    def _update(self) -> None:
        if native := self._native_layers():
            if settings := getattr(self._context(), "settings", None):
                native.set_auto_reload(settings.auto_reload_sublayers, settings.auto_reload_non_sublayers)
            native.update(time.monotonic() * 1000.0)
            self._queue_events()

    def _queue_events(self) -> None:
        for event in self._native.take_events() if self._native else []:
            kind = LayerEventType(event["type"])
            payload: dict[str, typing.Any] = {"name": layer_event_name(kind)}
            if event["layer"]:
                payload["layer_identifier"] = event["layer"]
            if event["entries"]:
                payload["val"] = [{"key": key, "value": value} for key, value in event["entries"]]
            elif event["values"]:
                payload["val"] = event["values"]
            self._stream.push(kind, payload=payload)

    def _deliver(self) -> None:
        self._stream.pump()


_all_layers: "weakref.WeakSet[Layers]" = weakref.WeakSet()


def distribute_all() -> None:
    """Distributes the edits of all contexts, for a save that knows only layers."""
    for layers in list(_all_layers):
        layers._distribute()


def authoring_context(layers: Layers) -> Usd.EditContext:
    """Edits the default layer in the modes with a delegate, otherwise the edit target."""
    stage = layers.usd_context.get_stage()
    if layers.get_edit_mode() == LayerEditMode.NORMAL:
        return Usd.EditContext(stage, stage.GetEditTarget())
    default = Sdf.Layer.Find(layers.get_auto_authoring().get_default_layer())
    return Usd.EditContext(stage, stage.GetEditTargetForLocalLayer(default))
