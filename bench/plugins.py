"""How long a dynamic payload of generated prims takes to reload after its parameters were changed, beside the time of
composing it.

    ./run bench plugins [--prims 10000] [--rounds 7]

`reloadRatio` is the median time of a change of one parameter on an open stage, until all prims are composed again,
divided by the median time of opening a stage with this payload. Each round has parameters of its own, so that every
layer is read. `editMs` is a change of metadata that the payload does not depend on."""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]


def measured(work) -> float:
    start = time.perf_counter()
    work()
    return (time.perf_counter() - start) * 1000


def measure(prims: int, rounds: int) -> None:
    from pxr import Sdf, Usd

    side = prims // 100

    def scene(spacing: float) -> Sdf.Layer:
        layer = Sdf.Layer.CreateAnonymous(".usda")
        prim = Sdf.CreatePrimInLayer(layer, "/A")
        prim.specifier = Sdf.SpecifierDef
        prim.payloadList.explicitItems = [Sdf.Payload("anon:edf:bench.edf")]
        prim.SetInfo("EdfDataParameters", {"dataProviderId": "generator", "providerArgs": {
            "size": f"100x{side}x1", "spacing": spacing}})
        return layer

    def check(stage: Usd.Stage, spacing: float) -> None:
        items = stage.GetPrimAtPath("/A").GetAllChildren()
        assert len(items) == 100 * side, len(items)
        assert items[1].GetAttribute("xformOp:translate").Get()[0] == spacing

    composing, reloading, editing = [], [], []
    stages = []
    for round in range(rounds + 1):
        layer = scene(1 + round)
        composing.append(measured(lambda: stages.append(Usd.Stage.Open(layer))))
        check(stages[-1], 1 + round)
    stage = stages[-1]
    del stages
    prim = stage.GetPrimAtPath("/A")
    for round in range(rounds + 1):
        reloading.append(measured(lambda: prim.SetMetadataByDictKey(
            "EdfDataParameters", "providerArgs:spacing", 100.0 + round)))
        check(stage, 100 + round)
        editing.append(measured(lambda: prim.SetMetadataByDictKey("EdfDataParameters", "note", round)))
    # The first round also loads the libraries.
    compose, reload = statistics.median(composing[1:]), statistics.median(reloading[1:])
    print(json.dumps({"bench": "plugins", "prims": 100 * side, "composeMs": round_(compose), "reloadMs": round_(reload),
                      "editMs": round_(statistics.median(editing[1:])), "reloadRatio": round_(reload / compose)}))


def round_(number: float) -> float:
    return round(number, 3)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prims", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    plugins = os.environ.get("USDLIVE_BUILD", str(ROOT / "build" / "release")) + "/usd-plugins"
    if os.environ.get("PXR_PLUGINPATH_NAME") != plugins:
        # OpenUSD reads the variable when the process starts.
        os.environ["PXR_PLUGINPATH_NAME"] = plugins
        sys.exit(subprocess.run([sys.executable, *sys.argv]).returncode)
    measure(arguments.prims, arguments.rounds)
