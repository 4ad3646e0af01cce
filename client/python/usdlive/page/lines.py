"""Answers about the live sessions of a project, in the name of a viewer. The calls wait for the server: use them on workers."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shlex
import typing

import usdlive

from .access import Person, Server
from .history import edit_text, short

MOST_LINES = 200
MOST_CONFLICTS = 200

Side = typing.Literal["main", "session"]


@dataclasses.dataclass(frozen=True)
class Wish:
    """A merge or an update that a viewer asks for. `takes`: the side of each decided conflict, by its id; `others`: the side
    of those that are not there."""

    name: str
    is_update: bool
    is_dry_run: bool
    is_kept: bool
    takes: dict[str, Side]
    others: Side | None


def of(server: Server, person: Person) -> usdlive.Sessions:
    return usdlive.sessions(server.url, user=person.name, token=person.token)


def listed(server: Server, person: Person) -> list[dict]:
    return [_session(one) for one in of(server, person).list()]


def created(server: Server, person: Person, name: str, revision: int) -> dict:
    return _session(of(server, person).create(name, revision=revision))


def changed(server: Server, person: Person, verb: str, name: str) -> dict:
    """`verb`: end, restore or delete."""
    return _session(getattr(of(server, person), verb)(name))


def merged(server: Server, person: Person, wish: Wish) -> dict:
    """Merges or updates a session, or finds out what that would do."""
    sessions = of(server, person)

    def take(conflict: usdlive.Conflict) -> Side | None:
        return wish.takes.get(_id(conflict), wish.others)

    if wish.is_update:
        done = sessions.update(wish.name, take=take, dry_run=wish.is_dry_run)
    else:
        done = sessions.merge(wish.name, take=take, keep=wish.is_kept, dry_run=wish.is_dry_run)
    return {"revision": done.revision, "edits": len(done.edits), "lines": [_line(one) for one in done.edits[:MOST_LINES]],
            "created": list(done.created[:MOST_LINES]), "dropped": done.dropped, "conflictCount": len(done.conflicts),
            "conflicts": [_conflict(one) for one in done.conflicts[:MOST_CONFLICTS]]}


def _session(one: usdlive.LiveSession) -> dict:
    """`command`: starts a gateway that shows it."""
    return {"name": one.name, "creator": one.creator, "at": one.time, "revision": one.revision, "ended": one.ended,
            "merged": one.merged, "problem": one.problem, "users": list(one.users),
            "command": f"usdlive page --open {shlex.quote(one.address)}"}


def _line(edit: usdlive.events.Edit) -> str:
    return " ".join(str(one) for one in (edit.layer, edit_text(edit), edit.field, edit.part) if one is not None)


def _id(conflict: usdlive.Conflict) -> str:
    """Stands for a conflict with its contents: what somebody writes after the dry run has to be decided again."""
    known = dataclasses.asdict(conflict) | {"take": None}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()[:32]


def _conflict(one: usdlive.Conflict) -> dict:
    def text(value: typing.Any) -> str | None:
        return None if value is None else short(value)

    return {"id": _id(one), "what": one.what, "layer": one.layer, "path": one.path, "field": one.field,
            "part": None if one.part is None else str(one.part), "before": text(one.before), "main": text(one.main),
            "session": text(one.session), "deletedIn": one.deleted_in, "reason": one.reason, "mainUser": one.main_user,
            "sessionUser": one.session_user}
