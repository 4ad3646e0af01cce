"""usdlive: edit one OpenUSD stage together with others. Import it before the first layer is opened.

    import usdlive
    live = usdlive.connect("ws://127.0.0.1:7447", user="ada")
    stage = live.open_stage("shot.usda")     # an ordinary Usd.Stage whose layers are live
    while editing:
        ...                                  # author with pxr.Usd, as ever
        live.tick()                          # once per frame: sends yours, applies what others did
"""

from __future__ import annotations

from ._error_code import ErrorCode
from ._errors import Error
from ._openusd import OtherOpenUsd as _OtherOpenUsd
from ._openusd import check as _check_openusd
from ._openusd import is_portable_here as _is_portable_here

try:
    _check_openusd()  # loads usd-core's library, which the extension uses
    _other = None
except _OtherOpenUsd as _found:
    if not _is_portable_here():
        raise ImportError(str(_found)) from None
    _other = str(_found)

from . import events  # noqa: E402
from ._history import LoggedCommit, Opinion  # noqa: E402
from ._playhead import Playhead  # noqa: E402
from ._session import __version__  # noqa: E402
from ._sessions import Conflict, LiveSession, Merged, Sessions, sessions  # noqa: E402
from ._undo import UndoKept, UndoResult, UndoStack  # noqa: E402
from ._unsent import UnsentWork  # noqa: E402

__all__ = ["__version__", "Conflict", "Error", "ErrorCode", "LiveSession", "LoggedCommit", "Merged", "Opinion", "Playhead", "Sessions",
           "UndoKept", "UndoResult", "UndoStack", "UnsentWork", "connect", "connect_async", "events", "sessions"]

if _other is None:
    from . import plugins
    from ._live import Live, connect, connect_async
    from ._namespace import NamespaceEditor
    from ._player import Player

    plugins.register()

    __all__ += ["Live", "NamespaceEditor", "Player", "plugins"]
else:
    from .portable.connecting import connect, connect_async

    def __getattr__(name: str) -> object:
        raise AttributeError(f"usdlive has no {name!r} in this process, which has only the portable backend: {_other}")
