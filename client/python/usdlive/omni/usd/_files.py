"""Writes layers to files atomically.

`Sdf.Layer.Save()` overwrites the file: with a full disk neither the old nor the new content remains, and a
`.usdc` file is changed in place. Here the content is written to a file beside the old one, synced and read
back, and then replaces it.
"""

from __future__ import annotations

import contextlib
import os
import secrets

from pxr import Sdf

from ._errors import Failure

_CRATE = b"PXR-USDC"
WRITABLE_EXTENSIONS = ("usd", "usda", "usdc", "live")


def extension(path: str) -> str:
    return os.path.splitext(path)[1].removeprefix(".").lower()


def check_writable(path: str) -> None:
    """Raises a Failure with the reason if a file cannot be written there. Also refuses root if the file has no
    write permission."""
    folder = os.path.dirname(os.path.abspath(path))
    if extension(path) not in WRITABLE_EXTENSIONS or not Sdf.FileFormat.FindByExtension(extension(path)):
        raise Failure(f"{path}: files of this kind cannot be written; use .usd, .usda or .usdc")
    if os.path.isdir(path):
        raise Failure(f"{path} is a folder")
    if os.path.exists(path) and is_read_only(path):
        raise Failure(f"{path} is read-only")
    if os.path.isdir(folder) and not os.access(folder, os.W_OK):
        raise Failure(f"the folder {folder} is read-only")


def is_read_only(path: str) -> bool:
    return not os.access(path, os.W_OK) or not os.stat(path).st_mode & 0o222


class Replacement:
    """The new content of `path` in a temporary file beside it. discard() removes a file that was not put in
    place."""

    def __init__(self, layer: Sdf.Layer, path: str, like: Sdf.Layer | None = None):
        """Writes the temporary file. Raises Failure, OSError or Tf.ErrorException, and leaves no file then.
        `like`: the layer whose kind of `.usd` file a new file gets."""
        self.path = os.path.realpath(path)
        check_writable(self.path)
        folder, name = os.path.split(self.path)
        os.makedirs(folder, exist_ok=True)
        stem, suffix = os.path.splitext(name)
        self._temporary = os.path.join(folder, f".{stem}-{secrets.token_hex(8)}{suffix}")
        try:
            if not layer.Export(self._temporary, args=_arguments(like or layer, self.path)):
                raise Failure(f"{path} could not be written")
        except BaseException:
            self.discard()
            raise

    def sync_and_verify(self) -> None:
        """Syncs the file and reads it once, so that an unreadable file never replaces a readable one. Uses no
        stage, so it may run in a thread."""
        with open(self._temporary, "rb") as file:
            os.fsync(file.fileno())
        if not Sdf.Layer.OpenAsAnonymous(self._temporary):
            raise Failure(f"{self.path}: the written file cannot be read back")

    def put_in_place(self) -> None:
        """Replaces the old file. Keeps its permissions, and its owner if possible."""
        with contextlib.suppress(FileNotFoundError):
            old = os.stat(self.path)
            with contextlib.suppress(PermissionError):
                os.chown(self._temporary, old.st_uid, old.st_gid)
            os.chmod(self._temporary, old.st_mode & 0o7777)
        os.replace(self._temporary, self.path)
        _sync_folder(self.path)

    def discard(self) -> None:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self._temporary)


def _sync_folder(path: str) -> None:
    folder = os.open(os.path.dirname(path), os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _arguments(layer: Sdf.Layer, path: str) -> dict[str, str]:
    """Returns the arguments for a `.usd` file: text or binary as before. A new file is like its layer's file,
    or binary."""
    if extension(path) != "usd":
        return {}
    for existing in (path, layer.realPath):
        if existing and os.path.isfile(existing) and os.path.getsize(existing):
            if extension(existing) == "usda":
                return {"format": "usda"}
            with open(existing, "rb") as file:
                return {"format": "usdc" if file.read(len(_CRATE)) == _CRATE else "usda"}
    return {"format": "usdc"}
