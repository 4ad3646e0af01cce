"""Answers about the past: commits, authors of opinions, checkpoints, reverts. Asked by a connection of its own, because they
wait for the server."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import typing

import usdlive
from usdlive._history import logged, milliseconds

from .access import Person, Server
from .owned import Owner

_PAUSE = 0.05
MOST_COMMITS = 500
_SECONDS = 60.0


class Reader(Owner):
    """Asks the server about the history."""

    def frame(self) -> float:
        self.live.tick()
        return _PAUSE

    def log(self, query: dict, before: int, limit: int) -> dict:
        """The newest commits first."""
        limit = max(1, min(limit, MOST_COMMITS))
        commits, _, _, more = self.live._call("log", query, before, limit)
        return {"commits": [_commit(logged(one)) for one in commits], "more": bool(more)}

    def blame(self, layer: str, path: str, below: bool = False) -> list[dict]:
        return [{"layer": layer, "path": one.path, "field": one.field or "", "valueText": short(one.value),
                 "before": short(one.before) if one.before_known else "", "user": one.user or ("(file)" if one.imported else ""),
                 "at": one.time, "revision": one.revision} for one in self.live.blame(layer, path, below)]

    def opinions(self, specs: list[tuple[str, str, str]]) -> list[dict]:
        """Opinions with their authors: of each spec, the last commit that wrote it."""
        found = []
        for layer, path, text in specs:
            entry: dict = {"layer": layer, "path": path, "valueText": text}
            try:
                written = [one for one in self.live.blame(layer, path) if one.path == path]
            except usdlive.Error:  # a layer that is not of this project, or was not live yet
                written = []
            if written:
                last = max(written, key=lambda one: one.revision)
                entry |= {"author": last.user or ("(file)" if last.imported else ""), "at": last.time, "revision": last.revision}
            found.append(entry)
        return found

    def checkpoints(self) -> dict:
        return {"items": [{"name": one.name, "revision": one.revision, "user": one.user, "at": one.time}
                          for one in self.live.checkpoints()]}


def query(message: dict) -> dict:
    """The query of `log` for the extension."""
    def texts(name: str) -> list[str]:
        value = message.get(name)
        return [value] if isinstance(value, str) and value else [one for one in value if isinstance(one, str)] if isinstance(value, list) else []

    def place(name: str) -> str:
        value = message.get(name)
        return value if isinstance(value, str) else ""

    def moment(name: str) -> int | None:
        value = message.get(name)
        return milliseconds(value if isinstance(value, (int, float)) and not isinstance(value, bool) else value or None)

    return {"users": texts("user"), "kinds": texts("kind"), "since": moment("since"), "until": moment("until"),
            "layer": place("layer"), "path": place("path"), "label": place("label")}


def short(value: typing.Any) -> str:
    text = value if isinstance(value, str) else "" if value is None else json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."


def _commit(one: usdlive.LoggedCommit) -> dict:
    paths = list(dict.fromkeys(edit.path.partition(".")[0] for edit in one.edits))
    layers = list(dict.fromkeys([edit.layer for edit in one.edits] + ([one.imported] if one.imported else [])))
    return {"revision": one.revision, "user": one.user, "client": one.client, "at": one.time, "layers": layers[:16], "paths": paths[:5],
            "edits": len(one.edits), "text": _sentence(one, paths)}


def _sentence(one: usdlive.LoggedCommit, paths: list[str]) -> str:
    if one.label:
        return one.label
    if one.imported:
        return f"read the file of {one.imported}"
    if not one.edits:
        return ""
    what = edit_text(one.edits[0])
    more = len(one.edits) - 1
    return (what if len(what) <= 120 else what[:117] + "...") + (f", and {more} more" if more else "")


def edit_text(edit: usdlive.events.Edit) -> str:
    return f"{edit.kind} {edit.path}" + (f" to {edit.new_path}" if edit.new_path else "")


async def revert(server: Server, person: Person, revisions: list[int], path: str, layer: str, dry_run: bool) -> dict:
    """Runs `usdlive revert` in the name of the viewer."""
    first, last = min(revisions), max(revisions)
    if sorted(set(revisions)) != list(range(first, last + 1)):
        raise usdlive.Error("invalidArgument", "the revisions must follow one another: revert the others by themselves")
    words = [sys.executable, "-m", "usdlive", "revert", "--json", *(["--dry-run"] if dry_run else []),
             *([f"--layer={layer}"] if layer else []), *([f"--path={path}"] if path else []), f"--user={person.name}",
             server.url, f"{first}-{last}"]
    environment = dict(os.environ)
    if person.token:
        place = f"{server.host}:{server.port}" if ":" not in server.host else f"[{server.host}]:{server.port}"
        environment["USDLIVE_TOKEN"] = f"usdlive-token://{person.name}@{place}/{person.token}{'?tls' if server.secure else ''}"
        environment.pop("USDLIVE_TOKEN_FILE", None)
    running = await asyncio.create_subprocess_exec(*words, env=environment, stdin=asyncio.subprocess.DEVNULL,
                                                   stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    try:
        output, errors = await asyncio.wait_for(running.communicate(), _SECONDS)
    except (asyncio.TimeoutError, asyncio.CancelledError):
        running.kill()
        raise
    try:
        found = json.loads(output)
    except ValueError:
        raise usdlive.Error("refused", errors.decode(errors="replace").strip().removeprefix("usdlive: ") or "the revert failed") from None
    return {"edits": len(found.get("edits", [])), "lines": [_line(one) for one in found.get("edits", [])[:200]],
            "kept": [f"{one.get('layer')} {one.get('path')} {one.get('field') or ''}: {one.get('reason')}" for one in found.get("kept", [])[:200]],
            "revision": found.get("revision") or found.get("reverted") or None}


def _line(edit: dict) -> str:
    return " ".join(str(edit[name]) for name in ("layer", "action", "path", "field") if edit.get(name))
