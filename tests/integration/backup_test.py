"""`usdlive backup` copies a project while it is served: what was confirmed before is there, and the copy can be served."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time

import pytest
from conftest import cat, connect, refused, run
from pxr import Gf, Sdf, Vt

ROOT = '#usda 1.0\n\ndef "World"\n{\n    int number = 0\n    float3[] points\n}\n'
BIG = 300_000  # points; a big value


@pytest.fixture
def project(project):
    (project / "root.usda").write_text(ROOT)
    (project / "tex").mkdir()
    (project / "tex" / "brick.png").write_bytes(bytes(range(256)) * 40)
    (project / "current").symlink_to("tex")
    return project


def number_in(text: str) -> int:
    return int(text.split("int number = ")[1].split()[0])


class Writer:
    """An editor that writes as fast as it can, on a thread of its own."""

    def __init__(self, server):
        self.confirmed, self._ends, self._server, self.failed = 0, threading.Event(), server, None
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        while not self.confirmed and self._thread.is_alive():
            time.sleep(0.01)

    def _run(self):
        try:
            with connect(self._server, "ada") as live:
                layer = live.open_layer("root.usda")
                number = 0
                while not self._ends.is_set():
                    number += 1
                    layer.GetAttributeAtPath("/World.number").default = number
                    if number % 50 == 1:
                        layer.GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(number, 0, 0))
                    assert live.flush(20)
                    self.confirmed = number
        except BaseException as failed:  # noqa: BLE001
            self.failed = failed

    def end(self):
        self._ends.set()
        self._thread.join()
        assert self.failed is None, self.failed


def test_a_backup_under_load_has_what_was_confirmed_before(project, serve, tmp_path):
    server = serve(project)
    writer = Writer(server)
    backups = []
    for name in ("one", "two"):
        before = writer.confirmed
        printed = run("backup", str(project), str(tmp_path / name))
        backups.append((tmp_path / name, before, writer.confirmed))
        assert printed.startswith(f"{tmp_path / name} has the project at revision "), printed
    writer.end()
    assert not list((project / ".usdlive").glob("copy-*"))
    for folder, before, after in backups:
        assert (folder / "tex" / "brick.png").read_bytes() == bytes(range(256)) * 40
        assert os.readlink(folder / "current") == "tex"
        copy = serve(folder)
        number = number_in(cat(copy, "root.usda"))
        assert before <= number <= after + 1
        with connect(copy, "bo") as live:
            layer = live.open_layer("root.usda")
            points = layer.GetAttributeAtPath("/World.points").default
            assert len(points) == BIG and 1 <= points[0][0] <= number
            layer.GetAttributeAtPath("/World.number").default = -1
            assert live.flush(20) and live.save().saved
        revisions = [one for one in run("log", copy.url, "--json", "-n", "100000").splitlines()]
        assert len(revisions) >= number
    # The original has nothing of it.
    assert number_in(cat(server, "root.usda")) == writer.confirmed


def test_a_project_that_nobody_serves(project, serve, tmp_path):
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 7
        assert live.flush()
        live.create_checkpoint("lunch")
    server.stop()
    run("backup", str(project), str(tmp_path / "one") + "/")
    run("backup", str(tmp_path / "one"), str(tmp_path / "two"))
    for folder in (project, tmp_path / "one", tmp_path / "two"):
        again = serve(folder)
        assert number_in(cat(again, "root.usda")) == 7
        assert "lunch" in run("checkpoints", again.url)
        again.stop()


def test_a_history_that_begins_with_a_base(project, serve, tmp_path):
    server = serve(project)
    with connect(server, "ada") as live:
        layer = live.open_layer("root.usda")
        for number in range(1, 20):
            layer.GetAttributeAtPath("/World.number").default = number
            assert live.flush()
        assert live.ask("compactHistory", timeout=20, days=0)
        layer.GetAttributeAtPath("/World.number").default = 20
        assert live.flush()
        run("backup", str(project), str(tmp_path / "one"))
    assert number_in(cat(serve(tmp_path / "one"), "root.usda")) == 20


def test_accounts_stay_private(project, tmp_path):
    run("user", "add", "ann", "--at", "127.0.0.1:1", str(project))
    server = subprocess.Popen([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0"], stdout=subprocess.PIPE, text=True)
    server.stdout.readline()
    run("backup", str(project), str(tmp_path / "one"))
    server.terminate()
    assert server.wait(20) == 0
    users = tmp_path / "one" / ".usdlive" / "users.json"
    assert users.stat().st_mode & 0o777 == 0o600
    assert not (tmp_path / "one" / ".usdlive" / "server.json").exists()


def test_misuse_names_what_is_wrong(project, serve, tmp_path):
    assert "no history yet" in refused("backup", str(project), str(tmp_path / "one"))
    server = serve(project)
    cat(server, "root.usda")
    (tmp_path / "there").mkdir()
    for target, why in ((tmp_path / "there", "exists"), (project / "backup", "cannot be in the folder"),
                        (project, "exists"), (tmp_path / "no" / "folder", "there is no folder"),
                        (project / "tex" / ".." / "b", "cannot be in the folder")):
        assert why in refused("backup", str(project), str(target)), target
    assert sorted(one.name for one in tmp_path.iterdir() if "part" in one.name) == []
    (tmp_path / "link").symlink_to("nowhere")
    assert "exists" in refused("backup", str(project), str(tmp_path / "link"))


def test_a_server_that_ends_leaves_no_backup(project, serve, tmp_path):
    server = serve(project)
    cat(server, "root.usda")
    server.process.send_signal(signal.SIGSTOP)
    backup = subprocess.Popen([os.environ["USDLIVE_BIN"], "backup", str(project), str(tmp_path / "one")],
                              stderr=subprocess.PIPE, text=True)
    while not (project / ".usdlive" / "copy.json").exists():
        time.sleep(0.01)
    server.process.kill()
    server.process.wait()
    assert backup.wait(20) == 1 and "server has ended" in backup.stderr.read()
    assert not (tmp_path / "one").exists() and not (tmp_path / "one.part").exists()
    server.start()
    run("backup", str(project), str(tmp_path / "one"))


def test_a_killed_backup_is_begun_again(project, serve, tmp_path):
    server = serve(project)
    writer = Writer(server)
    for moment in (0.02, 0.1, 0.2, 0.3):
        backup = subprocess.Popen([os.environ["USDLIVE_BIN"], "backup", str(project), str(tmp_path / "one")],
                                  stdout=subprocess.DEVNULL)
        time.sleep(moment)
        backup.kill()
        backup.wait()
        if (tmp_path / "one").exists():
            break
    if not (tmp_path / "one").exists():
        run("backup", str(project), str(tmp_path / "one"))
    writer.end()
    assert not (tmp_path / "one.part").exists()
    assert number_in(cat(serve(tmp_path / "one"), "root.usda")) > 0


def test_a_full_disk_leaves_nothing(project, serve, tmp_path, small_disk):
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("root.usda").GetAttributeAtPath("/World.points").default = Vt.Vec3fArray(BIG, Gf.Vec3f(1, 2, 3))
        assert live.flush(20)
    disk = small_disk("2m")
    why = refused("backup", str(project), str(disk / "one"))
    assert "No space left" in why or "disk is too full" in why
    assert list(disk.iterdir()) == []
    # The server goes on.
    with connect(server, "ada") as live:
        live.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 3
        assert live.flush(20)
    other = small_disk("200m")  # another file system: copied, not shared
    run("backup", str(project), str(other / "one"))
    copy = serve(other / "one")
    assert number_in(cat(copy, "root.usda")) == 3


def test_files_are_not_changed_through_the_copy(project, serve, tmp_path):
    server = serve(project)
    with connect(server, "ada") as live:
        live.open_layer("root.usda").GetAttributeAtPath("/World.number").default = 1
        assert live.flush() and live.save().saved
        run("backup", str(project), str(tmp_path / "one"))
    (tmp_path / "one" / "tex" / "brick.png").write_bytes(b"x")
    assert len((project / "tex" / "brick.png").read_bytes()) == 256 * 40
    layer = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "one" / "root.usda"))
    assert layer.GetAttributeAtPath("/World.number").default == 1
