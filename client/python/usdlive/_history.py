"""The results of searches in the history."""

from __future__ import annotations

import dataclasses
import datetime
import json
import numbers
import typing

from . import _session, events
from ._errors import Error


@dataclasses.dataclass(frozen=True)
class LoggedCommit:
    """A commit of the past. `time`: seconds since 1970. `label`: that of the author's undo group, or "". `edits`: those that
    were asked for. `imported`: the layer whose file it has read, or None; the edits of an import are not known."""

    revision: int
    user: str
    client: str
    time: float
    label: str
    edits: tuple[events.Edit, ...]
    imported: str | None


@dataclasses.dataclass(frozen=True)
class Opinion:
    """An opinion, and the last commit that has written it.

    `field` is None for the spec itself, with its name; `part` as in `events.Edit`, if one field was asked for. `revision` is
    0 if the opinion is older than the history, which then begins at a base (`usdlive compact`); `user` is "" and `time` 0
    then. `imported`: it came with the layer's file. `value` is as `usdlive blame --json` prints it: numbers, texts, lists
    and dictionaries; a big value is {"blob": hash, "bytes": size}. `before` is what was there before that commit, None if
    there was nothing; it is only known if `before_known`."""

    path: str
    field: str | None
    part: str | float | None
    revision: int
    user: str
    time: float
    imported: bool
    value: typing.Any
    before: typing.Any
    before_known: bool


def opinion(found: dict) -> Opinion:
    for name in ("value", "before"):
        found[name] = None if found[name] is None else json.loads(found[name])
    return Opinion(**found)


def logged(found: dict) -> LoggedCommit:
    return LoggedCommit(**{**found, "edits": tuple(events.Edit(**one) for one in found["edits"])})


Moment = typing.Union[str, float, datetime.datetime, datetime.timedelta, None]


def milliseconds(moment: Moment) -> int | None:
    """Returns a moment in milliseconds since 1970: seconds since 1970, a datetime (local if it has no time zone), a timedelta
    (so long ago), or a text as the commands have it."""
    if moment is None:
        return None
    if isinstance(moment, str):
        return _session.moment(moment)
    if isinstance(moment, datetime.timedelta):
        moment = datetime.datetime.now().astimezone() - moment
    if isinstance(moment, datetime.datetime):
        moment = moment.timestamp()
    if not isinstance(moment, numbers.Real):
        raise Error("invalidArgument", f"{moment!r} is no time: give seconds since 1970, a datetime, a timedelta for a time "
                    "before now, or a text such as '2h' or '2026-11-29 14:05'")
    return int(moment * 1000)
