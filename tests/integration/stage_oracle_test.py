"""Compares composed stages with pxr.Usd: every arc with every kind of opinion, stages from seeds, stages of packages.

Both sides compose with one thread. With several threads, the instance that a prototype shows may differ, in pxr.Usd too.
"""

import importlib.util
import itertools
import json
import os
import pathlib
import subprocess
import sys

import pytest
from stage_dump import differences

HERE = pathlib.Path(__file__).parent
SEEDS = int(os.environ.get("USDLIVE_STAGE_SEEDS", "200"))
FIRST = int(os.environ.get("USDLIVE_SEED", "0"))
AT_ONCE = 100
ONE_THREAD = {**os.environ, "PXR_WORK_THREAD_LIMIT": "1"}

# For each kind of opinion: metadata and content of the weaker opinion, then of the stronger one.
OPINIONS = {
    "nothing": ("", "", "", ""),
    "value": ("", "custom double v = 1", "", "double v = 2"),
    "time samples": ("", "custom double v.timeSamples = { 0: 1, 10: 3 }", "", "double v = 2"),
    "stronger samples": ("", "custom float v = 1", "", "float v.timeSamples = { 1: 1, 5: None, 9: 4 }"),
    "block": ("", "custom int v = 1", "", "int v = None"),
    "samples of arrays": ("", "float[] a.timeSamples = { 0: [1, 2], 4: [3, 4], 8: [1] }", "", "custom string s = \"x\""),
    "held": ("", "custom token t.timeSamples = { 0: \"x\", 10: \"y\" }", "", "bool b = 1"),
    "time code": ("", "timecode t = 5\ntimecode[] u = [1, 2]", "", "custom rel r"),
    "spline": ("", "double v.spline = {\n1: 0; post linear,\n10: 9; post held,\n}", "", ""),
    "asset": ("", "asset f = @./a.usda@\nasset[] g = [@./gone.png@, @@]", "", "asset h = @`\"./${NAME}.usda\"`@"),
    "dictionary": ("customData = { int a = 1\n dictionary d = { string s = \"x\"\n double n = 1.5 } }", "",
                   "customData = { int b = 2\n dictionary d = { string s = \"y\" } }", ""),
    "schemas": ("prepend apiSchemas = [\"CollectionAPI:one\", \"UnheardAPI\"]", "", "append apiSchemas = [\"SkelBindingAPI\"]", ""),
    "schemas deleted": ("prepend apiSchemas = [\"CollectionAPI:one\", \"GeomModelAPI\"]", "", "delete apiSchemas = [\"GeomModelAPI\"]", ""),
    "targets": ("", "rel r = [</Target/Child>, </Source/Child>, </Local>]\ncustom double v.connect = </Source/Child.w>", "",
                "prepend rel r = </Other.v>\ndelete rel r = </Local>"),
    "kind": ("kind = \"group\"", "", "kind = \"component\"", ""),
    "inactive": ("active = false", "", "", ""),
    "active again": ("active = false", "", "active = true", ""),
    "instance": ("instanceable = true", "custom int v = 1", "", "custom int w = 2"),
    "order": ("", "reorder properties = [\"c\", \"a\"]\nint a = 1\nint b = 2\nint c = 3", "", "reorder nameChildren = [\"Second\", \"Child\"]"),
    "property metadata": ("", "double v = 1 (\ncustomData = { int k = 1 }\ndoc = \"one\"\ninterpolation = \"vertex\")", "",
                          "double v (\ncustomData = { int l = 2 }\ndisplayName = \"V\")"),
    "list": ("prepend inactiveIds = [1, 2]", "", "append inactiveIds = [3]", ""),
    "list added": ("add inactiveIds = [1, 2]", "", "add inactiveIds = [3, 1]", ""),
    "list added to": ("prepend inactiveIds = [1, 2]", "", "add inactiveIds = [3]", ""),
    "list after one added": ("add inactiveIds = [1, 2]", "", "append inactiveIds = [1, 3]", ""),
    "list reordered": ("inactiveIds = [1, 2, 3]", "", "reorder inactiveIds = [3, 1]", ""),
    "schemas added": ("add apiSchemas = [\"CollectionAPI:one\", \"GeomModelAPI\"]", "", "add apiSchemas = [\"SkelBindingAPI\"]", ""),
    "schemas reordered": ("prepend apiSchemas = [\"CollectionAPI:one\", \"GeomModelAPI\"]", "",
                          "reorder apiSchemas = [\"GeomModelAPI\", \"CollectionAPI:one\"]", ""),
    "variants added": ("variants = { string m = \"x\" }\nadd variantSets = \"m\"",
                       "variantSet \"m\" = {\n\"x\" {\ncustom int m = 1\n}\n}",
                       "variants = { string n = \"y\" }\nadd variantSets = [\"n\", \"m\"]",
                       "variantSet \"n\" = {\n\"y\" {\ncustom int n = 1\n}\n}"),
    "expression": ("", "pathExpression e = \"/Source//Child + %_\"", "", "pathExpression e = \"/Other %_\""),
    "uniform": ("", "uniform token v = \"x\"", "", "token v = \"y\""),
}
ARCS = {
    "sublayer": "",
    "reference": "prepend references = @./a.usda@</Source>",
    "reference with offset": "prepend references = @./a.usda@</Source> (offset = 10; scale = 2)",
    "default prim": "prepend references = @./a.usda@",
    "internal reference": "prepend references = </Source>",
    "payload": "prepend payload = @./a.usda@</Source>",
    "inherit": "prepend inherits = </Source>",
    "specialize": "prepend specializes = </Source>",
    "variant": "",
    "expression": "prepend references = @`\"./${NAME}.usda\"`@</Source>",
}
HEADER = "#usda 1.0\n(\n    defaultPrim = \"Source\"\n    expressionVariables = { string NAME = \"a\" }\n%s)\n"
CHILDREN = "def Xform \"Child\" {\n    custom double w = 4\n}\ndef \"Second\" {\n}\n"
BROKEN = {
    "no such file": "def \"A\" (references = @./gone.usda@) {\n}\n",
    "no such prim": "def \"A\" (references = @./a.usda@</Gone>) {\n}\n",
    "no such prim here": "def \"A\" (references = </Gone>) {\n}\n",
    "no such class": "def \"A\" (inherits = </Gone>) {\n}\n",
    "itself": "def \"A\" (references = </A>) {\n}\n",
    "each other": "def \"A\" (references = </B>) {\n}\ndef \"B\" (references = </A>) {\n}\n",
    "ancestor": "def \"A\" {\n    def \"B\" (references = </A>) {\n    }\n}\n",
    "child": "def \"A\" (references = </A/B>) {\n    def \"B\" {\n    }\n}\n",
    "inherits itself": "def \"A\" (inherits = </A>) {\n}\n",
    "inherits in a circle": "class \"A\" (inherits = </B>) {\n}\nclass \"B\" (inherits = </A>) {\n}\n",
    "specializes in a circle": "class \"A\" (specializes = </B>) {\n}\nclass \"B\" (specializes = </A>) {\n}\n",
    "payload of itself": "def \"A\" (payload = @./root.usda@</A>) {\n}\n",
    "root of itself": "def \"A\" (references = @./root.usda@</A/B>) {\n}\n",
    "no default prim": "def \"A\" (references = @./plain.usda@) {\n}\n",
    "unreadable": "def \"A\" (references = @./bad.usda@) {\n}\n",
    "unset variable": "def \"A\" (references = @`\"./${UNSET}.usda\"`@) {\n}\n",
    "bad expression": "def \"A\" (references = @`${`@) {\n}\n",
    "absent variant": "def \"A\" (variants = { string v = \"gone\" }\nprepend variantSets = \"v\") {\n    variantSet \"v\" = {\n"
                      "        \"on\" {\n            int a = 1\n        }\n    }\n}\n",
    "targets to nothing": "def \"A\" {\n    rel r = [</Gone>, </A/Gone.x>]\n    int a.connect = </Gone.x>\n}\n",
    "types that disagree": "def \"A\" (references = </B>) {\n    int a = 1\n}\ndef \"B\" {\n    double a = 2\n    rel r\n}\n",
    "kinds that disagree": "def \"A\" (references = </B>) {\n    int r = 1\n}\ndef \"B\" {\n    rel r\n}\n",
    "sublayer that is gone": ("subLayers = [@./gone.usda@]\n", "def \"A\" {\n}\n"),
    "sublayer in a circle": ("subLayers = [@./root.usda@]\n", "def \"A\" {\n}\n"),
    "relocates": ("relocates = { </A/B>: </A/C>, </A/C>: </A/D> }\n", "def \"A\" (references = @./a.usda@</Source>) {\n}\n"),
    "relocated child": ("relocates = { </A/Child>: </A/Moved> }\n", "def \"A\" (references = @./a.usda@</Source>) {\n}\n"),
    "relocated to nothing": ("relocates = { </A/Child>: <> }\n", "def \"A\" (references = @./a.usda@</Source>) {\n}\n"),
    "instance in itself": "def \"A\" (instanceable = true\nreferences = </B>) {\n}\ndef \"B\" {\n    def \"C\" (instanceable = true\n"
                          "references = </D>) {\n    }\n}\ndef \"D\" {\n    def \"E\" {\n    }\n}\n",
    "legacy frames": ("startFrame = 1\nendFrame = 5\n", "def \"A\" {\n}\n"),
    "a legacy frame and a time code": ("startFrame = 1\nendTimeCode = 5\n", "def \"A\" {\n}\n"),
    "fallback type": ("fallbackPrimTypes = { token[] Unheard = [\"AlsoUnheard\", \"Scope\"] }\n", "def Unheard \"A\" {\n}\n"),
}


