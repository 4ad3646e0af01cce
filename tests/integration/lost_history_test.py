"""A project's history that is missing or damaged: the messages, and that work continues."""

import os
import shutil
import subprocess
import time

import pytest
import usdlive
from conftest import cat, connect, wait


def test_a_history_that_was_deleted_is_explained_once(project, serve, tmp_path):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    for _ in range(3):  # makes three epochs
        server.stop()
        server.start()
    said = []
    with connect(server, "ada") as live:

        def happened(event):
            if isinstance(event, usdlive.events.ServerError) and "another history" in event.message:
                said.append(event.message)

        live.add_handler(happened)
        layer = live.open_layer("shot.usda")
        server.stop()
        (project / ".usdlive").rename(tmp_path / "aside")
        server.start()
        wait(lambda: said, live)
        for _ in range(300):  # enough for several attempts to connect
            live.tick()
            time.sleep(0.01)
        assert len(said) == 1, said
        for words in ("another history", ".usdlive was deleted", "connect again", "unsent_work"):
            assert words in said[0]
        server.stop()
        shutil.rmtree(project / ".usdlive")
        (tmp_path / "aside").rename(project / ".usdlive")
        server.start()
        wait(lambda: live.connected, live, timeout=20)
        layer.comment = "goes on"
        assert live.flush(20)


def test_a_history_that_is_deleted_under_the_server_acknowledges_nothing(project, serve, tmp_path):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    aside, lost = tmp_path / "aside", []
    with connect(server, "ada") as live:
        live.add_handler(lambda event: lost.append(event) if isinstance(event, usdlive.events.Lost) else None)
        layer = live.open_layer("shot.usda")
        layer.comment = "before"
        assert live.flush(20)
        known = live.revision
        (project / ".usdlive").rename(aside)
        layer.comment = "waits"
        with pytest.raises(AssertionError):
            wait(lambda: live.revision > known, live, timeout=3)
        log = server.log.read_text()
        assert "was deleted or moved while the server runs" in log and "Put it back" in log
        assert "full" not in log
        aside.rename(project / ".usdlive")
        wait(lambda: "store opened again" in server.log.read_text(), live)
        assert live.flush(20), "what was refused is sent again"
        assert not lost and layer.comment == "waits"
        layer.documentation = "goes on"
        assert live.flush(20) and live.revision == known + 2
        text = layer.ExportToString()
    server.stop()
    server.start()
    assert cat(server, "shot.usda") == text


def test_a_damaged_store_gets_advice(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    assert cat(server, "shot.usda")
    server.stop()
    [current] = (project / ".usdlive" / "store").rglob("CURRENT")
    current.write_text("nonsense")
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0"], capture_output=True,
                         text=True, timeout=60)
    assert ran.returncode == 1
    assert "CURRENT" in ran.stderr and f"history in {project}/.usdlive is damaged" in ran.stderr
    assert f"mv {project}/.usdlive {project}/.usdlive-damaged" in ran.stderr and "backup" in ran.stderr
    (project / ".usdlive").rename(project / ".usdlive-damaged")
    server.start()
    assert cat(server, "shot.usda") == "#usda 1.0\n\n"
