"""Plays the same edits with Usd.NamespaceEditor and with ours, each on copies of its own, and compares verdicts,
layers and composed stages.

    python namespace_oracle.py FIRST LAST [SHOWN]

plays the seeds from FIRST to LAST, shows the first SHOWN differences of each 50 seeds, and counts the results. "more
corrected" are edits after which our layers differ only as docs/namespace-editing.md lists it; "composed" are those whose composed stages differ, too."""

import collections
import contextlib
import difflib
import json
import os
import pathlib
import random
import resource
import shutil
import subprocess
import sys
import tempfile

import namespace_scenes as scenes
import usdlive
from pxr import Sdf, Tf, Usd


class Opened:
    """A scene in a folder of its own, open as stages."""

    def __init__(self, scene: scenes.Scene, folder: pathlib.Path):
        shutil.rmtree(folder, ignore_errors=True)
        scene.write(folder)
        self.folder = folder
        self.editors = []
        self.layers = [Sdf.Layer.FindOrOpen(str(folder / name)) for name in scene.files]
        load = Usd.Stage.LoadAll if scene.load else Usd.Stage.LoadNone
        # After a change of a layer, Usd.Stage composes some prims below inactive ones, and its editor then corrects
        # paths to them. Hence the session layer has its content before the stage is opened.
        session = Sdf.Layer.CreateAnonymous("session.usda")
        if scene.session:
            session.ImportFromString(scene.session)
        self.stage = Usd.Stage.Open(self.layers[list(scene.files).index(scene.root)], session, load)
        self.dependents = [Usd.Stage.Open(str(folder / name)) for name in scene.dependents]

    def editor(self, kind, options=None):
        editor = kind(self.stage, options) if options else kind(self.stage)
        for dependent in self.dependents:
            editor.AddDependentStage(dependent)
        self.editors.append(editor)  # Usd's closes its dependent stages when it goes
        return editor

    def neutral(self, text: str) -> str:
        text = text.replace(str(self.folder), "")
        return text.replace(self.stage.GetSessionLayer().identifier, "session")

    def texts(self) -> list[str]:
        """All layers as text."""
        return [self.neutral(layer.ExportToString()) for layer in self.all_layers()]

    def meant(self) -> list[str]:
        """All fields of all layers, without overs in which nothing is."""
        fields = []
        for layer in self.all_layers():
            copy = Sdf.Layer.CreateAnonymous(".usda")
            copy.TransferContent(layer)
            copy.RemoveInertSceneDescription()
            fields += sorted(self.neutral(f"{layer.identifier} {path} {name} {value}")
                             for (path, name), value in _fields(copy).items())
        return fields

    def all_layers(self) -> list[Sdf.Layer]:
        return [*self.layers, self.stage.GetSessionLayer()]

    def objects(self) -> list[set[Sdf.Path]]:
        """The paths of the prims and properties of each stage."""
        return [{one.GetPath() for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(
            Usd.PrimAllPrimsPredicate)) for one in [prim, *prim.GetProperties()]} for stage in [self.stage, *self.dependents]]

    def composed(self) -> list[str]:
        """The prims of the stages, one a line. (Flattened stages differ by the numbers of their prototypes.)"""
        lines = []
        for stage in [self.stage, *self.dependents]:
            lines.append(f"stage {stage.GetRootLayer().GetDisplayName()}")
            for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
                lines.append(f"{prim.GetPath()} {prim.GetSpecifier()} {prim.GetTypeName()} {prim.IsInstance()}")
                for name in sorted(prim.GetAuthoredPropertyNames()):
                    lines.append(f"    {_property(prim.GetProperty(name))}")
        return lines


def _property(one: Usd.Property) -> str:
    if isinstance(one, Usd.Relationship):
        return f"{one.GetName()} -> {one.GetTargets()}"
    return f"{one.GetName()} = {one.Get()} <- {one.GetConnections()}"


