"""Tests peers that stop after each byte and step of the handshake (SE16, FR20): the server ends each of them in time, keeps
nothing of them, and everybody else can connect and edit meanwhile."""

from __future__ import annotations

import base64
import contextlib
import os
import socket
import ssl
import struct
import time
import urllib.request

import pytest
import usdlive
import wire
from conftest import connect, wait

ROOT = '#usda 1.0\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'
UPGRADE = ("GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
           f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\n"
           "Sec-WebSocket-Version: 13\r\n\r\n").encode()


def masked(payload, size=None, fin=True):
    """A binary WebSocket frame, masked with zeros. `size` announces more than is sent."""
    size = len(payload) if size is None else size
    if size < 126:
        head = bytes([0x80 | size])
    else:
        head = struct.pack(">BH" if size < 65536 else ">BQ", 0x80 | (126 if size < 65536 else 127), size)
    return bytes([(0x80 if fin else 0) | 2]) + head + bytes(4) + payload


def stops(hello):
    """The places where a peer may stop: the bytes that it sends before and after the upgrade is answered."""
    for count in [*range(6), *range(6, len(UPGRADE) - 4, 13), *range(len(UPGRADE) - 4, len(UPGRADE) + 1)]:
        yield UPGRADE[:count], None
    for count in [*range(16), *range(16, len(hello), 29), len(hello) - 1]:
        yield UPGRADE, hello[:count]
    yield UPGRADE, masked(hello[:100], fin=False)  # the first fragment of a message
    yield UPGRADE, masked(b"", fin=False)
    yield b"GET /files HTTP/1.1\r\nHost: 127.0.0.1\r\n", None
    yield b"POST /live HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000000\r\n\r\n", None


def trusting() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


class Stopped:
    """A peer that sends so much and then nothing more."""

    def __init__(self, port, before, after=None):
        self.what = (before[-20:], after and len(after))
        self.socket = self.connected(port)
        self.socket.sendall(before)
        if after is not None:
            answer = b""
            while not answer.endswith(b"\r\n\r\n"):
                part = self.socket.recv(1)
                assert part, ("closed before the answer", answer)
                answer += part
            self.socket.sendall(after)
        self.socket.setblocking(False)

    @staticmethod
    def connected(port):
        return socket.create_connection(("127.0.0.1", port), timeout=20)

    def has_ended(self):
        with contextlib.suppress(BlockingIOError):
            try:
                while self.socket.recv(65536):
                    continue
            except ConnectionError:
                pass
            return True
        return False


@pytest.fixture
def hello():
    return masked(bytes(wire.hello(wire.new_client())))


def metric(server, name):
    scheme = "https" if "--tls" in server.options else "http"
    url = f"{scheme}://127.0.0.1:{server.port}/metrics"
    with urllib.request.urlopen(url, timeout=20, context=trusting()) as page:
        for line in page.read().decode().splitlines():
            if line.startswith(name + " "):
                return int(float(line.split()[1]))
    raise AssertionError("no such metric")


def connections(server):
    return metric(server, "usdlive_http_connections")


