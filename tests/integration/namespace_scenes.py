"""Stages with arcs of all kinds for the tests of namespace edits, written as files: by hand, and random from a
seed. Edits of them are tuples ("delete" or "move", path, new path)."""

import dataclasses
import random
import re

from pxr import Sdf, Usd

PRIM_NAMES = ["A", "B", "C", "D"]


@dataclasses.dataclass
class Scene:
    """Files by name. `root` is edited; `dependents` are stages that use it. `session` is content of the session
    layer; `edits` are tried each on its own."""

    files: dict[str, str]
    edits: list[tuple[str, str, str]] = dataclasses.field(default_factory=list)
    root: str = "root.usda"
    dependents: tuple[str, ...] = ()
    session: str = ""
    load: bool = True
    name: str = ""

    def write(self, folder) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.files.items():
            (folder / name).write_text(text)


_STATEMENT = re.compile(
    r"(\w*)\s+(?=(?:def|over|class|rel|double|pathExpression|uniform|custom|variantSet|prepend|variants|payload|"
    r"inherits|instanceable)\b)")


def lines(text: str) -> str:
    """Puts each statement on a line of its own, as the format wants it."""
    text = re.sub(r"([{(])\s+", r"\1\n", text)
    text = re.sub(r"\s+([})])", r"\n\1", text)
    text = re.sub(r"}\s+", "}\n", text)
    return _STATEMENT.sub(lambda found: found[0] if found[1] in ("custom", "uniform", "prepend") else found[1] + "\n",
                          text)


def usda(body: str, metadata: str = "") -> str:
    return f"#usda 1.0\n(\n{metadata}\n)\n{lines(body)}\n"


class _RandomScene:
    """A root with a sublayer, a referenced asset and a stage that references the root."""

    def __init__(self, seed: int):
        self.random = random.Random(seed)
        self.seed = seed

    def make(self) -> Scene:
        choice = self.random
        asset = Sdf.Layer.CreateAnonymous("asset.usda")
        self._fill(asset, ["Asset", "Other"], depth=2, count=7, arcs=0.3, external=None)
        asset.defaultPrim = "Asset"
        sub = Sdf.Layer.CreateAnonymous("sub.usda")
        root = Sdf.Layer.CreateAnonymous("root.usda")
        roots = ["World", "Class", "Set"]
        self._fill(sub, roots, depth=2, count=8, arcs=0.5, external="asset.usda")
        self._fill(root, roots, depth=2, count=10, arcs=0.6, external="asset.usda")
        root.subLayerPaths.append("./sub.usda")
        root.subLayerOffsets[0] = Sdf.LayerOffset(choice.choice([0, 10]), choice.choice([1, 2]))
        if choice.random() < 0.5:
            root.defaultPrim = "World"
        files = {"asset.usda": asset.ExportToString(), "sub.usda": sub.ExportToString(),
                 "root.usda": root.ExportToString()}
        dependents = ()
        if choice.random() < 0.4:
            user = Sdf.Layer.CreateAnonymous("user.usda")
            self._fill(user, ["World", "Shot"], depth=2, count=6, arcs=0.3, external="root.usda")
            shot = Sdf.CreatePrimInLayer(user, "/Shot")
            shot.specifier = Sdf.SpecifierDef
            shot.referenceList.prependedItems = [
                Sdf.Reference("./root.usda", choice.choice([Sdf.Path("/World"), Sdf.Path("/Set")]))]
            files["user.usda"] = user.ExportToString()
            dependents = ("user.usda",)
        session = ""
        if choice.random() < 0.3:
            layer = Sdf.Layer.CreateAnonymous("session.usda")
            self._fill(layer, roots, depth=2, count=3, arcs=0.0, external=None, overs=True)
            session = layer.ExportToString()
        return Scene(files, dependents=dependents, session=session, load=choice.random() < 0.85,
                     name=f"seed {self.seed}")

    def _path(self, roots: list[str], depth: int) -> Sdf.Path:
        choice = self.random
        path = Sdf.Path("/" + choice.choice(roots))
        for _ in range(choice.randint(0, depth)):
            path = path.AppendChild(choice.choice(PRIM_NAMES))
        return path

    def _fill(self, layer, roots, depth, count, arcs, external, overs=False) -> None:
        choice = self.random
        with Sdf.ChangeBlock():
            for name in roots if not overs else []:
                spec = Sdf.CreatePrimInLayer(layer, f"/{name}")
                spec.specifier = Sdf.SpecifierClass if name == "Class" else Sdf.SpecifierDef
            for _ in range(count):
                path = self._path(roots, depth)
                if choice.random() < 0.15:
                    owner = path
                    prim = Sdf.CreatePrimInLayer(layer, owner)
                    prim.specifier = Sdf.SpecifierDef
                    if "look" not in prim.variantSets:
                        variants = Sdf.VariantSetSpec(prim, "look")
                        prim.variantSetNameList.prependedItems = ["look"]
                        for variant in ("red", "blue"):
                            Sdf.VariantSpec(variants, variant)
                    prim.variantSelections["look"] = "red"
                    path = owner.AppendVariantSelection("look", choice.choice(["red", "blue"])).AppendChild(
                        choice.choice(PRIM_NAMES))
                prim = Sdf.CreatePrimInLayer(layer, path)
                prim.specifier = (Sdf.SpecifierOver if overs else
                                  choice.choice([Sdf.SpecifierDef, Sdf.SpecifierDef, Sdf.SpecifierOver]))
                if choice.random() < 0.3:
                    prim.typeName = choice.choice(["Sphere", "Xform", "Material"])
                self._properties(prim, roots, depth)
                if choice.random() < arcs:
                    self._arc(prim, roots, depth, external)
                if choice.random() < 0.06:
                    prim.SetInfo("active", False)
                if choice.random() < 0.12:
                    prim.SetInfo("instanceable", True)

    def _properties(self, prim, roots, depth) -> None:
        choice = self.random
        if choice.random() < 0.6:
            name = choice.choice(["p", "q", "radius"])
            if name not in prim.properties:
                attribute = Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Double)
                attribute.default = float(choice.randint(0, 9))
                if choice.random() < 0.4:
                    attribute.connectionPathList.prependedItems = [
                        self._path(roots, depth).AppendProperty(choice.choice(["p", "q"]))]
        if choice.random() < 0.6:
            name = choice.choice(["r", "s"])
            if name not in prim.properties:
                relationship = Sdf.RelationshipSpec(prim, name)
                targets = list({self._target(roots, depth) for _ in range(choice.randint(1, 3))})
                targets.sort()
                if choice.random() < 0.5:
                    relationship.targetPathList.explicitItems = targets
                else:
                    relationship.targetPathList.appendedItems = targets
        if choice.random() < 0.15 and "e" not in prim.properties:
            attribute = Sdf.AttributeSpec(prim, "e", Sdf.ValueTypeNames.PathExpression)
            attribute.default = Sdf.PathExpression(f"{self._path(roots, depth)}//* + {self._path(roots, depth)}")

    def _target(self, roots, depth) -> Sdf.Path:
        path = self._path(roots, depth)
        return path.AppendProperty("p") if self.random.random() < 0.2 else path

    @staticmethod
    def _below(prim, roots) -> list[str]:
        """The roots that an arc may lead to. Cycles would make Usd compose without an end."""
        order = ["Other", "Asset", "Class", "World", "Set", "Shot"]
        own = str(prim.path.GetPrefixes()[0])[1:].split("{")[0]
        return [root for root in roots if order.index(root) < order.index(own)]

    def _arc(self, prim, roots, depth, external) -> None:
        choice = self.random
        kind = choice.choice(["reference", "reference", "payload", "inherit", "specialize", "internal"])
        below = self._below(prim, roots)
        if not below and (kind in ("inherit", "specialize", "internal") or not external):
            return
        target = self._path(below, 1) if below else None
        outside = Sdf.Path("/" + choice.choice(["Asset", "Other", "Asset/A", "Asset/B"]))
        if external == "root.usda":
            outside = self._path(["World", "Set"], 1)
        file = f"./{external}" if external else ""
        if kind == "inherit":
            prim.inheritPathList.prependedItems = [target]
        elif kind == "specialize":
            prim.specializesList.prependedItems = [target]
        elif kind == "payload" and external:
            prim.payloadList.prependedItems = [Sdf.Payload(file, outside)]
        elif kind == "reference" and external:
            prim.referenceList.prependedItems = [Sdf.Reference(file, outside)]
        elif below:
            prim.referenceList.prependedItems = [Sdf.Reference("", target)]


