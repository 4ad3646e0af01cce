"""The portable backend beside the fast one: frames of an editor on a layer of many prims.

    ./run bench portable [--prims 100000] [--edits 1000] [--backend portable]

Each backend runs in processes of its own, an editor and a follower, with the same server. Milliseconds are medians:

- `joinMs`: opening a stage on the layer, of `prims` prims with one attribute each, from an empty cache.
- `idleMs`: a `tick()` of an editor that has written nothing.
- `editMs`: setting one attribute and the `tick()` after it; `afterMs`: the 100 ticks after that, each.
- `followMs`: the longest `tick()` of the follower in the third of a second after one of these edits.
- `usPerEdit`: setting `edits` attributes in one change block, and the `tick()` after it, for one of them;
  `usPerFollowed`: applying them in the follower. `ratio`: `usPerEdit` of this backend to that of the fast one.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from support.serving import serve

LAYER = "scene.usda"
FRAMES, FEW = 60, 10


def write(path: pathlib.Path, prims: int) -> None:
    with path.open("w") as file:
        file.write("#usda 1.0\n")
        for group in range(prims // 100):
            file.write(f'\ndef Scope "G{group}"\n{{\n')
            for number in range(100):
                file.write(f'    def Cube "C{number}"\n    {{\n        double size = {number}\n    }}\n')
            file.write("}\n")


def milliseconds(call) -> float:
    start = time.perf_counter()
    call()
    return (time.perf_counter() - start) * 1000


def settled(live) -> None:
    """Ticks until everything is committed and compared."""
    assert live.flush(60)
    while live.tick():
        pass


def measure(backend: str, url: str, edits: int, ask) -> dict:
    import usdlive
    from pxr import Sdf
    live = usdlive.connect(url, user="writer", backend=backend)
    stages = []
    row = {"joinMs": milliseconds(lambda: stages.append(live.open_stage(LAYER)))}
    attributes = [prim.GetAttribute("size") for prim in stages[0].Traverse() if prim.GetTypeName() == "Cube"]
    settled(live)
    row["idleMs"] = statistics.median(milliseconds(live.tick) for _ in range(200))

    start = time.time()  # no value is one that another process has written

    def edit(frame: int) -> None:
        attributes[frame * 97 % len(attributes)].Set(start + frame)
        live.tick()

    edit(0)
    settled(live)
    row["editMs"] = statistics.median(milliseconds(lambda frame=frame: edit(frame)) for frame in range(1, FRAMES))
    row["afterMs"] = statistics.median(milliseconds(live.tick) for _ in range(100))
    settled(live)
    followed = []
    ask("begin")
    for frame in range(FEW):
        edit(FRAMES + frame)
        settled(live)
        followed.append(ask("follow"))
    row["followMs"] = statistics.median(followed)

    def frame_of_edits(frame: int) -> None:
        with Sdf.ChangeBlock():
            for number in range(edits):
                attributes[(frame * edits + number) % len(attributes)].Set(-start - frame)
        live.tick()

    row["usPerEdit"] = statistics.median(milliseconds(lambda frame=frame: frame_of_edits(frame)) for frame in range(FEW)) * 1000 / edits
    settled(live)
    ask("begin")
    frame_of_edits(FEW)
    settled(live)
    row["usPerFollowed"] = ask("follow") * 1000 / edits
    live.close()
    return row


def follow(backend: str, url: str) -> None:
    """Ticks, and answers each line of stdin with the longest tick since the line before."""
    import select

    import usdlive
    live = usdlive.connect(url, user="follower", backend=backend)
    stage = live.open_stage(LAYER)  # noqa: F841  kept
    settled(live)
    print("ready", flush=True)
    longest = 0.0
    while True:
        longest = max(longest, milliseconds(live.tick))
        if select.select([sys.stdin], [], [], 0.002)[0]:
            line = sys.stdin.readline()
            if not line:
                break
            quiet = time.monotonic() + 0.3
            while time.monotonic() < quiet:
                longest = max(longest, milliseconds(live.tick))
                time.sleep(0.002)
            print(longest, flush=True)
            longest = 0.0
    live.close()


def run(backend: str, url: str, edits: int) -> dict:
    def process(role: str) -> list:
        return [sys.executable, __file__, "--role", role, "--backend", backend, "--source", url, "--edits", str(edits)]

    with subprocess.Popen(process("follower"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as follower:
        assert follower.stdout.readline() == "ready\n"
        with subprocess.Popen(process("writer"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer:
            for line in writer.stdout:
                if line.startswith("{"):
                    return json.loads(line)
                follower.stdin.write(line)
                follower.stdin.flush()
                writer.stdin.write(follower.stdout.readline())
                writer.stdin.flush()
    raise RuntimeError("the writer has ended")


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--prims", type=int, default=100_000)
    arguments.add_argument("--edits", type=int, default=1000)
    arguments.add_argument("--backend", action="append", choices=["fast", "portable"])
    arguments.add_argument("--role", help=argparse.SUPPRESS)
    arguments.add_argument("--source", help=argparse.SUPPRESS)
    options = arguments.parse_args()

    def ask(what: str) -> float:
        print(what, flush=True)
        return float(sys.stdin.readline())

    if options.role == "writer":
        print(json.dumps(measure(options.backend[0], options.source, options.edits, ask)), flush=True)
        return
    if options.role == "follower":
        follow(options.backend[0], options.source)
        return
    with tempfile.TemporaryDirectory() as folder:
        project = pathlib.Path(folder, "project")
        project.mkdir()
        write(project / LAYER, options.prims)
        server, port = serve(project, "--min-free-mib", "1", stderr=subprocess.DEVNULL)
        try:
            fast = None
            for backend in options.backend or ["fast", "portable"]:
                row = run(backend, f"ws://127.0.0.1:{port}", options.edits)
                fast = row if backend == "fast" else fast
                ratio = {"ratio": round(row["usPerEdit"] / fast["usPerEdit"], 1)} if fast else {}
                print(json.dumps({"bench": "portable", "backend": backend, "prims": options.prims, "edits": options.edits,
                                  **{key: round(value, 3) for key, value in row.items()}, **ratio}), flush=True)
        finally:
            server.kill()
            server.wait()


if __name__ == "__main__":
    main()
