"""Uploaded files are files of the project for everybody (FI7): real servers, and editors in other processes."""

import hashlib
import os
import pathlib
import random
import subprocess
import threading
import time

import pytest
import usdlive
from conftest import Server, connect, refused, refused_in_a_notice, run, wait
from dds_test import join, server as dds_server  # noqa: F401
from disk_test import disk  # noqa: F401
from fault_points_test import FAULTY
from pxr import Ar, Usd
from usdlive import events

SHOT = '#usda 1.0\n\ndef "World"\n{\n    asset texture = @tex/brick.png@\n}\n\n'
MIB = 1 << 20
SEES = """
from pxr import Ar
path = stage.GetPrimAtPath("/World").GetAttribute("texture").Get().resolvedPath
result = path and Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path)).GetBuffer().decode()
"""


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text(SHOT)
    return serve(project)


@pytest.fixture(params=["fast", "portable"])
def backend(request):
    return request.param


@pytest.fixture
def local(tmp_path):
    """local(content, name) creates a file of this machine."""
    def create(content: bytes | str, name: str = "local.png") -> pathlib.Path:
        file = tmp_path / name
        file.write_bytes(content.encode() if isinstance(content, str) else content)
        return file
    return create


def seen(stage: Usd.Stage) -> str | None:
    """Returns the content of the texture as a program with OpenUSD reads it, or None if it is not found."""
    path = stage.GetPrimAtPath("/World").GetAttribute("texture").Get().resolvedPath
    return Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path)).GetBuffer().decode() if path else None


def temporary(folder: pathlib.Path) -> list[str]:
    return [str(file) for file in folder.rglob(".usdlive-save-*")] + \
        [str(file) for file in (folder / ".usdlive" / "blobs" / "unfinished").iterdir()]


def error(function, *arguments, **options) -> usdlive.Error:
    with pytest.raises(usdlive.Error) as raised:
        function(*arguments, **options)
    return raised.value


def noise(size: int, seed: int = 1) -> bytes:
    return random.Random(seed).randbytes(size)


