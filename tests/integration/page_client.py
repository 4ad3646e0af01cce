"""A page without a browser: connects to the gateway, keeps what is to be drawn, and computes where it is."""

from __future__ import annotations

import json
import os
import pathlib
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

KINDS = {1: ("matrices", "<f4", 12), 2: ("visibility", "<u1", 1), 3: ("colours", "<f4", 4), 4: ("geometry", "<u1", 32)}
SECTIONS = {1: ("positions", "<f4", 3), 2: ("normals", "<f4", 3), 3: ("uvs", "<f4", 2), 4: ("colours", "<f4", 3),
            5: ("indices", "<u4", 1), 6: ("faces", "<u4", 1), 7: ("widths", "<f4", 1), 8: ("flags", "<u4", 1)}


class Gateway:
    """`usdlive page` in a process of its own."""

    def __init__(self, url: str, folder: pathlib.Path, *options: str, **environment: str):
        self.url, self.folder, self.options = url, folder, options
        self.environment = {**os.environ, "USDLIVE_PYTHON": sys.executable, **environment}
        self.port_file = folder / "gateway.port"
        self.log = folder / "gateway.log"
        self.process: subprocess.Popen | None = None

    def start(self) -> "Gateway":
        self.launch()
        end = time.monotonic() + 60
        while not self.port_file.exists():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end, f"the gateway did not start: {self.log.read_text()}"
            time.sleep(0.01)
        self.port = int(self.port_file.read_text())
        return self

    def launch(self) -> None:
        self.port_file.unlink(missing_ok=True)
        self.process = subprocess.Popen(
            [os.environ["USDLIVE_BIN"], "page", self.url, "--port-file", str(self.port_file), *self.options],
            env=self.environment, stdout=subprocess.PIPE, stderr=self.log.open("ab"), text=True)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def stop(self) -> int:
        self.process.terminate()
        code = self.process.wait(timeout=20)
        self.process.stdout.close()
        return code

    def get(self, path: str, **headers: str) -> tuple[int, dict, bytes]:
        try:
            with urllib.request.urlopen(urllib.request.Request(self.address + path, headers=headers)) as answer:
                return answer.status, dict(answer.headers), answer.read()
        except urllib.error.HTTPError as refused:
            with refused:
                return refused.code, dict(refused.headers), refused.read()


