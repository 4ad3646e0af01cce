"""Lists who is here: editors, from the server, and the viewers of this gateway."""

from __future__ import annotations

import hashlib
import json
import math
import typing

import usdlive

from . import wire

if typing.TYPE_CHECKING:
    from .viewer import Viewer

APPLICATION = "usdlive page"  # the gateway's own connections, which are no people
MOST_SELECTED = 256


def colour_of(name: str) -> str:
    """A colour for a name that is the same in all pages: bright, of any hue."""
    hue = int.from_bytes(hashlib.sha256(name.encode()).digest()[:2], "big") / 65536 * 6
    parts = [max(0.0, min(1.0, abs((hue + shift) % 6 - 3) - 1)) for shift in (0, 4, 2)]
    return "#" + "".join(f"{round(70 + 170 * one):02x}" for one in parts)


def _of_editor(one: usdlive.events.Presence) -> dict:
    person: dict = {"id": one.client, "user": one.user, "application": one.application, "viewer": False,
                    "color": "#" + "".join(f"{max(0, min(255, round(part * 255))):02x}" for part in one.colour),
                    "selection": list(one.selection[:MOST_SELECTED])}
    if one.camera is not None and len(one.camera) == 16 and all(map(math.isfinite, one.camera)):
        person["camera"] = list(one.camera)
    if one.time is not None and math.isfinite(one.time):
        person["time"] = one.time
    return person


def _of_viewer(viewer: "Viewer") -> dict:
    person: dict = {"id": viewer.id, "user": viewer.person.name, "application": "page", "viewer": True,
                    "color": colour_of(viewer.person.name), "selection": viewer.selection}
    if viewer.camera is not None:
        person["camera"] = viewer.camera
    if viewer.time is not None:
        person["time"] = viewer.time
    return person


class People:
    """The list that all pages get, each without itself."""

    def __init__(self) -> None:
        self._all: dict[str, str] = {}  # each person as JSON, by id

    def update(self, editors: typing.Iterable[usdlive.events.Presence], viewers: typing.Iterable["Viewer"]) -> bool:
        """Returns whether it differs. A viewer who edits is here once: as a viewer."""
        viewers = list(viewers)
        own = {viewer.editor.client for viewer in viewers if viewer.editor is not None}
        now = [_of_editor(one) for one in editors
               if one.client not in own and one.application != APPLICATION] + [_of_viewer(one) for one in viewers]
        texts = {one["id"]: wire.text(one) for one in now}
        if texts == self._all:
            return False
        self._all = texts
        return True

    def text_without(self, id: str) -> str:
        """The message for a page."""
        return f'{{"type":"presence","people":[{",".join(text for one, text in self._all.items() if one != id)}]}}'

    def others(self, id: str) -> list[dict]:
        return [json.loads(text) for one, text in self._all.items() if one != id]
