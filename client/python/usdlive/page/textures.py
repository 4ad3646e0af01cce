"""Fetches textures with OpenUSD's resolver on worker threads, because a file of the project may have to be downloaded."""

from __future__ import annotations

import concurrent.futures
import typing

from pxr import Ar

from .blobs import Blobs

MOST_BYTES = 128 << 20
_TYPES = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"GIF8", "image/gif"), (b"BM", "image/bmp"))
_READERS = 2


class Texture(typing.NamedTuple):
    hash: str
    problem: str


class Textures:
    """`done(path)` is called on a worker when a texture that `find()` did not have is there."""

    def __init__(self, blobs: Blobs, done: typing.Callable[[str], None]):
        self._blobs, self._done = blobs, done
        self._found: dict[str, Texture | None] = {}  # None: being fetched
        self._workers = concurrent.futures.ThreadPoolExecutor(_READERS, "usdlive page textures")

    def find(self, path: str, context: Ar.ResolverContext) -> Texture | None:
        """The texture at a resolved path; None while it is fetched."""
        if path not in self._found:
            self._found[path] = None
            self._workers.submit(self._fetch, path, context)
        return self._found[path]

    def forget(self) -> None:
        """Fetches all again when they are asked for: files have changed."""
        self._found = {path: found for path, found in self._found.items() if found is None}

    def close(self) -> None:
        self._workers.shutdown(wait=False, cancel_futures=True)

    def _fetch(self, path: str, context: Ar.ResolverContext) -> None:
        try:
            with Ar.ResolverContextBinder(context):
                found = self._read(path)
        except Exception as failed:  # the resolver or the network has failed
            found = Texture("", f"the texture {path} cannot be read: {failed}")
        self._found[path] = found
        self._done(path)

    def _read(self, path: str) -> Texture:
        asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
        if not asset:
            return Texture("", f"the texture {path} cannot be opened")
        size = asset.GetSize()
        if size > MOST_BYTES:
            return Texture("", f"the texture {path} has {size >> 20} MiB, more than the {MOST_BYTES >> 20} MiB that are shown")
        with asset:
            content = bytes(asset.GetBuffer())
        kind = image_type(content)
        if not kind:
            return Texture("", f"the texture {path} is no image that browsers show")
        return Texture(self._blobs.add(content, type=kind), "")


def image_type(content: bytes) -> str:
    """The type of an image by its first bytes; empty for one that browsers do not show."""
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return "image/webp"
    return next((kind for start, kind in _TYPES if content.startswith(start)), "")
