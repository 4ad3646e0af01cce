"""usdlive: edit one OpenUSD stage together with others. Import it before the first layer is opened.

    import usdlive
    live = usdlive.connect("ws://127.0.0.1:7447", user="ada")
    stage = live.open_stage("shot.usda")     # an ordinary Usd.Stage whose layers are live
    while editing:
        ...                                  # author with pxr.Usd, as ever
        live.tick()                          # once per frame: sends yours, applies what others did
"""

from __future__ import annotations

from ._openusd import check as _check_openusd

_check_openusd()  # loads usd-core's library, which the extension uses

from . import events, plugins  # noqa: E402
from ._usdlive import __version__  # noqa: E402
from ._error_code import ErrorCode  # noqa: E402
from ._errors import Error  # noqa: E402
from ._history import LoggedCommit, Opinion  # noqa: E402
from ._live import Live, UnsentWork, connect, connect_async  # noqa: E402
from ._namespace import NamespaceEditor  # noqa: E402
from ._player import Player  # noqa: E402
from ._undo import UndoKept, UndoResult, UndoStack  # noqa: E402

plugins.register()

__all__ = ["__version__", "Error", "ErrorCode", "Live", "LoggedCommit", "NamespaceEditor", "Opinion", "Player", "UndoKept",
           "UndoResult", "UndoStack", "UnsentWork", "connect", "connect_async", "events", "plugins"]
