"""Edits of a viewer, made by a connection of their own, so that the server sees, checks and attributes them."""

from __future__ import annotations

import contextlib
import time
import typing

import usdlive
from pxr import Gf, Sdf, Usd

from .. import _opinions
from .._opinions import Write
from .._transforms import ops_for
from . import tree, values
from .owned import Owner

if typing.TYPE_CHECKING:
    from .picture import Picture

_ACTIVE, _IDLE = 1 / 60, 0.1
_ACTIVE_SECONDS = 2.0


# -- what to write: on the thread of the stage


def _layer_for(picture: "Picture", prim: Usd.Prim, name: str, wanted: str | None) -> str:
    if picture.past is not None:
        raise usdlive.Error("invalidArgument", "the past cannot be edited; go back to now")
    return _opinions.layer_for(picture.live, prim, name, wanted)


def setting(picture: "Picture", path: str, name: str, value: typing.Any, at: float | None, layer: str | None) -> tuple[str, list[Write]]:
    prim = tree.prim_at(picture.stage, path)
    attribute = prim.GetAttribute(name)
    if not attribute:
        raise usdlive.Error("NotFound", f"{path} has no attribute {name}")
    kind = attribute.GetTypeName()
    return _layer_for(picture, prim, name, layer), [
        Write("attribute", prim.GetPath(), name, None if value is None else values.from_json(kind, value), kind,
              attribute.GetVariability() == Sdf.VariabilityUniform, attribute.IsCustom(), at)]


def moving(picture: "Picture", path: str, matrix: list[float], layer: str | None) -> tuple[str, list[Write]]:
    prim = tree.prim_at(picture.stage, path)
    rows = [matrix[3 * row:3 * row + 3] + [1.0 if row == 3 else 0.0] for row in range(4)]
    now = picture.scene.time
    found = ops_for(prim, Gf.Matrix4d(*[one for row in rows for one in row]), now)
    writes = []
    for one in found:
        attribute = prim.GetAttribute(one.name)
        at = now.GetValue() if attribute and attribute.GetNumTimeSamples() and not now.IsDefault() else None
        writes.append(Write("attribute", prim.GetPath(), one.name, one.value, one.type, one.is_uniform, False, at, "transform"))
    return _layer_for(picture, prim, found[0].name, layer), writes


def choosing(picture: "Picture", path: str, set: str, choice: str | None, layer: str | None) -> tuple[str, list[Write]]:
    prim = tree.prim_at(picture.stage, path)
    if set not in prim.GetVariantSets().GetNames():
        raise usdlive.Error("NotFound", f"{path} has no variant set {set}")
    if choice and choice not in prim.GetVariantSet(set).GetVariantNames():
        raise usdlive.Error("NotFound", f"the variant set {set} of {path} has no variant {choice}")
    return _layer_for(picture, prim, "", layer), [Write("variant", prim.GetPath(), set, choice, opinion="variants")]


def activating(picture: "Picture", path: str, active: bool, layer: str | None) -> tuple[str, list[Write]]:
    prim = tree.prim_at(picture.stage, path)
    return _layer_for(picture, prim, "", layer), [Write("active", prim.GetPath(), value=active, opinion="metadata")]


# -- writing: on the thread of the editor


class Editor(Owner):
    """The connection of one viewer. `refused` is called on its thread with what the server did not take."""

    def __init__(self, name: str, connect: typing.Callable[[], usdlive.Live], refused: typing.Callable[[dict], None]):
        super().__init__(f"editor {name}", connect)
        self.client = ""  # its id, from the beginning of the connection on
        self._refused = refused
        self._active_until = 0.0
        self._drag: contextlib.ExitStack | None = None  # the undo group and the gesture that are open

    def begin(self) -> None:
        self.client = self.live.id
        self.live.add_handler(self._happened)

    def frame(self) -> float:
        more = self.live.tick()
        if more or self.live.pending:
            self._active_until = time.monotonic() + _ACTIVE_SECONDS
        return _ACTIVE if self._drag is not None or time.monotonic() < self._active_until else _IDLE

    def write(self, layer: str, writes: list[Write], label: str, commit: bool = True) -> dict:
        """Writes all of it as one transaction. Without `commit`, others see it as a preview until a later call commits."""
        opened = self._open(layer)
        _opinions.check(self.live, layer, writes)
        if self._drag is None:
            self._drag = contextlib.ExitStack()
            self._drag.enter_context(self.live.undo_group(label))
            self._drag.callback(self.live.tick)  # the edits belong to the group when they are ticked
            if not commit:
                self._drag.enter_context(self.live.gesture())
                self._drag.callback(self.live.tick)
        try:
            _opinions.write(opened, layer, writes)
        except usdlive.Error:
            self.end_drag()
            raise
        if commit:
            self.end_drag()
        self._send()
        return {"layer": layer}

    def end_drag(self) -> None:
        if self._drag is not None:
            self._drag.close()
            self._drag = None

    def lock(self, layer: str, locked: bool) -> None:
        self._open(layer)
        permission = self.live.may_do("lock", layer)
        if not permission:
            raise usdlive.Error("forbidden", f"you may not lock or unlock {layer}: {permission.why}")
        self.live.lock(layer) if locked else self.live.unlock(layer)
        self._send()

    def mute(self, root: str, layer: str, muted: bool) -> None:
        self._open(root)
        permission = self.live.may_do("mute", root)
        if not permission:
            raise usdlive.Error("forbidden", f"you may not mute layers of {root}: {permission.why}")
        self.live.mute(root, layer) if muted else self.live.unmute(root, layer)
        self._send()

    def take_back(self, again: bool) -> dict:
        """Undo, or redo, of the viewer's own work."""
        self.end_drag()
        result = self.live.redo() if again else self.live.undo()
        self._send()
        kept = "; ".join(map(str, result.kept[:10]))
        return {"done": bool(result), "message": kept or (result.label if result else "there is nothing to take back")}

    def present(self, selection: list[str], camera: list[float] | None, at: float | None) -> None:
        """Shows others what the viewer looks at."""
        self.live.show_presence(selection, camera, at)

    def explain(self, layer: str, path: str, kind: str) -> tuple[bool, str]:
        found = self.live.may_edit(layer, path, kind or None)
        return bool(found), found.why or f"as {self.live.role or 'everybody'}"

    def checkpoint(self, name: str) -> dict:
        made = self.live.create_checkpoint(name)
        return {"name": made.name, "revision": made.revision, "user": made.user, "at": made.time}

    def _open(self, layer: str) -> Sdf.Layer:
        return self.live.opened_layer(layer) or self.live.open_layer(layer, payloads=False)

    def _send(self) -> None:
        self.live.tick()
        self._active_until = time.monotonic() + _ACTIVE_SECONDS

    def _happened(self, event: usdlive.events.Event) -> None:
        if not isinstance(event, usdlive.events.Lost):
            return
        places = {(edit.layer, edit.path.partition(".")[0]) for edit in event.edits} or {("", "")}
        for layer, path in sorted(places)[:16]:
            self._refused({"type": "refused", "path": path, "layer": layer, "code": event.code, "message": event.message})