def open_scene(scene: scenes.Scene, folder: pathlib.Path) -> Opened | None:
    """None: Usd itself fails on it."""
    try:
        return Opened(scene, folder)
    except Tf.ErrorException:
        return None


@contextlib.contextmanager
def quiet():
    """Without USD's warnings on the terminal."""
    sys.stderr.flush()
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


def play(opened: Opened, kind, edit) -> tuple[bool | None, str]:
    """The verdict with its reason, after applying. None: Usd itself fails, which is no verdict."""
    try:
        editor = opened.editor(kind)
        scenes.add(editor, edit)
        result = editor.CanApplyEdits()
        if not result:
            return False, opened.neutral(result.whyNot)
        return bool(editor.ApplyEdits()), ""
    except Tf.ErrorException as error:
        if "Invalid path" in str(error):
            return False, "invalid path"
        return None, str(error)
    except Tf.CppException as error:  # a property of a missing prim
        return None, str(error)


def _paths_of(value) -> list[Sdf.Path]:
    if isinstance(value, (Sdf.PathListOp, Sdf.ReferenceListOp, Sdf.PayloadListOp)):
        items = [item for items in (value.explicitItems, value.addedItems, value.prependedItems, value.appendedItems,
                                    value.deletedItems, value.orderedItems) for item in items]
        return [item if isinstance(item, Sdf.Path) else item.primPath for item in items
                if isinstance(item, Sdf.Path) or not item.assetPath]
    if isinstance(value, Sdf.PathExpression):
        paths = []
        value.Walk(lambda op, index: None, lambda reference: paths.append(reference.path),
                   lambda pattern: paths.append(pattern.GetPrefix()))
        return paths
    return []


def _fields(layer: Sdf.Layer) -> dict:
    fields = {}

    def visit(path):
        spec = layer.GetObjectAtPath(path)
        for name in spec.ListInfoKeys() if spec else []:
            if name != "subLayerOffsets":
                fields[path, name] = spec.GetInfo(name)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return fields


def is_composed(stage: Usd.Stage, layer: Sdf.Layer, path: Sdf.Path) -> bool:
    """Does the stage compose the spec, other than in an instance? Usd's editor corrects no other specs."""
    prim = stage.GetPrimAtPath(path.StripAllVariantSelections().GetPrimPath())
    return bool(prim) and not prim.IsInstanceProxy() and any(
        spec.layer == layer and spec.path == path.GetPrimOrPrimVariantSelectionPath() for spec in prim.GetPrimStack())


def loses_the_relocate(theirs: Sdf.Layer, ours: Sdf.Layer, new: Sdf.Path) -> bool:
    """Usd's editor loses a new relocate where others are below its source; ours has it besides."""
    more = [relocate for relocate in ours.relocates if relocate not in theirs.relocates]
    return (len(more) == 1 and more[0][1] == new
            and [relocate for relocate in ours.relocates if relocate != more[0]] == list(theirs.relocates))


def leaves_relocates(theirs: Sdf.Layer, ours: Sdf.Layer, stage: Usd.Stage) -> bool:
    """Usd's editor leaves some relocates from and to paths below a prim that moves, and loses the prims that they
    bring."""
    pairs = [(a, b) for a, b in zip(theirs.relocates, ours.relocates) if a != b]
    return (bool(pairs) and len(theirs.relocates) == len(ours.relocates) and
            all(any(one != other and not stage.GetObjectAtPath(one.GetParentPath()) for one, other in zip(a, b))
                for a, b in pairs))


def parents_gone(theirs: Sdf.Layer, new: Sdf.Path) -> list[Sdf.Path]:
    """Usd's editor deletes specs at the new place of the prim that it moves, and deletes that prim with them. Returns
    the paths above the new place, and that place, which the layer lacks."""
    return [path for path in new.GetPrefixes() if not theirs.GetObjectAtPath(path)] if new else []


