"""A thread that composes a stage of the project and tells viewers what there is to draw."""

from __future__ import annotations

import logging
import time
import typing

import usdlive
from pxr import Sdf, Usd

from . import wire
from .blobs import Blobs
from .owned import Owner
from .presence import APPLICATION
from .scene import Frame, Scene
from .textures import Textures

FRAME = 1 / 60
_TICK_MS = 6.0
_READ_SECONDS = 0.010
_CHANGED_SECONDS = 0.1  # between two messages of changed prims
_STATE_SECONDS = 0.25
MOST_CHANGED = 256
MOST_LAYERS = 10_000
# A viewer that has more than this to receive waits for the rest of the scene.
_STREAM_BYTES = 4 << 20

_log = logging.getLogger("usdlive.page")


class Stream(typing.Protocol):
    """A viewer who gets the whole scene. Any thread."""

    waiting_bytes: int
    is_gone: bool


class Watcher(typing.Protocol):
    """Gets what a picture tells. Called on the picture's thread."""

    def show(self, picture: "Picture", frames: list[Frame], version: int) -> None:
        """Frames for all viewers of the picture. `version`: of the scene before them."""

    def show_one(self, viewer: Stream, frames: list[Frame], begins: bool) -> None:
        """A part of the scene for one viewer; `begins`: the first one."""


