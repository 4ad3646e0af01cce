"""Honest editors beside connections that only want to do harm.

    ./run bench hostile [--hostile 1000] [--seconds 10]

A server whose users sign in. Ten sessions of one user, of which one writes 120 edits a second; the delay until the other
nine have them. First alone, then beside `hostile` connections of another process, which connect again when they are
closed: silent ones, half requests, requests that grow by a byte, wrong tokens, garbage, and requests whose answer
nobody reads. `ratio` is p99 beside them to p99 alone (aim: at most 2). `memoryMib` is what the server has more, 10 s
after they have left.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import random
import re
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "integration"))

import wire  # noqa: E402
from crowd import Crowd, percentile, read_stamp, stamped  # noqa: E402
from support.serving import serve  # noqa: E402

BIN = ROOT / "build" / "release" / "bin"
RATE, HONEST, EDIT_BYTES = 120, 10, 256
QUIET_SECONDS = 10
LAYER = '#usda 1.0\n\ndef "World"\n{\n    string s\n}\n\n'


# --- the hostile process


def behaviours(port: int) -> list[bytes]:
    """Returns the first bytes of each kind of connection."""
    host = f"Host: 127.0.0.1:{port}\r\n"
    upgrade = (f"GET /live HTTP/1.1\r\n{host}Upgrade: websocket\r\nConnection: Upgrade\r\n"
               f"Sec-WebSocket-Key: {'A' * 22}==\r\nSec-WebSocket-Version: 13\r\n")
    return [b"", b"GET /files HT", f"GET / HTTP/1.1\r\n{host}X: ".encode(), upgrade.encode(),
            (upgrade + f"Authorization: Bearer {'0' * 64}\r\n\r\n").encode(), os.urandom(2_000),
            f"GET /files HTTP/1.1\r\n{host}Authorization: Bearer {'1' * 64}\r\n\r\n".encode(),
            f"POST /join HTTP/1.1\r\n{host}Authorization: Invitation {'2' * 64}\r\n\r\n".encode(),
            f"GET /healthz HTTP/1.1\r\n{host}\r\n".encode()]


def attack(port: int, count: int) -> None:
    """Keeps `count` connections until SIGTERM. Prints a line when they are there, and how many it has made."""
    os.nice(10)  # the machine also runs what is measured
    selector, first, chance = selectors.DefaultSelector(), behaviours(port), random.Random(1)
    opened, is_ready, ends = 0, False, []
    signal.signal(signal.SIGTERM, lambda *_: ends.append(True))

    def connect() -> None:
        nonlocal opened
        link = socket.socket()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2_048)
        try:
            link.connect(("127.0.0.1", port))
            link.sendall(first[opened % len(first)])
        except OSError:
            link.close()
            return
        link.setblocking(False)
        selector.register(link, selectors.EVENT_READ)
        opened += 1

    while not ends:
        for _ in range(min(50, count - len(selector.get_map()))):
            connect()
        for key, _ in selector.select(0.02):
            link = key.fileobj
            try:
                gone = not link.recv(64)
            except BlockingIOError:
                continue
            except OSError:
                gone = True
            if gone:
                selector.unregister(link)
                link.close()
        for key in chance.sample(list(selector.get_map().values()), min(20, len(selector.get_map()))):
            try:
                key.fileobj.send(b"x")
            except OSError:
                pass
        if not is_ready and opened >= count:
            is_ready = True
            print("ready", flush=True)
    print(opened)


# --- the honest ones


class Server:
    def __init__(self, folder: pathlib.Path):
        project, self.config = folder / "project", folder / "config"
        project.mkdir()
        (project / "root.usda").write_text(LAYER)
        self.environment = {**os.environ, "XDG_CONFIG_HOME": str(self.config)}
        self.command("user", "add", "ann", "--at", "127.0.0.1:1", project)
        self.process, self.port = serve(project, program=(BIN / "usdlive-server",), env=self.environment,
                                        stderr=subprocess.DEVNULL)
        invitation = re.search(r"usdlive-invitation://\S+", self.command("user", "invite", "ann", project)).group()
        self.command("join", invitation)
        known = json.loads((self.config / "usdlive" / "servers.json").read_text())["servers"]
        self.token = next(iter(known.values()))["token"]

    def command(self, *words: object) -> str:
        return subprocess.run([BIN / "usdlive", *map(str, words)], env=self.environment, check=True,
                              capture_output=True, text=True).stdout

    def mib(self) -> float:
        text = pathlib.Path(f"/proc/{self.process.pid}/smaps_rollup").read_text()
        return int(re.search(r"^Anonymous:\s+(\d+)", text, re.MULTILINE).group(1)) / 1024


def delays(server: Server, seconds: float) -> list[float]:
    """Milliseconds from the writer to each reader, for each edit."""
    noted: list[float] = []
    writer: list[wire.Peer] = []

    def take(connection, frame) -> None:
        if connection is not writer[0] and (stamp := read_stamp(frame)):
            noted.append(stamp[1] * 1_000)

    crowd = Crowd(server, take)
    sessions = crowd.join(HONEST, user="ann", token=server.token)
    writer.append(sessions[0])
    if not crowd.until(lambda: all(one.welcomed for one in sessions), 20):
        raise RuntimeError("honest editors were kept out")
    begin, sequence = time.monotonic(), 0
    while time.monotonic() - begin < seconds:
        sequence += 1
        # One register again and again, so that the layer does not grow.
        edit = wire.set_field("/World.s", "default", wire.string(stamped(sequence, EDIT_BYTES)))
        writer[0].send(wire.encode("Submit", {"client": writer[0].client, "layers": ["root.usda"],
                                              "sequence": sequence, "base": 0, "edits": [edit]}))
        crowd.until(lambda: False, begin + sequence / RATE - time.monotonic())
    if not crowd.until(lambda: len(noted) == sequence * (HONEST - 1), 20):
        raise RuntimeError(f"{sequence * (HONEST - 1) - len(noted)} of {sequence * (HONEST - 1)} edits did not arrive")
    crowd.close()
    return noted


def measure(server: Server, hostile: int, seconds: float) -> None:
    delays(server, 2)  # warms up
    alone, before = delays(server, seconds), server.mib()
    attacker = subprocess.Popen([sys.executable, __file__, "--attack", str(server.port), "--hostile", str(hostile)],
                                stdout=subprocess.PIPE, text=True)
    try:
        if attacker.stdout.readline() != "ready\n":
            raise RuntimeError("the hostile process has ended")
        beside, most = delays(server, seconds), server.mib()
        attacker.terminate()
        connections = int(attacker.stdout.read())
    finally:
        attacker.kill()
        attacker.wait()
    time.sleep(QUIET_SECONDS)
    for name, found in (("alone", alone), ("hostile", beside)):
        print(json.dumps({"bench": "hostile", "case": name, "edits": len(found) // (HONEST - 1),
                          "p50Ms": round(percentile(found, 0.5), 2), "p99Ms": round(percentile(found, 0.99), 2)}))
    print(json.dumps({"bench": "hostile", "case": "both", "hostile": hostile, "connections": connections,
                      "ratio": round(percentile(beside, 0.99) / percentile(alone, 0.99), 2),
                      "memoryMib": round(server.mib() - before, 1), "mostMib": round(most - before, 1)}))


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--hostile", type=int, default=1_000)
    words.add_argument("--seconds", type=float, default=10)
    words.add_argument("--attack", type=int, help=argparse.SUPPRESS)  # the port, in the hostile process
    asked = words.parse_args()
    if asked.attack:
        return attack(asked.attack, asked.hostile)
    with tempfile.TemporaryDirectory() as folder:
        server = Server(pathlib.Path(folder))
        try:
            measure(server, asked.hostile, asked.seconds)
        finally:
            server.process.kill()
            server.process.wait()


if __name__ == "__main__":
    main()
