"""The part of the API that connections of both backends have in the same form."""

from __future__ import annotations

import abc
import atexit
import contextlib
import os
import typing
import warnings
import weakref

from pxr import Sdf

from . import events
from ._errors import Error
from ._playhead import Playhead
from ._undo import UndoKept, UndoResult, UndoStack
from ._unsent import UnsentWork

opened: "weakref.WeakSet[Connection]" = weakref.WeakSet()


class _Shown(typing.NamedTuple):
    """The own presence, as `show_presence()` of the extensions takes it."""

    selection: list[str] = []
    camera: list[float] = []
    time: float | None = None
    edit_target: str = ""
    data: str = ""


class Connection(abc.ABC):
    """The part of `Live` and `PortableLive` over the functions that their extensions have under the same names."""

    def __init__(self, client: typing.Any, url: str):
        self._client, self._url = client, url
        self._process = os.getpid()
        self._handlers: list[typing.Callable[[events.Event], None]] = []
        self._presence: _Shown | None = None
        self._playhead: Playhead | None = None
        opened.add(self)

    @abc.abstractmethod
    def close(self, timeout: float = 5.0) -> events.Unsent | None:
        """Leaves the project."""

    # -- layers

    def layers(self) -> list[str]:
        """Returns the layers of the project, by path relative to it."""
        return self._client.layers()

    # -- undo

    def undo(self) -> UndoResult:
        """Takes back the newest step of one's own work: the edits of one `tick()`, of a gesture or of a group, in all live
        layers. Edits since the last tick are a step of their own. The stage shows the result at once. What others have
        written since stays, and is in the result's `kept`. The result is false if there is no step. Raises an Error while
        a gesture or a group is open."""
        return _undo_result(self._take_back("undo"))

    def redo(self) -> UndoResult:
        """Takes back the newest undo, in the same way. Own edits in between end what can be redone."""
        return _undo_result(self._take_back("redo"))

    @abc.abstractmethod
    def _take_back(self, undo_or_redo: str) -> dict:
        """Calls a function of the client, after which the layers are up to date, and returns its result."""

    def undo_stack(self) -> UndoStack:
        """Returns the labels of the steps that can be undone and redone."""
        undo, redo = self._client.undo_stack()
        return UndoStack(tuple(undo), tuple(redo))

    @contextlib.contextmanager
    def undo_group(self, label: str) -> typing.Iterator[None]:
        """The edits within are one step of the undo, over any number of ticks: `with live.undo_group("Move chairs"): ...`
        Groups nest: the outermost one counts. The history has the label, too (`live.log(label=...)`), at most 1,000 bytes
        of it."""
        self._seal()
        self._client.begin_undo_group(label)
        try:
            yield
        finally:
            self._seal()
            self._client.end_undo_group()

    def _seal(self) -> None:
        """Gives the client what the editor has written, if it does not see that itself."""

    @abc.abstractmethod
    def begin_gesture(self) -> None:
        """Starts a gesture. Until `end_gesture()`, others see the edits at once, and all are committed
        together. Gestures nest: the outermost one counts."""

    @abc.abstractmethod
    def end_gesture(self) -> None:
        """Ends a gesture."""

    @contextlib.contextmanager
    def gesture(self) -> typing.Iterator[None]:
        """Calls `begin_gesture()` and `end_gesture()`: `with live.gesture(): ...`"""
        self.begin_gesture()
        try:
            yield
        finally:
            self.end_gesture()

    # -- presence

    def show_presence(self, selection: typing.Iterable[object] = (), camera: object = None,
                      time: float | None = None, edit_target: str = "", data: str = "") -> None:
        """Sends one's presence to others: selected paths, a camera's matrix (`Gf.Matrix4d` or 16 numbers by
        rows), the time code, the edit target, and free text (JSON). Sent at most 20 times a second."""
        numbers: list[float] = []
        for row in camera if camera is not None else ():
            numbers.extend(map(float, row) if hasattr(row, "__len__") else (float(row),))
        before, self._presence = self._presence, _Shown([str(path) for path in selection], numbers, time, edit_target, data)
        try:
            self._show()
        except BaseException:
            self._presence = before
            raise

    def hide_presence(self) -> None:
        """Removes one's presence, and releases the playhead. Others see it within 3 seconds."""
        self._presence = None
        if self._playhead is not None:
            self._playhead.release()
        self._client.hide_presence()

    def _show(self) -> None:
        """Sends the own presence, with the playhead if this connection leads it."""
        shown = self._presence or _Shown()
        led = self._playhead.shown if self._playhead is not None else None
        if led is not None:
            shown = shown._replace(time=led.time, data=led.within(shown.data))
        self._client.show_presence(*shown)

    @property
    def playhead(self) -> Playhead:
        """The time that a group looks at together: one leads, the others follow, anybody takes over."""
        if self._playhead is None:
            self._playhead = Playhead(self)
        return self._playhead

    def presences(self) -> list[events.Presence]:
        """Returns the presences of others."""
        return [events.Presence(**d) for d in self._client.presences()]

    def follow(self, user: str, function: typing.Callable[[events.Presence | None], None]
               ) -> typing.Callable[[], None]:
        """Calls `function(presence)` with the presence of a user, now and after each change, during `tick()`.
        Use it to follow a camera or a selection. If the user has several clients, the one that changed last is followed;
        when it has left, the one that changed before. None means that the user has left with all clients. Returns a
        function that ends it."""
        shown: dict[str, events.Presence] = {}  # by client; the one that changed last is the last

        def moved(presence: events.Presence) -> None:
            if shown.get(presence.client) == presence:
                return
            shown.pop(presence.client, None)
            shown[presence.client] = presence
            function(presence)

        def happened(event: events.Event) -> None:
            if not isinstance(event, events.PresenceChanged):
                return
            for presence in event.shown:
                if presence.user == user:
                    moved(presence)
            followed = next(reversed(shown), None)
            for client in event.gone:
                shown.pop(client, None)
            now = next(reversed(shown), None)
            if now != followed:
                function(shown[now] if now else None)

        for presence in self.presences():
            if presence.user == user:
                moved(presence)
        self.add_handler(happened)
        return lambda: self.remove_handler(happened)

    # -- other histories, unsent and lost work

    @property
    def other_history(self) -> events.OtherHistory | None:
        """Not None while this connection has stopped because the server has another history than the editor shows:
        another project is served at the address, or an older copy of this one. An `events.ServerError` with the
        code `historyDiverged` reports it once. The layers stay as they are, edits are kept as without a
        connection, nothing is sent, and work continues when the right server is back."""
        found = self._client.other_history()
        return None if found is None else events.OtherHistory(**found)

    def join_other_history(self) -> None:
        """Decides to join the history that `other_history` describes, with the next connection. Then all open
        layers get its content. Everything that this editor was told is committed and that this history lacks
        becomes lost work (`events.Lost`). Unsent edits are sent if it is the same project; those made in another
        project become lost work, too. Returns at once; `events.Connected` reports the result. Raises an Error
        (`invalidArgument`) if the connection has not stopped."""
        self._client.join_other_history()

    def unsent_work(self) -> list[UnsentWork]:
        """Returns work that earlier connections of this user to this project could not send, because the
        process, the server or the network ended first; with any backend. Oldest first. It is kept until it is sent or
        discarded. Work in another project of the same name (`about.other_project`) cannot be sent to this one."""
        return [UnsentWork(self._client, events.Unsent(**one), self._unsent_as_layer) for one in self._client.unsent_work()]

    @abc.abstractmethod
    def _unsent_as_layer(self, work: str, layer: str) -> Sdf.Layer:
        """Returns the changes of a layer by unsent work as an anonymous layer."""

    # -- events

    def add_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        """Calls `handler(event)` for every event, during `tick()` and `flush()`. Without a handler, `events.Lost` and
        `events.JoinFailed` become a RuntimeWarning."""
        self._handlers.append(handler)

    def remove_handler(self, handler: typing.Callable[[events.Event], None]) -> None:
        self._handlers.remove(handler)

    # -- state

    @property
    def connected(self) -> bool:
        """False while the connection is lost, and when it was closed."""
        return not self._client.closed and self._client.connected

    @property
    def closed(self) -> bool:
        return self._client.closed

    @property
    def user(self) -> str:
        """The name that others see."""
        return self._client.user

    @property
    def role(self) -> str:
        """The role of this user in the project: "viewer", "reviewer", "editor" or "admin". Live layers refuse the edits
        of viewers and reviewers: their `permissionToEdit` is False. Empty while the project is not known."""
        return self._client.role

    @property
    def revision(self) -> int:
        """The newest revision that is confirmed and applied here."""
        return self._client.revision

    @property
    def pending(self) -> int:
        """The number of own transactions that the server has not acknowledged. A frame of edits whose big
        arrays are being encoded counts, too."""
        return self._client.pending

    @property
    def id(self) -> str:
        """This client's id, as in `events.Committed.client`."""
        return self._client.id

    @property
    def cache_folder(self) -> str:
        return self._client.cache_folder

    # -- leaving

    def _left(self, unsent: dict | None) -> events.Unsent | None:
        """Warns of unsent work, and returns it."""
        if unsent is None:
            return None
        left = events.Unsent(**unsent)
        warnings.warn(str(left), RuntimeWarning, stacklevel=3)
        return left

    def __del__(self) -> None:
        # Without `_process`, it has not connected.
        if self.__dict__.get("_process") == os.getpid() and not self._client.closed:
            warnings.warn(f"the connection to {self._url} was not closed, and nothing refers to it any more. Its layers are no "
                          "longer live and refuse edits; what was not sent is kept, and unsent_work() of the next connection "
                          "returns it. Keep what usdlive.connect() returns as long as you edit", RuntimeWarning, stacklevel=1)

    def __enter__(self) -> typing.Self:
        return self

    def __exit__(self, raised: type | None, *_: object) -> None:
        """Closes the connection. Raises an Error (`notConnected`) if work was not sent, unless another exception is on
        its way."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore" if raised is None else "default", RuntimeWarning)
            unsent = self.close()
        if unsent is not None and raised is None:
            raise Error("notConnected", str(unsent))


def _undo_result(result: dict) -> UndoResult:
    kept = tuple(UndoKept(**one) for one in result.pop("kept"))
    return UndoResult(kept=kept, **result)


@atexit.register
def _close_all() -> None:
    """Closes open connections when the interpreter exits, so that they warn about unsent work."""
    for live in list(opened):
        if not live.closed:
            # It belongs to another thread; the journal keeps its work.
            with contextlib.suppress(Error):
                live.close(timeout=2.0)
