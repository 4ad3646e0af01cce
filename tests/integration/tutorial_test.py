"""The commands of docs/tutorial.md run in their order, in one folder, and print what it says."""

import subprocess
import time

import pytest
from conftest import unused_port
from documents import Reader, blocks, matches


@pytest.fixture
def reader(tmp_path):
    return Reader(tmp_path, unused_port())


def test_the_tutorial_runs(reader, tmp_path):
    printed, servers, log = "", [], tmp_path / "server.log"
    try:
        for block in blocks("docs/tutorial.md"):
            if block.before.endswith("prints:"):
                assert matches(reader.here(block.code), printed), f"expected:\n{block.code}\nprinted:\n{printed}"
            elif block.code.startswith("usdlive serve"):
                servers.append(reader.start(f"exec {block.code.strip()} --port 7447 --min-free-mib 1", stdout=log.open("w"),
                                            stderr=subprocess.DEVNULL))
                end = time.monotonic() + 20
                while not (printed := log.read_text()).endswith("\n"):
                    assert time.monotonic() < end and servers[-1].poll() is None, printed
                    time.sleep(0.01)
            else:
                printed = reader.run(block.code)
    finally:
        for server in servers:
            server.terminate()
            server.wait(timeout=20)
    assert len(servers) == 1 and servers[0].returncode == 0
