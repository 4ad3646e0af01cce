"""A browser with the page of a big stage.

    ./run bench page_browser [--prims 10000] [--moving 200] [--seconds 10] [--width 640]

A server, its gateway, an editor that moves `moving` prims 60 times a second, and a headless Chromium without a graphics
card. The picture is rasterised by the processor, which takes most of it, so that few frames are drawn: the numbers are
those of the page's own main thread.

    first paint      from the request of the page to its first pixels
    open             until all prims are in the scene, and all meshes are here
    frame            milliseconds of the main thread for a drawn frame: changes, three.js, labels (aim: at most 8)
    update           milliseconds of the main thread for a batch of the gateway
    latency          from the editor's tick to the page's scene (aim: p99 at most 50 ms)
"""

from __future__ import annotations

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "integration"))

from conftest import Server  # noqa: E402
from page_client import Gateway  # noqa: E402
from page_screen import CHROMIUM, SOFTWARE, VIEWPORT, Screen  # noqa: E402
from playwright.sync_api import sync_playwright  # noqa: E402

RATE = 60
# Notes when the scene of the page has got which frame of the editor, and how long a batch takes.
WATCH = """() => {
  const {session} = usdlivePage, id = session.store.idOf('/World/P0');
  const seen = window.seen = {frames: [], batches: []};
  const apply = session.store.applyBatch.bind(session.store);
  session.store.applyBatch = (...given) => {
    const start = performance.now();
    apply(...given);
    const end = performance.now();
    seen.batches.push(end - start);
    seen.frames.push([Math.round(session.store.world(id)[9]), performance.timeOrigin + end]);
  };
}"""


def stage(prims: int) -> str:
    cubes = "\n".join(f'''    def Cube "P{number}"
    {{
        color3f[] primvars:displayColor = [({number % 7 / 7}, {number % 11 / 11}, {number % 13 / 13})]
        double3 xformOp:translate = ({number % 100 * 3}, {number // 100 * 3}, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}''' for number in range(prims))
    return f'#usda 1.0\n(\n    upAxis = "Z"\n)\n\ndef Xform "World"\n{{\n{cubes}\n}}\n'


def edit(url: str, moving: int, seconds: float) -> None:
    """The editor: writes the number of the frame into the matrix of each prim, and prints when."""
    import usdlive
    from pxr import Sdf

    live = usdlive.connect(url, user="editor")
    layer = live.open_layer("root.usda")
    specs = [layer.GetAttributeAtPath(f"/World/P{number}.xformOp:translate") for number in range(moving)]
    times = {}
    start = time.monotonic()
    for frame in range(1, int(seconds * RATE) + 1):
        with Sdf.ChangeBlock():
            for number, spec in enumerate(specs):
                spec.default = (frame, 3 * number, 5)
        times[frame] = 1000 * time.time()
        live.tick()
        time.sleep(max(0, start + frame / RATE - time.monotonic()))
    live.flush(20)
    live.close()
    print(json.dumps(times))


def part(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def told(name: str, values: list[float]) -> None:
    print(f"{name:12} p50 {statistics.median(values):7.1f} ms   p90 {part(values, 0.9):7.1f} ms   p99 {part(values, 0.99):7.1f} ms"
          f"   of {len(values)}")


def measure(screen: Screen, server: Server, options: argparse.Namespace) -> None:
    begin = time.monotonic()
    screen.until(f"usdlivePage.session.items.value >= {options.prims}", timeout=120)
    screen.until(f"{VIEWPORT}?.isSettled", timeout=120)
    opened = time.monotonic() - begin
    paint = screen.run("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    print(f"first paint {paint:.0f} ms, open {opened:.1f} s after it was loaded, {screen.run(f'{VIEWPORT}.stats.draws')} draws")
    screen.run(WATCH)
    drawn = screen.run(f"{VIEWPORT}.stats.frames")
    words = [sys.executable, __file__, "--editor", server.url, "--moving", str(options.moving), "--seconds", str(options.seconds)]
    output = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout
    written = {int(frame): at for frame, at in json.loads(output.splitlines()[-1]).items()}
    screen.until(f"window.seen.frames.some(([frame]) => frame === {max(written)})")
    seen = screen.run("window.seen")
    frames = screen.run(f"{VIEWPORT}.stats.frames") - drawn
    told("frame", screen.run(f"{VIEWPORT}.stats.milliseconds")[-frames:])
    told("update", seen["batches"])
    told("latency", [at - written[frame] for frame, at in seen["frames"] if frame in written])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prims", type=int, default=10_000)
    parser.add_argument("--moving", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--editor", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.editor:
        edit(options.editor, options.moving, options.seconds)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        project = folder / "project"
        project.mkdir()
        (project / "root.usda").write_text(stage(options.prims))
        server = Server(project, folder / "server.log").start()
        gateway = Gateway(server.url, folder).start()
        try:
            with sync_playwright() as tools:
                browser = tools.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
                measure(Screen(browser, gateway.address, width=options.width, height=480), server, options)
                browser.close()
        finally:
            gateway.stop()
            server.stop()


if __name__ == "__main__":
    main()
