"""Work that the server has not acknowledged survives the death of the editor (kill -9), and is committed
once; with both backends in turn.

USDLIVE_JOURNAL_KILLS: how often the editor is killed.
"""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from conftest import connect
from pxr import Sdf

KILLS = int(os.environ.get("USDLIVE_JOURNAL_KILLS", "20"))
ROOT = '#usda 1.0\n\ndef "World"\n{\n}\n'

# Creates a prim in each frame, some with a big value, some in a gesture, and prints which it created and
# when.
EDITOR = """
import sys, time
import usdlive
from pxr import Sdf, Vt
live = usdlive.connect(sys.argv[1], user="ada", backend=sys.argv[3])
layer = live.open_layer("shot.usda")
number = int(sys.argv[2])
print("ready", flush=True)
while True:
    gesture = number % 50 == 49
    if gesture:
        live.begin_gesture()
    prim = Sdf.CreatePrimInLayer(layer, f"/World/p{number}")
    if number % 20 == 19:
        Sdf.AttributeSpec(prim, "big", Sdf.ValueTypeNames.IntArray).default = Vt.IntArray(100_000, number)
    live.tick()
    if gesture:
        live.end_gesture()
        live.tick()
    print(number, time.time(), flush=True)
    number += 1
    time.sleep(0.004)
"""


class Line:
    """Lets the server work, or stops it, so that nothing is acknowledged."""

    def __init__(self, server):
        self.server, self.stopped = server, False

    def set(self, stopped: bool) -> None:
        if stopped != self.stopped:
            self.server.process.send_signal(signal.SIGSTOP if stopped else signal.SIGCONT)
            self.stopped = stopped


def creations(url: str) -> dict[str, int]:
    """How often each prim was created, by the log."""
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "log", "--json", "-n", "1000000", url],
                         capture_output=True, text=True, check=True)
    counts: dict[str, int] = {}
    for line in ran.stdout.splitlines():
        for edit in json.loads(line)["edits"]:
            if edit["action"] == "create" and edit["path"].startswith("/World/p"):
                counts[edit["path"]] = counts.get(edit["path"], 0) + 1
    return counts


@pytest.mark.alone  # edits older than a second must be kept
def test_an_editor_that_is_killed_loses_nothing(project, serve):
    chance = random.Random(int(os.environ.get("USDLIVE_SEED", "1")))
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    line, next_number, found, committed_before = Line(server), 0, 0, 0
    for kill in range(KILLS):
        editor = subprocess.Popen([sys.executable, "-c", EDITOR, server.url, str(next_number), ("fast", "portable")[kill % 2]],
                                  stdout=subprocess.PIPE, text=True)
        assert editor.stdout.readline() == "ready\n"
        time.sleep(chance.uniform(0, 0.2))
        line.set(chance.random() < 0.7)  # otherwise the acknowledgements are missing, or the work itself
        time.sleep(chance.uniform(1, 1.6) if kill % 4 == 0 else chance.uniform(0, 0.4))
        editor.kill()
        killed = time.time()
        made = [text.split() for text in editor.stdout.read().splitlines()]
        editor.wait()
        line.set(False)
        old = [int(number) for number, moment in made[:-1] if float(moment) < killed - 1]
        with connect(server, "ada") as later:
            layer = later.open_layer("shot.usda")
            for work in later.unsent_work():
                sent = work.send()
                found += sent.committed
                committed_before += sent.before
                assert sent.lost == 0
            assert later.unsent_work() == []
            assert later.flush()
            later.wait(lambda: False, 0.05)
            missing = [number for number in old if not layer.GetPrimAtPath(f"/World/p{number}")]
            assert not missing, (missing, len(made))
            names = {child.name for child in layer.GetPrimAtPath("/World").nameChildren}
        next_number += len(made) + 1
    assert found > 0
    print(f"{KILLS} kills, {next_number} edits, {found} sent later, {committed_before} found to be committed")
    counts = creations(server.url)
    assert {f"/World/{name}" for name in names} <= set(counts)
    doubled = {path: count for path, count in counts.items() if count > 1}
    assert not doubled, doubled
    assert len(names) > next_number / 2


PASTE = """
import sys, time
import usdlive
from pxr import Sdf
live = usdlive.connect(sys.argv[1], user="ada")
layer = live.open_layer("shot.usda")
print("ready", flush=True)
sys.stdin.readline()
with Sdf.ChangeBlock():
    for number in range(3_000):
        prim = Sdf.CreatePrimInLayer(layer, f"/World/p{number}")
        Sdf.AttributeSpec(prim, "text", Sdf.ValueTypeNames.String).default = str(number) * 250
live.tick()
print("written", flush=True)
while True:
    live.tick()
    time.sleep(0.01)
"""


def test_a_transaction_larger_than_a_frame_is_sent_later(project, serve):
    """An editor that was killed could only send it in parts (FR8). Whoever sends it later does the same."""
    (project / "shot.usda").write_text(ROOT)
    server = serve(project, "--max-frame-mib", "1")
    editor = subprocess.Popen([sys.executable, "-c", PASTE, server.url], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                              text=True)
    assert editor.stdout.readline() == "ready\n"
    server.process.send_signal(signal.SIGSTOP)
    editor.stdin.write("go\n")
    editor.stdin.flush()
    assert editor.stdout.readline() == "written\n"
    time.sleep(2)  # the journal is on the disk after a second at the latest
    editor.kill()
    editor.wait()
    server.process.send_signal(signal.SIGCONT)
    with connect(server, "ada") as later:
        layer = later.open_layer("shot.usda")
        [work] = later.unsent_work()
        sent = work.send()
        assert (sent.committed, sent.lost) == (1, 0)
        later.wait(lambda: layer.GetAttributeAtPath("/World/p2999.text"), 30)
        assert layer.GetAttributeAtPath("/World/p2999.text").default == "2999" * 250
