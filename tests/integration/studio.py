"""A server with users, each with a configuration folder of their own, and the commands that manage it."""

from __future__ import annotations

import http.client
import json
import os
import pathlib
import re
import subprocess

import pytest
import usdlive
from conftest import shots
from pxr import Sdf, Usd

ROOT = """#usda 1.0

def Xform "World"
{
    def Xform "Props"
    {
        def Cube "Box"
        {
            double size = 1
        }
    }
    def Xform "Hero"
    {
    }
}
"""


@pytest.fixture
def project(tmp_path):
    return shots(tmp_path, ROOT)


def usdlive_(*words: object, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run([os.environ["USDLIVE_BIN"], *map(str, words)], capture_output=True, text=True,
                          env={**os.environ, **environment}, timeout=30)


def user(*words: object) -> str:
    """Runs `usdlive user` and returns what it prints."""
    ran = usdlive_("user", *words)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def invited(*words: object) -> str:
    return re.search(r"usdlive-invitation://\S+", user(*words)).group()


class Studio:
    """A server with users, each of whom has a configuration folder of their own."""

    def __init__(self, folder, serve, tmp_path, monkeypatch):
        self.folder, self.tmp_path, self.monkeypatch, self.joined = folder, tmp_path, monkeypatch, []
        user("add", "chief", "--role", "admin", "--at", "127.0.0.1:1", folder)
        self.server = serve(folder)
        self.be("nobody")

    def home(self, name: str) -> str:
        return str(self.tmp_path / "homes" / name)

    def be(self, name: str) -> None:
        self.monkeypatch.setenv("XDG_CONFIG_HOME", self.home(name))

    def join(self, name: str, role: str, backend: str | None = None, stays: bool = False):
        """Adds a user, who joins, and returns their connection. `stays`: the process is theirs from then on. Without it, what
        is fetched by threads of the connection may be refused, because the process has the token of nobody."""
        invitation = invited("add", name, "--role", role, self.folder)
        self.be(name)
        self.joined.append(usdlive.connect(invitation, backend=backend))
        if not stays:
            self.be("nobody")
        return self.joined[-1]

    def token(self, name: str) -> str:
        servers = json.loads((pathlib.Path(self.home(name)) / "usdlive" / "servers.json").read_text())["servers"]
        return next(iter(servers.values()))["token"]

    def get(self, path: str, token: str = "", method: str = "GET", authorization: str = ""):
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=15)
        authorization = authorization or (f"Bearer {token}" if token else "")
        connection.request(method, path, headers={"Authorization": authorization} if authorization else {})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()


@pytest.fixture
def studio(project, serve, tmp_path, monkeypatch):
    studio = Studio(project, serve, tmp_path, monkeypatch)
    yield studio
    for live in studio.joined:
        live.close(timeout=0)


def opened(live) -> tuple[Usd.Stage, Sdf.Layer]:
    layer = live.open_layer("root.usda")
    return Usd.Stage.Open(layer), layer