def spec(word, name, metadata, content):
    return "%s \"%s\" (\n%s\n) {\n%s\n}\n" % (word, name, metadata, content)


def enumerated():
    """Yields (name, files) for each arc with each kind of opinion, alone and with a stronger opinion."""
    for (arc, clause), (what, (facts, content, over_facts, over)) in itertools.product(ARCS.items(), OPINIONS.items()):
        for stronger in (False, True):
            if stronger and not (over_facts or over):
                continue
            weak = spec("def Mesh", "Source", facts, content + "\n" + CHILDREN)
            mine = (over_facts, over) if stronger else ("", "")
            files = {"a.usda": HEADER % "" + weak}
            local = "def \"Local\" {\n}\ndef \"Other\" {\n}\n"
            if arc == "sublayer":
                files["root.usda"] = HEADER % "    subLayers = [@./a.usda@ (offset = 5)]\n" + spec("over", "Source", *mine) + local
            elif arc == "variant":
                variant = "variantSet \"v\" = {\n\"on\" (\n%s\n) {\n%s\n}\n\"off\" {\n}\n}\n" % (facts, content + "\n" + CHILDREN)
                chosen = "variants = { string v = \"on\" }\nprepend variantSets = \"v\"\n"
                files["root.usda"] = HEADER % "" + spec("def Xform", "Target", chosen + mine[0], mine[1] + "\n" + variant) + local
            else:
                here = weak if arc in ("internal reference", "inherit", "specialize") else ""
                files["root.usda"] = HEADER % "" + spec("def", "Target", clause + "\n" + mine[0], mine[1]) + here + local
            yield "%s, %s%s" % (arc, what, ", overridden" if stronger else ""), files


