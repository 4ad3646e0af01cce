"""A browser with the page of a gateway, and what a test needs of it: conditions, places and colours of the picture."""

from __future__ import annotations

import math
import pathlib
import struct
import time
import zlib

import numpy

CHROMIUM = "/usr/bin/chromium"
# WebGL without a graphics card.
SOFTWARE = ["--no-sandbox", "--enable-unsafe-swiftshader"]
SCREENSHOTS = pathlib.Path(__file__).resolve().parents[2] / "build" / "screenshots"
VIEWPORT = "window.usdlivePage?.viewport.value"


class Screen:
    """One tab. What the page complains about is in `complaints`; a test fails if it leaves any."""

    def __init__(self, browser, address: str, width: int = 1360, height: int = 800, scheme: str = "dark", **options):
        self.address = address
        self.context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, **options)
        self.tab = self.context.new_page()
        self.complaints: list[str] = []
        self.hosts: set[str] = set()
        self.tab.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        self.tab.on("console", self._said)
        self.tab.on("dialog", self._asked)
        self.tab.on("request", lambda request: self.hosts.add(request.url.split("/")[2]))
        self.tab.goto(address)

    def _said(self, message) -> None:
        # The browser tells of lost lines, too, and of blobs that are gone or come later, which the page asks for again.
        is_expected = "WebSocket connection" in message.text or (
            message.text.startswith("Failed to load resource") and "/blob/" in message.location.get("url", ""))
        if message.type == "error" and not is_expected:
            self.complaints.append(f"console: {message.text}")

    def _asked(self, dialog) -> None:
        self.complaints.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    def close(self) -> None:
        self.context.close()
        assert self.complaints == []
        assert self.hosts <= {self.address.split("/")[2]}, f"the page asked other hosts: {self.hosts}"

    def run(self, script: str, argument: object = None):
        return self.tab.evaluate(script, argument)

    def until(self, condition, what: str = "", timeout: float = 30):
        """Waits until a function, or an expression of JavaScript, is true; returns its value."""
        end = time.monotonic() + timeout
        while True:
            value = self.run(condition) if isinstance(condition, str) else condition()
            if value:
                return value
            if time.monotonic() > end:
                self.shot("failed")
                raise AssertionError(f"this did not become true: {what or condition}; on the page: {self.text()[:2000]}")
            self.tab.wait_for_timeout(20)

    def opened(self) -> "Screen":
        self.until(f"{VIEWPORT}?.isSettled === true")
        return self

    def text(self) -> str:
        return self.tab.inner_text("body")

    def sees(self, text: str) -> None:
        self.until(lambda: text in self.text(), f"{text!r} is on the page")

    def place(self, path: str) -> tuple[float, float] | None:
        """The middle of a prim in the window."""
        found = self.run(f"path => {VIEWPORT}.placeOf(path)", path)
        return found and (found["x"], found["y"])

    def found(self, path: str) -> tuple[float, float]:
        """The place of a prim, when it is in the picture."""
        return self.until(lambda: self.place(path), f"{path} is in the picture")

    def shift(self, path: str, before: tuple[float, float]) -> float:
        """By how many pixels a prim has moved to the side; not a number, which no comparison accepts, while it is not there."""
        found = self.place(path)
        return abs(found[0] - before[0]) if found else math.nan

    def around(self, place: tuple[float, float], size: int = 3) -> numpy.ndarray:
        """The window's pixels around a place: rows of columns of red, green and blue."""
        x, y = place
        return read_png(self.tab.screenshot(clip={"x": round(x) - size // 2, "y": round(y) - size // 2, "width": size, "height": size}))

    def color_at(self, place: tuple[float, float]) -> tuple[int, int, int]:
        return tuple(int(one) for one in self.around(place)[1, 1])

    def color(self, path: str) -> tuple[int, int, int]:
        """The colour at a prim's middle."""
        return self.color_at(self.found(path))

    def select(self, path: str) -> None:
        self.run("path => window.usdlivePage.select(path, false)", path)

    def shot(self, name: str) -> None:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        self.tab.screenshot(path=str(SCREENSHOTS / f"{name}.png"))


def read_png(data: bytes) -> numpy.ndarray:
    """Decodes what a browser writes: 8 bits for each of three or four channels, not interlaced."""
    at, compressed, width, height, channels = 8, b"", 0, 0, 0
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack_from(">IIBB", data, at + 8)
            assert depth == 8 and color in (2, 6)
            channels = 3 if color == 2 else 4
        elif kind == b"IDAT":
            compressed += data[at + 8:at + 8 + size]
        at += size + 12
    lines = numpy.frombuffer(zlib.decompress(compressed), numpy.uint8).reshape(height, 1 + width * channels)
    picture = numpy.zeros((height, width, channels), numpy.uint8)
    above = numpy.zeros((width, channels), numpy.uint8)
    for row in range(height):
        above = picture[row] = unfiltered(lines[row, 0], lines[row, 1:].reshape(width, channels), above)
    return picture[:, :, :3]


def unfiltered(kind: int, line: numpy.ndarray, above: numpy.ndarray) -> numpy.ndarray:
    if kind == 0:
        return line
    if kind == 1:
        return numpy.cumsum(line, axis=0, dtype=numpy.uint8)
    if kind == 2:
        return line + above
    found = numpy.zeros_like(line)
    left, corner = numpy.zeros(line.shape[1], int), numpy.zeros(line.shape[1], int)
    for column in range(len(line)):
        up = above[column].astype(int)
        if kind == 3:
            guess = (left + up) // 2
        else:
            far = numpy.abs(numpy.stack([up - corner, left - corner, left + up - 2 * corner]))
            guess = numpy.where((far[0] <= far[1]) & (far[0] <= far[2]), left, numpy.where(far[1] <= far[2], up, corner))
        left = (line[column].astype(int) + guess) & 255
        found[column] = left
        corner = up
    return found
