"""Places edits before, during and after each milestone of a client: the first list of files, the fetch of a file,
a reconnect, a reload. When all is quiet, its stage shows what a stage of the saved files shows."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
import threading
import time

import pytest
import usdlive
from conftest import Relay, connect, wait
from late_files_test import write_cube, write_package
from pxr import Sdf, Usd


class Gate(Relay):
    """Passes connections on to a server. Requests whose line has the text `holds` wait until release(), and all connections
    can be cut."""

    def __init__(self, server, holds: str):
        self.holds = holds.encode()
        self.held, self.opened = threading.Event(), threading.Event()
        super().__init__(server)

    def release(self):
        self.opened.set()

    def cut(self):
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self):
        self.release()
        self._listener.close()
        self.cut()

    def _serve(self, here):
        with contextlib.suppress(OSError), here:
            first = here.recv(65536)
            if self.holds and self.holds in first.split(b"\r\n")[0]:
                self.held.set()
                self.opened.wait(60)
            with socket.create_connection(("127.0.0.1", self.server.port)) as there:
                self._ends.append(there)
                there.sendall(first)
                while True:
                    for one in select.select([here, there], [], [])[0]:
                        data = one.recv(65536)
                        if not data:
                            return
                        (there if one is here else here).sendall(data)


def shown(stage: Usd.Stage) -> list[str]:
    """Returns the prims that the stage shows, and for assets the names of the files that they resolve to."""
    lines = []
    for prim in stage.Traverse():
        lines.append(f"{prim.GetPath()} {prim.GetTypeName()}")
        for attribute in prim.GetAttributes():
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath):
                lines.append(f"{attribute.GetPath()} {value.path} {os.path.basename(value.resolvedPath)}")
    return lines


class Scene:
    """A project, what can be added to it, and who adds it."""

    def __init__(self, serve, project, tmp_path):
        (project / "shot.usda").write_text('#usda 1.0\ndef "X"\n{\n    double x = 0\n}\n')
        for number in range(3):
            write_cube(project / f"cube{number}.obj")
            write_package(tmp_path / f"package{number}", project / f"prop{number}.usdz")
            (project / f"tex{number}.png").write_bytes(os.urandom(100))
            (project / f"set{number}.usda").write_text(f'#usda 1.0\n(\n    defaultPrim = "S"\n)\ndef "S"\n{{\n    def Sphere "B{number}"\n    {{\n    }}\n}}\n')
        self.server, self.number = serve(project), 0
        self.author = connect(self.server, "ada")
        self.layer = self.author.open_layer("shot.usda")
        wait(lambda: self.layer.GetPrimAtPath("/X"), self.author)

    def add(self) -> None:
        """One edit of each kind."""
        number, self.number = self.number, self.number + 1
        with Sdf.ChangeBlock():
            for file in (f"cube{number}.obj", f"prop{number}.usdz", f"set{number}.usda"):
                prim = Sdf.CreatePrimInLayer(self.layer, "/" + file.replace(".", "_"))
                prim.specifier = Sdf.SpecifierDef
                arcs = prim.payloadList if file.endswith(".usdz") else prim.referenceList
                arcs.Prepend((Sdf.Payload if file.endswith(".usdz") else Sdf.Reference)("./" + file))
            attribute = Sdf.AttributeSpec(prim, "tex", Sdf.ValueTypeNames.Asset)
            attribute.default = Sdf.AssetPath(f"./tex{number}.png")
        assert self.author.flush(20)

    def expected(self) -> list[str]:
        """Returns what OpenUSD shows of the folder, without usdlive."""
        assert self.author.save("shot.usda").saved == ("shot.usda",)
        return shown(Usd.Stage.Open(str(self.server.folder / "shot.usda")))


@pytest.fixture
def scene(serve, project, tmp_path):
    made = Scene(serve, project, tmp_path)
    yield made
    made.author.close()


def for_some_ticks(live) -> None:
    for _ in range(20):
        live.tick()
        time.sleep(0.005)


# The request that is held while the client passes the milestone.
MILESTONES = {"list": "layers=no", "fetch": ".obj", "package": ".usdz", "reconnect": "", "reload": ""}


@pytest.mark.parametrize("milestone", MILESTONES)
def test_edits_at_a_milestone_are_shown_as_from_files(scene, milestone):
    gate = Gate(scene.server, MILESTONES[milestone])
    try:
        with usdlive.connect(gate.url, user="bo", application="test") as live:
            if milestone in ("reconnect", "reload"):
                scene.add()
            stage = live.open_stage("shot.usda")
            for_some_ticks(live)
            if milestone == "list":
                assert gate.held.wait(20)
                scene.add()
                for_some_ticks(live)
            elif milestone in ("fetch", "package"):
                scene.add()
                wait(gate.held.is_set, live, timeout=20)
            elif milestone == "reconnect":
                gate.cut()
            else:
                stage.Reload()
            scene.add()  # during
            for_some_ticks(live)
            if milestone == "reload":
                stage.Reload()
            gate.release()
            for_some_ticks(live)
            scene.add()  # after
            expected = scene.expected()
            assert sum("Mesh" in line for line in expected) == scene.number == 3
            with contextlib.suppress(AssertionError):
                wait(lambda: shown(stage) == expected, live, timeout=30)
            assert "\n".join(shown(stage)) == "\n".join(expected)
    finally:
        gate.close()


OPENS = """
import sys, time
import usdlive
with usdlive.connect(sys.argv[1], user="bo") as live:
    stage = live.open_stage("shot.usda")
    print("opened", flush=True)
    assert live.wait(lambda: any(prim.GetTypeName() == "Mesh" for prim in stage.Traverse()), 10)
"""


def test_a_list_that_did_not_come_in_time_is_asked_for_again_at_once(scene, tmp_path):
    """Not after twenty times the time that was waited for it."""
    scene.add()
    gate = Gate(scene.server, MILESTONES["list"])
    environment = {**os.environ, "USDLIVE_RESOLVER_TIMEOUT_MS": "1500", "USDLIVE_CACHE": str(tmp_path / "other")}
    with subprocess.Popen([sys.executable, "-c", OPENS, gate.url], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          env=environment) as process:
        assert process.stdout.readline() == "opened\n", process.stderr.read()[-2000:]
        gate.release()
        assert process.wait(30) == 0, process.stderr.read()[-2000:]
    gate.close()
