"""How long renaming a prim takes that has many descendants and many targets to correct, beside
Usd.NamespaceEditor on the same content in the same process.

    ./run bench namespace [--descendants 100000] [--targets 10000] [--rounds 5]

`rename` is a rename with the composition of all prims afterwards: by Usd.NamespaceEditor, whose Usd.Stage composes
them within the call, and by ours without a Usd.Stage, with the composition that it has itself. `onStage` is ours
on a Usd.Stage, which composes them besides. `batch` is ten renames of other prims in one batch. Medians."""

import argparse
import json
import statistics
import time

import usdlive
from pxr import Sdf, Usd
from usdlive import _usdlive


def make(descendants: int, targets: int) -> Usd.Stage:
    layer = Sdf.Layer.CreateAnonymous("bench.usda")
    with Sdf.ChangeBlock():
        big = Sdf.CreatePrimInLayer(layer, "/Big0")
        big.specifier = Sdf.SpecifierDef
        paths = []
        group = None
        for i in range(descendants):
            if i % 100 == 0:
                group = Sdf.PrimSpec(big, f"Group{i // 100}", Sdf.SpecifierDef)
            else:
                paths.append(Sdf.PrimSpec(group, f"Prim{i}", Sdf.SpecifierDef, "Xform").path)
        users = Sdf.CreatePrimInLayer(layer, "/Users")
        users.specifier = Sdf.SpecifierDef
        for i in range(targets):
            user = Sdf.PrimSpec(users, f"User{i}", Sdf.SpecifierDef)
            relationship = Sdf.RelationshipSpec(user, "r")
            relationship.targetPathList.explicitItems = [paths[i * 7 % len(paths)]]
    return Usd.Stage.Open(layer)


class LayerAlone:
    """A root layer that no Usd.Stage is open on, for the extension."""

    def __init__(self, layer: Sdf.Layer):
        self.layer = layer

    def root(self) -> str:
        return self.layer.identifier

    def session(self) -> str:
        return ""

    def view(self):
        return [], {}, [], {}

    def edit_target(self):
        return "", False

    def is_built_in(self, *_) -> bool:
        return False

    def is_in_prototype(self, _) -> bool:
        return False


def seconds(work) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def rename(editor, stage: Usd.Stage, old: str, new: str) -> None:
    assert editor.RenamePrim(stage.GetPrimAtPath(old), new)
    assert editor.ApplyEdits()


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--descendants", type=int, default=100_000)
    arguments.add_argument("--targets", type=int, default=10_000)
    arguments.add_argument("--rounds", type=int, default=5)
    options = arguments.parse_args()

    theirs, ours = (make(options.descendants, options.targets) for _ in range(2))
    alone = make(options.descendants, options.targets).GetRootLayer()
    headless = _usdlive.namespace.Editor(LayerAlone(alone), True, False)
    on_stage = usdlive.NamespaceEditor(ours)
    headless.prepare()
    on_stage.Prepare()
    times = {"usd": [], "alone": [], "onStage": []}

    def rename_alone(old: str, new: str) -> None:
        assert headless.move_prim(old, new) == ""
        assert headless.apply() == ([], [])
        headless.prepare()

    for i in range(options.rounds):
        old, new = f"/Big{i}", f"Big{i + 1}"
        times["usd"].append(seconds(lambda: rename(Usd.NamespaceEditor(theirs), theirs, old, new)))
        times["alone"].append(seconds(lambda: rename_alone(old, "/" + new)))
        times["onStage"].append(seconds(lambda: rename(on_stage, ours, old, new)))
        on_stage.Prepare()
    texts = {layer.ExportToString() for layer in (theirs.GetRootLayer(), ours.GetRootLayer(), alone)}
    assert len(texts) == 1

    def batch() -> None:
        for i in range(10):
            headless.move_prim(f"/Big{options.rounds}/Group{i}", f"/Big{options.rounds}/Renamed{i}")
        assert headless.apply() == ([], [])

    usd, ours_alone, ours_on_stage = (statistics.median(times[name]) for name in ("usd", "alone", "onStage"))
    print(json.dumps({
        "bench": "namespace", "descendants": options.descendants, "targets": options.targets,
        "renameRatio": round(ours_alone / usd, 3), "renameMs": round(ours_alone * 1000, 1),
        "usdMs": round(usd * 1000, 1), "onStageRatio": round(ours_on_stage / usd, 3),
        "batchOfTenMs": round(seconds(batch) * 1000, 1)}))


if __name__ == "__main__":
    main()