class Picture(Owner):
    """The stage of one root layer: live, or at a revision of the past, which `seek()` and `play()` move."""

    def __init__(self, connect: typing.Callable[[], usdlive.Live], layer: str, blobs: Blobs, watcher: Watcher,
                 past: int | None = None):
        super().__init__(f"stage {layer}", connect)
        self.layer, self.past = layer, past
        self._blobs, self._watcher = blobs, watcher
        self.scene: Scene
        self.stage: Usd.Stage
        self.player: usdlive.Player | None = None
        self._streams: dict[Stream, typing.Iterator[Frame]] = {}
        self._begun: set[Stream] = set()
        self._next_changed = self._next_state = 0.0
        self._all_changed = False
        self._paths: set[str] = set()
        self._structure = False
        self._state: dict | None = None
        self.health = {"live": False, "revision": 0}  # replaced as a whole; any thread
        self._about: dict | None = None
        self.message = ""
        self._last_error = ""

    # -- calls on its thread

    def begin(self) -> None:
        self.live.add_handler(self._happened)
        if self.past is None:
            self.stage = self.live.open_stage(self.layer)
        else:
            self.player = self.live.player(self.layer, at=self.past)
            self.stage = self.player.stage
        self._textures = Textures(self._blobs, self._texture_arrived)
        self.scene = Scene(self.stage, self._blobs, self._textures)

    def end(self) -> None:
        self._textures.close()
        self.scene.close()

    def welcome(self) -> dict:
        """Returns what a page is told of the stage."""
        player = self.player
        return {"stage": self.layer, "stages": self.live.layers(), **self.scene.about(),
                "revision": {"first": player.first if player else 1, "last": player.last if player else self.live.revision},
                "server": {"connected": self.live.connected, "revision": self.live.revision}}

    def stream(self, viewer: Stream) -> None:
        """Begins to send the whole scene to a viewer."""
        self._streams[viewer] = self.scene.everything()
        self._begun.discard(viewer)

    def catch_up(self, viewer: Stream, version: int) -> None:
        """Sends a viewer one batch in place of those after `version`, which it has not got."""
        frame = self.scene.since(version)
        if frame is not None:
            self._watcher.show_one(viewer, [frame], False)

    def set_time(self, value: float | None) -> None:
        self.scene.set_time(value)
        self._next_state = 0.0

    def seek(self, revision: int) -> None:
        if self.player is not None:
            self.player.seek(revision)
            self.past = self.player.revision
            self._next_state = 0.0

    def play(self, speed: float) -> None:
        if self.player is not None:
            self.player.play(speed)

    def state(self) -> dict:
        message = self.message
        if self.live.other_history is not None:
            message = str(self.live.other_history)
        elif not self.live.connected:
            message = message or "the server does not answer; what you see is from before"
        else:
            message = ""
        return {"type": "state", "connected": self.live.connected, "revision": self.live.revision,
                "time": None if self.scene.time.IsDefault() else self.scene.time.GetValue(),
                "past": self.player.revision if self.player else None,
                "playing": bool(self.player and self.player.playing), "message": message}

    def layers(self) -> dict:
        """The layer stack with the states of its layers, as a tree."""
        states = self.live.layer_states()
        muted = set(self.stage.GetMutedLayers())
        seen: set[str] = set()
        # The gateway has the layers open, too; its user counts if they have another program open.
        own = {self.live.user} - {one.user for one in self.live.presences() if one.application != APPLICATION}

        def entry(layer: Sdf.Layer | None, name: str, identifier: str) -> dict:
            state = states.get(name)
            found = {"layer": name, "children": [], "muted": identifier in muted, "dirty": bool(state and state.dirty),
                     "lockedBy": (state.holder or "somebody") if state and state.locked else "",
                     "openBy": sorted(set(state.editors) - own) if state else [], "missing": layer is None}
            if layer is None or identifier in seen or len(seen) > MOST_LAYERS:
                return found
            seen.add(identifier)
            for path in layer.subLayerPaths:
                below = layer.ComputeAbsolutePath(path)
                sublayer = Sdf.Layer.Find(below)
                found["children"].append(entry(sublayer, self.name_of(sublayer) if sublayer is not None else path, below))
            return found

        root = self.stage.GetRootLayer()
        return {"type": "layers", "root": self.layer, "stack": [entry(root, self.layer, root.identifier)]}

    def name_of(self, layer: Sdf.Layer) -> str:
        """The name of a layer in the project; of another one, what it calls itself."""
        return self.live.layer_name(layer) or layer.GetDisplayName()

    def frame(self) -> float:
        try:
            self._frame()
        except Exception as wrong:  # the picture goes on: one prim must not end it
            if str(wrong) != self._last_error:
                self._last_error = str(wrong)
                _log.exception("an error in a frame of %s", self.layer)
        return FRAME

    def _frame(self) -> None:
        self._tick()
        version = self.scene.version
        frames = self.scene.update(_READ_SECONDS)
        self._collect()
        now = time.monotonic()
        if now >= self._next_changed:
            frames += self._changes()
            self._next_changed = now + _CHANGED_SECONDS
        if now >= self._next_state:
            frames += self._states()
            self._next_state = now + _STATE_SECONDS
        if frames:
            self._watcher.show(self, frames, version)
        self._serve_streams()

    def _tick(self) -> None:
        try:
            # Does what Live.tick() does, without an object for each edit of others: the stage tells what has changed.
            _, _, happened = self.live._client.tick(_TICK_MS)
            self.live._notify([one for one in happened if one["event"] != "Committed"])
            if self.player is not None and self.player.playing:
                if self.player.tick():
                    self._next_state = 0.0
        except usdlive.Error as failed:
            self.message = failed.message
            _log.warning("%s: %s", self.layer, failed.message)

    def _collect(self) -> None:
        touched, self.scene.touched = self.scene.touched, set()
        self._structure |= self.scene.restructured
        self.scene.restructured = False
        if not self._all_changed:
            self._paths |= touched
            if len(self._paths) > MOST_CHANGED:
                self._all_changed = True
                self._paths = set()

    def _changes(self) -> list[Frame]:
        if not (self._paths or self._structure or self._all_changed):
            return []
        message: dict = {"type": "changed", "paths": sorted(self._paths), "structure": self._structure,
                         "revision": self.live.revision}
        if self._all_changed:
            message["all"] = True
        self._paths, self._structure, self._all_changed = set(), False, False
        return [wire.text(message)]

    def _states(self) -> list[Frame]:
        frames: list[Frame] = []
        if self.scene.metadata_changed:
            self.scene.metadata_changed = False
            about = self.scene.about()
            if self._about is not None and {**about, "time": 0} != {**self._about, "time": 0}:
                frames.append(wire.text({"type": "about", **about}))
            self._about = about
        state = self.state()
        self.health = {"live": state["connected"], "revision": state["revision"]}
        if state != self._state:
            self._state = state
            frames.append(wire.text(state))
        return frames

    def _serve_streams(self) -> None:
        end = time.perf_counter() + _READ_SECONDS
        for viewer, frames in tuple(self._streams.items()):
            while not viewer.is_gone and viewer.waiting_bytes < _STREAM_BYTES and time.perf_counter() < end:
                frame = next(frames, None)
                if frame is not None:
                    self._watcher.show_one(viewer, [frame], viewer not in self._begun)
                    self._begun.add(viewer)
                    continue
                del self._streams[viewer]
                self._begun.discard(viewer)
                break
            if viewer.is_gone:
                self._streams.pop(viewer, None)
                self._begun.discard(viewer)

    def _happened(self, event: usdlive.events.Event) -> None:
        if isinstance(event, usdlive.events.FilesChanged):
            self.scene.files_changed()
        elif isinstance(event, usdlive.events.Disconnected):
            self.message = event.message
            self._next_state = 0.0
        elif isinstance(event, usdlive.events.Connected):
            self.message = ""
            self._next_state = 0.0

    def _texture_arrived(self, path: str) -> None:  # on a worker
        self.call(lambda: self.scene.texture_arrived(path))