class Page:
    """One viewer. `items` by id; `messages` has the last message of each type, `all` every one."""

    def __init__(self, gateway: Gateway, hello: dict | None = None, **options: object):
        self.gateway = gateway
        self.socket = connect(f"ws://127.0.0.1:{gateway.port}/live", max_size=None, compression=None, **options)
        self.items: dict[int, dict] = {}
        self.instances: dict[int, tuple[numpy.ndarray, numpy.ndarray]] = {}
        self.materials: dict[str, dict] = {}
        self.messages: dict[str, dict] = {}
        self.all: list[dict] = []
        self.batches: list[dict[int, object]] = []
        self.resets = 0
        self.complete = False
        self._number = 0
        self._blobs: dict[str, dict] = {}
        self.send({"type": "hello", "viewer": "test", **(hello or {})})

    def send(self, message: dict) -> None:
        self.socket.send(json.dumps(message))

    def close(self) -> None:
        self.socket.close()

    def receive(self, timeout: float = 0.5) -> bool:
        """Takes one message. False if none came in time."""
        try:
            frame = self.socket.recv(timeout=timeout)
        except TimeoutError:
            return False
        self._take(frame)
        return True

    def wait(self, condition, timeout: float = 20) -> None:
        end = time.monotonic() + timeout
        while not condition(self):
            assert time.monotonic() < end, f"the condition did not become true; the last messages: {self.all[-5:]}"
            self.receive()

    def opened(self) -> "Page":
        """Waits for the whole scene."""
        self.wait(lambda page: page.complete and "state" in page.messages)
        return self

    def closed(self) -> int:
        """Waits until the gateway closes the connection; returns the code."""
        try:
            for _ in range(10_000):
                self._take(self.socket.recv(timeout=20))
        except ConnectionClosed as closed:
            return closed.rcvd.code
        raise AssertionError("it was not closed")

    def ask(self, request: str, **fields: object):
        """Sends a request and waits for its answer. An error is a RuntimeError with its code."""
        self._number += 1
        number = self._number
        self.send({"type": request, "id": number, **fields})
        self.wait(lambda _: any(one["id"] == number for one in self.all if one["type"] == "reply"))
        reply = next(one for one in self.all if one["type"] == "reply" and one["id"] == number)
        if "error" in reply:
            raise RuntimeError(f"{reply['error']['code']}: {reply['error']['message']}")
        return reply.get("value")

    def at(self, path: str) -> dict:
        return next(one for one in self.items.values() if one["path"] == path)

    def has(self, path: str) -> bool:
        return any(one["path"] == path for one in self.items.values())

    def _take(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            self._take_batch(frame)
            return
        message = json.loads(frame, parse_constant=_refuse)
        self.all.append(message)
        self.messages[message["type"]] = message
        if message["type"] == "scene":
            if message["reset"]:
                self.items.clear()
                self.instances.clear()
                self.materials.clear()
                self.resets += 1
            for one in message["remove"]:
                self.items.pop(one, None)
                self.instances.pop(one, None)
            for item in message["add"]:
                self.items[item["id"]] = item
            for material in message["materials"]:
                self.materials[material["hash"]] = material
            self.complete = not message.get("more")

    def _take_batch(self, frame: bytes) -> None:
        magic, sections = struct.unpack_from("<II", frame)
        assert magic == 0x55534C50
        place, batch = 8, {}
        for _ in range(sections):
            kind, count, size = struct.unpack_from("<III", frame, place)
            content = frame[place + 12:place + 12 + size]
            place += 12 + size
            assert size % 4 == 0
            if kind == 6:
                number = struct.unpack_from("<I", content)[0]
                found = (numpy.frombuffer(content, "<f4", 12 * count, 4).reshape(-1, 12),
                         numpy.frombuffer(content, "<u4", count, 4 + 48 * count))
                self.instances[number] = found
                batch.setdefault(kind, {})[number] = found
                continue
            ids = numpy.frombuffer(content, "<u4", count).tolist()
            _, form, width = KINDS[kind]
            values = numpy.frombuffer(content, form, count * width, 4 * count).reshape(count, width)
            batch[kind] = dict(zip(ids, values))
            for number, value in batch[kind].items():
                self._apply(kind, number, value)
        assert place == len(frame)
        self.batches.append(batch)

    def _apply(self, kind: int, number: int, value: numpy.ndarray) -> None:
        item = self.items.get(number)
        if item is None:
            return
        if kind == 1:
            item["matrix"] = value.tolist()
        elif kind == 2:
            item["visible"] = bool(value[0])
        elif kind == 3:
            item["color"], item["opacity"] = value[:3].tolist(), float(value[3])
        else:
            item["geometry"] = bytes(value).hex()

    # -- what is drawn

    def world(self, item: dict) -> numpy.ndarray:
        """The 4x4 matrix from an item to the world."""
        matrix = numpy.eye(4)
        while item:
            local = numpy.eye(4)
            local[:, :3] = numpy.array(item["matrix"]).reshape(4, 3)
            matrix = matrix @ local
            if item["resetsStack"]:
                break
            item = self.items.get(item["parent"])
        return matrix

    def is_visible(self, item: dict) -> bool:
        while item:
            if not item["visible"]:
                return False
            item = self.items.get(item["parent"])
        return True

    def geometry(self, item: dict) -> dict:
        """The arrays of the item's blob."""
        name = item["geometry"]
        if name not in self._blobs:
            status, headers, content = self.gateway.get(f"/blob/{name}")
            assert status == 200 and "immutable" in headers["cache-control"], (status, headers)
            self._blobs[name] = unpacked(content)
        return self._blobs[name]

    def drawn(self, item: dict) -> numpy.ndarray:
        """The points in the world that are drawn for an item."""
        if "geometry" not in item:
            return numpy.zeros((0, 3))
        arrays = self.geometry(item)
        points = arrays["positions"]
        if "indices" in arrays:
            points = points[numpy.unique(arrays["indices"].reshape(-1))]
        return points.astype(float) @ self.world(item)[:3, :3] + self.world(item)[3, :3]


def unpacked(content: bytes) -> dict:
    magic, kind, sections = struct.unpack_from("<III", content)
    assert magic == 0x55534C47
    arrays, place = {"kind": kind}, 12
    for _ in range(sections):
        section, count, size = struct.unpack_from("<III", content, place)
        name, form, width = SECTIONS[section]
        arrays[name] = numpy.frombuffer(content, form, count * width, place + 12).reshape(count, width)
        place += 12 + size
    assert place == len(content)
    return arrays


def _refuse(constant: str):
    raise AssertionError(f"{constant} is no JSON")
