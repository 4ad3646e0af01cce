"""The live sessions of a project."""

from __future__ import annotations

import dataclasses
import json
import typing

from . import _session, events

Side = typing.Literal["main", "session"]


@dataclasses.dataclass(frozen=True)
class LiveSession:
    """A live session. `connect(address)` joins it. `time`: when it was created, in seconds since 1970. `revision`: the one of
    the main line from which it is. `ended`: nobody can join it. `merged`: the revision of the main line that has its changes,
    or 0. `problem`: why it cannot be opened, or "". `users`: who was in it when the server answered; only of `list()`."""

    name: str
    address: str
    creator: str
    time: float
    revision: int
    ended: bool
    merged: int
    problem: str
    users: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Conflict:
    """Something that the main line and a session have both changed, and not in the same way.

    `what`: "value" (both have written the register), "deleted" (one has deleted the spec, see `deleted_in`, and the other has
    changed it or something below it), "moved" (both have renamed or moved it), or "refused" (the other line cannot take the
    change, for the `reason`). `field` is None for the spec itself; `part` as in `events.Edit`. `before`, `main` and `session`
    are the contents when the lines last had the same and now, as in `Opinion.value`; None: there is none. `take`: the
    decision, None: there is none yet."""

    what: str
    layer: str
    path: str
    field: str | None
    part: str | float | None
    before: typing.Any
    main: typing.Any
    session: typing.Any
    deleted_in: Side | None
    reason: str
    main_user: str
    session_user: str
    take: Side | None


@dataclasses.dataclass(frozen=True)
class Merged:
    """The result of a merge or an update, or of its dry run. `revision`: that of the commit; 0: nothing was committed. `created`: the
    layers that the receiving line lacked. `dropped`: how many further edits were left out, because that line lacks their
    specs."""

    revision: int
    edits: tuple[events.Edit, ...]
    created: tuple[str, ...]
    conflicts: tuple[Conflict, ...]
    dropped: int


Take = typing.Union[Side, typing.Callable[[Conflict], typing.Optional[Side]], None]


def _conflict(found: dict) -> Conflict:
    values = {name: None if found[name] is None else json.loads(found[name]) for name in ("before", "main", "session")}
    return Conflict(**{**found, **values})


def _merged(found: dict) -> Merged:
    return Merged(found["revision"], tuple(events.Edit(**one) for one in found["edits"]), tuple(found["created"]),
                  tuple(map(_conflict, found["conflicts"])), found["dropped"])


def _checked(side: typing.Any) -> Side | None:
    if side not in (None, "main", "session"):
        raise ValueError(f"{side!r} is no side of a conflict: take \"main\" or \"session\"")
    return side


def _decider(take: Take) -> typing.Callable[[dict], Side | None]:
    if callable(take):
        return lambda found: _checked(take(_conflict(found)))
    side = _checked(take)
    return lambda found: side


class Sessions:
    """The live sessions of a project: `usdlive.sessions(address)` returns it. Every call waits for the server, on any thread; it
    needs no connection and no tick. Raises an Error: `notConnected` (also after 15 s without an answer: it may be done or not),
    `invalidArgument` with what is not possible, and what to do next."""

    def __init__(self, address: str, user: str, token: str) -> None:
        self._sessions = _session.Sessions(address, user, token)

    def list(self) -> "list[LiveSession]":
        """All live sessions, by name."""
        return [LiveSession(**one) for one in self._sessions.list()]

    def create(self, name: str, *, revision: int = 0, checkpoint: str = "") -> LiveSession:
        """Creates a session from a revision or a checkpoint of the main line; without both, from the newest revision."""
        if revision and checkpoint:
            raise ValueError("a session begins with a revision or with a checkpoint, not with both")
        made = self._sessions.create_from(name, checkpoint) if checkpoint else self._sessions.create(name, revision)
        return LiveSession(**made)

    def end(self, name: str) -> LiveSession:
        """Disconnects everybody. The history is kept."""
        return LiveSession(**self._sessions.end(name))

    def restore(self, name: str) -> LiveSession:
        """Opens an ended session again."""
        return LiveSession(**self._sessions.restore(name))

    def delete(self, name: str) -> LiveSession:
        """Deletes an ended session with its history."""
        return LiveSession(**self._sessions.delete(name))

    def merge(self, name: str, *, take: Take = None, keep: bool = False, dry_run: bool = False) -> Merged:
        """Brings what the session has changed to the main line as one commit, and ends the session unless `keep`.

        `take`: which line counts in a conflict: "main" or "session" for all, or a function that is called with each
        `Conflict` and returns one of both, or None. An undecided conflict is an Error, and nothing is changed. `dry_run` only
        returns what would be done, with all conflicts. If somebody edits the session meanwhile, it is not ended, and the
        Error says that it has to be merged again."""
        return _merged(self._sessions.merge(name, dry_run, keep, _decider(take)))

    def update(self, name: str, *, take: Take = None, dry_run: bool = False) -> Merged:
        """Brings what the main line has changed to the session as one commit. Takes what `merge()` does."""
        return _merged(self._sessions.update(name, dry_run, _decider(take)))


def sessions(address: str, *, user: str = "", token: str = "") -> Sessions:
    """Returns the live sessions of the project at an address `ws://host:port` or `ws://host:port/project` (not over DDS), without
    connecting. `user`, `token`: as for `connect()`. Raises an Error: `invalidArgument`."""
    return Sessions(address, user, token)
