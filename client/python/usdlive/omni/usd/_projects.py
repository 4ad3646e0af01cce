"""Which stages are live: those of an address, and files in a folder that was attached to a server."""

from __future__ import annotations

import dataclasses
import os
import re
import urllib.parse

from usdlive import _usdlive

_ADDRESS = re.compile(r"(?P<server>(?:usdlive|ws|dds)://[^/]+)/(?P<layer>.+)")
_SCHEMES = ("usdlive://", "ws://", "dds://")

_attached: dict[str, str] = {}  # folder -> server


@dataclasses.dataclass(frozen=True)
class LiveAddress:
    """Where a live layer is. `folder`: of the files it was attached to, "" when the client keeps its own."""

    server: str
    layer: str
    folder: str = ""


def attach_project(folder: str, server: str) -> None:
    """From now on files in `folder` open live: it is the folder that `server` (`usdlive://host:port`,
    `dds://project`) serves, or a copy of it."""
    _attached[os.path.realpath(local_path(folder))] = server.rstrip("/")


def detach_project(folder: str) -> None:
    """Files in it open as files again. Stages that are open stay as they are."""
    _attached.pop(os.path.realpath(local_path(folder)), None)


def local_path(url: str) -> str:
    """The path of a `file://` URL; anything else as it is."""
    return _usdlive.layer_utils.without_file_scheme(str(url))


def is_live_address(url: str) -> bool:
    return url.startswith(_SCHEMES)


def live_address(url: str) -> LiveAddress | None:
    """A layer's name may be given as it is or percent-encoded. None for a file that is not in an attached
    folder, and for what is_live_address() and names no layer."""
    if match := _ADDRESS.fullmatch(url):
        return LiveAddress(match["server"], urllib.parse.unquote(match["layer"]))
    if is_live_address(url):
        return None
    path = os.path.realpath(url)
    folders = [folder for folder in _attached if path.startswith(folder + os.sep)]
    if not folders:
        return None
    folder = max(folders, key=len)
    return LiveAddress(_attached[folder], os.path.relpath(path, folder).replace(os.sep, "/"), folder)
