"""`./run demo`: runs four editors on one real stage at once, and kills the server while they work.

A drone and a humanoid from the newton package become the cast of a small shot of root, layout, animation and
look layers. `usdlive serve` serves it. Two Python editors (one of them over DDS) and a C++ editor work in it
from the start, and a third Python editor joins late. In the middle the server is killed with SIGKILL and
started again. At the end the text of every layer is compared: that of each editor, that of the server, and
that of the saved file as pxr.Usd alone reads it. The exit status is 0 only if all are the same.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

from pxr import Gf, Sdf, Usd, UsdGeom

HERE = pathlib.Path(__file__).parent
LAYERS = ["shot.usda", "layout.usda", "anim.usda", "look.usda"]


def newton_assets() -> pathlib.Path:
    found = importlib.util.find_spec("newton")
    if not found:
        sys.exit("demo: the package newton, which has the stages, is not installed: ./run setup")
    return pathlib.Path(found.submodule_search_locations[0]) / "examples" / "assets"


def make_shot(folder: pathlib.Path) -> None:
    """Creates a shot from real assets: layout places them, animation moves them, look colours them."""
    (folder / "assets").mkdir(parents=True)
    for name in ("crazyflie.usd", "humanoid.usda"):
        shutil.copy(newton_assets() / name, folder / "assets" / name)

    def new_layer(name: str, comment: str) -> Usd.Stage:
        stage = Usd.Stage.CreateNew(str(folder / name))
        stage.GetRootLayer().comment = comment
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetDefaultPrim(stage.OverridePrim("/Shot"))
        return stage

    layout = new_layer("layout.usda", "Who and what is in the shot, and where")
    UsdGeom.Xform.Define(layout, "/Shot")
    UsdGeom.Scope.Define(layout, "/Shot/Cast")
    UsdGeom.Scope.Define(layout, "/Shot/Props")
    for index in range(4):
        drone = UsdGeom.Xform.Define(layout, f"/Shot/Cast/Drone{index}")
        drone.GetPrim().GetReferences().AddReference("./assets/crazyflie.usd")
        drone.AddTranslateOp().Set(Gf.Vec3d(index, 0, 1))
    actor = UsdGeom.Xform.Define(layout, "/Shot/Cast/Humanoid")
    actor.GetPrim().GetReferences().AddReference("./assets/humanoid.usda")
    anim = new_layer("anim.usda", "What moves")
    look = new_layer("look.usda", "What it looks like")
    over = look.OverridePrim("/Shot/Cast/Humanoid")
    dress = over.GetVariantSets().AddVariantSet("dress")
    for name in ("work", "gala"):
        dress.AddVariant(name)
        dress.SetVariantSelection(name)
        with dress.GetVariantEditContext():
            over.CreateAttribute("primvars:displayColor", Sdf.ValueTypeNames.Color3fArray).Set(
                [Gf.Vec3f(0.2, 0.3, 0.9) if name == "work" else Gf.Vec3f(0.9, 0.1, 0.2)])
    shot = new_layer("shot.usda", "The shot")
    shot.GetRootLayer().subLayerPaths = ["./look.usda", "./anim.usda", "./layout.usda"]
    shot.SetStartTimeCode(1)
    shot.SetEndTimeCode(240)
    for stage in (layout, anim, look, shot):
        stage.GetRootLayer().Save()


class Server:
    """`usdlive serve`, which can be killed and started again on the same port."""

    def __init__(self, folder: pathlib.Path, log: pathlib.Path):
        self.folder, self.log, self.port = folder, log, 0

    def start(self) -> None:
        port_file = self.log.with_suffix(".port")
        port_file.unlink(missing_ok=True)
        self.process = subprocess.Popen(
            [os.environ["USDLIVE_BIN"], "serve", str(self.folder), "--port", str(self.port),
             "--port-file", str(port_file), "--min-free-mib", "16",
             "--dds", "--dds-domain", os.environ["USDLIVE_DDS_DOMAIN"]],
            stdout=subprocess.DEVNULL, stderr=self.log.open("ab"))
        while not port_file.exists():
            if self.process.poll() is not None:
                sys.exit(f"demo: the server did not start:\n{self.log.read_text()}")
            time.sleep(0.01)
        self.port = int(port_file.read_text())

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=20)

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    @property
    def dds_url(self) -> str:
        return f"dds://{self.folder.name}"


class Editor:
    """An editor's process. It prints its state to stdout, one JSON object a line."""

    def __init__(self, name: str, what: str, command: list[str], log: pathlib.Path):
        self.name, self.what, self.state = name, what, {}
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=log.open("ab"), text=True)
        self.log = log
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            if line.startswith("{"):
                self.state = json.loads(line)

    def ask(self, word: str) -> None:
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def alive(self) -> bool:
        return self.process.poll() is None


