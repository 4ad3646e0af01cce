"""Fixtures with real servers and real editors in their own processes."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import itertools
import json
import os
import pathlib
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import types

import page_client
import pytest
import usdlive
from pxr import Sdf, Tf
from usdlive.omni.kit.app import get_app

os.environ.setdefault("USDLIVE_PYTHON", sys.executable)  # runs the gateway of `usdlive page`

HERE = pathlib.Path(__file__).parent
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "gw0")

# The files with the longest tests. Their tests begin first, so that no worker is left alone with one at the end.
LONGEST = ["history_test.py", "page_browser_test.py", "frame_cost_test.py", "live_paths_test.py", "crash_prefix_test.py",
           "stage_oracle_test.py", "damage_test.py", "kill_test.py", "collect_test.py", "conformance_test.py",
           "network_test.py", "outside_test.py", "dds_test.py", "journal_test.py", "crowd_test.py",
           "failing_io_test.py"]
# Fixtures that many tests share. These tests run in one worker.
SHARED = {"history", "installed", "pair", "prefix"}


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the marks in its own
def pytest_collection_modifyitems(items):
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))
    for item in items:
        for fixture in SHARED & set(item.fixturenames):
            item.add_marker(pytest.mark.xdist_group(fixture))


def pytest_collection_finish(session):
    """Checks that groups have an effect, because not every pytest-xdist knows how every pytest names a test: without
    them, each worker makes what they share. And leaves the tests themselves, some 100,000 objects, out of the garbage
    collections of the run."""
    for item in session.items if "PYTEST_XDIST_WORKER" in os.environ else ():
        group = item.get_closest_marker("xdist_group")
        assert group is None or "@" in item.nodeid, f"pytest-xdist has not put {item.nodeid} into its group"
    gc.collect()
    gc.freeze()


_folders = itertools.count()


@pytest.fixture
def tmp_path(tmp_path):
    """A folder whose path no earlier test of this process had, although pytest removes those of tests that passed: a
    layer may outlive its test, and whoever opens its path gets it."""
    folder = tmp_path / str(next(_folders))
    folder.mkdir()
    return folder


@pytest.fixture
def uncollected():
    """Nothing is collected in a test that measures processor time: one collection can take 0.3 s."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


# The ports of this worker, one after the other. The system gives no port of this range to outgoing connections, so a
# port is still unused when its server starts again.
_FIRST_PORT = 20_000 + 500 * (int(WORKER[2:]) % 20)
_ports = itertools.islice(itertools.cycle(range(_FIRST_PORT, _FIRST_PORT + 500)), random.randrange(500), None)


def unused_port() -> int:
    for port in _ports:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                probe.bind(("127.0.0.1", port))
                return port


class Server:
    """`usdlive serve` on a port of loopback that stays the same when it is started again."""

    def __init__(self, folder: pathlib.Path, log: pathlib.Path, *options: str):
        self.folder, self.log, self.options, self.port = folder, log, options, unused_port()
        self.process: subprocess.Popen | None = None
        self.program = [os.environ["USDLIVE_BIN"], "serve"]
        self.environment: dict[str, str] = {}  # in addition to the tests' own
        self.min_free_mib = 1

    def start(self) -> "Server":
        self.launch()
        end = time.monotonic() + 20
        while not self.port_file.exists():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end, "the server did not start"
            time.sleep(0.005)
        self.port = int(self.port_file.read_text())
        return self

    def launch(self) -> None:
        """Starts the process without waiting for it."""
        self.port_file.unlink(missing_ok=True)
        self.process = subprocess.Popen(
            [*self.program, str(self.folder), "--port", str(self.port),
             "--port-file", str(self.port_file), "--min-free-mib", str(self.min_free_mib), *self.options],
            env={**os.environ, **self.environment},
            stdout=subprocess.DEVNULL, stderr=self.log.open("ab"))

    @property
    def port_file(self) -> pathlib.Path:
        return self.log.with_suffix(".port")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=20)

    @property
    def url(self) -> str:
        scheme = "wss" if "--tls" in self.options else "ws"
        return f"{scheme}://127.0.0.1:{self.port}"


