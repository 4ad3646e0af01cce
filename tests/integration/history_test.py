"""Tests a bounded history (CH4): by command, by option, while others edit, and with kills at any moment."""

import json
import os
import pathlib
import random
import re
import statistics
import subprocess
import threading
import time

import pytest
import wire
from conftest import Server, cat, refused, run, unused_port

FAULTY = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "usdlive-server-faults"
LAYERS = ("one.usda", "two.usda", "three.usda")
ROOT = '#usda 1.0\n\ndef "World"\n{\n    int64 n\n}\n'


@pytest.fixture
def served(project, serve):
    for name in LAYERS:
        (project / name).write_text(ROOT)
    return serve(project)


class Author:
    def __init__(self, server):
        self.peer, self.sequence = wire.Peer(server.url), 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.peer.close()

    def write(self, count, layers=LAYERS, window=64):
        """Edits the layers in turn; returns the newest revision."""
        waiting = 0
        for _ in range(count):
            self.sequence += 1
            self.peer.submit(self.sequence, layers[self.sequence % len(layers)],
                             wire.set_sample("/World.n", self.sequence, wire.int64(self.sequence)))
            waiting += 1
            while waiting >= window:
                waiting -= self.take()
        while waiting:
            waiting -= self.take()
        return self.peer.revision

    def take(self):
        kind, members = self.peer.frame(30)
        assert kind != "Refusal", members
        if kind != "Commit":
            return False
        self.peer.follow(members)
        return members["client"] == self.peer.client


def compact(server, days=0):
    return json.loads(run("compact", server.url, "--days", str(days), "--json"))


def whole(server):
    """Returns the history from its base on, verified as a chain, and the content of the layers."""
    with wire.Peer(server.url) as peer:
        base = peer.welcome["base"]
        log = peer.log(0) if peer.revision > base else []
        return base, log, peer.revision, peer.hash, {name: cat(server, name) for name in LAYERS}


def test_compaction_by_command(served):
    with Author(served) as ada:
        ada.write(30)
        named = json.loads(run("checkpoint", served.url, "lunch", "--json"))["revision"]
        at_lunch = {name: cat(served, name) for name in LAYERS}
        newest = ada.write(30)
        before = whole(served)
        assert "no commit was replaced" in run("compact", served.url, "--days", "1"), "all are of today"
        assert compact(served, 1)["base"] == 0

        done = compact(served)
        assert (done["base"], done["replaced"]) == (named, named)
        assert "lunch" in done["keptFor"]
        for opened in range(2):
            base, log, revision, hash_, texts = whole(served)
            assert (base, revision, hash_, texts) == (named, *before[2:])
            assert [c["hash"] for c in log] == [c["hash"] for c in before[1][base:]]
            assert {name: cat(served, name, "--checkpoint", "lunch") for name in LAYERS} == at_lunch
            if not opened:
                served.kill()
                served.start()
    said = refused("cat", f"{served.url}/one.usda", "--revision", str(named - 1))
    assert f"the oldest revision that can be read is {named}" in said.lower()
    assert "were replaced" in refused("log", served.url, "--from", "1")
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "log", served.url, "-n", "1000"], capture_output=True, text=True)
    assert ran.returncode == 0 and f"the history begins at revision {named}" in ran.stderr
    assert len(re.findall(r"^#", ran.stdout, re.M)) == newest - named
    assert "were replaced" not in subprocess.run([os.environ["USDLIVE_BIN"], "log", served.url, "-n", "5"],
                                                 capture_output=True, text=True).stderr
    assert "lunch" in run("compact", served.url, "--days", "0"), "and it goes no further"


def test_days_have_to_be_said_and_by_an_administrator(project, serve):
    (project / "one.usda").write_text(ROOT)
    server = serve(project, "--admin", "ada")
    assert "--days N" in refused("compact", server.url, "-u", "ada")
    assert "--admin" in refused("compact", server.url, "--days", "3", "-u", "bo")
    assert "no commit was replaced" in run("compact", server.url, "--days", "3", "-u", "ada")
    server.stop()
    server = serve(project, "--history-days", "3")
    assert "no commit was replaced" in run("compact", server.url)


def test_the_use_of_space_is_printed(served):
    with Author(served) as ada:
        ada.write(300, LAYERS[:2])
        for opened in range(2):
            stat = json.loads(run("stat", served.url, "--json"))
            assert stat["revision"] == ada.peer.revision and stat["free"] > 0
            layers = {one["layer"]: one for one in stat["layers"]}
            assert set(layers) == set(LAYERS[:2])
            if opened:
                assert stat["base"] == stat["revision"] and stat["bases"] > 0
                assert all(one["commits"] == 0 and one["log"] == 0 and one["base"] > 0 for one in layers.values())
            else:
                assert stat["base"] == stat["bases"] == 0 and stat["log"] > 0
                assert [one["commits"] for one in layers.values()] == [151, 151], "an import, and edits"
                assert abs(sum(one["log"] for one in layers.values()) - stat["log"]) <= 2
            text = run("stat", served.url)
            assert "log: " in text and "one.usda: " in text and ("base: " in text) == bool(opened)
            if not opened:
                compact(served)


