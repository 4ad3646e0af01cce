"""Tests edits that others made step by step, and that arrive in one frame: no editor dies of them, and its stage then
shows what a newly opened stage shows.

The author has no stage: a single change of variables can end a process with a Usd.Stage (OpenUSD issue 4179).
"""

import os
import random

import pytest
import usdlive
from pxr import Sdf

SEEDS = int(os.environ.get("USDLIVE_FRAME_SEEDS", "3"))
FIRST = int(os.environ.get("USDLIVE_SEED", "0"))
FRAMES = 12

SIDE = 'over "main"\n{\n double %s = 1\n double t.timeSamples = { 1: 1, 10: 10 }\n def "K%s"\n {\n def "D"\n {\n }\n }\n}\n'
FILES = {
    "root.usda": ('def "main" (\n prepend references = @./asset.usda@\n)\n{\n def "Own"\n {\n }\n}\n'
                  'def "loaded" (\n prepend payload = @./part.usda@\n)\n{\n}\n', "subLayers = [@./one.usda@]"),
    "asset.usda": ('def "main" (\n prepend references = @./part.usda@\n)\n{\n def "P"\n {\n def "Q"\n {\n }\n }\n}\n'
                   'def "other"\n{\n def "O"\n {\n }\n}\n',
                   'defaultPrim = "main"\nexpressionVariables = {\n string V = "data"\n}\nsubLayers = [@./data.usda@]'),
    "part.usda": ('def "main"\n{\n def "Deep"\n {\n def "Er"\n {\n }\n }\n}\ndef "other"\n{\n}\n',
                  'defaultPrim = "main"\nexpressionVariables = {\n string V = "data"\n}'),
    **{name + ".usda": (SIDE % (name, name), "") for name in ("one", "two", "data", "extra")},
}
# No layer uses itself.
SUBLAYERS = {"root.usda": ("one", "two", "data", "extra"), "asset.usda": ("data", "extra", "two"),
             "part.usda": ("extra", "data"), "one.usda": ("two", "extra"), "data.usda": ("extra",)}
VARIABLES = [{}, {"V": "data"}, {"V": "extra"}, {"W": "one"}, {"V": "data", "W": "one"}]
RELOCATES = [("/main/P", "/main/P2"), ("/main/P/Q", "/main/Q2"), ("/main/Deep", "/main/Deep2"), ("/main/P", "/main/Own/P")]
REFERENCES = [Sdf.Reference("./part.usda"), Sdf.Reference("./part.usda", "/other"), Sdf.Reference("./`${V}`.usda", "/main"), None]


def change_sublayers(layer, name, pick, arguments):
    paths = list(layer.subLayerPaths)
    if paths and pick.random() < .3:
        layer.subLayerOffsets[pick.randrange(len(paths))] = Sdf.LayerOffset(pick.choice([0, 1, 10]), pick.choice([1, 2]))
        return
    if paths and pick.random() < .5:
        paths.remove(pick.choice(paths))
    unused = [path for path in (f"./{one}.usda{arguments}" for one in SUBLAYERS[name]) if path not in paths]
    if unused and pick.random() < .7:
        paths.insert(pick.randrange(len(paths) + 1), pick.choice(unused))
    layer.subLayerPaths = paths


def change_rate(layer, pick):
    field = pick.choice(["timeCodesPerSecond", "framesPerSecond"])
    rate = pick.choice([None, 12.0, 24.0, 48.0])
    if rate is None:
        layer.pseudoRoot.ClearInfo(field)
    else:
        layer.pseudoRoot.SetInfo(field, rate)


def change(layers, pick, arguments=""):
    """Makes one edit of a root. Sublayers and references have the file format arguments."""
    name = pick.choice(["root.usda"] * 5 + ["asset.usda"] * 3 + ["part.usda", "one.usda", "data.usda"])
    layer = layers[name]
    what = pick.choice(["sublayers", "sublayers", "variables", "variables", "rate", "default", "relocates", "arc"])
    if what == "sublayers":
        change_sublayers(layer, name, pick, arguments)
    elif what == "variables":
        if variables := pick.choice(VARIABLES):
            layer.expressionVariables = variables
        else:
            layer.ClearExpressionVariables()
    elif what == "rate":
        change_rate(layer, pick)
    elif what == "default":
        layer.defaultPrim = pick.choice(["main", "other"])
    elif what == "relocates" and name == "root.usda":
        layer.relocates = pick.sample(RELOCATES, pick.randrange(2))
    elif what == "arc" and name in ("root.usda", "asset.usda"):
        reference = pick.choice(REFERENCES if name == "root.usda" else REFERENCES[:2])
        if reference and not reference.assetPath.startswith("./`"):
            reference = Sdf.Reference(reference.assetPath + arguments, reference.primPath)
        layer.GetPrimAtPath("/main").referenceList.prependedItems = [reference] if reference else []
    return what


def write(folder, arguments=""):
    for name, (body, metadata) in FILES.items():
        text = "#usda 1.0\n(\n%s\n)\n%s" % (metadata, body)
        (folder / name).write_text(text.replace(".usda@", f".usda{arguments}@"))


@pytest.mark.parametrize("arguments", ["", ":SDF_FORMAT_ARGS:who=a"])
@pytest.mark.parametrize("seed", sorted({*range(FIRST, FIRST + SEEDS), 39}))  # 39 found sublayers that were not apart
def test_edits_of_layer_stacks(seed, arguments, project, serve, editor):
    write(project, arguments)
    server, pick = serve(project), random.Random(seed)
    follower = editor(server, "bo", "root.usda")
    follower.run("for name in live.layers(): live.open_layer(name)")
    with usdlive.connect(server.url, user="ada") as live:
        layers = {name: live.open_layer(name) for name in FILES}
        for _ in range(FRAMES):
            for _ in range(pick.randrange(1, 6)):
                change(layers, pick, arguments)
                live.tick()
            assert live.flush(20)
            follower.catch_up(live.revision)
            follower.run("check_stage()")


def test_variables_that_a_referenced_layer_has_with_the_same_values(project, serve, editor):
    """The layer that the other one gets its variables from changes, and their values do not."""
    write(project)
    server = serve(project)
    followers = [editor(server, user, "root.usda") for user in ("bo", "cy")]
    with usdlive.connect(server.url, user="ada") as live:
        layer = live.open_layer("root.usda")
        for variables in ({"V": "data"}, {"V": "data", "W": "one"}, {"V": "data"}):
            layer.expressionVariables = variables
            assert live.flush(20)
            for follower in followers:
                follower.catch_up(live.revision)
                follower.run("check_stage()")
                assert follower.run("result = dict(layer('root.usda').expressionVariables)") == variables
        layer.ClearExpressionVariables()
        assert live.flush(20)
        for follower in followers:
            follower.catch_up(live.revision)
            assert "expressionVariables" not in follower.text("root.usda")