class Peer:
    """An editor in its own Python process, with `live`, `stage` and pxr's modules defined."""

    def __init__(self, url: str, user: str, layer: str, log: pathlib.Path, prefix=(), backend=()):
        self.log = log
        self.process = subprocess.Popen(
            [*prefix, sys.executable, str(HERE / "peer.py"), url, user, layer, *backend], text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log.open("ab"))
        self._answer()

    def _answer(self):
        line = self.process.stdout.readline()
        assert line, f"the editor ended:\n{self.log.read_text()[-4000:]}"
        answer = json.loads(line)
        assert "error" not in answer, answer["error"]
        return answer.get("value")

    def run(self, code: str):
        """Executes statements; returns the value of the name `result` (JSON)."""
        self.process.stdin.write(json.dumps(code) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def flush(self) -> int:
        """Waits until everything is committed; returns the revision of this editor."""
        return self.run("assert live.flush(20), 'not committed'; result = live.revision")

    def text(self, layer: str) -> str:
        return self.run(f"result = layer({layer!r}).ExportToString()")

    def catch_up(self, revision: int) -> None:
        self.run(f"assert live.wait(lambda: live.revision >= {revision}, 20), live.revision")

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=20)


@pytest.fixture
def capfd(capfd):
    """Also when several workers run the tests, what is printed under `capfd.disabled()` is shown: on stderr, because the
    stdout of a worker is not."""
    disabled = capfd.disabled

    @contextlib.contextmanager
    def shown():
        with disabled(), contextlib.redirect_stdout(sys.stderr):
            yield

    capfd.disabled = shown
    return capfd


@pytest.fixture(autouse=True)
def _folders_of_its_own(tmp_path, tmp_path_factory, monkeypatch):
    """Keeps the unsent work of one test from being offered to another, and gives the processes of a test empty caches.
    This process opens its cache only once, so its tests share the cache of the first one that needs it. pytest removes
    tmp_path after a test that passed, but no other folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    caches = tmp_path_factory.mktemp("caches")
    monkeypatch.setenv("USDLIVE_CACHE", str(caches / "files"))


@pytest.fixture
def dds_domain(monkeypatch):
    """A DDS domain on loopback that no other test on this machine uses at the same time."""
    for number in random.SystemRandom().sample(range(1, 91), 90):
        with open(os.path.join(tempfile.gettempdir(), f"usdlive-test-domain-{number}.lock"), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            monkeypatch.setenv("USDLIVE_DDS_DOMAIN", str(number))
            monkeypatch.setenv("USDLIVE_DDS_INTERFACE", "lo")
            yield number
            return
    pytest.fail("every DDS domain is in use")


def shots(tmp_path, root: str):
    """Makes a project with the name "shots" and one layer, and returns its folder."""
    folder = tmp_path / "shots"
    folder.mkdir()
    (folder / "root.usda").write_text(root)
    return folder


@pytest.fixture
def project(tmp_path):
    folder = tmp_path / "project"
    folder.mkdir()
    return folder


@pytest.fixture
def small_disk(tmp_path):
    """small_disk("8m") mounts a separate disk of this size and returns its folder. Without root the test is skipped."""
    folders: list[pathlib.Path] = []

    def mount(size: str) -> pathlib.Path:
        folder = tmp_path / f"disk{len(folders)}"
        folder.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)],
                                 capture_output=True, text=True, check=False)
        if mounted.returncode != 0:
            pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.strip()}")
        folders.append(folder)
        return folder

    yield mount
    for folder in folders:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.fixture
def serve(tmp_path):
    """serve(folder, *options) starts a server that is stopped after the test."""
    servers: list[Server] = []

    def start(folder: pathlib.Path, *options: str) -> Server:
        servers.append(Server(folder, tmp_path / f"server{len(servers)}.log", *options).start())
        return servers[-1]

    yield start
    for server in servers:
        if server.process.poll() is None:
            assert server.stop() == 0, server.log.read_text()


@pytest.fixture
def editor(tmp_path):
    """editor(server, user, layer) starts an editor that is closed after the test; with a fourth argument, with this
    backend."""
    peers: list[Peer] = []

    def start(server: Server, user: str, layer: str, *backend: str) -> Peer:
        peers.append(Peer(server.url, user, layer, tmp_path / f"{user}{len(peers)}.log", backend=backend))
        return peers[-1]

    yield start
    for peer in peers:
        peer.process.kill()
        peer.process.wait()


@pytest.fixture
def gateway(tmp_path):
    """gateway(server, *options) starts `usdlive page`, which is stopped after the test."""
    gateways: list[page_client.Gateway] = []

    def start(server: Server, *options: str, **environment: str) -> page_client.Gateway:
        folder = tmp_path / f"gateway{len(gateways)}"
        folder.mkdir()
        gateways.append(page_client.Gateway(server.url, folder, *options, **environment).start())
        return gateways[-1]

    yield start
    for one in gateways:
        if one.process.poll() is None:
            assert one.stop() == 0, one.log.read_text()


@pytest.fixture
def page():
    """page(gateway, hello) opens the page, which is closed after the test."""
    pages: list[page_client.Page] = []

    def open_page(gateway: page_client.Gateway, hello: dict | None = None) -> page_client.Page:
        pages.append(page_client.Page(gateway, hello).opened())
        return pages[-1]

    yield open_page
    for one in pages:
        one.close()


@contextlib.contextmanager
def without_answers(server: Server):
    """The server runs and answers nothing."""
    os.kill(server.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(server.process.pid, signal.SIGCONT)


def tick_without_answers(live) -> None:
    """A request to a server that answers nothing would take much longer."""
    start = time.monotonic()
    for _ in range(5):
        live.tick()
    assert time.monotonic() - start < 2


def cat(server: Server, layer: str, *options: str) -> str:
    """The text of a layer on the server."""
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "cat", f"{server.url}/{layer}", *options], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def synced(server: Server, *editors: Peer, layers: tuple[str, ...] = ("root.usda",)) -> list[str]:
    """Waits until the editors have all commits. The layers are the same everywhere; returns their texts."""
    revision = max(one.flush() for one in editors)
    for one in editors:
        one.catch_up(revision)
    texts = []
    for layer in layers:
        same = {one.text(layer) for one in editors} | {cat(server, layer)}
        assert len(same) == 1
        texts.append(same.pop())
    return texts


def connect(server: Server, user: str, backend: str | None = None) -> usdlive.Live:
    return usdlive.connect(server.url, user=user, application="test", backend=backend)


def refused_in_a_notice(call, live: usdlive.Live, server: Server) -> usdlive.Error:
    """Returns the error of a call that a notice handler makes while `live` applies somebody's edit of shot.usda."""
    layer = live.open_layer("shot.usda")
    said = []
    calling = threading.Lock()

    def changed(*_):
        if not calling.acquire(blocking=False):
            return  # the call itself makes layers
        try:
            call()  # bob's own edit is not within a tick of `live`, and allows it
        except usdlive.Error as refused:
            said.append(refused)
        finally:
            calling.release()

    key = Tf.Notice.RegisterGlobally(Sdf.Notice.LayersDidChange, changed)
    with connect(server, "bob") as bob:
        bob.open_layer("shot.usda").comment = "by bob"
        assert bob.flush()
    wait(lambda: layer.comment == "by bob", live)
    key.Revoke()
    assert said, "the call was not refused"
    return said[0]


