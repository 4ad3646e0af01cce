"""Honest editors beside one user's script.

    ./run bench fair [--cases edits,previews] [--rounds 6] [--seconds 3]

A server whose users sign in. Ten users write 5 edits a second each; the delay from an edit until a colleague has its
frame. Alone, beside the script of another user, and while that script works at another server of this machine
("elsewhere"), in turn in the same run, `rounds` times each. The script is a process of its own with the lowest priority
(nice 19), so that it is the server's work that competes and not the script's. p50 and p99 are the medians of those of
the rounds, because the machine has moments of its own. `ratio` is p99 beside it to p99 elsewhere (aim: at most 1.1): what
the users of one server cost each other. `ratioAlone` is p99 beside it to p99 alone, which contains that two cores have
more to do. `script` is what the script has done in a second.
Cases of the script:

    edits      one session that writes small edits as fast as the server takes them
    values     one session that writes values of 200 KiB
    sessions   50 sessions of the same user, each as in `edits`
    previews   previews of 4 KiB
    requests   the log, checkpoints, and files that are no layers
    layers     opens all 200 layers, again and again
    uploads    big values of 4 MiB
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import pathlib
import random
import re
import selectors
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "integration"))

import wire  # noqa: E402
from crowd import STAMP, Connection, Crowd, percentile, stamped  # noqa: E402
from support.serving import serve  # noqa: E402

BIN = pathlib.Path(os.environ.get("USDLIVE_BENCH_BIN", ROOT / "build" / "release" / "bin"))
HONEST, RATE, EDIT_BYTES, LAYERS = 10, 5, 128, 200
CASES = ("edits", "values", "sessions", "previews", "requests", "layers", "uploads")
QUIET_SECONDS = 0.7  # between two measurements
PATIENCE_SECONDS = 5  # a later edit counts as this late
STAMPS = re.compile(re.escape(STAMP) + rb"(\d+):(\d+)")
LAYER = '#usda 1.0\n\ndef "World"\n{\n' + "".join(f"    string s{number}\n" for number in range(HONEST + 1)) + "}\n\n"


class Server:
    def __init__(self, folder: pathlib.Path):
        self.project = folder / "project"
        self.project.mkdir()
        (self.project / "root.usda").write_text(LAYER)
        body = "".join(f'    def "P{number}" {{ double d = {number} }}\n' for number in range(200))
        for number in range(LAYERS):
            (self.project / f"layer{number}.usda").write_text(f'#usda 1.0\n\ndef "World"\n{{\n{body}}}\n\n')
        self.environment = {**os.environ, "XDG_CONFIG_HOME": str(folder / "config")}
        users = [*(f"ann{number}" for number in range(HONEST)), "script"]
        for user in users:
            self.command("user", "add", user, "--at", "127.0.0.1:1", self.project)
        self.process, self.port = serve(self.project, program=(BIN / "usdlive-server",), env=self.environment,
                                        stderr=subprocess.DEVNULL)
        self.tokens = [self.join(user) for user in users]

    def command(self, *words: object) -> str:
        return subprocess.run([BIN / "usdlive", *map(str, words)], env=self.environment, check=True,
                              capture_output=True, text=True).stdout

    def join(self, user: str) -> str:
        text = self.command("user", "invite", user, self.project)
        code = re.search(r"usdlive-invitation://[^/]+/([^?\s]+)", text).group(1)
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/join", method="POST",
                                         headers={"Authorization": f"Invitation {code}"})
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)["token"]

    def cpu(self) -> float:
        fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# --- the script


class Template:
    """A frame whose numbers are patched, because encoding one in Python takes longer than the server's work."""

    def __init__(self, kind: str, members: dict, *numbers: str):
        marks = {name: 0x1122334455667700 + index for index, name in enumerate(numbers)}
        self.frame = bytearray(wire.encode(kind, {**members, **marks}))
        self.at = {name: self.frame.index(mark.to_bytes(8, "little")) for name, mark in marks.items()}

    def make(self, **numbers: int) -> bytes:
        for name, number in numbers.items():
            self.frame[self.at[name]:self.at[name] + 8] = number.to_bytes(8, "little")
        return bytes(self.frame)