def test_everybody_finds_the_file_and_the_uploader_at_once(served, local, editor):
    bob = editor(served, "bob", "shot.usda")
    with connect(served, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        assert seen(stage) is None and bob.run(SEES) in (None, "")
        ada.upload(local("brick"), "tex/brick.png")
        assert seen(stage) == "brick", "as soon as upload() has returned"
        assert (served.folder / "tex" / "brick.png").read_text() == "brick"
        assert bob.run(f"live.wait(lambda: stage.GetPrimAtPath('/World').GetAttribute('texture').Get().resolvedPath, 10)\n{SEES}") == "brick"

        ada.upload(local("brick"), "tex/brick.png")  # the same content
        assert error(ada.upload, local("stone"), "tex/brick.png").code == "fileExists"
        assert seen(stage) == "brick"
        ada.upload(local("stone"), "tex/brick.png", overwrite=True)
        assert seen(stage) == "stone"
        end = time.monotonic() + 10
        while bob.run(f"live.tick()\n{SEES}") != "stone":
            assert time.monotonic() < end
        log = served.log.read_text()
        assert "file uploaded" in log and "tex/brick.png" in log and "ada" in log
        assert "not written" in log
    assert temporary(served.folder) == []


def test_names_and_files_that_cannot_be_are_refused(served, local, tmp_path, backend):
    (tmp_path / "outside").mkdir()
    (served.folder / "out").symlink_to(tmp_path / "outside")
    (served.folder / "layer.png").symlink_to("shot.usda")
    (served.folder / "file").write_text("")
    (served.folder / "dir").mkdir()
    file = local("x")
    before = sorted(str(one) for one in served.folder.rglob("*") if ".usdlive" not in one.parts)
    with connect(served, "ada", backend) as live:
        for name in ("", "/a.png", "../a.png", "a/../../b.png", "a//b.png", "tex/", ".usdlive/blobs/x", ".a.png",
                     "tex/.a/b.png", "new.usda", "new.USD", "shot.usda", "a\\b.png", "a:b.png", "a\nb.png",
                     "a\udcff.png", "out/a.png", "layer.png", "file/a.png", "dir", "x" * 2000):
            found = error(live.upload, file, name, overwrite=True)
            assert found.code == "invalidFileName", (name, found)
        assert "create_layer" in error(live.upload, file, "new.usda").message
        assert "out of the project" in error(live.upload, file, "out/a.png").message
        for missing in (tmp_path / "missing.png", tmp_path / "outside"):
            found = error(live.upload, missing, "a.png")
            assert found.code == "invalidArgument" and missing.name in found.message
        assert live.connected
        live.upload(os.fsencode(local("y", "ä.png")), "tex/ä ö.png")
        assert (served.folder / "tex" / "ä ö.png").read_text() == "y"
    assert set(sorted(str(one) for one in served.folder.rglob("*") if ".usdlive" not in one.parts)) - set(before) == \
        {str(served.folder / "tex"), str(served.folder / "tex" / "ä ö.png")}
    assert list((tmp_path / "outside").iterdir()) == []


def test_a_file_above_the_limit_is_refused_before_it_is_sent(project, serve, local, backend):
    (project / "shot.usda").write_text(SHOT)
    with connect(serve(project, "--max-blob-mib", "1"), "ada", backend) as live:
        found = error(live.upload, local(bytes(MIB + 1)), "big.png")
        assert found.code == "blobTooLarge" and "--max-blob-mib" in found.message
        live.upload(local(bytes(MIB)), "big.png")


def test_a_large_file_does_not_delay_frames(served, local, backend):
    content = noise(64 * MIB)
    happened = []
    with connect(served, "ada", backend) as live:
        layer = live.open_layer("shot.usda")
        live.add_handler(happened.append)
        number = live.request_upload(local(content), "big.bin")
        longest, ends = 0.0, []
        while not ends:
            start = time.perf_counter()
            live.tick()
            longest = max(longest, time.perf_counter() - start)
            time.sleep(0.004)
            ends = [one for one in happened if isinstance(one, (events.Uploaded, events.UploadFailed))]
        assert ends == [events.Uploaded(number, "big.bin")]
        assert longest < 0.25, "no tick waits for the disk or the server, also on a busy machine"
        progress = [one for one in happened if isinstance(one, events.Progress) and one.request == number]
        assert all(one.task == "upload" and one.done <= one.total for one in progress if one.total)
        layer.comment = "edits pass it"
        assert live.flush()
    assert hashlib.sha256((served.folder / "big.bin").read_bytes()).digest() == hashlib.sha256(content).digest()


def test_a_file_that_changes_meanwhile_is_not_uploaded(served, local):
    file = local(noise(64 * MIB))
    ends = []
    with connect(served, "ada") as live:
        live.add_handler(lambda event: ends.append(event) if isinstance(event, (events.Uploaded, events.UploadFailed))
                         else None)
        live.request_upload(file, "big.bin")
        unfinished = served.folder / ".usdlive" / "blobs" / "unfinished"
        wait(lambda: any(unfinished.iterdir()), live, timeout=60)
        with file.open("ab") as more:
            more.write(b"more")
        wait(lambda: ends, live, timeout=60)
        assert ends[0].code == "invalidArgument" and "changed while it was read" in ends[0].message
        live.upload(file, "big.bin")
    assert (served.folder / "big.bin").stat().st_size == 64 * MIB + 4
    # The part of the other content that has arrived can be continued (TL2).
    assert [os.path.basename(os.path.dirname(one)) for one in temporary(served.folder)] in ([], ["unfinished"])


def test_calls_at_the_wrong_place_are_errors(served, local, backend):
    file = local("x")
    with connect(served, "ada", backend) as live:
        found = refused_in_a_notice(lambda: live.upload(file, "a.png"), live, served)
        assert found.code == "invalidArgument" and "tick()" in found.message
        said = []
        thread = threading.Thread(target=lambda: said.append(error(live.upload, file, "a.png")))
        thread.start()
        thread.join()
        assert said.pop().code == "invalidArgument"
        done = []
        live.add_handler(lambda event: done or done.append(live.upload(file, "from_event.png")))
        with connect(served, "bob") as bob:
            bob.open_layer("shot.usda").comment = "again"
            assert bob.flush()
        wait(lambda: done and (served.folder / "from_event.png").exists(), live)
        served.kill()
        wait(lambda: not live.connected, live)
        found = error(live.upload, file, "offline.png")
        assert found.code == "notConnected" and "Try again" in found.message
    assert error(live.upload, file, "b.png").code == "notConnected"
    served.start()
    assert not (served.folder / "offline.png").exists()


@pytest.mark.parametrize("point, is_there", [("upload-before", False), ("upload-after", True)])
def test_a_killed_server_leaves_the_whole_file_or_none(project, tmp_path, local, point, is_there):
    (project / "shot.usda").write_text(SHOT)
    server = Server(project, tmp_path / "server.log")
    server.program = [str(FAULTY)]
    server.environment = {"USDLIVE_FAULT": point}
    server.start()
    content = noise(3 * MIB)
    file = project / "tex" / "big.bin"
    try:
        with connect(server, "ada") as live:
            found = error(live.upload, local(content), "tex/big.bin")
            assert found.code == "notConnected" and "whole file or none" in found.message
            server.process.wait(20)
            assert file.exists() == is_there and (not is_there or file.read_bytes() == content)
            assert is_there or len(temporary(project)) == 1, "what the server was writing"
            server.environment = {}
            server.start()
            assert temporary(project) == []
            wait(lambda: live.connected, live, timeout=30)
            live.upload(local(content), "tex/big.bin")
            assert file.read_bytes() == content
    finally:
        server.kill()


def test_a_server_killed_in_the_middle_of_the_transfer(served, local, backend):
    content = noise(64 * MIB)
    ends = []
    with connect(served, "ada", backend) as live:
        live.add_handler(lambda event: ends.append(event) if isinstance(event, (events.Uploaded, events.UploadFailed))
                         else None)
        live.request_upload(local(content), "big.bin")
        unfinished = served.folder / ".usdlive" / "blobs" / "unfinished"
        wait(lambda: any(unfinished.iterdir()), live, timeout=30)
        served.kill()
        wait(lambda: ends, live)
        assert ends[0].code == "notConnected"
        served.start()
        assert temporary(served.folder) == [] and not (served.folder / "big.bin").exists()
        wait(lambda: live.connected, live, timeout=30)
        live.upload(local(content), "big.bin")
    assert (served.folder / "big.bin").read_bytes() == content


def test_a_full_disk_refuses_and_keeps_nothing(disk, tmp_path, local):  # noqa: F811
    project = disk / "project"
    project.mkdir()
    (project / "shot.usda").write_text(SHOT)
    server = Server(project, tmp_path / "server.log").start()

    def space_is_noticed(live, name):
        end = time.monotonic() + 10
        while True:
            try:
                return live.upload(local(b"small", "small.bin"), name)
            except usdlive.Error as refused:
                assert refused.code == "storageFull" and time.monotonic() < end
                time.sleep(0.1)

    try:
        with connect(server, "ada") as live:
            found = error(live.upload, local(noise(60 * MIB)), "too_large.bin")
            assert found.code == "storageFull" and "full" in found.message
            assert not (project / "too_large.bin").exists()
            wait(lambda: temporary(project) == [], live)  # also if the server knew before that its disk is full
            space_is_noticed(live, "a.bin")

            free = os.statvfs(disk).f_bavail * os.statvfs(disk).f_frsize
            found = error(live.upload, local(noise(free * 6 // 10)), "tex/no_room_for_a_copy.bin")
            assert found.code == "storageFull" and "no_room" in found.message and "no space" in found.message
            assert not (project / "tex").exists()
            wait(lambda: temporary(project) == [], live)
            space_is_noticed(live, "b.bin")
        assert (project / "a.bin").read_bytes() == (project / "b.bin").read_bytes() == b"small"
    finally:
        server.kill()


def test_over_dds_and_by_the_command_line(dds_server, local):  # noqa: F811
    content = noise(5 * MIB)
    with usdlive.connect(dds_server.dds, user="ada") as live:
        live.open_layer("root.usda")
        live.upload(local(content), "tex/big.bin")
        assert (dds_server.folder / "tex" / "big.bin").read_bytes() == content
        assert error(live.upload, local(b"x"), "tex/big.bin").code == "fileExists"
    for url, name in ((dds_server.url, "ws.png"), (dds_server.dds, "dds.png")):
        assert run("upload", url, str(local("one")), name) == f"uploaded {name}\n"
        assert (dds_server.folder / name).read_text() == "one"
        assert "overwrite" in refused("upload", url, str(local("two")), name)
        assert run("upload", "--json", "--overwrite", url, str(local("two")), name) == f'{{"uploaded":"{name}"}}\n'
        assert (dds_server.folder / name).read_text() == "two"
    assert "create_layer" in refused("upload", dds_server.url, str(local("x")), "new.usda")
    assert "missing.png" in refused("upload", dds_server.url, "missing.png", "a.png")
    wrong = subprocess.run([os.environ["USDLIVE_BIN"], "upload", "a.png"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2 and "FILE PATH" in wrong.stderr
