"""Writing layers to files so that a file is whole or stays as it was.

`Sdf.Layer.Save()` overwrites: with a full disk it leaves neither the old file nor the new one, and a `.usdc`
is changed in place. Here the content goes to a file beside the old one, is synced and read back, and takes
its place then.
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
    """Raises a Failure with the reason why a file cannot be written there. Root is refused like everybody
    else where the file has no write permission at all."""
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
    """The new content of `path`, in a file beside it. discard() removes one that was not put in place."""

    def __init__(self, layer: Sdf.Layer, path: str, like: Sdf.Layer | None = None):
        """Raises Failure, OSError or Tf.ErrorException; nothing is left then. `like`: whose kind of `.usd` a
        new one is."""
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

    def settle(self) -> None:
        """Waits for the disk and reads the file once, so that what cannot be read never replaces what can.
        Needs no stage: may run in a thread."""
        with open(self._temporary, "rb") as file:
            os.fsync(file.fileno())
        if not Sdf.Layer.OpenAsAnonymous(self._temporary):
            raise Failure(f"{self.path}: what was written does not read back")

    def put_in_place(self) -> None:
        """With the owner, if one may, and the permissions of the old one."""
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
    """A `.usd` file stays text or binary as it was; one that is new is as its layer's file, else binary."""
    if extension(path) != "usd":
        return {}
    for existing in (path, layer.realPath):
        if existing and os.path.isfile(existing) and os.path.getsize(existing):
            if extension(existing) == "usda":
                return {"format": "usda"}
            with open(existing, "rb") as file:
                return {"format": "usdc" if file.read(len(_CRATE)) == _CRATE else "usda"}
    return {"format": "usdc"}