class Reader(Connection):
    """Reads once in a turn, so that connections on which always something arrives have turns, too."""

    def read(self) -> None:
        try:
            part = self.socket.recv(1 << 20)
        except BlockingIOError:
            return
        except OSError:
            part = b""
        if not part:
            return self.close()
        self.data += part
        self.parse()


class ScriptConnection(Reader):
    wants_answers = False

    def parse(self) -> None:
        if self.welcomed and not self.wants_answers:
            self.data.clear()
        else:
            super().parse()


def note_base(connection: Connection, frame: bytes) -> None:
    if b'"welcome"' in frame:
        connection.base = int(re.search(rb'"revision":(\d+)', frame)[1])


class Worker:
    """One session of the script."""

    WAITING = 1 << 20  # bytes that the server has not taken
    ANSWERS = (b'"layerOpened"', b'"logEnd"', b'"checkpoints"', b'"skippedFiles"', b'"blobStored"', b'"errorMessage"')

    def __init__(self, case: str, connection: Connection):
        self.case, self.connection = case, connection
        self.done = self.asked = self.answered = 0
        field = wire.set_field(f"/World.s{HONEST}", "default", wire.string("x" * (200 << 10 if case == "values" else 32)))
        submit = {"client": connection.client, "layers": ["root.usda"], "base": connection.base, "edits": [field]}
        self.submit = Template("Submit", submit, "sequence")
        preview = wire.set_field(f"/World.s{HONEST}", "default", wire.string("x" * 4096))
        self.preview = Template("Preview", {"author": connection.client, "layers": ["root.usda"], "base": 0,
                                            "edits": [preview]}, "gesture")

    def messages(self):
        if self.case in ("edits", "sessions"):
            for _ in range(64):
                self.done += 1
                yield self.submit.make(sequence=self.done)
        elif self.case == "values":
            self.done += 1
            yield self.submit.make(sequence=self.done)
        elif self.case == "previews":
            for _ in range(8):
                self.done += 1
                yield self.preview.make(gesture=1 + self.done % 8)
        elif self.case == "uploads" and self.asked - self.answered < 2:
            self.asked += 1
            content = os.urandom(4096) * 1024
            value = hashlib.sha256(content).digest()
            for at in range(0, len(content), wire.CHUNK):
                part = content[at:at + wire.CHUNK]
                yield wire.encode("Blob", {"hash": value, "size": len(content), "offset": at, "raw_bytes": len(part),
                                           "data": wire.stored_zstd(part)})
        elif self.case == "layers":
            while self.asked - self.answered < 400:
                self.asked += 1
                yield wire.control("openLayer", request=self.asked, layer=f"layer{self.asked % LAYERS}.usda",
                                   revision=0)
        elif self.case == "requests":
            while self.asked - self.answered < 12:
                self.asked += 1
                yield [wire.control("requestLog", request=self.asked, **{"from": 1, "to": 0}),
                       wire.control("listCheckpoints", request=self.asked),
                       wire.control("listSkipped", request=self.asked)][self.asked % 3]

    def answer(self, frame: bytes) -> None:
        if any(answer in frame for answer in self.ANSWERS):
            self.answered += 1
            if self.case not in ("edits", "sessions", "values", "previews"):
                self.done += 1

    def taken(self) -> int:
        """Returns how much was done, without the messages that the server has not taken yet."""
        sizes = {"previews": self.preview.frame, "values": self.submit.frame, "edits": self.submit.frame,
                 "sessions": self.submit.frame}
        return max(0, self.done - len(self.connection.out) // len(sizes.get(self.case, b"x" * (1 << 30))))

    def work(self) -> None:
        if self.connection.welcomed and not self.connection.closed and len(self.connection.out) < self.WAITING:
            for message in self.messages():
                self.connection.send(message)


def run_script(case: str, port: int, token: str) -> None:
    """Works until SIGTERM, then prints how much it has done."""
    os.nice(19)
    ends: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: ends.append(True))
    crowd = Crowd(argparse.Namespace(port=port), note_base)
    for _ in range(50 if case == "sessions" else 1):
        connection = ScriptConnection(crowd, user="script", token=token)
        connection.wants_answers = case in ("requests", "layers", "uploads")
        crowd.connections.append(connection)
    if not crowd.until(lambda: all(connection.welcomed for connection in crowd.connections), 20):
        raise RuntimeError("the script was kept out")
    workers = {connection: Worker(case, connection) for connection in crowd.connections}
    crowd.on_frame = lambda connection, frame: workers[connection].answer(frame)
    print("ready", flush=True)
    begin = time.monotonic()
    while not ends:
        for worker in workers.values():
            worker.work()
        crowd.turn(0.001)
    closed = sum(connection.closed for connection in workers)
    for connection in crowd.connections:  # the server drops what it has not read yet
        if not connection.closed:
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    print(json.dumps({"rate": sum(worker.taken() for worker in workers.values()) / (time.monotonic() - begin),
                      "closed": closed}), flush=True)
    crowd.close()


