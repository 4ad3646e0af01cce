"""How long it takes to search a long history, and to take a commit of it back.

    ./run bench history [--commits 100000] [--rounds 3]

A server whose project has a layer with 1,000 attributes, and as many commits of one value each as `commits` says. The
times are those of the whole command, in seconds; `connect` is `usdlive who`, which only connects. `blameNew` and
`blameOld` ask who has made an opinion that one of the last commits has written, and one that only the first has.
`logPath` looks for all commits of one attribute. `revertNew` and `revertOld` take back one of the last commits, and the
first one, which reads all of them (both as a dry run). Medians.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "integration"))
BIN = ROOT / "build" / "release" / "bin"

import usdlive  # noqa: E402

ATTRIBUTES = 1_000
LAYER = ('#usda 1.0\n\ndef "World"\n{\n    double first\n'
         + "".join(f"    double v{i}\n" for i in range(ATTRIBUTES)) + "}\n")


def fill(url: str, commits: int) -> None:
    chance = random.Random(1)
    with usdlive.connect(url, user="ann") as live:
        layer = live.open_layer("shot.usda")
        layer.GetAttributeAtPath("/World.first").default = 1.0
        live.flush()
        for number in range(commits):
            layer.GetAttributeAtPath(f"/World.v{chance.randrange(ATTRIBUTES - 1)}").default = float(number)
            live.tick()
            while live.pending > 500:
                live.tick()
                time.sleep(0.001)
        layer.GetAttributeAtPath(f"/World.v{ATTRIBUTES - 1}").default = 1.0
        live.flush()


def seconds(*words: str) -> float:
    begin = time.perf_counter()
    subprocess.run([BIN / "usdlive", *words], stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - begin


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--commits", type=int, default=100_000)
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project = pathlib.Path(folder) / "shots"
        project.mkdir()
        (project / "shot.usda").write_text(LAYER)
        port_file = pathlib.Path(folder) / "port"
        server = subprocess.Popen([BIN / "usdlive", "serve", project, "--port", "0", "--port-file", port_file,
                                   "--durability", "os"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            while not port_file.exists():
                time.sleep(0.01)
            url = f"ws://127.0.0.1:{port_file.read_text().strip()}"
            fill(url, options.commits)
            log = subprocess.run([BIN / "usdlive", "log", "--json", "-n", "1", url], capture_output=True, text=True,
                                 check=True)
            newest = json.loads(log.stdout)["revision"]
            lines = {
                "connect": ("who", url),
                "blameNew": ("blame", url, "shot.usda", f"/World.v{ATTRIBUTES - 1}.default"),
                "blameOld": ("blame", url, "shot.usda", "/World.first.default"),
                "logPath": ("log", "--path", "/World.v0", url, "shot.usda", "-n", "1000000"),
                "revertNew": ("revert", "--dry-run", url, str(newest)),
                "revertOld": ("revert", "--dry-run", url, "2"),
            }
            took = {name: statistics.median(seconds(*words) for _ in range(options.rounds))
                    for name, words in lines.items()}
        finally:
            server.terminate()
            server.wait()
    print(json.dumps({"bench": "history", "commits": newest, **{name: round(value, 3) for name, value in took.items()}}))


if __name__ == "__main__":
    main()
