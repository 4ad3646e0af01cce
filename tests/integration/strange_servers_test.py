"""Tests usdlive:// addresses of servers that send too much, too slowly or nonsense, and of servers at an IPv6 address, in
plain OpenUSD and live."""

from __future__ import annotations

import hashlib
import json
import socket
import threading
import time

import pytest
import usdlive
from conftest import run, wait
from pxr import Ar, UsdUtils
from resolver_test import cache, plain  # fixtures

SHOT = b'#usda 1.0\n(\n    defaultPrim = "A"\n)\ndef "A"\n{\n    asset t = @./t.png@\n    double x = 1\n}\n'
READ = """
import hashlib, json, sys, time
from pxr import Ar, Tf, Usd
begin = time.monotonic()
out = {}
try:
    stage = Usd.Stage.Open(sys.argv[1])
    prim = stage.GetPrimAtPath("/A")
    out["x"] = prim.GetAttribute("x").Get()
    path = prim.GetAttribute("t").Get().resolvedPath
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    out["t"] = asset and hashlib.sha256(asset.GetBuffer()).hexdigest()
except Tf.ErrorException as error:
    out["error"] = str(error)
out["seconds"] = time.monotonic() - begin
out["mib"] = [int(line.split()[1]) // 1024 for line in open("/proc/self/status") if line.startswith("VmHWM")][0]
print(json.dumps(out))
"""


def sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def head(length: int, content: bytes = b"", status: str = "200 OK") -> bytes:
    return (f"HTTP/1.1 {status}\r\nContent-Length: {length}\r\nETag: \"{sha(content)}\"\r\n"
            f"Usdlive-Sha256: {sha(content)}\r\n\r\n").encode()


class Strange:
    """A server with shot.usda and t.png, but for the answers in `instead`, by the beginning of the target: functions that get
    the connection."""

    def __init__(self, instead):
        self.instead, self.sent = instead, 0
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"usdlive://localhost:{self.socket.getsockname()[1]}/shot.usda"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            connection, _ = self.socket.accept()
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        with connection:
            try:
                target = connection.recv(65536).split(b" ")[1].decode()
                self._answer(connection, target)
            except (OSError, IndexError):
                pass  # the client has ended the connection

    def _answer(self, connection, target):
        for start, answer in self.instead.items():
            if target.startswith(start):
                return answer(lambda data: self._send(connection, data))
        files = {"shot.usda": SHOT, "t.png": b"texture"}
        if target.startswith("/projects"):
            body = json.dumps({"projects": [{"name": "p", "path": ""}], "several": False}).encode()
        elif target.partition("?")[0] == "/files":
            body = json.dumps({"project": "p", "revision": 1, "files": [
                {"path": name, "size": len(data), "modifiedMs": 1, "hash": sha(data)} for name, data in files.items()]}).encode()
        else:
            body = files[target.removeprefix("/files/").partition("?")[0]]
        self._send(connection, head(len(body), body) + body)

    def _send(self, connection, data):
        connection.sendall(data)
        self.sent += len(data)


def drip(send):
    send(head(7, b"texture"))
    while True:
        send(b"t")
        time.sleep(0.2)


def endless(send):
    send(head(1 << 40, b"texture"))
    while True:
        send(bytes(1 << 20))


def drip_of_headers(send):
    send(b"HTTP/1.1 200 OK\r\n")
    while True:
        send(b"X: y\r\n")
        time.sleep(0.2)


def large_error(send):
    send(head(1 << 40, status="500 Error"))
    while True:
        send(bytes(1 << 20))


def large_list(send):
    send(head(600 << 20))
    while True:
        send(b'{"files":[' + b" " * (1 << 20))


def list_of_junk(send):
    body = b'{"junk":[' + b"1," * 12_000_000 + b'1],"files":[' + b"[[[[[" + b"1," * 12_000_000 + b'1]]]]]]}'
    send(head(len(body)) + body)


