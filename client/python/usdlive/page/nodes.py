"""The gateway's knowledge of each prim."""

from __future__ import annotations

import typing

from pxr import Usd, UsdGeom

from .blobs import Blobs


class Dirty:
    """The parts that have to be read again, as bits. Plain numbers: thousands are combined in a frame."""

    MATRIX = 1
    VISIBLE = 2
    COLOUR = 4
    GEOMETRY = 8
    INSTANCES = 16
    ITEM = 32  # everything that only a whole item tells


class Node:
    """A prim of the stage. It is an item of the page if `id` is not 0. `parent`: the node above it; `animated`: what differs
    between times."""

    __slots__ = ("path", "prim", "kind", "id", "parent", "children", "prototype", "purpose", "inherits_purpose", "xformable",
                 "ops", "animated", "data", "text", "geometry", "material", "subsets", "depends", "instancer", "prototypes",
                 "instances", "problems", "cost", "has_primvars")

    def __init__(self, path: str, prim: Usd.Prim, parent: "Node | None"):
        self.path, self.prim, self.parent = path, prim, parent
        self.kind, self.id = "", 0
        self.children: dict[str, Node] = {}
        self.prototype = ""  # the path in the prototype of a native instance
        self.purpose, self.inherits_purpose = "default", False
        self.xformable: UsdGeom.Xformable | None = None
        self.ops: list = []
        self.animated = 0
        self.data: dict[str, typing.Any] = {}
        self.text: str | None = None
        self.geometry = ""
        self.material = ""
        self.subsets: list[tuple[str, int, int]] = []
        self.depends: tuple[str, ...] = ()
        self.instancer: Node | None = None  # this is drawn by it only
        self.prototypes: list[str] = []
        self.instances: bytes | None = None
        self.problems: dict[str, str] = {}
        self.cost = 0.0  # seconds that reading the geometry took
        self.has_primvars = False  # or inherits some

    def shown_parent(self) -> int:
        """The id of the next item above."""
        above = self.parent
        while above is not None and not above.id:
            above = above.parent
        return above.id if above is not None else 0

    def below(self) -> "typing.Iterator[Node]":
        """This node and all below it."""
        waiting = [self]
        while waiting:
            one = waiting.pop()
            yield one
            waiting.extend(one.children.values())

    def set_geometry(self, blobs: Blobs, name: str) -> None:
        if name == self.geometry:
            return
        if name:
            blobs.use(name)
        if self.geometry:
            blobs.release(self.geometry)
        self.geometry = name
