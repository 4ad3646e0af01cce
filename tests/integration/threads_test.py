"""Tests a limit of threads: the server and the clients say so, and what runs already continues."""

from __future__ import annotations

import json
import os
import pathlib
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

import pytest
import usdlive
from conftest import connect, unused_port, wait

LAYER = '#usda 1.0\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'
PROJECTS = 12
MOST_THREADS = 400
ADVICE = "raise it (ulimit -u, pids_limit)"

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root can run a process as another user")


class Restricted:
    """A server as a user of its own who may have `threads` threads."""

    def __init__(self, folder: pathlib.Path, threads: int):
        above = pathlib.Path(os.environ["USDLIVE_BIN"]).parents
        if closed := [str(one) for one in above if not one.stat().st_mode & 0o001]:
            pytest.skip(f"another user cannot run the server, because of the mode of {closed}")
        self.port, user = unused_port(), random.randrange(100_000, 1_000_000)
        self.user = user
        self.log = (folder / "log").open("w+")
        shots = folder / "shots"
        for index in range(PROJECTS):
            project = shots / f"p{index:02}"
            project.mkdir(parents=True)
            (project / "shot.usda").write_text(LAYER)
            os.chown(project, user, user)

        def restrict():
            resource.setrlimit(resource.RLIMIT_NPROC, (threads, MOST_THREADS))
            os.setgid(user)
            os.setuid(user)

        self.process = subprocess.Popen(
            [os.environ["USDLIVE_BIN"], "serve", "--projects", str(shots), "--port", str(self.port),
             "--min-free-mib", "1"], stdout=subprocess.DEVNULL, stderr=self.log, cwd="/", preexec_fn=restrict)

    def allow_more_threads(self) -> None:
        # Only the same user may change the limits of a process on every machine.
        subprocess.run(["prlimit", f"--pid={self.process.pid}", f"--nproc={MOST_THREADS}"], check=True,
                       user=self.user, group=self.user)

    def url(self, project: str) -> str:
        return f"ws://127.0.0.1:{self.port}/{project}"

    def get(self, path: str) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=20) as page:
            return page.read().decode()

    def projects(self) -> dict:
        try:
            return {one["name"]: one for one in json.loads(self.get("/projects"))["projects"]}
        except OSError:
            assert self.process.poll() is None, self.text()
            return {}

    def served(self) -> list[str]:
        return [name for name, one in self.projects().items() if one["status"] == "ok"]

    def text(self) -> str:
        return pathlib.Path(self.log.name).read_text()


@pytest.fixture
def restricted():
    folder = pathlib.Path(tempfile.mkdtemp(prefix="usdlive-threads-"))
    folder.chmod(0o755)
    servers = []

    def start(threads):
        servers.append(Restricted(folder, threads))
        return servers[-1]

    yield start
    for server in servers:
        server.process.kill()
        server.process.wait()
        server.log.close()
    shutil.rmtree(folder)


def edit(live, value):
    layer = live.open_layer("shot.usda")
    layer.GetAttributeAtPath("/Ball.radius").default = value
    assert live.flush(20)


def test_a_project_without_a_thread_says_so_and_the_others_work(restricted):
    server = restricted(30)
    wait(lambda: len(server.served()) >= 3, timeout=60)
    served = server.served()
    assert len(served) < PROJECTS
    refused = next(one for one in server.projects().values() if one["status"] == "failed")
    assert ADVICE in refused["reason"]
    with pytest.raises(usdlive.Error, match="cannot be opened: cannot start the thread"):
        usdlive.connect(server.url(refused["name"]), user="ada")
    with pytest.raises(urllib.error.HTTPError, match="503"):
        server.get(f"/{refused['name']}/files")

    # Imports, files over HTTP, saves and checkpoints work with the workers that there are.
    with usdlive.connect(server.url(served[0]), user="ada") as ada, \
            usdlive.connect(server.url(served[-1]), user="bob") as bob:
        edit(ada, 2.0)
        edit(bob, 3.0)
        assert ada.save()
        ada.create_checkpoint("named")
        assert "radius = 2" in server.get(f"/{served[0]}/files/shot.usda")

        # More threads are allowed: all projects are served, without a restart.
        server.allow_more_threads()
        wait(lambda: len(server.served()) == PROJECTS, ada, bob, timeout=30)
        with usdlive.connect(server.url(refused["name"]), user="eve") as eve:
            edit(eve, 4.0)
        edit(ada, 5.0)
    assert server.process.poll() is None


def test_a_server_without_its_threads_does_not_start(restricted):
    server = restricted(4)
    assert server.process.wait(20) == 1
    assert "usdlive-server: cannot start the thread" in server.text()
    assert ADVICE in server.text()


# Lets the system refuse each thread of connect() in turn.
CLIENT = """
import os, resource, sys
import usdlive
resource.setrlimit(resource.RLIMIT_NPROC, (1000, 1000))
os.setgid(int(sys.argv[2]))
os.setuid(int(sys.argv[2]))
refused = 0
for more in range(1, 20):
    threads = len(os.listdir("/proc/self/task"))
    resource.setrlimit(resource.RLIMIT_NPROC, (threads + more - 1, 1000))
    try:
        usdlive.connect(sys.argv[1], user="ada").close()
        break
    except usdlive.Error as error:
        assert str(error).startswith("cannot connect"), error
        assert "raise it (ulimit -u, pids_limit)" in str(error), error
        refused += 1
print(refused)
"""


def test_a_client_without_its_threads_raises_an_error(project, serve):
    (project / "shot.usda").write_text(LAYER)
    server = serve(project)
    folder = pathlib.Path(tempfile.mkdtemp(prefix="usdlive-threads-"))
    user = random.randrange(100_000, 1_000_000)
    os.chown(folder, user, user)
    environment = {**os.environ, "HOME": str(folder), "XDG_STATE_HOME": str(folder), "XDG_CACHE_HOME": str(folder)}
    ran = subprocess.run([sys.executable, "-c", CLIENT, server.url, str(user)], capture_output=True, text=True,
                         timeout=60, check=False, env=environment, cwd="/")
    shutil.rmtree(folder)
    assert ran.returncode == 0, ran.stderr
    assert int(ran.stdout) >= 4


def processor_seconds(process: subprocess.Popen) -> float:
    fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_server_at_rest_takes_no_processor_time(project, serve):
    """A thread of OpenUSD that waits for a task which nobody runs takes all of a core."""
    (project / "shot.usda").write_text(LAYER)
    server = serve(project)
    with connect(server, "ada") as ada:
        edit(ada, 2.0)
        assert ada.save()
        before, begin = processor_seconds(server.process), time.monotonic()
        time.sleep(2)
        assert processor_seconds(server.process) - before < 0.3 * (time.monotonic() - begin)
