"""A disk that runs full (D1, SE8): edits are refused with a code, reading continues, and editing continues
when there is space again."""

import secrets
import subprocess
import sys
import time

import pytest
import usdlive
import wire
from conftest import cat, connect, refused
from pxr import Sdf

MIB = 1024 * 1024
DISK_MIB = 48
EDIT_BYTES = 64 * 1024
ROOT = '#usda 1.0\n\ndef "World"\n{\n    string s\n}\n\n'


@pytest.fixture
def disk(small_disk):
    return small_disk(f"{DISK_MIB}m")


class Author:
    """Writes large samples, and notes which were acknowledged."""

    def __init__(self, server):
        self.peer = wire.Peer(server.url)
        self.sequence = 0
        self.acknowledged = {}
        self.refusals = []

    def edit(self):
        """Returns True if the edit was committed, False if it was refused."""
        self.sequence += 1
        text = secrets.token_hex(EDIT_BYTES // 2)
        self.peer.submit(self.sequence, "root.usda",
                         wire.set_sample("/World.s", self.sequence, wire.string(text)))
        while True:
            kind, members = self.peer.frame(20)
            if kind == "Commit":
                self.peer.follow(members)
                if members["client"] == self.peer.client:
                    assert members["sequence"] == self.sequence
                    self.acknowledged[self.sequence] = text
                    return True
            elif kind == "Refusal":
                assert members["sequence"] == self.sequence
                self.refusals.append(members["code"])
                return False

    def until_refused(self, most):
        for _ in range(most):
            if not self.edit():
                return
        pytest.fail(f"{most} edits fit on the disk")


def samples(text):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text)
    path = Sdf.Path("/World.s")
    return {int(t): layer.QueryTimeSample(path, t) for t in layer.ListTimeSamplesForPath(path)}


def accepted_after(author, seconds):
    """Returns how long it takes until an edit is accepted."""
    start = time.monotonic()
    while not author.edit():
        assert time.monotonic() < start + seconds, "there is space again, and edits are still refused"
        time.sleep(0.05)
    return time.monotonic() - start


def write_until_full(path):
    with path.open("wb", buffering=0) as file:
        for size in (MIB, 4096):
            try:
                while True:
                    file.write(b"x" * size)
            except OSError:
                pass


