"""Meshes and textures by the SHA-256 of their bytes. Any thread."""

from __future__ import annotations

import collections
import hashlib
import threading
import typing

# Those that nothing names any more are kept, because a page may be about to fetch them.
UNUSED_BYTES = 256 << 20


class Blob(typing.NamedTuple):
    content: bytes
    type: str


class Blobs:
    """Counts who uses each; the oldest unused ones are dropped when they have more than UNUSED_BYTES."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._all: dict[str, Blob] = {}
        self._uses: collections.Counter[str] = collections.Counter()
        self._unused: collections.OrderedDict[str, int] = collections.OrderedDict()  # hash to size, oldest first
        self._unused_bytes = 0

    def add(self, content: bytes, name: str = "", type: str = "application/octet-stream") -> str:
        """Returns the hash, which is `name` if that is known. The content is unused at first."""
        name = name or hashlib.sha256(content).hexdigest()
        with self._lock:
            if name not in self._all:
                self._all[name] = Blob(content, type)
                self._now_unused(name)
        return name

    def get(self, name: str) -> Blob | None:
        return self._all.get(name)

    def use(self, name: str) -> None:
        with self._lock:
            self._uses[name] += 1
            self._unused_bytes -= self._unused.pop(name, 0)

    def release(self, name: str) -> None:
        with self._lock:
            self._uses[name] -= 1
            if self._uses[name] <= 0:
                del self._uses[name]
                self._now_unused(name)

    def _now_unused(self, name: str) -> None:
        if name not in self._all:
            return
        self._unused[name] = len(self._all[name].content)
        self._unused_bytes += self._unused[name]
        while self._unused_bytes > UNUSED_BYTES and len(self._unused) > 1:
            oldest, size = self._unused.popitem(last=False)
            self._unused_bytes -= size
            del self._all[oldest]
