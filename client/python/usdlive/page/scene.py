"""Finds what there is to draw on a stage, and what has changed since the last frame. On the thread of the stage."""

from __future__ import annotations

import collections
import itertools
import json
import logging
import math
import time
import typing

import numpy
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from .._changes import StageChanges
from . import facts, geometry, materials, skinning, wire
from .blobs import Blobs
from .nodes import Dirty, Node
from .textures import Textures

_log = logging.getLogger("usdlive.page")

Frame = typing.Union[str, bytes]  # a message of JSON, or a batch

ALL = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
# Prototypes of instancers can be classes, which are not defined otherwise.
WITH_CLASSES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsDefined & Usd.PrimIsLoaded)
_UNSHOWN = ("material", "shader")  # prims below are not shown
ITEMS_OF_A_MESSAGE = 400
MOST_INSTANCES = 1_000_000
_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
_SHAPE_FIELDS = {"points", "normals", "faceVertexCounts", "faceVertexIndices", "holeIndices", "orientation", "subdivisionScheme",
                 "widths", "curveVertexCounts", "basis", "type", "wrap", "size", "radius", "radiusTop", "radiusBottom", "height",
                 "axis", "width", "length", "tetVertexIndices", "surfaceFaceVertexIndices"}
_BATCHED = (Dirty.MATRIX, Dirty.VISIBLE, Dirty.COLOUR, Dirty.GEOMETRY, Dirty.INSTANCES)
_DRAWN = ("mesh", "curves", "points")
_SKINNED = {"skel:skeleton", "skel:blendShapes", "skel:blendShapeTargets", "primvars:skel:jointIndices",
            "primvars:skel:jointWeights", "primvars:skel:geomBindTransform"}


class _Job:
    """A part of the stage that is read. `old`: nodes that are removed at the end if they are not found again."""

    def __init__(self, root: str):
        self.root = root
        self.old: dict[str, Node] = {}
        self.waiting: list[tuple[Usd.Prim, Node | None]] = []
        self.begun = False


