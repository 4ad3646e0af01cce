"""The portable backend: a live project in a process with any OpenUSD from 24.11 on.

The compiled part, `usdlive._session`, holds the session and knows no OpenUSD. Layers are read and written through the
process's own `pxr`.
"""

from __future__ import annotations

from .live import PortableLive

__all__ = ["PortableLive"]
