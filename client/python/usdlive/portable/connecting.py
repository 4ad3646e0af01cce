"""`usdlive.connect()` in a process that has another OpenUSD than the one for which usdlive was built."""

from __future__ import annotations

from .. import _session
from .._openusd import check
from .live import PortableLive


def connect(url: str, *, user: str = "", application: str = "python", cache_folder: str = "", timeout: float = 10.0,
            cache_mib: int = 4096, token: str = "", backend: str | None = None) -> PortableLive:
    """Connects with the portable backend, which is the only one here: `backend` is None or "portable". The other options
    are those of the fast one. Raises an Error: `notConnected`, `invalidArgument`; an ImportError for the fast backend."""
    if backend == "fast":
        check()
    check_backend(backend)
    return PortableLive(joined(url), user=user, application=application, cache_folder=cache_folder, timeout=timeout,
                        cache_mib=cache_mib, token=token)


def joined(url: str) -> str:
    """Exchanges an invitation for a token, and returns the address of the server; another address as it is."""
    return _session.join(url) if url.strip().startswith("usdlive-invitation://") else url


def check_backend(backend: str | None) -> None:
    if backend not in (None, "fast", "portable"):
        raise ValueError(f"backend is {backend!r}: it must be 'fast', 'portable' or None, which takes the fast one where it fits")
