"""Decides which stages are live: those of an address, and files in a folder that is attached to a server."""

from __future__ import annotations

import dataclasses
import os
import re
import urllib.parse

from usdlive import _usdlive

_ADDRESS = re.compile(r"(?P<server>(?:usdlive|wss?|dds)://[^/]+)/(?P<layer>.+)")
_SCHEMES = ("usdlive://", "ws://", "wss://", "dds://")

_attached: dict[str, str] = {}  # folder -> server


@dataclasses.dataclass(frozen=True)
class LiveAddress:
    """The address of a live layer. `folder`: the attached folder of its file, or "" if the client keeps its own
    files."""

    server: str
    layer: str
    folder: str = ""


def attach_project(folder: str, server: str) -> None:
    """Makes files in `folder` open live from now on. It is the folder that `server` (`usdlive://host:port`,
    `dds://project`) serves, or a copy of it."""
    _attached[os.path.realpath(local_path(folder))] = server.rstrip("/")


def detach_project(folder: str) -> None:
    """Makes files in the folder open as files again. Open stages stay unchanged."""
    _attached.pop(os.path.realpath(local_path(folder)), None)


def local_path(url: str) -> str:
    """Returns the path of a `file://` URL, and any other text unchanged."""
    return _usdlive.layer_utils.without_file_scheme(str(url))


def is_live_address(url: str) -> bool:
    return url.startswith(_SCHEMES)


def live_address(url: str) -> LiveAddress | None:
    """Returns the live address of a URL or file. A layer's name may be percent-encoded. Returns None for a file
    outside the attached folders, and for a live address without a layer."""
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