class Scene:
    """Reads a stage into numbered items. `update()` returns what all viewers get; `everything()` what a new one gets.

    The stage tells of changes by notices, within a tick or an edit. They are only noted then."""

    def __init__(self, stage: Usd.Stage, blobs: Blobs, textures: Textures):
        self.stage, self._blobs, self._textures = stage, blobs, textures
        self.time = Usd.TimeCode.Default()
        self.nodes: dict[str, Node] = {}
        self._items: dict[int, Node] = {}
        self._numbers = itertools.count(1)
        self._jobs: collections.deque[_Job] = collections.deque()
        self._dirty: dict[str, int] = {}
        self._proxies: dict[str, set[str]] = collections.defaultdict(set)  # path in a prototype to paths of nodes
        self._shared: dict[str, geometry.Geometry] = {}
        self._shared_hashes: dict[str, str] = {}
        self._skins = skinning.Skins()
        self._dependents: dict[str, set[str]] = collections.defaultdict(set)
        self._materials: dict[str, dict] = {}  # messages by path
        self._texture_users: dict[str, set[str]] = collections.defaultdict(set)  # materials and lights by resolved path
        self._held_textures: set[str] = set()
        self._new_materials: dict[str, dict] = {}
        self._moved_times: dict[str, float] = {}  # when the geometry of an expensive node may be read again
        self.version = 0  # the number of the last batch
        self._recent: dict[str, tuple[int, int]] = {}  # the parts of nodes that batches have told, the newest at the end
        self.touched: set[str] = set()  # prims that differ, for `changed`; taken by who sends it
        self.restructured = False
        self.metadata_changed = True
        self._changes = StageChanges(stage)
        self._rebuild("/")

    def close(self) -> None:
        self._changes.close()
        for node in list(self.nodes.values()):
            node.set_geometry(self._blobs, "")
        self._release_textures()

    def _release_textures(self) -> None:
        for name in self._held_textures:
            self._blobs.release(name)
        self._held_textures.clear()

    @property
    def is_building(self) -> bool:
        return bool(self._jobs)

    @property
    def is_idle(self) -> bool:
        return not (self._jobs or self._dirty or self._changes or self._new_materials)

    def about(self) -> dict:
        stage = self.stage
        def number(value: float, default: float) -> float:
            return float(value) if math.isfinite(value) else default
        return {"upAxis": str(UsdGeom.GetStageUpAxis(stage)), "metersPerUnit": number(UsdGeom.GetStageMetersPerUnit(stage), 0.01),
                "startTime": number(stage.GetStartTimeCode(), 0.0), "endTime": number(stage.GetEndTimeCode(), 0.0),
                "timeCodesPerSecond": number(stage.GetTimeCodesPerSecond(), 24.0),
                "time": None if self.time.IsDefault() else self.time.GetValue()}

    def set_time(self, value: float | None) -> None:
        """Everything that is animated is read at this time."""
        now = Usd.TimeCode.Default() if value is None else Usd.TimeCode(value)
        if now == self.time:
            return
        self.time = now
        self._shared.clear()
        self._shared_hashes.clear()
        for node in self.nodes.values():
            if node.animated:
                self._mark(node, node.animated)
        for path, message in tuple(self._materials.items()):
            if message["animated"]:
                self._material_changed(path)

    def texture_arrived(self, path: str) -> None:
        for user in self._texture_users.pop(path, ()):
            if user in self._materials:
                self._material_changed(user)
            elif user in self.nodes:
                self._mark(self.nodes[user], Dirty.ITEM)

    def files_changed(self) -> None:
        """Textures may have another content."""
        self._textures.forget()
        self._release_textures()
        for path in tuple(self._materials):
            self._material_changed(path)
        for node in self.nodes.values():
            if node.kind == "light":
                self._mark(node, Dirty.ITEM)

    # -- what has changed

    def _take_changes(self) -> None:
        resynced, changed = self._changes.take()
        if resynced:
            self._take_resynced(resynced)
        self.touched.update(changed)
        for text, names in changed.items():
            node = self.nodes.get(text)
            if node is not None:
                self._take_changed(node, names)
            elif text == "/":
                self.metadata_changed = True
            elif text.startswith("/__Prototype_"):
                self.touched.discard(text)
                if self._material_above(Sdf.Path(text)):
                    self._outside(Sdf.Path(text))
                    continue
                for proxy in tuple(self._proxies.get(text, ())):
                    self._take_changed(self.nodes[proxy], names)
                    self.touched.add(proxy)
                for name in [one for one in self._shared if one == text or text.startswith(one)]:
                    self._forget_shared(name)
                if text not in self._proxies:
                    self._outside(Sdf.Path(text))
            else:
                self._outside(Sdf.Path(text))

    def _forget_shared(self, name: str) -> None:
        self._shared.pop(name, None)
        self._shared_hashes.pop(name, None)

    def _take_resynced(self, paths: set[Sdf.Path]) -> None:
        self.restructured = True
        self._shared.clear()
        self._shared_hashes.clear()
        self._skins.forget()
        roots: set[str] = set()
        for path in Sdf.Path.RemoveDescendentPaths(list(paths)):
            text = str(path)
            self.touched.add(text)
            if path == Sdf.Path.absoluteRootPath:
                self.metadata_changed = True
                roots = {"/"}
                break
            if text.startswith("/__Prototype_"):
                found = self._proxies.get(text) or self._proxies.get(str(path.GetParentPath())) or ()
                roots.update(found)
                continue
            material = self._material_above(path)
            if material:
                self._material_changed(material)
                if text != material:
                    continue
            roots.add(text)
        for root in roots:
            self._rebuild(root)

    def _rebuild(self, root: str) -> None:
        """Reads a prim and everything below it again."""
        if root == "/":
            self._jobs.clear()
        elif self._is_subset(root):  # its mesh tells of it
            root = root.rpartition("/")[0]
        for job in self._jobs:
            if not job.begun and (root == job.root or root.startswith(job.root.rstrip("/") + "/")):
                return
        self._jobs.append(_Job(root))

    def _is_subset(self, path: str) -> bool:
        known = self.nodes.get(path)
        prim = self.stage.GetPrimAtPath(path)
        return known is not None and known.kind == "subset" or bool(prim) and prim.IsA(UsdGeom.Subset)

    def _material_above(self, path: Sdf.Path) -> str:
        """The path of the material that this prim is, or is a part of."""
        return next((str(one) for one in path.GetAncestorsRange() if str(one) in self._materials), "")

    def _outside(self, path: Sdf.Path) -> None:
        """A prim that is no item has changed: a part of a material, or a shader that materials use from elsewhere."""
        material = self._material_above(path)
        if material:
            self._material_changed(material)
            return
        prim = self.stage.GetPrimAtPath(path)
        if prim and (prim.IsA(UsdShade.Shader) or prim.IsA(UsdShade.NodeGraph)):
            for one in tuple(self._materials):
                self._material_changed(one)

    def _mark(self, node: Node, what: int) -> None:
        self._dirty[node.path] = self._dirty.get(node.path, 0) | what

    def _take_changed(self, node: Node, names: set[str]) -> None:
        what, kind = 0, node.kind
        for name in names:
            if name.startswith("primvars:"):
                node.has_primvars = True
            if name.startswith("xformOp"):
                what |= Dirty.MATRIX
                if name == "xformOpOrder":
                    self._find_ops(node)
                    what |= Dirty.ITEM
            elif name == "visibility":
                what |= Dirty.VISIBLE
            elif name == "purpose" or name.startswith("material:binding") or name == "prototypes" or name == "skel:skeleton":
                self._skins.forget()
                self._rebuild(node.path)
                return
            elif kind == "subset" and node.parent is not None:
                self._mark(node.parent, Dirty.GEOMETRY | Dirty.ITEM)
            elif kind in _UNSHOWN:
                self._outside(node.prim.GetPath())
            elif name.startswith("primvars:display") and node.id:
                what |= Dirty.COLOUR
            elif kind in _DRAWN and (name in _SHAPE_FIELDS or name.startswith("primvars:")):
                what |= Dirty.GEOMETRY
                if name in _SKINNED:
                    self._skins.forget()
            elif kind == "instancer":
                what |= Dirty.INSTANCES
            elif kind in ("camera", "light") or name == "doubleSided":
                what |= Dirty.ITEM
            if name.startswith("primvars:") and kind == "xform":  # inherited
                for one in node.below():
                    one.has_primvars = True
                    if one.kind in _DRAWN:
                        self._mark(one, Dirty.GEOMETRY)
        if what:
            self._mark(node, what)
        if what & Dirty.MATRIX and node.xformable is not None and not what & Dirty.ITEM and not node.ops:
            self._find_ops(node)
        if node.path in self._dependents:
            self._skins.forget()
            for path in self._dependents[node.path]:
                if path in self.nodes:
                    self._mark(self.nodes[path], Dirty.GEOMETRY)

    # -- reading prims

    def _build(self, end: float) -> tuple[list[Node], list[int]]:
        """Reads prims until the end of the time, at least some. Returns items that are new or differ, and those that left."""
        built: list[Node] = []
        removed: list[int] = []
        while self._jobs:
            job = self._jobs[0]
            if not job.begun:
                self._begin(job)
            while job.waiting:
                chunk: list[Node] = []
                while job.waiting and len(chunk) < 64:
                    prim, parent = job.waiting.pop()
                    self._visit(job, prim, parent, chunk)
                self._bind(chunk)
                for node in chunk:
                    self._read_safely(node)
                built += [node for node in chunk if node.id]
                if time.perf_counter() > end and job.waiting:
                    return built, removed
            self._jobs.popleft()
            for node in job.old.values():
                self._remove(node, removed)
            if time.perf_counter() > end:
                break
        return built, removed

    def _begin(self, job: _Job) -> None:
        job.begun = True
        known = self.nodes.get(job.root)
        job.old = dict(self.nodes) if job.root == "/" else {one.path: one for one in known.below()} if known else {}
        prim = self.stage.GetPrimAtPath(job.root)
        if not prim:
            return
        if prim.IsPseudoRoot():
            job.waiting = [(one, None) for one in reversed(prim.GetFilteredChildren(ALL))]
            return
        above = str(prim.GetPath().GetParentPath())
        parent = known.parent if known and known.instancer else self.nodes.get(above)
        if above != "/" and (parent is None or parent.kind in _UNSHOWN):
            return
        if ALL(prim) or (known is not None and known.instancer is not None):
            job.waiting = [(prim, parent)]

    def _visit(self, job: _Job, prim: Usd.Prim, parent: Node | None, chunk: list[Node]) -> None:
        if not prim:  # changed meanwhile: another job reads it
            return
        path = str(prim.GetPath())
        old = job.old.pop(path, None) or self.nodes.get(path)
        node = Node(path, prim, parent)
        if old is not None:
            self._unlink(old)
            node.id = old.id
        self.nodes[path] = node
        if parent is not None:
            parent.children[path] = node
            node.instancer = parent if parent.kind == "instancer" else parent.instancer
        if prim.IsInstanceProxy():
            node.prototype = str(prim.GetPrimInPrototype().GetPath())
        elif prim.IsInstance():
            node.prototype = str(prim.GetPrototype().GetPath())
        if node.prototype:
            self._proxies[node.prototype].add(path)
        node.kind = self._kind(prim)
        chunk.append(node)
        if node.kind in _UNSHOWN:
            return
        predicate = WITH_CLASSES if node.instancer is not None else ALL
        children = prim.GetFilteredChildren(predicate)
        for child in reversed(children):
            job.waiting.append((child, node))
        if node.kind == "instancer":
            self._find_prototypes(job, node)

    def _find_prototypes(self, job: _Job, node: Node) -> None:
        targets = UsdGeom.PointInstancer(node.prim).GetPrototypesRel().GetForwardedTargets()
        node.prototypes = [str(one) for one in targets]
        below = node.path + "/"
        for target in node.prototypes:
            prim = self.stage.GetPrimAtPath(target)
            if not prim:
                node.problems["prototypes"] = f"there is no prototype {target}"
            elif not target.startswith(below) and target not in self.nodes and not ALL(prim) and prim.IsActive():
                job.waiting.append((prim, node))  # a class, or below one
                job.old.pop(target, None)

    def _kind(self, prim: Usd.Prim) -> str:
        kind = _kinds.get(prim.GetTypeName())
        if kind is None:
            kind = _kinds[str(prim.GetTypeName())] = _kind_of(prim)
        if kind == "xform" and facts.is_light(prim):
            return "light"
        return kind

    def _bind(self, chunk: list[Node]) -> None:
        """Finds the materials of gprims and subsets."""
        bound = [node for node in chunk if node.kind in _DRAWN or node.kind == "subset"]
        if not bound:
            return
        try:
            found, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials([node.prim for node in bound])
        except Tf.ErrorException as wrong:
            _log.warning("materials cannot be found: %s", wrong)
            return
        for node, material in zip(bound, found):
            node.material = self._material(material) if material else ""

    def _material(self, material: UsdShade.Material) -> str:
        """Returns the name of a material for pages, and sends it when it is new. Native instances share it."""
        if material.GetPrim().IsInstanceProxy():
            material = UsdShade.Material(material.GetPrim().GetPrimInPrototype())
        path = str(material.GetPath())
        if path not in self._materials:
            self._read_material(material, path)
        return self._materials[path]["hash"]

    def _read_material(self, material: UsdShade.Material, path: str) -> None:
        read = materials.read(material, self.time)
        message = {**read.message, "hash": materials.name_of(path)}
        for slot, asset in read.files.items():
            message["textures"][slot]["hash"], problem = self._texture(asset, path)
            if problem:
                message["problem"] = problem
        self._materials[path] = message
        self._new_materials[path] = message

    def _texture(self, asset: Sdf.AssetPath, user: str) -> tuple[str, str]:
        """Returns the hash of a texture, empty while it is not here, and the problem with it."""
        path = asset.resolvedPath
        if "<UDIM>" in asset.path:
            return "", f"the texture {asset.path} consists of several tiles, which are not shown"
        if not path:
            return "", f"the texture {asset.path} was not found"
        found = self._textures.find(path, self.stage.GetPathResolverContext())
        if found is None:
            self._texture_users[path].add(user)
            return "", ""
        if found.hash and found.hash not in self._held_textures:
            self._blobs.use(found.hash)
            self._held_textures.add(found.hash)
        return found.hash, found.problem

    def _material_changed(self, path: str) -> None:
        material = UsdShade.Material(self.stage.GetPrimAtPath(path))
        if material:
            self._read_material(material, path)
        else:
            del self._materials[path]

    def _read_safely(self, node: Node) -> None:
        """A prim that cannot be read is shown as a place with a problem."""
        try:
            self._read(node)
        except Exception as wrong:
            _log.warning("%s cannot be read: %s", node.path, wrong)
            node.problems["read"] = f"cannot be read: {wrong}"
            node.data = {"id": node.id, "path": node.path, "parent": node.shown_parent(), "kind": "xform", "matrix": _IDENTITY,
                         "resetsStack": False, "visible": True, "purpose": node.purpose}
            node.kind, node.text = "xform", None

    def _read(self, node: Node) -> None:
        """Reads everything of a new node."""
        prim, kind = node.prim, node.kind
        if not kind or kind == "subset" or kind in _UNSHOWN:
            if node.id:
                self._items.pop(node.id, None)
                node.id = 0
            return
        if not node.id:
            node.id = next(self._numbers)
        self._items[node.id] = node
        names = prim.GetAuthoredPropertyNames()
        parent = node.parent
        node.has_primvars = (parent is not None and parent.has_primvars) or any(one.startswith("primvars:") for one in names)
        if "xformOpOrder" in names:
            self._find_ops(node)
        if "purpose" in names:
            node.purpose, node.inherits_purpose = str(prim.GetAttribute("purpose").Get()), True
        elif parent is not None and parent.inherits_purpose:
            node.purpose, node.inherits_purpose = parent.purpose, True
        self._find_animated(node, names)
        self._read_item(node)
        if kind in _DRAWN:
            self._read_geometry(node)
        elif kind == "instancer":
            self._mark(node, Dirty.INSTANCES)

    def _find_animated(self, node: Node, names: typing.Sequence[str]) -> None:
        """Finds out what differs between times."""
        kind = node.kind
        for name in names:
            if name == "visibility":
                what = Dirty.VISIBLE
            elif name.startswith("xformOp"):
                continue  # _find_ops()
            elif kind in _DRAWN:
                what = Dirty.GEOMETRY
            elif kind == "instancer":
                what = Dirty.INSTANCES
            elif kind in ("camera", "light"):
                what = Dirty.ITEM
            elif name.startswith("primvars:"):
                what = Dirty.COLOUR
            else:
                continue
            if not node.animated & what and node.prim.GetAttribute(name).ValueMightBeTimeVarying():
                node.animated |= what
        above = node.parent
        if above is not None and above.animated & Dirty.COLOUR:  # inherited primvars
            node.animated |= Dirty.GEOMETRY if kind in _DRAWN else Dirty.COLOUR

    def _find_ops(self, node: Node) -> None:
        xformable = UsdGeom.Xformable(node.prim)
        node.xformable = xformable if xformable else None
        node.ops = xformable.GetOrderedXformOps() if xformable else []
        node.animated &= ~Dirty.MATRIX
        if any(op.MightBeTimeVarying() for op in node.ops):
            node.animated |= Dirty.MATRIX

    def _matrix(self, node: Node) -> Gf.Matrix4d | None:
        """The local matrix; None if it is the identity."""
        if not node.ops:
            return None
        return node.xformable.GetLocalTransformation(node.ops, self.time)

    def _read_item(self, node: Node) -> None:
        prim, kind = node.prim, node.kind
        matrix = self._matrix(node)
        numbers = _IDENTITY
        node.problems.pop("matrix", None)
        if matrix is not None:
            numbers = wire.rows(matrix)[0].tolist()
            if not all(map(math.isfinite, numbers)):
                node.problems["matrix"], numbers = "its matrix is not finite", _IDENTITY
        data = {"id": node.id, "path": node.path, "parent": node.shown_parent(), "kind": kind, "matrix": numbers,
                "resetsStack": bool(node.xformable) and node.xformable.GetResetXformStack(),
                "visible": self._visible(node), "purpose": node.purpose}
        if kind == "camera":
            data["camera"] = facts.camera(prim, self.time)
        elif kind == "light":
            data["light"], asset = facts.light(prim, self.time)
            if asset:
                data["light"]["texture"], problem = self._texture(asset, node.path)
                if problem:
                    node.problems["texture"] = problem
        elif kind in _DRAWN:
            sided = prim.GetAttribute("doubleSided")
            data["doubleSided"] = bool(sided and sided.Get(self.time))
            for name in ("color", "opacity"):
                if name in node.data:
                    data[name] = node.data[name]
        if node.instancer is not None:
            data["prototypeOf"] = node.instancer.id
        node.data, node.text = data, None

    def _visible(self, node: Node) -> bool:
        attribute = node.prim.GetAttribute("visibility")
        return not attribute or attribute.Get(self.time) != UsdGeom.Tokens.invisible

    def _read_geometry(self, node: Node) -> bool:
        """Returns whether the item differs in more than its hash."""
        begin = time.perf_counter()
        before = (node.data.get("color"), node.data.get("opacity"), node.subsets, dict(node.problems))
        name = node.prototype
        found = self._shared.get(name) if name else None
        digest = self._shared_hashes.get(name, "") if found is not None else ""
        skinned = self._skins.points(node.prim, self.time) if node.kind == "mesh" else None
        if skinned is not None:
            found = None
            self._depend(node, skinned.depends)
        if found is None:
            found = geometry.read(node.prim, self.time, node.has_primvars, skinned.points if skinned else None)
            if skinned is not None and skinned.problem:
                found.problem = skinned.problem
            digest = self._blobs.add(*found.shape.blob) if found.shape is not None else ""
            if name and skinned is None:
                self._shared[name], self._shared_hashes[name] = found, digest
        found.shape = None  # the blob is enough
        node.set_geometry(self._blobs, digest)
        node.subsets = [self._subset(node, *one) for one in found.subsets]
        for key, value in (("color", found.colour), ("opacity", found.opacity)):
            node.data.pop(key, None)
            if value is not None:
                node.data[key] = value
        node.problems.pop("geometry", None)
        if found.problem:
            node.problems["geometry"] = found.problem
        if skinned is not None and skinned.animated:
            node.animated |= Dirty.GEOMETRY
        node.text = None
        node.cost = time.perf_counter() - begin
        return before != (node.data.get("color"), node.data.get("opacity"), node.subsets, dict(node.problems))

    def _subset(self, node: Node, path: str, first: int, count: int) -> tuple[str, int, int]:
        """`path` may be one in a prototype."""
        name = Sdf.Path(path).name
        return f"{node.path}/{name}", first, count

    def _depend(self, node: Node, paths: tuple[str, ...]) -> None:
        for path in node.depends:
            self._dependents[path].discard(node.path)
        node.depends = paths
        for path in paths:
            self._dependents[path].add(node.path)

    def _unlink(self, node: Node) -> None:
        """Forgets what others know of a node that is replaced or removed."""
        node.set_geometry(self._blobs, "")
        self._depend(node, ())
        if node.prototype:
            self._proxies[node.prototype].discard(node.path)
            if not self._proxies[node.prototype]:
                del self._proxies[node.prototype]
        if node.parent is not None and node.parent.children.get(node.path) is node:
            del node.parent.children[node.path]

    def _remove(self, node: Node, removed: list[int]) -> None:
        if self.nodes.get(node.path) is not node:
            return
        self._unlink(node)
        del self.nodes[node.path]
        self._dirty.pop(node.path, None)
        self._recent.pop(node.path, None)
        self._moved_times.pop(node.path, None)
        self._materials.pop(node.path, None)
        if node.id:
            self._items.pop(node.id, None)
            removed.append(node.id)

    # -- messages

    def item(self, node: Node) -> str:
        """The item as JSON, which is kept until it changes."""
        if node.text is None:
            data = dict(node.data)
            if node.geometry:
                data["geometry"] = node.geometry
            if node.kind in _DRAWN:
                data["material"] = node.material
            if node.subsets:
                data["subsets"] = [{"material": self.nodes[path].material if path in self.nodes else "", "start": first,
                                    "count": count} for path, first, count in node.subsets]
            if node.kind == "instancer":
                data["instances"] = {"prototypes": [self.nodes[one].id if one in self.nodes else 0 for one in node.prototypes]}
            if node.problems:
                data["problem"] = "; ".join(node.problems.values())
            node.text = wire.text(data)
        return node.text

    def _scene(self, nodes: typing.Sequence[Node], removed: list[int], new: list[dict], reset: bool, more: bool) -> str:
        head = json.dumps({"type": "scene", "reset": reset, "more": more, "remove": removed})[:-1]
        items = ",".join(map(self.item, nodes))
        return f'{head},"add":[{items}],"materials":[{",".join(map(wire.text, new))}]}}'

    def update(self, budget: float = 0.008) -> list[Frame]:
        """Takes what has changed. Returns the messages for all viewers."""
        if self.is_idle:
            return []
        end = time.perf_counter() + budget
        self._take_changes()
        built, removed = self._build(end)
        added: dict[int, Node] = {node.id: node for node in built}
        batch = self._read_dirty(added, time.perf_counter() + budget)
        frames: list[Frame] = []
        new, self._new_materials = list(self._new_materials.values()), {}
        waiting = [node for node in added.values() if self._items.get(node.id) is node]
        while waiting or removed or new:
            part, waiting = waiting[:ITEMS_OF_A_MESSAGE], waiting[ITEMS_OF_A_MESSAGE:]
            frames.append(self._scene(part, removed, new, False, bool(waiting) or self.is_building))
            removed, new = [], []
        if batch:
            frames.append(wire.batch(batch))
        return frames

    def since(self, version: int) -> bytes | None:
        """One batch in place of those after this one: the present state of what they have told."""
        nodes: dict[int, list[Node]] = collections.defaultdict(list)
        for path, (told, what) in reversed(self._recent.items()):
            if told <= version:
                break
            node = self.nodes.get(path)
            if node is not None and node.id:
                for one in _BATCHED:
                    if what & one:
                        nodes[one].append(node)
        moved = nodes[Dirty.MATRIX]
        sections = [(wire.MATRICES, len(moved), wire.ids(one.id for one in moved) + wire.floats([one.data["matrix"] for one in moved])),
                    self._seen(nodes[Dirty.VISIBLE]), self._coloured([one for one in nodes[Dirty.COLOUR] if "color" in one.data]),
                    self._shaped([one for one in nodes[Dirty.GEOMETRY] if one.geometry])]
        sections = [one for one in sections if one[1]] + [self._placed(one) for one in nodes[Dirty.INSTANCES] if one.instances]
        return wire.batch(sections) if sections else None

    def _told(self, nodes: typing.Iterable[Node], what: int) -> None:
        for node in nodes:
            before = self._recent.pop(node.path, (0, 0))[1]
            self._recent[node.path] = (self.version, before | what)

    @staticmethod
    def _seen(nodes: list[Node]) -> wire.Section:
        return wire.VISIBILITY, len(nodes), wire.ids(one.id for one in nodes) + bytes(one.data["visible"] for one in nodes)

    @staticmethod
    def _coloured(nodes: list[Node]) -> wire.Section:
        values = [[*one.data["color"], one.data.get("opacity", 1.0)] for one in nodes]
        return wire.COLOURS, len(nodes), wire.ids(one.id for one in nodes) + wire.floats(values)

    @staticmethod
    def _shaped(nodes: list[Node]) -> wire.Section:
        return (wire.GEOMETRIES, len(nodes),
                wire.ids(one.id for one in nodes) + b"".join(bytes.fromhex(one.geometry) for one in nodes))

    @staticmethod
    def _placed(node: Node) -> wire.Section:
        return wire.INSTANCES, (len(node.instances) - 4) // 52, node.instances

    def _read_dirty(self, added: dict[int, Node], end: float) -> list[wire.Section]:
        """Reads what is dirty. Whole items are put into `added`; returns the sections of the rest."""
        moved: list[Node] = []
        matrices: list[Gf.Matrix4d] = []
        seen: list[Node] = []
        coloured: list[Node] = []
        shaped: list[Node] = []
        placed: list[Node] = []
        dirty, self._dirty = self._dirty, {}
        for path, what in dirty.items():
            node = self.nodes.get(path)
            if node is None or not node.id or not node.prim:
                continue
            if what & Dirty.ITEM:
                self._read_item(node)
                added[node.id] = node
            if node.kind in _DRAWN and what & (Dirty.GEOMETRY | Dirty.COLOUR):
                if what & Dirty.GEOMETRY or not self._recoloured(node):
                    if not self._may_read(node, end):
                        self._mark(node, Dirty.GEOMETRY)
                    elif self._read_geometry(node) or not node.geometry:
                        added[node.id] = node
                    else:
                        shaped.append(node)
                else:
                    coloured.append(node)
            if what & Dirty.INSTANCES and node.kind == "instancer":
                self._read_instances(node, added)
                placed.append(node)
            if node.id in added:
                continue
            if what & Dirty.MATRIX:
                moved.append(node)
                matrices.append(self._matrix(node) or Gf.Matrix4d(1))
            if what & Dirty.VISIBLE:
                node.data["visible"], node.text = self._visible(node), None
                seen.append(node)
        if not (moved or seen or coloured or shaped or placed):
            return []
        self.version += 1
        sections = [self._moved(moved, matrices, added)] if moved else []
        coloured = [one for one in coloured if one.id not in added]
        for nodes, what, section in ((seen, Dirty.VISIBLE, self._seen), (coloured, Dirty.COLOUR, self._coloured),
                                     (shaped, Dirty.GEOMETRY, self._shaped)):
            self._told(nodes, what)
            sections.append(section(nodes))
        self._told(moved, Dirty.MATRIX)
        self._told(placed, Dirty.INSTANCES)
        return [one for one in sections if one[1]] + [self._placed(one) for one in placed]

    def _may_read(self, node: Node, end: float) -> bool:
        """Geometry that takes long to read is read more rarely, so that other things go on moving."""
        now = time.perf_counter()
        if now > end or now < self._moved_times.get(node.path, 0.0):
            return False
        if node.cost > 0.004:
            self._moved_times[node.path] = now + 4 * node.cost
        return True

    def _moved(self, nodes: list[Node], matrices: list[Gf.Matrix4d], added: dict[int, Node]) -> wire.Section:
        numbers = wire.rows(Vt.Matrix4dArray(matrices))  # ten times as fast as from a list
        finite = numpy.isfinite(numbers).all(axis=1)
        kept: list[int] = []
        for place, (node, row) in enumerate(zip(nodes, numbers.tolist())):
            if finite[place] and "matrix" not in node.problems:
                node.data["matrix"], node.text = row, None
                kept.append(place)
            else:
                self._read_item(node)
                added[node.id] = node
        return wire.MATRICES, len(kept), wire.ids(nodes[one].id for one in kept) + wire.floats(numbers[kept])

    def _recoloured(self, node: Node) -> bool:
        """Reads the colour again. False if it differs within the prim, or did: its geometry has it then."""
        found = geometry.colour(node.prim, self.time)
        if found is None or "color" not in node.data:
            return False
        node.data["color"], opacity = found
        node.text = None
        if opacity is not None:
            node.data["opacity"] = opacity
        else:
            node.data.pop("opacity", None)
        return True

    def _read_instances(self, node: Node, added: dict[int, Node]) -> None:
        before = node.problems.get("instances")
        node.problems.pop("instances", None)
        rows, indices = numpy.zeros((0, 12)), numpy.zeros(0, "i8")
        try:
            rows, indices = self._instances(node)
        except Exception as wrong:  # Tf errors of arrays that do not fit
            node.problems["instances"] = f"its instances cannot be read: {wrong}"
        if node.problems.get("instances") != before:
            node.text = None
            added[node.id] = node
        node.instances = wire.ids([node.id]) + wire.floats(rows) + numpy.ascontiguousarray(indices, "<u4").tobytes()

    def _instances(self, node: Node) -> tuple[numpy.ndarray, numpy.ndarray]:
        instancer = UsdGeom.PointInstancer(node.prim)
        indices = geometry.array(instancer.GetProtoIndicesAttr().Get(self.time), 0, "i8")
        if not len(indices):
            return numpy.zeros((0, 12)), indices
        found = instancer.ComputeInstanceTransformsAtTime(self.time, self.time, UsdGeom.PointInstancer.ExcludeProtoXform,
                                                          UsdGeom.PointInstancer.IgnoreMask)
        rows = wire.rows(found)
        mask = instancer.ComputeMaskAtTime(self.time)
        kept = numpy.ones(len(indices), bool) if not mask else numpy.array(mask, bool)
        if len(rows) != len(indices) or len(kept) != len(indices):
            raise ValueError(f"there are {len(rows)} positions for {len(indices)} instances")
        wrong = ~numpy.isfinite(rows).all(axis=1) | (indices < 0) | (indices >= len(node.prototypes))
        if wrong.any():
            node.problems["instances"] = f"{int(wrong.sum())} instances have no prototype or a matrix that is not finite"
            kept &= ~wrong
        rows, indices = rows[kept], indices[kept]
        if len(rows) > MOST_INSTANCES:
            node.problems["instances"] = f"{MOST_INSTANCES} of {len(rows)} instances are shown"
        return rows[:MOST_INSTANCES], indices[:MOST_INSTANCES]

    def everything(self) -> typing.Iterator[Frame]:
        """The whole scene for one viewer, as it is when each part is taken. The first message has "reset"."""
        nodes = [node for node in self._ordered() if node.id]
        first = True
        for start in range(0, max(len(nodes), 1), ITEMS_OF_A_MESSAGE):
            part = [node for node in nodes[start:start + ITEMS_OF_A_MESSAGE] if self.nodes.get(node.path) is node]
            more = start + ITEMS_OF_A_MESSAGE < len(nodes) or self.is_building
            yield self._scene(part, [], list(self._materials.values()) if first else [], first, more)
            first = False
            sections = [self._placed(node) for node in part if node.instances]
            if sections:
                yield wire.batch(sections)

    def _ordered(self) -> typing.Iterator[Node]:
        """All nodes, a parent before what is below it."""
        waiting = [node for node in self.nodes.values() if node.parent is None][::-1]
        while waiting:
            node = waiting.pop()
            yield node
            waiting.extend(reversed(node.children.values()))


_kinds: dict[str, str] = {"Xform": "xform", "Scope": "xform", "Mesh": "mesh", "Material": "material", "Shader": "shader",
                          "GeomSubset": "subset", "": "", "Camera": "camera", "PointInstancer": "instancer"}


def _kind_of(prim: Usd.Prim) -> str:
    """The kind of the items of a type; empty for one that is not drawn, below which others may be."""
    if prim.IsA(UsdShade.Material):
        return "material"
    if prim.IsA(UsdShade.Shader) or prim.IsA(UsdShade.NodeGraph):
        return "shader"
    if prim.IsA(UsdGeom.Subset):
        return "subset"
    if prim.IsA(UsdGeom.PointInstancer):
        return "instancer"
    if prim.IsA(UsdGeom.Camera):
        return "camera"
    if prim.IsA(UsdGeom.Gprim):
        return geometry.kind_of(prim)
    if prim.GetTypeName() == "Skeleton":
        return "skeleton"
    return "xform" if prim.IsA(UsdGeom.Imageable) else ""
