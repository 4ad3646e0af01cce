"""`usdlive.connect()` in a process that has another OpenUSD than the one for which usdlive was built."""

from __future__ import annotations

import os

from .. import _session
from .._asynchronous import connecting
from .._openusd import check
from .live import PortableLive


def connect(url: str, *, user: str = "", application: str = "python", cache_folder: str = "", timeout: float = 10.0,
            cache_mib: int = 4096, token: str = "", backend: str | None = None) -> PortableLive:
    """Connects with the portable backend, which is the only one here: `backend` is None or "portable". The other options
    are those of the fast one. Raises an Error: `notConnected`, `invalidArgument`; an ImportError for the fast backend."""
    return PortableLive(*_session_of(url, user, application, cache_folder, timeout, cache_mib, token, backend))


async def connect_async(url: str, *, user: str = "", application: str = "python", cache_folder: str = "", timeout: float = 10.0,
                        cache_mib: int = 4096, token: str = "", backend: str | None = None) -> PortableLive:
    """`connect()` while the event loop goes on: another thread waits for the server."""
    return PortableLive(*await connecting(
        lambda: _session_of(url, user, application, cache_folder, timeout, cache_mib, token, backend), lambda made: made[0].close()))


def _session_of(url: str, user: str, application: str, cache_folder: str, timeout: float, cache_mib: int, token: str,
                backend: str | None) -> tuple["_session.Session", str]:
    """Returns a session and the address of its server. No Sdf.Layer is made, so it may be on any thread."""
    if backend == "fast":
        check()
    check_backend(backend)
    named = os.path.realpath(os.fspath(cache_folder)) if cache_folder else ""
    url = joined(url)
    return _session.Session(url, user, application, named, timeout * 1000.0, cache_mib << 20, token), url


def joined(url: str) -> str:
    """Exchanges an invitation for a token, and returns the address of the server; another address as it is."""
    return _session.join(url) if url.strip().startswith("usdlive-invitation://") else url


def check_backend(backend: str | None) -> None:
    if backend not in (None, "fast", "portable"):
        raise ValueError(f"backend is {backend!r}: it must be 'fast', 'portable' or None, which takes the fast one where it fits")
