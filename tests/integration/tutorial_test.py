"""The commands of docs/tutorial.md run in their order, in one folder, and print what it says."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest
from conftest import unused_port
from documents import blocks, matches


@pytest.fixture
def shell(tmp_path):
    """Runs commands as a reader does, in a folder of their own, with the programs and the Python of the build."""
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "usdlive").symlink_to(os.environ["USDLIVE_BIN"])
    folder = tmp_path / "work"
    folder.mkdir()
    environment = {**os.environ, "PATH": f"{programs}:{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}", "HOME": str(tmp_path)}
    return lambda code, **options: subprocess.Popen(["bash", "-c", code], cwd=folder, env=environment, text=True,
                                                    start_new_session=True, **options)


def end(process: subprocess.Popen, what: int) -> None:
    if process.poll() is None:
        os.killpg(process.pid, what)
        process.wait(timeout=20)


def test_the_tutorial_runs(shell, tmp_path):
    port = str(unused_port())
    printed, servers = None, []
    try:
        for block in blocks("docs/tutorial.md"):
            code = block.code.replace("7447", port)
            if block.before.endswith("prints:"):
                assert matches(code, printed), f"expected:\n{code}\nprinted:\n{printed}"
            elif code.startswith("usdlive serve"):
                log = tmp_path / "server.log"
                servers.append(shell(f"exec {code.strip()} --port {port} --min-free-mib 1", stdout=log.open("w"), stderr=subprocess.DEVNULL))
                limit = time.monotonic() + 20
                while not (printed := log.read_text()).endswith("\n"):
                    assert time.monotonic() < limit and servers[-1].poll() is None, printed
                    time.sleep(0.01)
            else:
                commands = shell(f"export USDLIVE_URL=ws://127.0.0.1:{port}\n{code}", stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                printed = commands.communicate(timeout=60)[0]
    finally:
        for server in servers:
            end(server, signal.SIGTERM)
    assert len(servers) == 1 and servers[0].returncode == 0