def test_a_client_before_the_base_gets_a_snapshot(project, serve, editor):
    for name in LAYERS:
        (project / name).write_text(ROOT)
    server = serve(project)
    old = wire.Peer(server.url)
    with Author(server) as ada:
        ada.write(20)
        ada.peer.close()
    bo = editor(server, "bo", "one.usda")
    bo.run("stage.DefinePrim('/World/Before', 'Xform')")
    bo.flush()
    server.kill()
    bo.run("assert live.wait(lambda: not live.connected, 20)\n"
           "stage.DefinePrim('/World/Offline', 'Xform'); live.tick()\n")
    port, server.port = server.port, unused_port()  # bo does not know this one
    server.start()
    with Author(server) as ada:
        ada.write(200)
    assert compact(server)["base"] > 200
    with Author(server) as ada:
        ada.write(20)
    server.kill()
    server.port = port
    server.start()
    bo.run("assert live.wait(lambda: live.connected, 20)")
    bo.catch_up(bo.flush())
    text = cat(server, "one.usda")
    assert bo.text("one.usda") == text and 'def Xform "Before"' in text and 'def Xform "Offline"' in text

    resumed = wire.Peer(server.url, resume=old.resume_point())
    assert not resumed.welcome["resumed"]
    old.close()
    resumed.close()


def test_editing_continues_while_it_compacts(project, serve, capfd):
    """Editing continues while the history is compacted, and is not delayed by it."""
    for name in LAYERS:
        (project / name).write_text(ROOT)
    server = serve(project)
    with Author(server) as ada:
        ada.write(60_000, window=1000)
        took, marks, going = [], [], True

        def edit():
            while going:
                begin = time.monotonic()
                ada.write(1, window=1)
                took.append((begin, time.monotonic() - begin))

        editing = threading.Thread(target=edit)
        editing.start()
        time.sleep(2)
        begin = time.monotonic()
        done = compact(server)
        end = time.monotonic()
        time.sleep(2)
        going = False
        editing.join()
    quiet = [one for at, one in took if at < begin]
    beside = [one for at, one in took if begin <= at <= end]
    assert done["replaced"] > 59_000 and done["bytesAfter"] < done["bytesBefore"] / 2

    def figures(times):
        return f"median {1000 * statistics.median(times):.1f} ms, longest {1000 * max(times):.1f} ms"

    with capfd.disabled():
        print(f"\nCH4: {done['replaced']} commits in {end - begin:.2f} s, {done['bytesBefore']} bytes before and "
              f"{done['bytesAfter']} after; an edit took {figures(quiet)} before, {figures(beside)} beside it")
    assert len(beside) > 5
    assert max(beside) < max(1, (end - begin) / 3), "an edit waited for the compaction"


@pytest.mark.parametrize("how", ["points", "moments"])
def test_killed_while_it_compacts(how, project, tmp_path, capfd):
    """After each kill the store opens, its chain is correct, and each readable revision has its earlier
    content."""
    random_ = random.Random(int(os.environ.get("USDLIVE_SEED", "1")))
    kills = int(os.environ.get("USDLIVE_KILLS", "8"))
    for name in LAYERS:
        (project / name).write_text(ROOT)
    server = Server(project, tmp_path / "server.log")
    product = server.program
    moved, seconds, expected = 0, 0.3, {}
    for number in range(kills):
        server.start()
        with Author(server) as author:
            author.write(random_.randint(1, 400))
        wanted = whole(server)
        for at in random_.sample(range(wanted[2] // 2, wanted[2] + 1), 3):
            if at >= max(wanted[0], len(LAYERS)):
                expected |= {(name, at): cat(server, name, "--revision", str(at)) for name in LAYERS}
        server.kill()
        # The server is killed while it compacts: at a point of the code, or at a random moment.
        if how == "points":
            point = random_.choice(("compact-before", "compact-after", f"keeping:{random_.randint(1, 1500)}"))
            server.program, server.environment = [str(FAULTY)], {"USDLIVE_FAULT": point}
        server.start()
        asked = subprocess.Popen([os.environ["USDLIVE_BIN"], "compact", server.url, "--days", "0"],
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if how == "points":
            asked.wait(timeout=30)
        else:
            time.sleep(seconds * random_.random())
        server.kill()
        asked.wait(timeout=30)
        server.program, server.environment = product, {}

        server.start()
        base, log, revision, hash_, texts = whole(server)
        assert (revision, hash_, texts) == wanted[2:], f"after kill {number}"
        assert base >= wanted[0]
        assert [c["hash"] for c in log] == [c["hash"] for c in wanted[1][base - wanted[0]:]]
        moved += base > wanted[0]
        seconds *= 0.8 if base > wanted[0] else 1.5  # about as long as a compaction takes here
        expected = {(name, at): text for (name, at), text in expected.items() if at >= base}
        for name, at in random_.sample(sorted(expected), min(12, len(expected))):
            assert cat(server, name, "--revision", str(at)) == expected[name, at], f"{name} at {at}"
        server.kill()
    with capfd.disabled():
        print(f"\nCH4 {how}: {kills} kills, the base moved at {moved} of them")
    assert 0 < moved, "the history was never compacted"
    server.start()
    for name, at in expected:
        assert cat(server, name, "--revision", str(at)) == expected[name, at], f"{name} at {at}"
    assert compact(server)["base"] == wanted[2]
    base, log, revision, hash_, texts = whole(server)
    assert (base, log, revision, hash_, texts) == (wanted[2], [], *wanted[2:])
    assert server.stop() == 0