class Relay:
    """Accepts connections in the place of a server, each on a thread of its own. `_serve()` of a subclass says what
    happens to them."""

    def __init__(self, server):
        self.server = server
        self._ends: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", unused_port()))
        self.url = f"ws://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                self._ends.append(here)
                threading.Thread(target=self._serve, args=(here,), daemon=True).start()

    def _serve(self, here: socket.socket):
        raise NotImplementedError

    def close(self):
        for end in [self._listener, *self._ends]:
            end.close()


def error_elsewhere(call) -> "usdlive.Error | None":
    """Returns the error that the call raises on another thread."""
    caught = []

    def run():
        try:
            call()
        except usdlive.Error as error:
            caught.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return caught[0] if caught else None


def wait(condition, *ticking, timeout=10):
    """Waits until the condition is true; `live` objects with a tick() run frames meanwhile."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, "the condition did not become true in time"
        for one in ticking:
            one.tick()
        time.sleep(0.002)


def wait_frames(condition, timeout=10):
    """Does the same with the frames of `omni.kit.app`."""
    wait(condition, types.SimpleNamespace(tick=get_app().update), timeout=timeout)


def run(*arguments: str) -> str:
    """Runs the command line tool, which must succeed; returns its output."""
    return subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True, check=True).stdout


def refused(*arguments: str) -> str:
    """Runs the tool, which must fail; returns its message."""
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True)
    assert ran.returncode == 1
    return ran.stderr
