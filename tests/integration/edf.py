"""Shared by the tests of plugins/edf: scenes, and stock usd-core in fresh processes that run code on them."""

import json
import os
import pathlib
import subprocess
import sys
import textwrap

BUILD = pathlib.Path(os.environ["USDLIVE_BUILD"])
PLUGINS = BUILD / "usd-plugins"
TEST_PLUGINS = BUILD / "test-plugins"

# The code of a test begins with these names.
PRELUDE = """
import json, os, sys, time
from pxr import Gf, Plug, Sdf, Tf, Usd
def names(stage, path="/A"):
    return [child.GetName() for child in stage.GetPrimAtPath(path).GetAllChildren()]
def edf(stage):
    return sorted(layer.identifier for layer in stage.GetUsedLayers() if ".edf" in layer.identifier)
def arguments(stage):
    return [Sdf.Layer.SplitIdentifier(one)[1] for one in edf(stage)]
def errors(stage):
    return [str(one) for one in stage.GetCompositionErrors()]
def change(prim, **args):
    for key, value in args.items():
        prim.SetMetadataByDictKey("EdfDataParameters", "providerArgs:" + key, value)
"""


def plugin_path(*more):
    return os.pathsep.join(map(str, [PLUGINS, TEST_PLUGINS / "edfTest", TEST_PLUGINS / "helloProvider", *more]))


class Ran:
    def __init__(self, ran):
        self.returncode, self.warnings = ran.returncode, ran.stderr
        assert ran.returncode == 0, ran.stderr[-6000:]
        self.result = json.loads(ran.stdout.splitlines()[-1]) if ran.stdout else None


def fresh(folder, code, *plugins, timeout=60, **environment):
    """Runs code in a new Python process that has usd-core and none of our modules. Returns its `result`."""
    inherited = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    full = PRELUDE + textwrap.dedent(code) + "\nprint(); print(json.dumps(globals().get('result')))\n"
    return Ran(subprocess.run(
        [sys.executable, "-c", full], text=True, capture_output=True, cwd=folder, timeout=timeout,
        env={**inherited, "PXR_PLUGINPATH_NAME": plugin_path(*plugins), "EDF_TEST_LOG": str(folder / "calls"),
             "USDLIVE_CACHE": str(folder / "cache"), **environment}))


def calls(folder):
    """Returns the calls of the test provider since the last use of this function."""
    log = folder / "calls"
    lines = log.read_text().splitlines() if log.exists() else []
    log.write_text("")
    return lines


def parameters(provider, /, **arguments):
    lines = "".join(f"            {'int' if isinstance(value, int) else 'string'} {name} = {json.dumps(value)}\n"
                    for name, value in arguments.items())
    return ("    EdfDataParameters = {\n"
            f"        string dataProviderId = {json.dumps(provider)}\n"
            "        dictionary providerArgs = {\n" + lines + "        }\n    }\n")


def prim(name, metadata="", content="", asset="anon:edf:content.edf", word="def"):
    payload = f"    payload = @{asset}@\n" if asset else ""
    return f'{word} "{name}" (\n{payload}{metadata})\n{{\n{content}}}\n'


def scene(folder, *prims, name="scene.usda", header=""):
    file = folder / name
    file.write_text(f"#usda 1.0\n(\n{header})\n" + "".join(prims))
    return file