# --- the honest ones


class Editor(Reader):
    """Notes when stamps arrive; decodes nothing, so that what the script writes costs little here."""

    def parse(self) -> None:
        if not self.welcomed:
            return super().parse()
        arrived = time.monotonic_ns()
        self.editors.arrived += 1
        end = at = 0
        while (at := self.data.find(STAMP, at)) >= 0:
            found = STAMPS.match(self.data, at)
            if not found or found.end() == len(self.data):
                break  # its end is still to come
            end = at = found.end()
            if int(found[1]) != self.number:
                self.noted.append((arrived - int(found[2])) / 1e6)
        del self.data[:max(end, len(self.data) - 64)]


class Editors:
    def __init__(self, server: Server):
        self.server, self.noted, self.editors, self.arrived = server, [], [], 0
        self.chance = random.Random(1)
        self.join()

    def join(self) -> None:
        """Connects all again, so that their edits are based on a revision that the server still has."""
        for editor in self.editors:
            editor.close()
        self.crowd, self.editors = Crowd(self.server, note_base), []
        for number in range(HONEST):
            editor = Editor(self.crowd, user=f"ann{number}", token=self.server.tokens[number])
            editor.editors, editor.noted, editor.number, editor.sequence = self, self.noted, number, 0
            self.crowd.connections.append(editor)
            self.editors.append(editor)
        if not self.crowd.until(lambda: all(one.welcomed for one in self.editors), 20):
            raise RuntimeError("honest editors were kept out")

    def edit(self, editor: Editor) -> None:
        editor.sequence += 1
        value = wire.string(stamped(editor.number, EDIT_BYTES))
        editor.send(wire.encode("Submit", {
            "client": editor.client, "layers": ["root.usda"], "sequence": editor.sequence, "base": editor.base,
            "edits": [wire.set_field(f"/World.s{editor.number}", "default", value)]}))

    def is_quiet(self) -> bool:
        """Whether nothing has arrived for a moment."""
        before = self.arrived
        for editor in self.editors:
            editor.send(b"", 10)  # a sign of life
        self.crowd.until(lambda: False, QUIET_SECONDS)
        return self.arrived == before

    def measure(self, seconds: float, beside: bool = False) -> list[float]:
        """Milliseconds from the author to each colleague, for each edit."""
        if not beside:
            while not self.is_quiet():
                pass
            self.join()
        self.noted.clear()
        end, sent = time.monotonic() + seconds, 0
        while (now := time.monotonic()) < end:
            pause = self.chance.expovariate(RATE * HONEST)
            self.crowd.until(lambda: False, min(end, now + pause) - now)
            self.edit(self.chance.choice(self.editors))
            sent += 1
        self.crowd.until(lambda: len(self.noted) >= sent * (HONEST - 1), PATIENCE_SECONDS)
        if any(one.closed for one in self.editors):
            raise RuntimeError("the server has closed an honest editor")
        late = sent * (HONEST - 1) - len(self.noted)
        return [*self.noted, *[PATIENCE_SECONDS * 1e3] * late]


