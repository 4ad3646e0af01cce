"""namespace_chains.py FIRST LAST: batches of renames, moves and deletes whose names meet, on a Usd.Stage. Prints how many were applied.

After each batch, and after its Undo(), the stage shows what a newly opened one shows, the editor sees what a new editor sees, and every
prim can be edited. OpenUSD ends the process if one change block held such a batch."""

import random
import sys

import usdlive
from pxr import Sdf, Usd

NAMES = "abcd"


def make(pick):
    """Some prims with children, in a layer and its sublayer, with targets and internal arcs."""
    root, sublayer = Sdf.Layer.CreateAnonymous("root.usda"), Sdf.Layer.CreateAnonymous("sub.usda")
    root.subLayerPaths = [sublayer.identifier]
    paths = []
    for parent in ["/W"] + ["/W/" + one for one in NAMES]:
        for name in NAMES:
            if pick.random() < .6 and (parent == "/W" or parent in paths):
                paths.append("%s/%s" % (parent, name))
    for path in paths:
        for layer, specifier in ((root, Sdf.SpecifierDef), (sublayer, Sdf.SpecifierOver)):
            if layer == root or pick.random() < .5:
                Sdf.CreatePrimInLayer(layer, path).specifier = specifier
                Sdf.AttributeSpec(layer.GetPrimAtPath(path), path.replace("/", "_"), Sdf.ValueTypeNames.Int)
    users = Sdf.CreatePrimInLayer(root, "/Users")
    users.specifier = Sdf.SpecifierDef
    for number, path in enumerate(paths):
        Sdf.RelationshipSpec(users, "to%d" % number).targetPathList.explicitItems = [path]
        if pick.random() < .2:
            copy = Sdf.CreatePrimInLayer(root, "/Users/Copy%d" % number)
            copy.specifier = Sdf.SpecifierDef
            copy.inheritPathList.Prepend(path)
    return root, sublayer


def add_batch(editor, stage, pick):
    """Adds moves that reuse names: chains, cycles over a third name, and deletes."""
    now = [str(prim.GetPath()) for prim in stage.TraverseAll() if str(prim.GetPath()).startswith("/W/")]
    for _ in range(pick.randrange(2, 6)):
        if not now:
            return
        source = pick.choice(now)
        gone = [path for path in now if path == source or path.startswith(source + "/")]
        if pick.random() < .15:
            editor.DeletePrimAtPath(source)
            now = [path for path in now if path not in gone]
            continue
        parents = ["/W"] * 2 + [path for path in now if path.count("/") == 2 and path not in gone]
        free = [path for path in ("%s/%s" % (parent, name) for parent in parents for name in NAMES + "xy") if path not in now]
        target = pick.choice(free)
        editor.MovePrimAtPath(source, target)
        now = [target + path[len(source):] if path in gone else path for path in now]


def shown(stage):
    """Sorted, because a Usd.Stage does not always follow the order of children that its layers agree on only together."""
    return sorted((str(prim.GetPath()), sorted(prim.GetPropertyNames())) for prim in stage.TraverseAll())


def check(stage, editor, when):
    afresh = Usd.Stage.Open(stage.GetRootLayer())
    assert shown(stage) == shown(afresh), "%s: %s instead of %s" % (when, shown(stage), shown(afresh))
    for prim in stage.TraverseAll():
        answers = []
        for one in (editor, usdlive.NamespaceEditor(stage)):
            one.MovePrimAtPath(prim.GetPath(), prim.GetPath().ReplaceName("renamed"))
            answers.append(one.CanApplyEdits().whyNot)
            one.ClearEdits()
        assert answers[0] == answers[1], "%s: the editor says of %s %r, a new one %r" % (when, prim, *answers)


def edit_all(stage):
    for prim in list(stage.TraverseAll()):
        prim.SetTypeName("Xform")
        prim.CreateAttribute("x", Sdf.ValueTypeNames.Double).Set(1.0)
    children = [prim.GetPath().AppendChild("New") for prim in stage.TraverseAll()]
    for path in children:
        stage.DefinePrim(path)
    for path in children:
        stage.RemovePrim(path)


def play(seed):
    pick = random.Random(seed)
    layers = make(pick)
    stage = Usd.Stage.Open(layers[0])
    editor = usdlive.NamespaceEditor(stage)
    applied = 0
    for _ in range(3):
        before = [layer.ExportToString() for layer in layers]
        add_batch(editor, stage, pick)
        if not editor.ApplyEdits():
            assert before == [layer.ExportToString() for layer in layers]
            continue
        applied += 1
        check(stage, editor, "applied")
        if pick.random() < .5:
            kept = editor.Undo()
            assert kept == [], kept
            assert before == [layer.ExportToString() for layer in layers], "Undo() leaves something else"
            check(stage, editor, "undone")
        edit_all(stage)
        check(stage, editor, "edited")
    return applied


if __name__ == "__main__":
    count = 0
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        print("seed", seed, flush=True)
        count += play(seed)
    print(count)