def broken():
    for name, content in BROKEN.items():
        header, prims = content if isinstance(content, tuple) else ("", content)
        yield name, {
            "root.usda": "#usda 1.0\n(\n%s)\n" % header + prims,
            "a.usda": HEADER % "" + spec("def Mesh", "Source", "", "int a = 1\n" + CHILDREN),
            "plain.usda": "#usda 1.0\ndef \"P\" {\n}\n",
            "bad.usda": "#usda 1.0\ndef {",
        }


def handmade(folder):
    lines = []
    for number, (name, files) in enumerate(itertools.chain(enumerated(), broken())):
        base = folder / ("hand%03d" % number)
        base.mkdir()
        for file, text in files.items():
            (base / file).write_text(text)
        (base / "name").write_text(name)
        lines.append((str(base / "root.usda"), "", str(base), str(base / "want.json")))
    return lines


def of_package(name, folder):
    place = importlib.util.find_spec(name)
    base = pathlib.Path(place.submodule_search_locations[0])
    files = sorted(file for file in base.rglob("*") if file.suffix in (".usd", ".usda", ".usdc", ".usdz"))
    return [(str(file), "", str(base), str(folder / ("%d.json" % number))) for number, file in enumerate(files)]


def listed(lines, path):
    path.write_text("".join("\t".join(words) + "\n" for words in lines))
    return path


def compared(path, *seeds, timeout=300):
    """Writes the dumps of a list on both sides. Returns the number of compared stages and their differences."""
    subprocess.run([sys.executable, HERE / "stage_dump.py", path, *map(str, seeds)], env=ONE_THREAD, check=True, timeout=timeout,
                   stderr=subprocess.DEVNULL)
    lines = [line.split("\t") for line in path.read_text().splitlines()]
    mine = listed([(root, session, base, want[:-5] + ".got") for root, session, base, want in lines], path.with_suffix(".mine"))
    subprocess.run([os.environ["USDLIVE_BIN"], "dump", "--composed", "--batch", mine], env=ONE_THREAD, check=True, timeout=timeout,
                   stderr=subprocess.DEVNULL)
    found = []
    for root, _, base, want in lines:
        one, other = (json.loads(pathlib.Path(file).read_text()) for file in (want, want[:-5] + ".got"))
        name = pathlib.Path(base) / "name"
        name = name.read_text() if name.exists() else root
        found += ["%s: %s" % (name, difference) for difference in itertools.islice(differences(one, other), 5)]
    return len(lines), found


def test_each_arc_with_each_opinion_shows_what_pxr_shows(tmp_path):
    lines = handmade(tmp_path)
    count, found = compared(listed(lines, tmp_path / "list"))
    assert count >= 200 and count >= len(lines) - 5, "%d of %d stages could be compared" % (count, len(lines))
    assert not found, "\n".join(found[:40])


@pytest.mark.parametrize("first", range(FIRST, FIRST + SEEDS, AT_ONCE))
def test_stages_from_seeds_show_what_pxr_shows(first, tmp_path):
    last = min(first + AT_ONCE, FIRST + SEEDS)
    count, found = compared(tmp_path / "list", first, last, tmp_path)
    assert count >= (last - first) * 0.8, "%d of %d stages could be compared" % (count, last - first)
    assert not found, "\n".join(found[:40])


@pytest.mark.parametrize("package", ["newton"])
def test_stages_of_packages_show_what_pxr_shows(package, tmp_path):
    count, found = compared(listed(of_package(package, tmp_path), tmp_path / "list"))
    assert count > 0
    assert not found, "\n".join(found[:40])