def beside_script(case: str, editors: Editors, at: Server, seconds: float) -> tuple[list[float], dict, float]:
    """Measures while the script works at a server. Returns the delays, what it has done, and the processor time of
    that server."""
    script = subprocess.Popen([sys.executable, __file__, "--script", case, "--port", str(at.port), "--token",
                               at.tokens[-1]], stdout=subprocess.PIPE, text=True)
    if script.stdout.readline() != "ready\n":
        raise RuntimeError("the script has ended")
    editors.crowd.until(lambda: False, 0.3)
    before = at.cpu()
    delays = editors.measure(seconds, beside=True)
    busy = at.cpu() - before
    script.terminate()
    while script.poll() is None:
        editors.is_quiet()
    return delays, json.loads(script.stdout.read()), busy


def measure(case: str, rounds: int, seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as other_folder:
        server, other = Server(pathlib.Path(folder)), Server(pathlib.Path(other_folder))
        try:
            editors = Editors(server)
            editors.measure(1)  # warms up
            alone, elsewhere, beside, rates, closed, busy = [], [], [], [], 0, 0.0
            for _ in range(rounds):
                alone.append(editors.measure(seconds))
                elsewhere.append(beside_script(case, editors, other, seconds)[0])
                editors.measure(0.1)  # until it is quiet
                delays, found, cpu = beside_script(case, editors, server, seconds)
                beside.append(delays)
                busy += cpu
                rates.append(found["rate"])
                closed += found["closed"]

            def figure(of: list[list[float]], share: float) -> float:
                return statistics.median(percentile(round, share) for round in of)

            print(json.dumps({
                "bench": "fair", "case": case, "edits": sum(map(len, alone)) // (HONEST - 1),
                "aloneP50Ms": round(figure(alone, 0.5), 2), "aloneP99Ms": round(figure(alone, 0.99), 2),
                "elsewhereP50Ms": round(figure(elsewhere, 0.5), 2), "elsewhereP99Ms": round(figure(elsewhere, 0.99), 2),
                "besideP50Ms": round(figure(beside, 0.5), 2), "besideP99Ms": round(figure(beside, 0.99), 2),
                "besideMostMs": round(max(map(max, beside))), "aloneMostMs": round(max(map(max, alone))),
                "ratio": round(figure(beside, 0.99) / figure(elsewhere, 0.99), 2),
                "ratioP50": round(figure(beside, 0.5) / figure(elsewhere, 0.5), 2),
                "ratioAlone": round(figure(beside, 0.99) / figure(alone, 0.99), 2),
                "script": round(sum(rates) / len(rates)), "scriptSessionsClosed": closed,
                "serverCpu": round(busy / seconds / rounds, 2)}), flush=True)
        finally:
            for one in (server, other):
                one.process.kill()
                one.process.wait()


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--cases", default=",".join(CASES))
    words.add_argument("--rounds", type=int, default=6)
    words.add_argument("--seconds", type=float, default=3)
    for hidden in ("--script", "--port", "--token"):
        words.add_argument(hidden, help=argparse.SUPPRESS)
    asked = words.parse_args()
    if asked.script:
        return run_script(asked.script, int(asked.port), asked.token)
    for case in asked.cases.split(","):
        measure(case, asked.rounds, asked.seconds)


if __name__ == "__main__":
    main()
