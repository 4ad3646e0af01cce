"""One Python editor of the demo: `editor.py ROLE URL OUTPUT`. It works at 60 frames a second until it reads
`finish`, prints its state to stdout as JSON lines, and on `export` writes the texts of its layers and ends."""

from __future__ import annotations

import collections
import json
import math
import pathlib
import random
import select
import sys
import time

import usdlive
from pxr import Gf, Sdf, Usd, UsdGeom

FRAME = 1 / 60
LAYERS = ["shot.usda", "layout.usda", "anim.usda", "look.usda"]


class Mover:
    """Moves the drones in every frame, and writes their motion to their custom data."""

    def __init__(self, stage: Usd.Stage):
        self.stage = stage
        stage.SetEditTarget(Sdf.Layer.Find(stage.GetRootLayer().ComputeAbsolutePath("./anim.usda")))

    def frame(self, number: int) -> int:
        edits = 0
        for index in range(2):
            prim = self.stage.GetPrimAtPath(f"/Shot/Cast/Drone{index}")
            if not prim:
                continue
            angle = number / 30 + index
            prim.GetAttribute("xformOp:translate").Set(
                Gf.Vec3d(math.cos(angle), math.sin(angle), 1 + 0.1 * index))
            edits += 1
        if number % 30 == 0:
            self.stage.GetPrimAtPath("/Shot").SetCustomDataByKey("flight:lap", number // 30)
            edits += 1
        return edits


class Builder:
    """Renames, adds, deletes, sets variants and references: it changes the structure of the shot."""

    def __init__(self, stage: Usd.Stage):
        self.stage, self.random, self.number = stage, random.Random(7), 0
        root = stage.GetRootLayer()
        self.layout = Sdf.Layer.Find(root.ComputeAbsolutePath("./layout.usda"))
        self.look = Sdf.Layer.Find(root.ComputeAbsolutePath("./look.usda"))

    def frame(self, number: int) -> int:
        if number % 6:
            return 0
        self.stage.SetEditTarget(self.layout)
        props = self.stage.GetPrimAtPath("/Shot/Props")
        mine = [child for child in props.GetAllChildren() if child.GetName().startswith("Crate")]
        choice = self.random.randrange(6)
        if choice < 2 or len(mine) < 3:
            self.number += 1
            crate = UsdGeom.Cube.Define(self.stage, f"/Shot/Props/Crate{self.number}")
            crate.GetSizeAttr().Set(self.random.uniform(0.1, 1))
            crate.AddTranslateOp().Set(Gf.Vec3d(*(self.random.uniform(-5, 5) for _ in range(3))))
            return 4
        if choice == 2:
            self.stage.RemovePrim(self.random.choice(mine).GetPath())
            return 1
        if choice == 3:
            self.number += 1
            editor = Usd.NamespaceEditor(self.stage)
            editor.RenamePrim(self.random.choice(mine), f"Crate{self.number}Renamed")
            editor.ApplyEdits()
            return 1
        if choice == 4:
            self.stage.SetEditTarget(self.look)
            dress = self.stage.GetPrimAtPath("/Shot/Cast/Humanoid").GetVariantSet("dress")
            dress.SetVariantSelection(self.random.choice(["work", "gala"]))
            return 1
        crate = self.random.choice(mine)
        references = crate.GetReferences()
        references.ClearReferences()
        references.AddReference("./assets/crazyflie.usd", Sdf.Path("/root"))
        return 2


class Late:
    """Joins when the others are working, and adds props."""

    def __init__(self, stage: Usd.Stage):
        self.stage, self.random = stage, random.Random(11)
        self.layout = Sdf.Layer.Find(stage.GetRootLayer().ComputeAbsolutePath("./layout.usda"))

    def frame(self, number: int) -> int:
        if number % 4:
            return 0
        self.stage.SetEditTarget(self.layout)
        prop = UsdGeom.Sphere.Define(self.stage, f"/Shot/Props/Ball{number // 4 % 20}")
        prop.GetRadiusAttr().Set(self.random.uniform(0.1, 0.5))
        return 1


ROLES = {"mover": Mover, "builder": Builder, "late": Late}


class Report:
    """Edits, latencies (from authoring to acknowledgement, in ms) and the rest of one editor's state."""

    def __init__(self, live: usdlive.Live):
        self.live, self.edits, self.lost = live, 0, 0
        self.sent: collections.deque[float] = collections.deque()
        self.latencies: list[float] = []
        self.extra: dict = {}
        live.add_handler(self.happened)

    def happened(self, event: usdlive.events.Event) -> None:
        if isinstance(event, usdlive.events.Committed) and event.client == self.live.id:
            if self.sent:
                self.latencies.append((time.monotonic() - self.sent.popleft()) * 1000)
        elif isinstance(event, usdlive.events.Lost):
            self.lost += 1
            print(event, file=sys.stderr, flush=True)
        elif isinstance(event, usdlive.events.Saved):
            self.extra["saved"] = not event.failed
            print(event, file=sys.stderr, flush=True)

    def show(self) -> None:
        ordered = sorted(self.latencies)
        at = lambda share: ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0
        print(json.dumps({"edits": self.edits, "p50": at(0.5), "p99": at(0.99), "lost": self.lost,
                          "revision": self.live.revision, "pending": self.live.pending,
                          "connected": self.live.connected, **self.extra}), flush=True)


def read_word() -> str:
    ready, _, _ = select.select([sys.stdin], [], [], 0)
    return sys.stdin.readline().strip() if ready else ""


def main() -> None:
    role, url, output = sys.argv[1:4]
    live = usdlive.connect(url, user=role, application="usdlive demo")
    stage = live.open_stage("shot.usda")
    worker = ROLES[role](stage)
    report = Report(live)
    working, number, word, printed = True, 0, "", 0.0
    while word != "export":
        begin = time.monotonic()
        if working:
            edits = worker.frame(number)
            number += 1
            report.edits += edits
            if edits:
                report.sent.append(begin)
        live.tick()
        if live.pending == 0:
            report.sent.clear()  # these frames' edits changed nothing
        word = read_word()
        if word == "finish":
            working = False
            report.extra["finished"] = live.flush(30)
        elif word == "save":
            live.save()
        if begin - printed > 0.1 or word:
            printed = begin
            report.show()
        time.sleep(max(0.0, FRAME - (time.monotonic() - begin)))
    pathlib.Path(output).mkdir(parents=True)
    for name in LAYERS:
        layer = Sdf.Layer.Find(stage.GetRootLayer().ComputeAbsolutePath("./" + name))
        pathlib.Path(output, name + ".txt").write_text(layer.ExportToString())
    report.show()


if __name__ == "__main__":
    main()
