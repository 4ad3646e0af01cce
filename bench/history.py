"""How long it takes to search a long history, to take a commit of it back, and to play it.

    ./run bench history [--commits 100000] [--rounds 3] [--fields 100000]

A server whose project has a layer with 1,000 attributes, and as many commits of one value each as `commits` says. The
times are those of the whole command, in seconds; `connect` is `usdlive who`, which only connects. `blameNew` and
`blameOld` ask who has made an opinion that one of the last commits has written, and one that only the first has.
`logPath` looks for all commits of one attribute. `revertNew` and `revertOld` take back one of the last commits, and the
first one, which reads all of them (both as a dry run). Medians.

`player*` are of another layer of the project, which has `--fields` attributes with a value each and 1,000 commits. `playerForward` and
`playerBackward` are revisions a second of a player that is moved to each of them in turn, with a stage on its layers,
`playerRandom` those of jumps to and fro; the commits are read once before. `playerOpen` is the time to open the stage of a
revision (`open_stage(at=)`) that this process has not opened, and `playerRatio` how many revisions a player shows forward in
that time.
"""

from __future__ import annotations

import argparse
import json
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
from support.serving import serve  # noqa: E402

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


def fields_layer(fields: int) -> str:
    prims = "".join(f'    def "Group{number}"\n    {{\n'
                    + "".join(f"        double v{i} = {i}\n" for i in range(100)) + "    }\n" for number in range(fields // 100))
    return f'#usda 1.0\n\ndef "World"\n{{\n{prims}}}\n'


def play(url: str, fields: int, commits: int = 1_000) -> dict[str, float]:
    chance = random.Random(1)
    with usdlive.connect(url, user="ann", timeout=60) as live:
        layer = live.open_layer("fields.usda")
        live.flush()
        begin = live.revision
        for number in range(commits):
            path = f"/World/Group{chance.randrange(fields // 100)}.v{chance.randrange(100)}"
            layer.GetAttributeAtPath(path).default = -1.0 - number
            live.tick()
            while live.pending > 500:
                live.tick()
        assert live.flush(60)
        assert live.revision == begin + commits
        player = live.player("fields.usda", at=begin)
        player.seek(begin + commits)
        player.seek(begin)

        def rate(revisions: list[int]) -> float:
            start = time.perf_counter()
            for one in revisions:
                player.seek(one)
            return len(revisions) / (time.perf_counter() - start)

        forward = rate(list(range(begin + 1, begin + commits + 1)))
        backward = rate(list(range(begin + commits - 1, begin - 1, -1)))
        back_and_forth = rate([begin + chance.randrange(commits) for _ in range(200)])
        opened = []
        for at in (begin + 3, begin + 333, begin + 777):
            start = time.perf_counter()
            live.open_stage("fields.usda", at=at)
            opened.append(time.perf_counter() - start)
        took = statistics.median(opened)
        return {"playerForward": forward, "playerBackward": backward, "playerRandom": back_and_forth, "playerOpen": took,
                "playerRatio": forward * took}


def seconds(*words: str) -> float:
    begin = time.perf_counter()
    subprocess.run([BIN / "usdlive", *words], stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - begin


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--commits", type=int, default=100_000)
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--fields", type=int, default=100_000)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project = pathlib.Path(folder) / "shots"
        project.mkdir()
        (project / "shot.usda").write_text(LAYER)
        (project / "fields.usda").write_text(fields_layer(options.fields))
        server, port = serve(project, "--durability", "os", program=(BIN / "usdlive", "serve"), stderr=subprocess.DEVNULL)
        try:
            url = f"ws://127.0.0.1:{port}"
            played = play(url, options.fields)
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
    print(json.dumps({"bench": "history", "commits": newest, "fields": options.fields,
                      **{name: round(value, 3) for name, value in {**took, **played}.items()}}))


if __name__ == "__main__":
    main()
