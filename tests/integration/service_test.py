"""The unit for systemd starts a server with options that exist, which reloads and stops by its signals."""

import configparser
import os
import pathlib
import shlex
import shutil
import signal
import subprocess

import pytest
from conftest import Server, run, wait

UNIT = pathlib.Path(__file__).parents[2] / "server" / "tools" / "usdlive.service"


def service() -> configparser.SectionProxy:
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read_string(UNIT.read_text())
    return unit["Service"]


@pytest.fixture
def served(tmp_path, monkeypatch):
    """The server that the unit runs, with folders and programs of the test."""
    projects = tmp_path / "srv"
    (projects / "s010").mkdir(parents=True)
    (projects / "s010" / "shot.usda").write_text("#usda 1.0\n")
    state = tmp_path / "state folder"
    assert service()["Environment"] == f"XDG_CONFIG_HOME=/var/lib/{service()['StateDirectory']}"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(state))
    program, *options = shlex.split(service()["ExecStart"])
    assert program == "/opt/usdlive/bin/usdlive-server" and service()["ReadWritePaths"] == "/srv/usdlive" in options
    for word in ("--projects", "/srv/usdlive"):
        options.remove(word)
    server = Server(projects, tmp_path / "server.log", *options)
    server.program = [os.environ["USDLIVE_SERVER_BIN"], "--projects"]
    run("user", "add", "ann", "--at", "render:7447", str(projects))
    yield server.start()
    server.kill()


def test_the_server_of_the_unit_reloads_and_stops(served):
    assert shlex.split(service()["ExecReload"]) == ["/bin/kill", "-HUP", "$MAINPID"]
    served.process.send_signal(signal.SIGHUP)
    wait(lambda: "certificate" in served.log.read_text())
    assert run("ls", served.url.replace("127.0.0.1", "localhost") + "/s010") == "shot.usda\n"
    assert served.stop() == 0


def test_wrong_options_end_with_the_code_that_prevents_a_restart():
    done = subprocess.run([os.environ["USDLIVE_SERVER_BIN"], "--no-such-option"], capture_output=True, check=False)
    assert str(done.returncode) == service()["RestartPreventExitStatus"]


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="there is no systemd-analyze here")
def test_systemd_accepts_the_unit(tmp_path):
    copy = tmp_path / "usdlive.service"
    copy.write_text(UNIT.read_text().replace("/opt/usdlive/bin/usdlive-server", os.environ["USDLIVE_SERVER_BIN"]))
    done = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
