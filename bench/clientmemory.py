"""The memory of a client of a large layer, beside pxr.Usd in a process that holds the same layer.

    ./run bench clientmemory [--attributes 100000]

Each row is from a process of its own. MiB of private memory (`Anonymous` of the kernel, without libraries) that were
added since the process had loaded them and, if it is a client, had connected; the end of each process, when it is idle.

`writer` authors the attributes in one change block, and waits until they are committed; its `peakMib` is the resident
peak of the whole process. `follower` opens the layer afterwards. Both keep a `Usd.Stage` of it. Their ceilings,
`usdWriter` and `usdFollower`, author and open the same layer without a connection. `freeMib` is the part of `mib` that
the C library has already freed, but not returned to the system.
"""

import argparse
import ctypes
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from pxr import Sdf, Usd
from support.serving import serve

LAYER = "scene.usda"


def counted_mib(file: str, name: str) -> float:
    """A figure of the kernel about this process."""
    for line in pathlib.Path("/proc/self", file).read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"the kernel does not count {name}")


def private_mib() -> float:
    return counted_mib("smaps_rollup", "Anonymous")


def author(stage: Usd.Stage, attributes: int) -> None:
    with Sdf.ChangeBlock():
        for i in range(attributes // 10):
            prim = Sdf.PrimSpec(stage.GetRootLayer(), f"Prim{i}", Sdf.SpecifierDef, "Xform")
            for k in range(10):
                Sdf.AttributeSpec(prim, f"a{k}", Sdf.ValueTypeNames.Double3).default = (i, k, 1)


def tick(live, idle: float = 1.0) -> None:
    """Ticks until everything is committed, and `idle` seconds more."""
    end = time.monotonic() + idle
    while live.pending or time.monotonic() < end:
        live.tick()
        if live.pending:
            end = time.monotonic() + idle
        time.sleep(0.01)


def measure(role: str, source: str, attributes: int) -> dict:
    """Runs in the measured process. `source` is the server's URL, or the file."""
    live = None
    if role in ("writer", "follower"):
        import usdlive
        live = usdlive.connect(source, user=role)
        live.tick()
    else:
        Usd.Stage.CreateInMemory()  # loads the plug-ins
    before = private_mib()
    if live:
        stage = live.open_stage(LAYER)
    else:
        stage = Usd.Stage.Open(source) if role == "usdFollower" else Usd.Stage.CreateInMemory()
    if role in ("writer", "usdWriter"):
        author(stage, attributes)
    if live:
        tick(live)
    found = sum(len(prim.GetAuthoredAttributes()) for prim in stage.Traverse())
    assert found == attributes // 10 * 10, found
    mib = private_mib() - before
    peak = counted_mib("status", "VmHWM")
    ctypes.CDLL(None).malloc_trim(0)
    free = mib + before - private_mib()
    if live:
        live.close()
    return {"mib": round(mib, 1), "freeMib": round(max(free, 0), 1), "peakMib": round(peak, 1)}


def run(role: str, source: object, attributes: int) -> dict:
    command = [sys.executable, __file__, "--attributes", str(attributes), "--role", role, "--source", str(source)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1])


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--attributes", type=int, default=100_000)
    arguments.add_argument("--role", help=argparse.SUPPRESS)
    arguments.add_argument("--source", help=argparse.SUPPRESS)
    options = arguments.parse_args()
    if options.role:
        print(json.dumps(measure(options.role, options.source, options.attributes)))
        return

    with tempfile.TemporaryDirectory() as folder:
        project = pathlib.Path(folder, "project")
        project.mkdir()
        (project / LAYER).write_text("#usda 1.0\n")
        server, port = serve(project, "--min-free-mib", "1", stderr=subprocess.DEVNULL)
        try:
            url = f"ws://127.0.0.1:{port}"
            ours = {role: run(role, url, options.attributes) for role in ("writer", "follower")}
        finally:
            server.kill()
            server.wait()
        stage = Usd.Stage.CreateInMemory()
        author(stage, options.attributes)
        stage.GetRootLayer().Export(str(pathlib.Path(folder, LAYER)))
        for role, row in ours.items():
            usd = run(f"usd{role.capitalize()}", pathlib.Path(folder, LAYER), options.attributes)
            print(json.dumps({"bench": "clientmemory", "attributes": options.attributes, "role": role,
                              "ratio": round(row["mib"] / usd["mib"], 2), **row, "usdMib": usd["mib"],
                              "usdFreeMib": usd["freeMib"], "usdPeakMib": usd["peakMib"]}))


if __name__ == "__main__":
    main()