def only_sounder(theirs: Sdf.Layer, ours: Sdf.Layer, stages: list[Usd.Stage], gone: list[set[Sdf.Path]],
                 unmoved: Sdf.Path, new: Sdf.Path) -> bool:
    """Do the layers differ in nothing but paths to what is no longer there, which theirs has left as they were, paths to
    what is not gone, which theirs has removed, and parents of the moved prim? `unmoved` is a prim that theirs has not
    moved, or empty."""
    layer, theirs, ours = theirs, _fields(theirs), _fields(ours)
    parents = parents_gone(layer, new)
    more = {path for path, _ in set(ours) - set(theirs)}
    if set(theirs) - set(ours) or not all(any(path.HasPrefix(parent) for parent in parents) for path in more):
        return False
    own = [stage for stage in stages if stage.HasLocalLayer(layer)]
    for key, value in theirs.items():
        if value == ours[key] or key[1] == "layerRelocates":
            continue
        left = set(_paths_of(value)) - set(_paths_of(ours[key]))
        kept = set(_paths_of(ours[key])) - set(_paths_of(value))
        if unmoved:
            left = {path for path in left if not path.HasPrefix(unmoved)}
        elif not left and not kept:
            return False
        if any(stage.GetObjectAtPath(path) and is_composed(stage, layer, key[0]) for stage in own for path in left):
            return False
        if any(path in paths and not any(path.HasPrefix(parent) for parent in parents)
               for stage, paths in zip(stages, gone) if stage in own for path in kept):
            return False
    return True


def exists_or_inactive(stage: Usd.Stage, path: Sdf.Path) -> bool:
    """Is there such an object, or is its parent inactive, so that the stage does not show it?"""
    parent = stage.GetPrimAtPath(path.GetParentPath())
    return bool(stage.GetObjectAtPath(path)) or bool(parent) and not parent.IsActive()


class Comparison:
    """Compares the results of one edit in our editor and in that of Usd."""

    def __init__(self, scene: scenes.Scene, edit, folder: pathlib.Path):
        self.scene, self.edit = scene, edit
        theirs, ours = Opened(scene, folder / "theirs"), Opened(scene, folder / "ours")
        before = theirs.objects()
        self.theirs = play(theirs, Usd.NamespaceEditor, edit)
        self.ours = play(ours, usdlive.NamespaceEditor, edit)
        gone = [paths - left for paths, left in zip(before, theirs.objects())]
        differing = [(a, b) for a, b in zip(theirs.all_layers(), ours.all_layers())
                     if theirs.neutral(a.ExportToString()) != ours.neutral(b.ExportToString())]
        self.is_same = not differing
        # Ours corrects paths in places that Usd's editor leaves as they are, and keeps paths to what is still there.
        old, new = Sdf.Path(edit[1]), Sdf.Path(edit[2]) if edit[2] else Sdf.Path()
        unmoved = old if any(loses_the_relocate(a, b, new) for a, b in differing) else Sdf.Path()
        self.corrects_more = all(
            only_sounder(a, b, [theirs.stage, *theirs.dependents], gone, unmoved, new) and
            (list(a.relocates) == list(b.relocates) or loses_the_relocate(a, b, new) or
             leaves_relocates(a, b, theirs.stage)) for a, b in differing)
        self.adds_relocate = any(list(a.relocates) != list(b.relocates) for a, b in differing)
        self.is_moved = not ours.stage.GetObjectAtPath(old) and (not edit[2] or exists_or_inactive(ours.stage, new))
        self.composes_same = self.is_same or theirs.composed() == ours.composed()
        self.texts, self.composed = [], []
        if not self.corrects_more:
            self.texts = list(zip(theirs.texts(), ours.texts()))
            self.composed = list(zip(theirs.composed(), ours.composed()))

    @property
    def is_known(self) -> bool:
        """Has Usd's editor a verdict?"""
        return self.theirs[0] is not None

    @property
    def is_refused_by_ours(self) -> bool:
        """Does Usd's editor report success, and the prim stays or is gone?"""
        return any(why in self.ours[1] for why in ("a relocate has moved out of it", "of the edit would remove"))

    def difference(self) -> str:
        """Empty: there is none."""
        if not self.is_known:
            return ""
        if self.is_refused_by_ours:
            return ""
        if self.theirs != self.ours:
            return f"verdict: {self.theirs} and ours {self.ours}"
        if self.adds_relocate and not self.is_moved:
            return "not moved"
        if self.corrects_more:
            return ""
        return "composed" if any(a != b for a, b in self.composed) else "layers"