def table(editors: list[Editor], clock: float, note: str) -> str:
    lines = [f"{clock:5.1f} s  {note}",
             f"  {'editor':<9} {'does':<42} {'edits':>7} {'p50 ms':>7} {'p99 ms':>7} {'revision':>8} "
             f"{'pending':>7}"]
    for editor in editors:
        s = editor.state
        lines.append(
            f"  {editor.name:<9} {editor.what:<42} {s.get('edits', 0):>7} {s.get('p50', 0):>7.1f} "
            f"{s.get('p99', 0):>7.1f} {s.get('revision', 0):>8} {s.get('pending', 0):>7}"
            f"{'' if s.get('connected', False) else '  (not connected)'}")
    return "\n".join(lines)


class Screen:
    """The table: redrawn in place on a terminal, otherwise printed from time to time."""

    def __init__(self) -> None:
        self.live, self.height, self.last = sys.stdout.isatty(), 0, time.monotonic()

    def show(self, text: str, force: bool = False) -> None:
        if self.live:
            print((f"\x1b[{self.height}F\x1b[J" if self.height else "") + text, flush=True)
            self.height = text.count("\n") + 1
        elif force or time.monotonic() - self.last > 2.5:
            self.last = time.monotonic()
            print(text, flush=True)


def compare(editors: list[Editor], outputs: pathlib.Path, server: Server,
            folder: pathlib.Path) -> bool:
    """Compares the text of every layer: of each editor, of the server, and of the saved files read by
    pxr.Usd."""
    print(f"\n  {'layer':<22} {'bytes':>7}  " + "".join(f"{e.name:<10}" for e in editors) +
          f"{'server':<10}{'saved file':<10}")
    same = True
    for layer in LAYERS:
        texts = {e.name: outputs / e.name / (layer + ".txt") for e in editors}
        shown = subprocess.run([os.environ["USDLIVE_BIN"], "cat", f"{server.url}/{layer}"],
                               capture_output=True, text=True, check=False)
        expected = shown.stdout
        columns = []
        for editor in editors:
            path = texts[editor.name]
            columns.append(path.exists() and path.read_text() == expected)
        columns.append(shown.returncode == 0 and expected.startswith("#usda"))
        columns.append(read_alone(folder / layer) == expected)
        same = same and all(columns)
        print(f"  {layer:<22} {len(expected.encode()):>7}  " +
              "".join(f"{'same' if ok else 'DIFFERS':<10}" for ok in columns))
    return same


def read_alone(path: pathlib.Path) -> str:
    """Returns the text of a file, read by pxr.Usd in a process without our code."""
    script = ("import sys; from pxr import Usd; stage = Usd.Stage.Open(sys.argv[1]); "
              "print(end=stage.GetRootLayer().ExportToString())")
    return subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True,
                          check=False).stdout


def wait_until(condition, seconds: float, what: str) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"{what}: not within {seconds:g} s")
        time.sleep(0.02)


