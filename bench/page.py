"""Measures what the gateway of the page costs, and how late a page sees an edit.

    ./run bench page [--prims 10000] [--moving 200] [--seconds 10] [--viewers 1 50]

A server, the gateway, an editor in a process of its own that moves `moving` of `prims` cubes 60 times a second, and `viewers` pages
without a browser in one more process. `start` is the time from the start of the gateway until a page has the whole scene, `opening` that of a
page for a scene that the gateway has read. `cpu` is the share of one core that the gateway takes, without and with what moves.
`bytes` are those of one viewer in a second, `frames` its batches in a second. `latency` is from the editor's tick() until one viewer has
the batch with this edit, or a later one that replaces it: median and 99 of 100, in ms.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "integration"))
os.environ.setdefault("USDLIVE_BIN", str(ROOT / "build" / "release" / "bin" / "usdlive"))
os.environ.setdefault("USDLIVE_PYTHON", sys.executable)

import numpy  # noqa: E402
import websockets  # noqa: E402
from page_client import Gateway, Page  # noqa: E402
from support.serving import serve  # noqa: E402

TICK = os.sysconf("SC_CLK_TCK")


def stage(prims: int) -> str:
    return '#usda 1.0\n\ndef Xform "World"\n{\n' + "".join(
        f'    def Cube "c{n}"\n    {{\n        double3 xformOp:translate = ({n % 100 * 2}, 0, {n // 100 * 2})\n'
        f'        color3f[] primvars:displayColor = [({n % 7 / 7:.2f}, {n % 11 / 11:.2f}, 0.5)]\n'
        '        uniform token[] xformOpOrder = ["xformOp:translate"]\n    }\n' for n in range(prims)) + "}\n"


def move(url: str, moving: int, seconds: float) -> None:
    """Runs in a process of its own. Prints when each step was ticked."""
    import usdlive
    from pxr import Sdf

    with usdlive.connect(url, user="mover") as live:
        layer = live.open_layer("shot.usda")
        specs = [layer.GetAttributeAtPath(f"/World/c{n}.xformOp:translate") for n in range(moving)]
        print("ready", flush=True)
        sent, begin = [], time.monotonic()
        while time.monotonic() < begin + seconds:
            step = len(sent) + 1
            with Sdf.ChangeBlock():
                for n, spec in enumerate(specs):
                    spec.default = (step, n, n % 17)
            live.tick()
            sent.append(time.monotonic())
            time.sleep(max(0.0, begin + step / 60 - time.monotonic()))
        live.flush()
    print(json.dumps(sent))


async def view(address: str, end: float, first: int, seen: list[tuple[float, int]] | None) -> tuple[int, int]:
    """One page until `end`. Notes in `seen` when each step of the item with the id `first` has come."""
    received = frames = 0
    async with websockets.connect(address, max_size=None, compression=None) as line:
        await line.send('{"type": "hello"}')
        while (left := end - time.monotonic()) > 0:
            try:
                frame = await asyncio.wait_for(line.recv(), left)
            except asyncio.TimeoutError:
                break
            now = time.monotonic()
            if isinstance(frame, str):
                continue
            received, frames = received + len(frame), frames + 1
            if seen is not None:
                kind, count, _ = struct.unpack_from("<3I", frame, 8)
                found = numpy.flatnonzero(numpy.frombuffer(frame, "<u4", count, 20) == first) if kind == 1 else ()
                if len(found):
                    seen.append((now, int(struct.unpack_from("<f", frame, 20 + 4 * count + 48 * int(found[0]) + 36)[0])))
    return received, frames


def cpu(process: int) -> float:
    fields = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


async def watched(address: str, viewers: int, seconds: float, first: int) -> tuple[list[tuple[float, int]], int, int]:
    seen: list[tuple[float, int]] = []
    end = time.monotonic() + seconds
    results = await asyncio.gather(*[view(address, end, first, seen if n == 0 else None) for n in range(viewers)])
    return seen, results[0][0], results[0][1]


def measure(gateway: Gateway, url: str, arguments: argparse.Namespace, viewers: int, first: int) -> dict:
    seconds = arguments.seconds
    mover = subprocess.Popen([sys.executable, __file__, "--move", url, str(arguments.moving), str(seconds + 2)], stdout=subprocess.PIPE,
                             text=True)
    mover.stdout.readline()  # it has opened the layer
    time.sleep(1)
    before, begin = cpu(gateway.process.pid), time.monotonic()
    seen, received, frames = asyncio.run(watched(f"ws://127.0.0.1:{gateway.port}/live", viewers, seconds - 1, first))
    spent = time.monotonic() - begin
    share = (cpu(gateway.process.pid) - before) / spent
    sent = json.loads(mover.communicate()[0])
    late = []
    waiting = min((step for _, step in seen), default=1)
    for at, step in seen:
        late += [(at - sent[one - 1]) * 1000 for one in range(waiting, step + 1)]
        waiting = max(waiting, step + 1)
    return {"viewers": viewers, "cpu": round(share, 3), "bytes": int(received / spent), "frames": round(frames / spent, 1),
            "latency": {"p50": round(percentile(late, 0.5), 1), "p99": round(percentile(late, 0.99), 1)} if late else None,
            "editor": round(len(sent) / (seconds + 2), 1)}


def main() -> None:
    if sys.argv[1:2] == ["--move"]:
        return move(sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prims", type=int, default=10_000)
    parser.add_argument("--moving", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--viewers", type=int, nargs="+", default=[1, 50])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
        project, own = pathlib.Path(folder) / "project", pathlib.Path(folder) / "gateway"
        project.mkdir()
        own.mkdir()
        os.environ["XDG_STATE_HOME"] = os.environ["XDG_CONFIG_HOME"] = os.environ["USDLIVE_CACHE"] = folder
        (project / "shot.usda").write_text(stage(arguments.prims))
        server, port = serve(project, "--log-level", "error", program=(os.environ["USDLIVE_BIN"], "serve"))
        url = f"ws://127.0.0.1:{port}"
        begin = time.monotonic()
        gateway = Gateway(url, own).start()
        opened = Page(gateway)
        opened.wait(lambda page: page.complete and len(page.items) > arguments.prims, 600)
        figures: dict = {"prims": arguments.prims, "moving": arguments.moving, "start": round(time.monotonic() - begin, 2)}
        first = opened.at("/World/c0")["id"]
        opened.close()
        begin = time.monotonic()
        opened = Page(gateway)
        opened.wait(lambda page: page.complete and len(page.items) > arguments.prims, 600)
        figures["opening"] = round(time.monotonic() - begin, 2)
        before = cpu(gateway.process.pid)
        time.sleep(5)
        figures["idle"] = round((cpu(gateway.process.pid) - before) / 5, 3)
        opened.close()
        figures["runs"] = [measure(gateway, url, arguments, viewers, first) for viewers in arguments.viewers]
        print(json.dumps(figures, indent=2))
        gateway.stop()
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