def random_comparisons(seed: int, folder: pathlib.Path, edits: int = 4):
    """Comparisons of random edits of one random scene. Some of them are of a stage that an earlier edit, by Usd's
    editor, has given relocates."""
    scene = scenes.random_scene(seed)
    choice = random.Random(seed * 7919 + 1)
    with quiet():
        first = open_scene(scene, folder / f"seed{seed}")
        if not first:
            return
        if choice.random() < 0.4:
            for edit in scenes.random_edits(first.stage, choice, 3):
                play(first, Usd.NamespaceEditor, edit)
            scene.files = {name: first.layers[i].ExportToString() for i, name in enumerate(scene.files)}
            scene.session = first.stage.GetSessionLayer().ExportToString() if scene.session else ""
        for number, edit in enumerate(scenes.random_edits(first.stage, choice, edits)):
            # Sdf knows layers by their paths: no folder is used twice.
            if open_scene(scene, folder / f"trial{seed}-{number}"):
                yield Comparison(scene, edit, folder / f"seed{seed}-{number}")


def count(first: int, last: int, shown: int) -> collections.Counter:
    counts = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last):
            for comparison in random_comparisons(seed, pathlib.Path(folder)):
                difference = comparison.difference()
                counts[kind_of(comparison)] += 1
                if difference and shown > 0:
                    shown -= 1
                    show(seed, comparison)
    return counts


def kind_of(comparison: Comparison) -> str:
    if not comparison.is_known:
        return "unknown"
    if difference := comparison.difference():
        return difference.split(":")[0]
    if comparison.is_refused_by_ours:
        return "refused by ours"
    if comparison.is_same:
        return "same, applied" if comparison.ours[0] else "same, refused"
    return "more corrected" if comparison.composes_same else "more corrected, composed"


def show(seed: int, comparison: Comparison) -> None:
    difference = comparison.difference()
    print(f"--- seed {seed}: {comparison.edit}: {difference}")
    for a, b in [] if difference.startswith("verdict") else comparison.texts:
        for line in list(difflib.unified_diff(a.splitlines(), b.splitlines(), "theirs", "ours", n=2, lineterm=""))[:40]:
            print("   ", line)


def count_bounded(first: int, last: int, shown: int) -> collections.Counter:
    """Counts in a process of its own. Usd composes some stages without an end; their seeds are counted as endless."""
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))

    try:
        done = subprocess.run([sys.executable, __file__, "--here", str(first), str(last), str(shown)],
                              timeout=10 + (last - first), preexec_fn=limit, stdout=subprocess.PIPE, text=True,
                              stderr=subprocess.DEVNULL, check=True)
    except subprocess.SubprocessError:
        if last - first == 1:
            print(f"--- seed {first}: endless")
            return collections.Counter(endless=1)
        return sum((count_bounded(seed, seed + 1, shown) for seed in range(first, last)), collections.Counter())
    *text, counts = done.stdout.splitlines()
    print(*text, sep="\n", end="\n" if text else "", flush=True)
    return collections.Counter(json.loads(counts))


def main() -> None:
    here = sys.argv[1] == "--here"
    first, last, shown = (int(number) for number in [*sys.argv[1 + here:], "3"][:3])
    if here:
        print(json.dumps(count(first, last, shown)))
    else:
        pieces = [(at, min(at + 50, last)) for at in range(first, last, 50)]
        print(dict(sum((count_bounded(*piece, shown) for piece in pieces), collections.Counter())))


if __name__ == "__main__":
    main()