def list_of_small_files(send):
    body = b'{"files":[' + b",".join(b'{"path":"%d"}' % number for number in range(2_100_000)) + b"]}"
    send(head(len(body)) + body)


@pytest.mark.parametrize("instead, cause, most_mib", [
    ({"/files/t.png": drip}, "sends too slowly", 1),
    ({"/files/t.png": drip_of_headers}, "did not respond in time", 1),
    ({"/files/t.png": endless}, "longer than the server has listed", 40),
    ({"/files/t.png": large_error}, "status 500", 40),
    ({"/files": large_list}, "too large", 40),
    ({"/projects": large_list}, "too large", 40),
    ({"/files": list_of_small_files}, "more than 2000000 files", 60),
])
def test_a_server_cannot_hold_or_fill_its_clients(plain, instead, cause, most_mib):
    expected = {"x": 1} if "/files/t.png" in instead else {}
    server = Strange(instead)
    limit = "600" if most_mib == 1 else "10000"
    got = plain(READ, server.url, USDLIVE_RESOLVER_TIMEOUT_MS=limit, USDLIVE_CACHE_MIB="64").value(60)
    assert cause in got["error"] and {key: got[key] for key in expected} == expected, got
    assert got["seconds"] < 40 and server.sent < most_mib << 20, (got, server.sent)


def test_a_list_takes_no_multiple_of_its_size(plain):
    got = plain(READ, Strange({"/files": list_of_junk}).url).value(60)
    assert got["mib"] < 350, got  # the list has 46 MiB


@pytest.fixture
def ipv6(serve, project):
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    (project / "shot.usda").write_bytes(SHOT + b'def "P" (references = @./p.usdz@)\n{\n}\n')
    (project / "t.png").write_bytes(b"texture")
    inside = project.parent / "inside"
    inside.mkdir()
    (inside / "w.png").write_bytes(b"wood")
    (inside / "p.usda").write_text('#usda 1.0\n(\n    defaultPrim = "P"\n)\ndef "P"\n{\n    asset w = @./w.png@\n}\n')
    assert UsdUtils.CreateNewUsdzPackage(str(inside / "p.usda"), str(project / "p.usdz"))
    return serve(project, "--host", "::1")


INSIDE = """
import json, sys
from pxr import Ar, Usd
stage = Usd.Stage.Open(sys.argv[1])
def content(path):
    found = stage.GetAttributeAtPath(path).Get().resolvedPath
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(found))
    return bytes(asset.GetBuffer()).decode()
print(json.dumps([content("/A.t"), content("/P.w")]))
"""


@pytest.mark.parametrize("host", ["[::1]", "%5B::1%5D", "[0:0:0:0:0:0:0:1]", "localhost"])
def test_a_server_may_have_an_ipv6_address(ipv6, plain, host):
    """It listens only there: the other address of localhost refuses the connection."""
    assert plain(INSIDE, f"usdlive://{host}:{ipv6.port}/shot.usda").value() == ["texture", "wood"]


def test_a_live_stage_of_an_ipv6_address_has_its_files(ipv6, recwarn):
    url = f"ws://[::1]:{ipv6.port}"
    assert run("ls", url).split() == ["shot.usda"]
    assert 'def "A"' in run("flatten", url, "shot.usda")
    with usdlive.connect(url, user="ada", application="test") as live:
        stage = live.open_stage("shot.usda")

        def content(path):
            with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
                found = Ar.ResolvedPath(stage.GetAttributeAtPath(path).Get().resolvedPath)
                return bytes(Ar.GetResolver().OpenAsset(found).GetBuffer()) if found else None

        wait(lambda: stage.GetAttributeAtPath("/P.w"), live, timeout=20)
        assert (content("/A.t"), content("/P.w")) == (b"texture", b"wood")
    assert not [one for one in recwarn if "files of the project" in str(one.message)]
