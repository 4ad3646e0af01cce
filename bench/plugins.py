"""Measures usdlive's plug-ins in plain OpenUSD.

    ./run bench plugins [--prims 10000] [--rounds 7] [--textures-mib 1024]

`reloadRatio` is the median time of a change of one parameter of a dynamic payload of generated prims on an
open stage, until all prims are composed again, divided by the median time of opening a stage with this payload. Each
round has parameters of its own, so that every layer is read. `editMs` is a change of metadata that the payload does not
depend on.

`openRatio` is the median time of opening and traversing a stage of 5,000 prims in some 200 files by its
usdlive:// address, with a filled cache, divided by that of the same files from the disk. Each time is that of a new
process, without its start, in turn. `emptyMs` is the time with an empty cache.

`textureRatio` is the rate at which a process with an empty cache reads the textures of a project by their
addresses, divided by the rate of a plain HTTP download of the same files from the same server into files. Medians of
three, in turn, all in memory (/dev/shm), since a disk's rate varies. Both processes have loaded their libraries. The
resolver hashes files of this size afterwards, which is not part of the time."""

import argparse
import http.client
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from support.serving import serve

ROOT = pathlib.Path(__file__).resolve().parents[1]
TEXTURE_MIB = 16

# Opens a stage, and prints how long that takes.
OPEN = """
import sys, time
from pxr import Usd
start = time.perf_counter()
stage = Usd.Stage.Open(sys.argv[1])
prims = sum(1 for _ in stage.TraverseAll())
print((time.perf_counter() - start) * 1000, prims)
"""

# Reads textures by their addresses, and prints how long that takes. The first address loads the plug-in.
READ = """
import sys, time
from pxr import Ar
resolver = Ar.GetResolver()
assert resolver.Resolve(sys.argv[1])
start = time.perf_counter()
size = 0
for address in sys.argv[2:]:
    with resolver.OpenAsset(resolver.Resolve(address)) as asset:
        size += asset.GetSize()
print((time.perf_counter() - start) * 1000, size)
"""


def measured(work) -> float:
    start = time.perf_counter()
    work()
    return (time.perf_counter() - start) * 1000


def measure_reload(prims: int, rounds: int) -> dict:
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
    return {"prims": 100 * side, "composeMs": compose, "reloadMs": reload, "editMs": statistics.median(editing[1:]),
            "reloadRatio": reload / compose}


class Served:
    """A server for a project, with a folder for caches beside it."""

    def __init__(self, folder: pathlib.Path, project: pathlib.Path):
        self.cache = folder / "cache"
        self._process, self.port = serve(project)

    def address(self, path: str) -> str:
        return f"usdlive://localhost:{self.port}/{path}"

    def empty(self) -> None:
        shutil.rmtree(self.cache, ignore_errors=True)

    def run(self, code: str, *arguments: str) -> list[float]:
        """Runs code in a new process. Returns the numbers that it prints."""
        done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True,
                              env={**os.environ, "USDLIVE_CACHE": str(self.cache)})
        assert done.returncode == 0, done.stderr
        return [float(number) for number in done.stdout.split()]

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()


def measure_open(folder: pathlib.Path, rounds: int) -> dict:
    sys.path.insert(0, str(ROOT / "tests" / "integration"))
    from resolver_scene import make_project

    root = make_project(folder / "project")
    served = Served(folder, root.parent)
    try:
        address = served.address("shot.usda")
        disk, warm, empty = [], [], []
        for round in range(rounds + 1):
            served.empty()
            empty.append(served.run(OPEN, address))
            disk.append(served.run(OPEN, str(root)))
            warm.append(served.run(OPEN, address))
            assert disk[-1][1] == warm[-1][1] == empty[-1][1] > 5_000, (disk, warm, empty)
    finally:
        served.close()
    disk_ms, warm_ms, empty_ms = (statistics.median(ms for ms, _ in times[1:]) for times in (disk, warm, empty))
    return {"openPrims": int(disk[0][1]), "diskMs": disk_ms, "warmMs": warm_ms, "emptyMs": empty_ms,
            "openRatio": warm_ms / disk_ms}


def download(port: int, names: list[str], folder: pathlib.Path) -> int:
    """Downloads files one after the other into a folder. Returns the number of bytes."""
    part = memoryview(bytearray(512 * 1024))
    size = 0
    for name in names:
        connection = http.client.HTTPConnection("127.0.0.1", port)
        connection.request("GET", f"/files/{name}")
        answer = connection.getresponse()
        assert answer.status == 200, answer.status
        with open(folder / name, "wb", buffering=0) as file:
            while count := answer.readinto(part):
                file.write(part[:count])
                size += count
        connection.close()
    return size


def measure_textures(folder: pathlib.Path, mib: int) -> dict:
    project = folder / "textures"
    project.mkdir()
    (project / "shot.usda").write_text("#usda 1.0\n")
    names = [f"t{number}.png" for number in range(mib // TEXTURE_MIB)]
    for name in names:
        (project / name).write_bytes(os.urandom(TEXTURE_MIB << 20))
    wanted = len(names) * TEXTURE_MIB << 20
    served = Served(folder, project)
    try:
        addresses = [served.address(name) for name in names]
        plain, cached = [], []
        for _ in range(4):
            target = folder / "downloaded"
            target.mkdir()
            start = time.perf_counter()
            assert download(served.port, names, target) == wanted
            plain.append((time.perf_counter() - start) * 1000)
            shutil.rmtree(target)
            served.empty()
            ms, size = served.run(READ, served.address("shot.usda"), *addresses)
            assert size == wanted, size
            cached.append(ms)
    finally:
        served.close()
    plain_ms, cached_ms = statistics.median(plain[1:]), statistics.median(cached[1:])
    return {"textureMib": wanted >> 20, "plainMs": plain_ms, "cachedMs": cached_ms, "textureRatio": plain_ms / cached_ms}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prims", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--textures-mib", type=int, default=1024)
    arguments = parser.parse_args()
    build = pathlib.Path(os.environ.get("USDLIVE_BUILD", ROOT / "build" / "release"))
    os.environ.setdefault("USDLIVE_SERVER_BIN", str(build / "bin" / "usdlive-server"))
    if os.environ.get("PXR_PLUGINPATH_NAME") != str(build / "usd-plugins"):
        # OpenUSD reads the variable when the process starts.
        os.environ["PXR_PLUGINPATH_NAME"] = str(build / "usd-plugins")
        sys.exit(subprocess.run([sys.executable, *sys.argv]).returncode)
    figures = measure_reload(arguments.prims, arguments.rounds)
    with tempfile.TemporaryDirectory(prefix="usdlive-bench-") as name:
        figures |= measure_open(pathlib.Path(name), arguments.rounds)
    with tempfile.TemporaryDirectory(prefix="usdlive-bench-", dir="/dev/shm") as name:
        figures |= measure_textures(pathlib.Path(name), arguments.textures_mib)
    print(json.dumps({"bench": "plugins"} | {name: round(figure, 3) for name, figure in figures.items()}))
