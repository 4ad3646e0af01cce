"""For programs whose scene is not a Usd.Stage: what has changed on the composed stage, prim by prim, and exact opinions back.

    adapter = usdlive.adapter.Adapter(live, live.open_stage("shot.usda"))
    while True:                                   # once per frame, on the thread of the stage
        live.tick()
        for change in adapter.changes():          # the first time: all prims, as created
            apply(change)                         # reads what it needs with adapter.matrix(change.path) and the like
        if user_has_moved_something:
            adapter.move(path, matrix)            # sent by the next tick

The adapter keeps the names and types of prims, and no values: the stage has them. A program may edit its scene and the stage in any
order; what it writes comes back as a change, like an edit of somebody else. docs/embedding.md says what a program has to do.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import typing

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from . import _opinions, events
from ._changes import StageChanges
from ._errors import Error
from ._live import Live
from ._namespace import NamespaceEditor
from ._opinions import Write
from ._transforms import ops_for

__all__ = ["Adapter", "Change", "Mesh", "Part"]

_MATERIAL = "Material"
_SHOWN = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


class Part(enum.Flag):
    """The parts of a prim that have to be read again."""

    TRANSFORM = enum.auto()
    VISIBILITY = enum.auto()
    MESH = enum.auto()  # the shape of a gprim of any type, with its primvars
    MATERIAL = enum.auto()  # which material is bound; of a material: anything in it
    OTHER = enum.auto()  # other properties, and metadata

    @classmethod
    def all(cls) -> "Part":
        return cls.TRANSFORM | cls.VISIBILITY | cls.MESH | cls.MATERIAL | cls.OTHER


@dataclasses.dataclass(frozen=True)
class Change:
    """One prim that differs since the last `changes()`.

    `kind`: "created", "removed", "renamed" or "changed". `parts`: of a created or changed prim. `names`: the properties, and "" for
    metadata, if only these have changed; empty if anything may have. `former`: of a renamed prim, its path before; everything
    below it has moved along."""

    kind: str
    path: str
    parts: Part = Part(0)
    names: frozenset[str] = frozenset()
    former: str = ""


class Mesh(typing.NamedTuple):
    """A UsdGeom.Mesh: points, the numbers of corners of the faces, and the point of each corner."""

    points: Vt.Vec3fArray
    counts: Vt.IntArray
    indices: Vt.IntArray


class _Node:
    """A prim that the program knows."""

    __slots__ = ("name", "type", "parent", "children")

    def __init__(self, name: str, type: str, parent: "_Node | None"):
        self.name, self.type, self.parent = name, type, parent
        self.children: dict[str, _Node] = {}

    def path(self) -> str:
        names: list[str] = []
        node: _Node | None = self
        while node is not None and node.parent is not None:
            names.append(node.name)
            node = node.parent
        return "/" + "/".join(reversed(names))

    def below(self) -> "typing.Iterator[_Node]":
        """This node, then all below it, a parent before its children."""
        waiting = [self]
        while waiting:
            one = waiting.pop()
            yield one
            waiting.extend(reversed(one.children.values()))


class _Found:
    """The changes of a frame. Those of one prim are joined."""

    def __init__(self) -> None:
        self.structure: list[Change] = []
        self.created: set[str] = set()
        self.parts: dict[str, Part] = {}
        self.names: dict[str, set[str] | None] = {}  # None: anything may have changed

    def add(self, path: str, parts: Part, names: typing.Iterable[str] | None) -> None:
        self.parts[path] = self.parts.get(path, Part(0)) | parts
        known = self.names.setdefault(path, set())
        if names is None or known is None:
            self.names[path] = None
        else:
            known.update(names)

    def changes(self) -> list[Change]:
        return self.structure + [
            Change("changed", path, parts, frozenset(self.names[path] or ())) for path, parts in self.parts.items()
            if path not in self.created]


@functools.lru_cache(maxsize=256)
def _shape_names(type: str) -> frozenset[str]:
    """The properties of the shape of a type of gprims; none for other types."""
    found = Usd.SchemaRegistry().GetTypeFromSchemaTypeName(type)
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition(type)
    if not found or not found.IsA(UsdGeom.Gprim) or not definition:
        return frozenset()
    return frozenset(definition.GetPropertyNames()) - {*UsdGeom.Xformable.GetSchemaAttributeNames(True), "proxyPrim"}


def _part_of(name: str, type: str) -> Part:
    if name.startswith("xformOp"):
        return Part.TRANSFORM
    if name == "visibility":
        return Part.VISIBILITY
    if name.startswith("material:binding") or name.startswith("collection:"):
        return Part.MATERIAL
    if name.startswith("primvars:") or name in _shape_names(type):
        return Part.MESH
    return Part.OTHER


class Adapter:
    """Follows the composed stage of a live connection, and writes opinions into its layers.

    Belongs to the thread of `live` and the stage, which it keeps alive. The errors of what writes are usdlive.Errors:
    `forbidden` (role, rules, a lock), `layerNotFound` (a layer that the stage does not have), `specNotFound` (a prim that it does
    not show), `invalidArgument`; nothing is written then."""

    def __init__(self, live: Live, stage: Usd.Stage):
        self.live, self.stage = live, stage
        self.time = Usd.TimeCode.Default()
        self._root = _Node("", "", None)
        self._stage_changes = StageChanges(stage)
        self._moves: list[tuple[str, str]] = []
        self._resynced = {Sdf.Path.absoluteRootPath}
        self._animated = False  # the time has changed
        self._other_materials = False  # some have come or gone
        live._answered.append(self._happened)  # no handler of the user: `events.Lost` stays a warning

    def close(self) -> None:
        """Ends following. The connection and the stage go on."""
        self._stage_changes.close()
        if self._happened in self.live._answered:
            self.live._answered.remove(self._happened)

    # -- what has changed

    def changes(self) -> list[Change]:
        """Returns what differs from what the last call returned; the first call returns all prims. In this order: renamed,
        after the new parent is created; removed, a prim after those below it; created, a prim before those below it; changed. Apply them in this order. A prim whose
        type has changed is removed and created. A prim may be named as changed although what it shows is the same.

        A rename is recognized from the commit of who made it; otherwise, for example while it is
        a preview, the prims are removed and created. "/" stands for the metadata of the stage. Takes time in proportion to what has changed; the first call, and one after a material has come or gone, in
        proportion to the stage."""
        found = _Found()
        resynced, changed = self._stage_changes.take()
        roots, self._resynced = resynced | self._resynced, set()
        moves, self._moves = self._moves, []
        for old, new in moves:
            roots.update((Sdf.Path(old), Sdf.Path(new)))
            self._rename(old, new, found)
        removed: list[Change] = []
        created: list[Change] = []
        shown = [Sdf.Path(path) for root in roots for path in self._shown_as(str(root))]
        outermost = [str(path) for path in Sdf.Path.RemoveDescendentPaths(shown)]  # nothing is compared twice
        for path in outermost:
            self._compare(path, removed, created, found)
        found.structure += removed + created
        found.created = {one.path for one in found.structure if one.kind == "created"}
        for path in outermost:
            self._note_material_above(path, {""}, found)
        for text, names in changed.items():
            for path in self._shown_as(text):
                self._note(path, names, found)
        if self._other_materials:  # bindings to them have another meaning
            self._other_materials = False
            for path in self.paths():
                found.add(path, Part.MATERIAL, None)
        if self._animated:
            self._animated = False
            self._note_animated(found)
        return found.changes()

    def set_time(self, time: float | None) -> None:
        """The time at which values are read; None: without samples. The next `changes()` has the prims that differ in time."""
        now = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        if now != self.time:
            self.time, self._animated = now, True

    def paths(self) -> list[str]:
        """The prims of which `changes()` has told, a parent before what is below it."""
        return [node.path() for node in self._root.below() if node is not self._root]

    def _happened(self, event: events.Event) -> None:
        if not isinstance(event, events.Committed) or not any(edit.kind == "move" for edit in event.edits):
            return
        local = {self.live.layer_name(layer) for layer in self.stage.GetLayerStack(False)}
        for edit in event.edits:
            if edit.kind == "move" and edit.layer in local and edit.new_path and "." not in edit.path and "{" not in edit.path:
                self._moves.append((edit.path, edit.new_path))

    def _node(self, path: str) -> _Node | None:
        node: _Node | None = self._root
        for name in path.split("/")[1:] if path != "/" else ():
            node = node.children.get(name) if node is not None else None
        return node

    def _rename(self, old: str, new: str, found: _Found) -> None:
        """Moves what is known. The comparison that follows finds out what is there."""
        node = self._node(old)
        if node is None or node is self._root or self._node(new) is not None or new.startswith(old + "/"):
            return
        if self._is_shown(self.stage.GetPrimAtPath(old)) and not self._is_shown(self.stage.GetPrimAtPath(new)):
            return  # a move in a layer whose opinions do not decide
        above, _, name = new.rpartition("/")
        parent = self._node(above or "/") or self._new_parent(above, found)
        if parent is None:
            return
        self._other_materials |= any(one.type == _MATERIAL for one in node.below())
        del node.parent.children[node.name]
        node.name, node.parent = name, parent
        parent.children[name] = node
        found.structure.append(Change("renamed", new, former=old))

    def _new_parent(self, path: str, found: _Found) -> _Node | None:
        """The node of a prim that is made by the same edit, as when prims are grouped."""
        prim = self.stage.GetPrimAtPath(path)
        above, _, name = path.rpartition("/")
        parent = self._node(above or "/")
        if parent is None or not self._is_shown(prim):
            return None
        return self._meet(prim, name, parent, found.structure, found.structure, found)

    @staticmethod
    def _is_shown(prim: Usd.Prim) -> bool:
        """Not looking at what is above it."""
        return bool(prim) and (prim.IsPseudoRoot() or _SHOWN(prim))

    def _shown_as(self, path: str) -> list[str]:
        """The paths that a prim has on the stage: of one in a prototype, those in all instances."""
        if not path.startswith("/__Prototype_"):
            return [path]
        name, _, below = path[1:].partition("/")
        prototype = self.stage.GetPrimAtPath("/" + name)
        if not prototype:
            return []
        return [one for instance in prototype.GetInstances()
                for one in self._shown_as(str(instance.GetPath()) + ("/" + below if below else ""))]

    def _compare(self, path: str, removed: list[Change], created: list[Change], found: _Found) -> None:
        """Compares what is known at and below a path with the stage."""
        while path != "/" and self._node(path.rpartition("/")[0] or "/") is None:
            path = path.rpartition("/")[0] or "/"
        if path == "/":
            found.add("/", Part.OTHER, None)
            self._compare_children(self.stage.GetPseudoRoot(), self._root, removed, created, found)
            return
        above, _, name = path.rpartition("/")
        prim = self.stage.GetPrimAtPath(path)
        self._compare_one(prim if self._is_shown(prim) else None, name, self._node(above or "/"), removed, created, found)

    def _compare_children(self, prim: Usd.Prim, node: _Node, removed: list[Change], created: list[Change], found: _Found) -> None:
        waiting = [(prim, node, "")]
        while waiting:
            prim, node, name = waiting.pop()
            if name:
                node = self._meet(prim, name, node, removed, created, found)
            there = prim.GetFilteredChildren(_SHOWN)
            names = {one.GetName() for one in there}
            for gone in [one for one in node.children if one not in names]:
                self._remove(node.children[gone], removed)
            waiting.extend((one, node, one.GetName()) for one in reversed(there))

    def _compare_one(self, prim: Usd.Prim | None, name: str, parent: _Node, removed: list[Change], created: list[Change],
                     found: _Found) -> None:
        if prim is not None:
            self._compare_children(prim, self._meet(prim, name, parent, removed, created, found), removed, created, found)
        elif name in parent.children:
            self._remove(parent.children[name], removed)

    def _meet(self, prim: Usd.Prim, name: str, parent: _Node, removed: list[Change], created: list[Change], found: _Found) -> _Node:
        """Returns the node of a prim that the stage shows."""
        type, path = str(prim.GetTypeName()), str(prim.GetPath())
        node = parent.children.get(name)
        if node is not None and node.type == type:
            found.add(path, Part.all(), None)
            return node
        if node is not None:
            self._remove(node, removed)
        node = parent.children[name] = _Node(name, type, parent)
        self._other_materials |= type == _MATERIAL
        created.append(Change("created", path, Part.all()))
        return node

    def _remove(self, node: _Node, removed: list[Change]) -> None:
        below = list(node.below())
        removed += [Change("removed", one.path()) for one in reversed(below)]
        self._other_materials |= any(one.type == _MATERIAL for one in below)
        del node.parent.children[node.name]

    def _note(self, path: str, names: set[str], found: _Found) -> None:
        """Properties of a prim have changed, or its metadata (the empty name)."""
        self._note_material_above(path, names, found)
        node = self._node(path)
        if node is None:
            return
        parts = Part(0)
        for name in names:
            parts |= _part_of(name, node.type)
        found.add(path, parts, names)
        inherited = parts & Part.MATERIAL
        if any(name.startswith("primvars:") for name in names):
            inherited |= Part.MESH
        if inherited:
            for one in node.below():
                if one is not node:
                    found.add(one.path(), inherited, names)

    def _note_material_above(self, path: str, names: set[str], found: _Found) -> None:
        """A change in a material is a change of the material."""
        prim = self.stage.GetPrimAtPath(path) if path != "/" else None
        while prim and not prim.IsPseudoRoot():
            if prim.IsA(UsdShade.Material):
                if self._node(str(prim.GetPath())) is not None:
                    found.add(str(prim.GetPath()), Part.MATERIAL, names)
                return
            prim = prim.GetParent()

    def _note_animated(self, found: _Found) -> None:
        for path in self.paths():
            prim = self.stage.GetPrimAtPath(path)
            names = {one.GetName() for one in prim.GetAuthoredAttributes()
                     if one.GetNumTimeSamples() or one.HasSpline() or one.ValueMightBeTimeVarying()} if prim else set()
            if names:
                self._note(path, names, found)

    # -- what the stage shows, at the present time

    def prim(self, path: str) -> Usd.Prim:
        """The prim, for everything that has no function here."""
        prim = self.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if not prim:
            raise Error("specNotFound", f"the stage shows no prim {path}")
        return prim

    def matrix(self, path: str) -> Gf.Matrix4d:
        """The transform relative to the parent; the identity for prims without one."""
        xformable = UsdGeom.Xformable(self.prim(path))
        return xformable.GetLocalTransformation(self.time) if xformable else Gf.Matrix4d(1)

    def visible(self, path: str) -> bool:
        """False if the prim itself is invisible; those below it are not shown then either."""
        imageable = UsdGeom.Imageable(self.prim(path))
        return not imageable or imageable.GetVisibilityAttr().Get(self.time) != UsdGeom.Tokens.invisible

    def mesh(self, path: str) -> Mesh | None:
        """The mesh; None for prims of other types."""
        mesh = UsdGeom.Mesh(self.prim(path))
        if not mesh:
            return None
        return Mesh(mesh.GetPointsAttr().Get(self.time) or Vt.Vec3fArray(), mesh.GetFaceVertexCountsAttr().Get(self.time) or Vt.IntArray(),
                    mesh.GetFaceVertexIndicesAttr().Get(self.time) or Vt.IntArray())

    def material(self, path: str) -> str:
        """The path of the material that is bound to the prim, also by a prim above it; empty for none, and for one that is not among
        the prims of `changes()`, because it is only an over or abstract."""
        material = UsdShade.MaterialBindingAPI(self.prim(path)).ComputeBoundMaterial()[0]
        return str(material.GetPath()) if material and self._is_shown(material.GetPrim()) else ""

    # -- opinions of one's own
    #
    # Each call writes into one layer of the stage: `layer`, or the one with the strongest opinion, else the one with the prim, else
    # the root layer. The calls of one tick are one commit; `live.undo_group("Move chair")` around them gives it a name.

    def set(self, path: str, name: str, value: object, type: Sdf.ValueTypeName | None = None, time: float | None = None,
            layer: str | None = None) -> None:
        """Writes the value of an attribute: the default, or the sample at `time`. `type`: of an attribute that the stage does not
        have yet, which is then a custom one."""
        prim = self.prim(path)
        attribute = prim.GetAttribute(name)
        if not attribute and type is None:
            raise Error("invalidArgument", f"{path} has no attribute {name}: say its type")
        is_uniform = bool(attribute) and attribute.GetVariability() == Sdf.VariabilityUniform
        self._write(prim, name, layer, [Write(
            "attribute", prim.GetPath(), name, value, attribute.GetTypeName() if attribute else type, is_uniform,
            attribute.IsCustom() if attribute else True, time)])

    def clear(self, path: str, name: str, time: float | None = None, layer: str | None = None) -> None:
        """Removes the default of an attribute from the layer, or the sample at `time`: what is weaker shows then."""
        prim = self.prim(path)
        self._write(prim, name, layer, [Write("attribute", prim.GetPath(), name, time=time)])

    def move(self, path: str, matrix: Gf.Matrix4d, layer: str | None = None) -> None:
        """Gives the prim this transform relative to its parent, by the xformOps that it has, or by translate, rotateXYZ and scale.
        Animated ops get a sample at the present time. Error: `invalidArgument` if its ops cannot express the matrix."""
        prim = self.prim(path)
        writes = []
        for one in ops_for(prim, matrix, self.time):
            attribute = prim.GetAttribute(one.name)
            at = self.time.GetValue() if attribute and attribute.GetNumTimeSamples() and not self.time.IsDefault() else None
            writes.append(Write("attribute", prim.GetPath(), one.name, one.value, one.type, one.is_uniform, False, at, "transform"))
        self._write(prim, writes[0].name, layer, writes)

    def show(self, path: str, visible: bool, layer: str | None = None) -> None:
        """Lets the prim be visible if those above it are, or makes it invisible."""
        self._imageable(path)
        self.set(path, "visibility", UsdGeom.Tokens.inherited if visible else UsdGeom.Tokens.invisible, layer=layer)

    def set_mesh(self, path: str, mesh: Mesh, layer: str | None = None) -> None:
        """Writes points, counts and indices of a mesh, with its extent."""
        prim = self.prim(path)
        if not UsdGeom.Mesh(prim):
            raise Error("invalidArgument", f"{path} is no mesh: it is a {prim.GetTypeName() or 'prim without a type'}")
        points = Vt.Vec3fArray(mesh.points)
        extent = UsdGeom.PointBased.ComputeExtent(points) if len(points) else Vt.Vec3fArray(2)
        values = {"points": points, "faceVertexCounts": Vt.IntArray(mesh.counts), "faceVertexIndices": Vt.IntArray(mesh.indices),
                  "extent": extent}
        self._write(prim, "points", layer, [
            Write("attribute", prim.GetPath(), name, value, prim.GetAttribute(name).GetTypeName(), opinion="geometry")
            for name, value in values.items()])

    def bind(self, path: str, material: str, layer: str | None = None) -> None:
        """Binds a material to the prim and what is below it; empty: removes the own binding of the prim."""
        prim = self.prim(path)
        self._imageable(path)
        target = self.prim(material).GetPath() if material else None
        self._write(prim, "material:binding", layer, [Write("binding", prim.GetPath(), "material:binding", target, opinion="shading")])

    def create(self, path: str, type: str, layer: str | None = None) -> None:
        """Defines a prim. Its parent has to be there, and its name must not be used by a prim that is shown."""
        if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsPrimPath():
            raise Error("invalidArgument", f"{path} is not the path of a prim")
        if self._is_shown(self.stage.GetPrimAtPath(path)):
            raise Error("specExists", f"there is a prim {path}")
        parent = self.prim(str(Sdf.Path(path).GetParentPath()))
        self._write(parent, "", layer, [Write("prim", Sdf.Path(path), value=type, opinion="namespace")])

    def remove(self, path: str) -> None:
        """Removes a prim with everything below it from all layers of the stage (docs/namespace-editing.md)."""
        editor = NamespaceEditor(self.stage)
        editor.DeletePrim(self.prim(path))
        self._apply(editor, f"{path} cannot be removed")

    def rename(self, path: str, new: str) -> None:
        """Renames or moves a prim in all layers of the stage, and corrects the paths that lead to it."""
        if not Sdf.Path.IsValidPathString(new) or not Sdf.Path(new).IsPrimPath():
            raise Error("invalidArgument", f"{new} is not the path of a prim")
        editor = NamespaceEditor(self.stage)
        editor.MovePrimAtPath(self.prim(path).GetPath(), new)
        self._apply(editor, f"{path} cannot become {new}")
        self._moves.append((path, new))

    def _imageable(self, path: str) -> None:
        if not UsdGeom.Imageable(self.prim(path)):
            raise Error("invalidArgument", f"{path} is nothing that is shown: it is a {self.prim(path).GetTypeName() or 'prim without a type'}")

    def _write(self, prim: Usd.Prim, name: str, layer: str | None, writes: list[Write]) -> None:
        chosen = _opinions.layer_for(self.live, prim, name, layer)
        _opinions.check(self.live, chosen, writes)
        opened = self.live.opened_layer(chosen)
        if opened is None:
            raise Error("layerNotOpen", f"{chosen} is not live here yet")
        _opinions.write(opened, chosen, writes)

    @staticmethod
    def _apply(editor: NamespaceEditor, what: str) -> None:
        if not editor.ApplyEdits():
            raise Error("invalidArgument", f"{what}: {editor.GetResult().whyNot}")