def memory(server):
    with open(f"/proc/{server.process.pid}/status") as status:
        return next(int(line.split()[1]) // 1024 for line in status if line.startswith("VmRSS"))


def edit(live, value):
    live.open_layer("shot.usda").GetAttributeAtPath("/Ball.radius").default = value
    assert live.flush(20)


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text(ROOT)
    return lambda *options: serve(project, *options)


def test_a_peer_that_stops_anywhere_is_ended_in_time(served, hello):
    server = served("--guest-seconds", "1")
    peers = [Stopped(server.port, *stop) for stop in stops(hello)]
    assert len(peers) > 50
    all_end_beside_an_editor(server, peers)


def all_end_beside_an_editor(server, peers):
    with connect(server, "ada") as ada:
        edit(ada, 2.0)
        # 1 s, the sweep of 1 s, and 5 s for the goodbye of a peer that does not answer it.
        end = time.monotonic() + 20
        while left := [peer.what for peer in peers if not peer.has_ended()]:
            assert time.monotonic() < end, left
            ada.tick()
            time.sleep(0.05)
        edit(ada, 3.0)
        wait(lambda: connections(server) <= 3, ada)  # ada's session, her list of files, and this request


def client_hello() -> bytes:
    """The first message of a TLS handshake."""
    outgoing = ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        trusting().wrap_bio(ssl.MemoryBIO(), outgoing).do_handshake()
    return outgoing.read()


class StoppedInTls(Stopped):
    """The same over TLS, after the handshake."""

    @staticmethod
    def connected(port):
        return trusting().wrap_socket(Stopped.connected(port))

    def has_ended(self):
        with contextlib.suppress(ssl.SSLWantReadError):
            return super().has_ended()
        return False


def test_a_peer_that_stops_anywhere_in_tls_is_ended_in_time(served, hello, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    server, first = served("--guest-seconds", "1", "--tls", "auto"), client_hello()
    peers = [Stopped(server.port, first[:count]) for count in (0, 1, 4, 5, 6, len(first) // 2, len(first) - 1, len(first))]
    peers += [StoppedInTls(server.port, *stop) for stop in list(stops(hello))[::4]]
    assert len(peers) > 20
    all_end_beside_an_editor(server, peers)


@pytest.mark.parametrize("tls", [False, True])
def test_fr6_a_session_that_never_reads_is_ended(served, hello, monkeypatch, tmp_path, tls):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    server = served("--slow-reader-mib", "1", *(["--tls", "auto"] if tls else []))
    silent = (StoppedInTls if tls else Stopped)(server.port, UPGRADE, hello)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        for number in range(200):  # 40 MB, which no buffer of the system holds
            layer.GetPrimAtPath("/Ball").SetInfo("documentation", chr(97 + number % 26) * 200_000)
            ada.tick()
            if number % 10 == 9:
                assert ada.flush(20)
        edit(ada, 4.0)
        wait(lambda: metric(server, 'usdlive_slow_readers_total{transport="websocket"}') == 1, ada, timeout=30)
    del silent


def test_silent_peers_keep_nobody_out(served, hello):
    """They could stay for an hour, and there are more of them than seats of any kind."""
    server = served("--guest-seconds", "3600", "--max-guests", "6", "--max-sessions", "3")
    with connect(server, "ada") as ada:
        edit(ada, 2.0)
        peers, places = [], list(stops(hello))
        for index in range(24):
            before, after = places[index * len(places) // 24]
            with contextlib.suppress(AssertionError, ConnectionError):  # had to give way already
                peers.append(Stopped(server.port, before, after))
            ada.tick()
        with usdlive.connect(server.url, user="bob") as bob:
            edit(bob, 3.0)
            edit(ada, 4.0)
        assert connections(server) <= 9
        edit(ada, 5.0)
        wait(lambda: sum(not peer.has_ended() for peer in peers) <= 6, ada, timeout=30)


def test_only_sessions_that_said_hello_count(served):
    server = served("--max-sessions", "2")
    silent = [Stopped(server.port, UPGRADE, b"") for _ in range(5)]
    with connect(server, "ada") as ada, connect(server, "bob"):
        with pytest.raises(usdlive.Error) as error:
            usdlive.connect(server.url, user="mallory")
        assert error.value.code == "tooManySessions"
        edit(ada, 2.0)
    assert not any(peer.has_ended() for peer in silent)


def test_what_peers_send_before_hello_is_bounded(served):
    server = served()
    before = memory(server)
    peers = [Stopped(server.port, UPGRADE, masked(bytes(1 << 20), size=60 << 20)) for _ in range(60)]
    for peer in peers:  # 8 MiB each, if the server takes them
        peer.socket.setblocking(True)
        with contextlib.suppress(ConnectionError):
            for _ in range(7):
                peer.socket.sendall(bytes(1 << 20))
        peer.socket.setblocking(False)
    assert memory(server) - before < 200
    with connect(server, "ada") as ada:
        edit(ada, 2.0)
        wait(lambda: all(peer.has_ended() for peer in peers), ada, timeout=30)


@pytest.mark.parametrize("members", [{"user": "x" * (5 << 20)}, {"features": [""] * 140_000}])
def test_a_control_message_is_bounded(served, members):
    server = served()
    with wire.Peer(server.url) as peer:
        peer.send(wire.control("showPresence", **members))
        assert peer.expect_error()["code"] == "malformedControl"
    with connect(server, "ada") as ada:
        edit(ada, 2.0)