@pytest.mark.parametrize("by", ["edits", "others"])
def test_d1_a_full_disk_refuses_edits_and_harms_no_reader(by, disk, serve, editor, capfd):
    project = disk / "project"
    project.mkdir()
    (project / "root.usda").write_text(ROOT)
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(8 * MIB))
    server = serve(project)
    author = Author(server)
    ada = editor(server, "ada", "root.usda")
    with wire.Peer(server.url) as reader:
        assert author.edit()
        if by == "others":
            write_until_full(disk / "other")
        author.until_refused(DISK_MIB * MIB // EDIT_BYTES)
        for _ in range(20):
            author.edit()
        assert set(author.refusals) == {"storageFull"}

        # Reading continues: connected editors have everything, and new ones receive it.
        while reader.revision < author.peer.revision:
            reader.follow(reader.expect("Commit"))
        assert samples(cat(server, "root.usda")) == author.acknowledged
        late = editor(server, "late", "root.usda")
        assert samples(late.text("root.usda")) == author.acknowledged

        # An editor keeps its work, and is notified once (SE21).
        told = ada.run("stage.DefinePrim('/First'); result = live.flush(2); stage.DefinePrim('/First/Second')\n"
                       "result = [live.flush(1), live.pending, *(e.code for e in happened if"
                       " type(e).__name__ in ('Lost', 'ServerError'))]")
        assert told == [False, 2, "storageFull"]
        assert samples(ada.text("root.usda")) == author.acknowledged

        # When there is space again, editing continues without any action, on the same session.
        (disk / "other" if by == "others" else ballast).unlink()
        took = accepted_after(author, 5)
        ada.run("assert live.flush(20)")
        assert 'def "First"' in cat(server, "root.usda") and 'def "Second"' in cat(server, "root.usda")
    author.peer.close()
    text = cat(server, "root.usda")
    server.kill()
    server.start()
    assert cat(server, "root.usda") == text
    assert samples(text) == author.acknowledged
    with capfd.disabled():
        print(f"\nD1 by {by}: {len(author.acknowledged)} edits of {EDIT_BYTES} bytes kept, "
              f"{len(author.refusals)} refused, accepted again after {took:.2f} s")


def test_d1_killed_on_a_full_disk(disk, serve):
    """After a kill -9 on a full disk everything acknowledged is there: at once, or, if there is no room to
    open the store, after a message that says so and after the disk has space again."""
    project = disk / "project"
    project.mkdir()
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    author = Author(server)
    for _ in range(20):
        assert author.edit()
    write_until_full(disk / "other")
    author.until_refused(DISK_MIB * MIB // EDIT_BYTES)
    server.kill()
    author.peer.close()
    server.launch()
    end = time.monotonic() + 20
    while server.process.poll() is None and not server.port_file.exists():
        assert time.monotonic() < end, "neither serves nor ends"
        time.sleep(0.01)
    if server.process.poll() is not None:
        assert server.process.returncode == 1
        said = server.log.read_text().splitlines()[-1]
        assert str(project / ".usdlive" / "store") in said and "full" in said
        (disk / "other").unlink()
        server.start()
    else:
        server.port = int(server.port_file.read_text())
    assert samples(cat(server, "root.usda")) == author.acknowledged


FULL_MIB = 100_000_000  # with this least free space every disk is full
NAMES = [f"/World/n{number}" for number in range(20)]


def made(layer):
    return [name for name in NAMES if layer.GetPrimAtPath(name)]


def test_se21_work_made_offline_waits_for_space(project, serve):
    """The disk is full exactly when an editor comes back: nothing leaves its stage, and all is sent when there is space."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada") as live:
        layer = live.open_layer("root.usda")
        happened = []
        live.add_handler(happened.append)
        server.kill()
        for name in NAMES:
            Sdf.CreatePrimInLayer(layer, name)
            live.tick()
        server.min_free_mib = FULL_MIB
        server.start()
        live.wait(lambda: any(getattr(event, "code", "") == "storageFull" for event in happened), 20)
        assert not live.flush(1) and live.pending == len(NAMES)
        assert [event.code for event in happened if type(event).__name__ in ("Lost", "ServerError")] == ["storageFull"]
        server.stop()
        server.min_free_mib = 1
        server.start()
        assert live.flush(20) and made(layer) == NAMES
    assert cat(server, "root.usda").count("def ") + cat(server, "root.usda").count("over ") == 1 + len(NAMES)


KILLED = """
import os, sys, usdlive
from pxr import Sdf
live = usdlive.connect(sys.argv[1], user="ada")
layer = live.open_layer("root.usda")
print("ready", flush=True)
input()
for name in sys.argv[2:]:
    Sdf.CreatePrimInLayer(layer, name)
    live.tick()
assert live.close(0)
os._exit(9)
"""


def test_se21_a_full_disk_uses_up_no_journal(project, serve):
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    editor = subprocess.Popen([sys.executable, "-c", KILLED, server.url, *NAMES], text=True,
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert editor.stdout.readline() == "ready\n"
    server.kill()
    editor.communicate("\n", timeout=30)
    server.min_free_mib = FULL_MIB
    server.start()
    with connect(server, "ada") as live:
        [work] = live.unsent_work()
        with pytest.raises(usdlive.Error) as stopped:
            work.send(timeout=1)
        assert stopped.value.code == "storageFull" and work.about.file in str(stopped.value)
        assert [one.about.transactions for one in live.unsent_work()] == [len(NAMES)]
    assert "root.usda was not changed" in refused("lock", f"{server.url}/root.usda")  # the command does not wait
    server.stop()
    server.min_free_mib = 1
    server.start()
    with connect(server, "ada") as live:
        sent = live.unsent_work()[0].send()
        assert (sent.committed, sent.lost) == (len(NAMES), 0) and live.unsent_work() == []
        assert made(live.open_layer("root.usda")) == NAMES


def test_a_limit_of_file_sizes_is_a_full_disk(project, serve):
    """The server lives, and everything acknowledged is there when files may grow again."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    server.stop()
    program = server.program
    server.program = ["prlimit", "--fsize=3000000", "--", *program]
    server.start()
    with connect(server, "ada") as live:
        layer = live.open_layer("root.usda")
        attribute = layer.GetAttributeAtPath("/World.s")
        acknowledged = 0
        for number in range(60):
            layer.SetTimeSample(attribute.path, number, secrets.token_hex(EDIT_BYTES))
            if not live.flush(1):
                break
            acknowledged = number + 1
        assert server.process.poll() is None, server.log.read_text()[-2000:]
        server.kill()
        server.program = program
        server.start()
        assert live.flush(20)
        held = samples(cat(server, "root.usda"))
        assert set(range(acknowledged)) <= set(held) and held == samples(layer.ExportToString())