def random_scene(seed: int) -> Scene:
    return _RandomScene(seed).make()


def random_edits(stage: Usd.Stage, choice: random.Random, count: int) -> list[tuple[str, str, str]]:
    """Edits of what the stage has, and of some that it has not."""
    prims = [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(
        Usd.PrimAllPrimsPredicate)) if not prim.IsPseudoRoot()]
    paths = [prim.GetPath() for prim in prims]
    edits = []
    for _ in range(count):
        if not paths:
            break
        path = choice.choice(paths)
        if choice.random() < 0.05:
            path = path.AppendChild("Missing")
        names = stage.GetPrimAtPath(path).GetPropertyNames() if stage.GetPrimAtPath(path) else []
        if names and choice.random() < 0.25:
            old = path.AppendProperty(choice.choice(names))
            if choice.random() < 0.3:
                edits.append(("delete", str(old), ""))
            else:
                parent = path if choice.random() < 0.5 else choice.choice(paths)
                edits.append(("move", str(old), str(parent.AppendProperty(choice.choice(["p", "q", "r", "new"])))))
        elif choice.random() < 0.25:
            edits.append(("delete", str(path), ""))
        else:
            parent = path.GetParentPath() if choice.random() < 0.5 else choice.choice(
                paths + [Sdf.Path.absoluteRootPath])
            name = choice.choice(["New", "New", "Fresh", *PRIM_NAMES])
            edits.append(("move", str(path), str(parent.AppendChild(name))))
    return edits


def add(editor, edit) -> None:
    """Queues the edit in ours or in Usd.NamespaceEditor."""
    verb, old, new = edit
    is_property = Sdf.Path(old).IsPropertyPath()
    if verb == "delete":
        (editor.DeletePropertyAtPath if is_property else editor.DeletePrimAtPath)(old)
    else:
        (editor.MovePropertyAtPath if is_property else editor.MovePrimAtPath)(old, new)