def run(seconds: float, work: pathlib.Path, stay: bool) -> int:
    folder, outputs = work / "project", work / "out"
    make_shot(folder)
    # On loopback, and in a DDS domain that no other demo on this machine uses.
    os.environ["USDLIVE_DDS_DOMAIN"] = str(100 + os.getpid() % 100)
    server = Server(folder, work / "server.log")
    server.start()
    print(f"A shot of {len(LAYERS)} layers around two stages of the newton package, served at "
          f"{server.url} and over DDS\n")

    def python_editor(name: str, what: str, url: str) -> Editor:
        return Editor(name, what, [sys.executable, str(HERE / "editor.py"), name, url,
                                   str(outputs / name)], work / f"{name}.log")

    editors = [
        python_editor("mover", "Python: moves drones, 60 times a second", server.url),
        python_editor("builder", "Python, DDS: renames, adds, deletes", server.dds_url),
        Editor("cpp", "C++: keys the humanoid, sample by sample",
               [str(pathlib.Path(os.environ["USDLIVE_BIN"]).parent / "demo_editor"), server.url,
                str(outputs / "cpp")], work / "cpp.log"),
    ]
    screen = Screen()
    begin = time.monotonic()
    note = shown = "three editors at work"
    plan = [(0.35, "late"), (0.5, "kill"), (0.56, "restart")]
    try:
        while (clock := time.monotonic() - begin) < seconds:
            while plan and clock > plan[0][0] * seconds:
                event = plan.pop(0)[1]
                if event == "late":
                    editors.append(python_editor("late", "Python: joined late, places props",
                                                 server.url))
                    note = "a fourth editor has joined"
                elif event == "kill":
                    server.kill()
                    note = "the server was killed with SIGKILL"
                else:
                    server.start()
                    note = "the server was started again"
            for editor in editors:
                if not editor.alive():
                    raise RuntimeError(f"{editor.name} ended:\n{editor.log.read_text()[-3000:]}")
            screen.show(table(editors, clock, note), force=note != shown)
            shown = note
            time.sleep(0.1)

        # All editors finish, and then wait until all have received everything.
        for editor in editors:
            editor.ask("finish")
        wait_until(lambda: all(e.state.get("finished") for e in editors), 30, "finishing")
        head = max(e.state["revision"] for e in editors)
        wait_until(lambda: all(e.state["revision"] >= head for e in editors), 30, "catching up")
        editors[0].ask("save")
        wait_until(lambda: editors[0].state.get("saved"), 30, "saving")
        for editor in editors:
            editor.ask("export")
        for editor in editors:
            editor.process.wait(timeout=30)
        screen.show(table(editors, time.monotonic() - begin, "all have finished"), force=True)
        same = compare(editors, outputs, server, folder)
    except (RuntimeError, subprocess.TimeoutExpired) as error:
        for editor in editors:
            editor.process.kill()
        server.kill()
        print(f"\ndemo: {error}\nserver:\n{server.log.read_text()[-3000:]}", file=sys.stderr)
        return 1
    if stay and same:
        print(f"\nStill serving {folder}. Join in, with `./run python`:\n\n"
              f"    import usdlive\n"
              f"    live = usdlive.connect(\"{server.url}\", user=\"you\")\n"
              f"    stage = live.open_stage(\"shot.usda\")  # then live.tick() once per frame\n\n"
              "Ctrl-C ends it.")
        try:
            server.process.wait()
        except KeyboardInterrupt:
            print()
    status = server.stop()
    lost = sum(e.state.get("lost", 0) for e in editors)
    total = sum(e.state.get("edits", 0) for e in editors)
    if same and status == 0:
        print(f"\n{total} edits of {len(editors)} editors, revision {head}, {lost} refused or dropped; "
              "every layer is the same everywhere.")
        return 0
    print(f"\nNOT the same everywhere (server's exit status {status}).", file=sys.stderr)
    return 1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15, help="how long they work (default 15)")
    parser.add_argument("--stay", action="store_true",
                        help="keep serving at the end and tell how to join")
    parser.add_argument("--keep", metavar="DIR", help="keep the project, exports and logs there")
    args = parser.parse_args()
    if args.keep:
        work = pathlib.Path(args.keep)
        work.mkdir(parents=True)
        return run(args.seconds, work, args.stay)
    with tempfile.TemporaryDirectory(prefix="usdlive-demo-") as work:
        return run(args.seconds, pathlib.Path(work), args.stay)


if __name__ == "__main__":
    sys.exit(main())
