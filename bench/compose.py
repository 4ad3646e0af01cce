"""What opening and traversing a stage of many prims costs, and resolving many values, beside pxr.Usd in this process.

    ./run bench compose [--prims 100000] [--values 1000000] [--rounds 5]

Half of the prims come over references, in groups of a hundred. Of the attributes some have a default, some time samples, some both or
an array, and some only the fallback of a schema. CPU time of all threads, the least of the rounds, which alternate.

`openRatio`: stage::Stage is opened and traversed in C++, Usd.Stage is opened and traversed by a Usd.PrimRange. `valueRatio`:
Property::value() in C++, Usd.Attribute.Get() in Python. What such calls from Python cost besides, measured with IsValid() of the same
objects, is subtracted from the times of pxr.Usd."""

import argparse
import ctypes
import json
import os
import pathlib
import time

from pxr import Sdf, Usd


def make(prims: int) -> tuple[Sdf.Layer, Sdf.Layer]:
    asset = Sdf.Layer.CreateAnonymous("asset.usda")
    root = Sdf.Layer.CreateAnonymous("root.usda")
    types = Sdf.ValueTypeNames

    def fill(prim: Sdf.PrimSpec, number: int) -> None:
        Sdf.AttributeSpec(prim, "size", types.Double).default = 1.0 + number
        look = Sdf.AttributeSpec(prim, "look", types.Token, Sdf.VariabilityUniform)
        look.default = "plain"
        if number % 3 == 0:
            moves = Sdf.AttributeSpec(prim, "moves", types.Float3)
            for at in (1, 10, 20):
                prim.layer.SetTimeSample(moves.path, at, (at, number, 0))
        if number % 5 == 0:
            Sdf.AttributeSpec(prim, "weights", types.FloatArray).default = [1, 2, 3, 4]

    with Sdf.ChangeBlock():
        model = Sdf.PrimSpec(asset, "Model", Sdf.SpecifierDef, "Xform")
        for i in range(99):
            fill(Sdf.PrimSpec(model, f"Part{i}", Sdf.SpecifierDef, "Xform"), i)
        for group in range(prims // 100):
            prim = Sdf.PrimSpec(root, f"Group{group}", Sdf.SpecifierDef, "Xform")
            if group % 2:
                prim.referenceList.Prepend(Sdf.Reference(asset.identifier, "/Model"))
                Sdf.AttributeSpec(Sdf.PrimSpec(prim, "Part7", Sdf.SpecifierOver), "size", types.Double).default = 5.0
            else:
                for i in range(99):
                    fill(Sdf.PrimSpec(prim, f"Part{i}", Sdf.SpecifierDef, "Xform"), i)
    return root, asset


def load() -> ctypes.PyDLL:
    library = ctypes.PyDLL(str(pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "stage_watch.so"))
    library.watch_open.restype = ctypes.c_void_p
    for name in ("watch_traverse", "watch_gather", "watch_resolve"):
        getattr(library, name).restype = ctypes.c_size_t
    return library


def cpu(work):
    """Seconds of CPU time, and what `work` returned."""
    begin = time.process_time()
    result = work()
    return time.process_time() - begin, result


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--prims", type=int, default=100_000)
    arguments.add_argument("--values", type=int, default=1_000_000)
    arguments.add_argument("--rounds", type=int, default=5)
    options = arguments.parse_args()
    (layer, _asset), library = make(options.prims), load()
    session = Sdf.Layer.CreateAnonymous("session.usda")

    def open_ours():
        stage = ctypes.c_void_p(library.watch_open(layer.identifier.encode(), session.identifier.encode()))
        return stage, library.watch_traverse(stage)

    def open_theirs():
        stage = Usd.Stage.Open(layer, session)
        return stage, sum(1 for _ in stage.Traverse())

    opens = {"ours": [], "theirs": [], "calls": []}
    for _ in range(options.rounds):
        seconds, (ours, prims) = cpu(open_ours)
        opens["ours"].append(seconds)
        library.watch_close(ours)
        seconds, (theirs, same) = cpu(open_theirs)
        opens["theirs"].append(seconds)
        assert prims == same, (prims, same)
        objects = list(theirs.Traverse())
        opens["calls"].append(cpu(lambda: sum(1 for prim in objects if prim.IsValid()))[0])
        del theirs, objects

    ours, _ = open_ours()
    theirs = Usd.Stage.Open(layer, session)
    attributes = [attribute for prim in theirs.Traverse() for attribute in prim.GetAttributes()]
    assert library.watch_gather(ours) == len(attributes)
    passes = max(1, round(options.values / len(attributes) / 2))
    times = {"ours": [], "theirs": [], "calls": []}
    for _ in range(options.rounds):
        for at in (None, ctypes.byref(ctypes.c_double(7.5))):
            code = Usd.TimeCode(7.5) if at else Usd.TimeCode.Default()
            ours_now = theirs_now = calls_now = 0.0
            for _ in range(passes):
                seconds, found = cpu(lambda: library.watch_resolve(ours, at))
                ours_now += seconds
                seconds, same = cpu(lambda: sum(1 for attribute in attributes if attribute.Get(code) is not None))
                theirs_now += seconds
                assert found == same, (found, same)
                calls_now += cpu(lambda: sum(1 for attribute in attributes if attribute.IsValid()))[0]
            times["ours"].append((at is None, ours_now))
            times["theirs"].append((at is None, theirs_now))
            times["calls"].append((at is None, calls_now))

    def least(who):
        return [min(seconds for default, seconds in times[who] if default == which) for which in (True, False)]

    values = len(attributes) * passes * 2
    opened = min(opens["theirs"]) - min(opens["calls"])
    ours_values, their_values = sum(least("ours")), sum(least("theirs")) - sum(least("calls"))
    print(json.dumps({
        "bench": "compose", "prims": prims, "openRatio": round(min(opens["ours"]) / opened, 3),
        "valueRatio": round(ours_values / their_values, 3), "openMs": round(min(opens["ours"]) * 1000, 1),
        "usdOpenMs": round(opened * 1000, 1), "values": values, "valueNs": round(ours_values / values * 1e9),
        "usdValueNs": round(their_values / values * 1e9), "callNs": round(sum(least("calls")) / values * 1e9)}))


if __name__ == "__main__":
    main()
