"""Answers what a page asks for: each message with a number once."""

from __future__ import annotations

import asyncio
import logging
import math
import typing

import usdlive
from pxr import Tf, Usd

from . import editing, history, lines, properties, tree
from .gateway import Gateway, TooMany
from .viewer import Viewer

_log = logging.getLogger("usdlive.page")

MOST_REQUESTS = 64  # requests of a page that wait for an answer
_Handler = typing.Callable[["Requests", Viewer, dict], typing.Awaitable[typing.Any]]
_handlers: dict[str, _Handler] = {}


class Misused(usdlive.Error):
    """A request that cannot be understood."""

    def __init__(self, why: str):
        super().__init__("invalidArgument", why)


def request(name: str) -> typing.Callable[[_Handler], _Handler]:
    def add(handler: _Handler) -> _Handler:
        _handlers[name] = handler
        return handler
    return add


def text(message: dict, name: str, default: str | None = None) -> str:
    value = message.get(name, default)
    if not isinstance(value, str) or not _is_unicode(value):
        raise Misused(f"'{name}' must be a text")
    return value


def _is_unicode(value: str) -> bool:
    """Whether it has no half of a surrogate pair, which JSON allows."""
    return not any("\ud800" <= one <= "\udfff" for one in value)


def number(message: dict, name: str, default: int | None = None) -> int:
    value = message.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or not -2 ** 53 <= value <= 2 ** 53:
        raise Misused(f"'{name}' must be a whole number")
    return value


def moment(message: dict, name: str = "time") -> float | None:
    value = message.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise Misused(f"'{name}' must be a number or null")
    return float(value)


def numbers(message: dict, name: str, count: int) -> list[float]:
    value = message.get(name)
    if not isinstance(value, list) or len(value) != count or not all(
            isinstance(one, (int, float)) and not isinstance(one, bool) and math.isfinite(one) for one in value):
        raise Misused(f"'{name}' must be {count} numbers")
    return [float(one) for one in value]


def _yes(message: dict, name: str) -> bool:
    value = message.get(name)
    if not isinstance(value, bool):
        raise Misused(f"'{name}' must be true or false")
    return value


def _side(value: object) -> lines.Side:
    if value not in ("main", "session"):
        raise Misused(f"{str(value)[:80]!r} is no side of a conflict: take \"main\" or \"session\"")
    return value


def texts(message: dict, name: str, most: int = 256) -> list[str]:
    value = message.get(name, [])
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise Misused(f"'{name}' must be a list of texts")
    return value[:most]


class Requests:
    """Answers the requests of all viewers."""

    def __init__(self, gateway: Gateway):
        self.gateway = gateway

    def take(self, viewer: Viewer, message: dict) -> None:
        """Begins to answer. Requests of a viewer begin in their order."""
        if viewer.requests >= MOST_REQUESTS:
            self._answer(viewer, message, error=("overloaded", f"{MOST_REQUESTS} requests wait for an answer already"))
            return
        viewer.requests += 1
        self.gateway.spawn(self._handle(viewer, message))

    async def _handle(self, viewer: Viewer, message: dict) -> None:
        try:
            handler = _handlers.get(str(message.get("type")))
            if handler is None:
                raise usdlive.Error("Unsupported", f"there is no request {str(message.get('type'))[:80]!r}")
            self._answer(viewer, message, await handler(self, viewer, message))
        except usdlive.Error as failed:
            self._answer(viewer, message, error=(failed.code, failed.message))
        except TooMany as bound:
            self._answer(viewer, message, error=("overloaded", str(bound)))
        except asyncio.CancelledError:
            raise
        except Tf.ErrorException as failed:
            self._answer(viewer, message, error=("invalidArgument", str(failed)))
        except Exception as failed:
            _log.exception("an error while answering %s", message.get("type"))
            self._answer(viewer, message, error=("internal", f"{type(failed).__name__}: {failed}"))
        finally:
            viewer.requests -= 1

    @staticmethod
    def _answer(viewer: Viewer, message: dict, value: typing.Any = None, error: tuple[str, str] | None = None) -> None:
        if not isinstance(message.get("id"), (int, str)):
            return
        reply = {"type": "reply", "id": message["id"]}
        viewer.tell(reply | ({"value": value} if error is None else {"error": {"code": error[0], "message": error[1]}}))

    @staticmethod
    async def on_stage(viewer: Viewer, function: typing.Callable, *arguments: typing.Any) -> typing.Any:
        """Calls it on the thread of the viewer's picture."""
        return await asyncio.wrap_future(viewer.picture.call(function, *arguments))

    # -- reading the stage

    @request("children")
    async def _children(self, viewer: Viewer, message: dict) -> dict:
        return await self.on_stage(viewer, tree.children, viewer.picture.stage, text(message, "path", "/"),
                                   number(message, "from", 0), number(message, "count", 100))

    @request("search")
    async def _search(self, viewer: Viewer, message: dict) -> dict:
        picture = viewer.picture
        return await self.on_stage(viewer, tree.search, picture.stage, picture.scene.nodes, text(message, "text"),
                                   number(message, "limit", 100))

    @request("bounds")
    async def _bounds(self, viewer: Viewer, message: dict) -> dict:
        picture = viewer.picture
        return await self.on_stage(viewer, lambda: tree.bounds(picture.stage, texts(message, "paths"), picture.scene.time))

    @request("properties")
    async def _properties(self, viewer: Viewer, message: dict) -> dict:
        picture, at = viewer.picture, moment(message)

        def read() -> dict:
            time = picture.scene.time if "time" not in message else Usd.TimeCode.Default() if at is None else Usd.TimeCode(at)
            return properties.properties(picture.stage, picture.name_of, text(message, "path"), time)

        return await self.on_stage(viewer, read)

    # -- the history

    @request("opinions")
    async def _opinions(self, viewer: Viewer, message: dict) -> dict:
        picture = viewer.picture
        specs = await self.on_stage(viewer, properties.specs_of, picture.stage, picture.name_of, text(message, "path"),
                                    text(message, "name", ""))
        reader = self.gateway.reader()
        return {"opinions": await asyncio.wrap_future(reader.call(reader.opinions, specs))}

    @request("blame")
    async def _blame(self, viewer: Viewer, message: dict) -> dict:
        picture, reader = viewer.picture, self.gateway.reader()
        specs = await self.on_stage(viewer, properties.specs_of, picture.stage, picture.name_of, text(message, "path"), "")
        known = set(await self.on_stage(viewer, picture.live.layers))
        items: list[dict] = []
        for layer, path, _ in specs:
            if layer in known:
                items += await asyncio.wrap_future(reader.call(reader.blame, layer, path))
        return {"items": items[:2000]}

    @request("log")
    async def _log(self, viewer: Viewer, message: dict) -> dict:
        reader = self.gateway.reader()
        return await asyncio.wrap_future(reader.call(reader.log, history.query(message), number(message, "before", 0),
                                                     number(message, "limit", 50)))

    @request("checkpoints")
    async def _checkpoints(self, viewer: Viewer, message: dict) -> dict:
        reader = self.gateway.reader()
        return await asyncio.wrap_future(reader.call(reader.checkpoints))

    @request("checkpoint")
    async def _checkpoint(self, viewer: Viewer, message: dict) -> dict:
        editor = self._editor(viewer, False)
        return await asyncio.wrap_future(editor.call(editor.checkpoint, text(message, "name")))

    @request("revert")
    async def _revert(self, viewer: Viewer, message: dict) -> dict:
        wanted = message.get("revisions")
        if not isinstance(wanted, list) or not wanted or not all(
                isinstance(one, int) and not isinstance(one, bool) and one > 0 for one in wanted):
            raise Misused("'revisions' must be a list of revisions")
        return await history.revert(self.gateway.server, viewer.person, wanted, text(message, "path", ""),
                                    text(message, "layer", ""), message.get("dryRun") is not False)

    # -- live sessions

    @request("sessions")
    async def _sessions(self, viewer: Viewer, message: dict) -> dict:
        return {"items": await self.gateway.with_sessions(lines.listed, viewer.person)}

    @request("createSession")
    async def _create_session(self, viewer: Viewer, message: dict) -> dict:
        self._check_may_edit(viewer)
        revision = number(message, "revision", 0)
        if revision < 0:
            raise Misused("'revision' must be a revision of the main line, or 0: the newest")
        return await self.gateway.with_sessions(lines.created, viewer.person, text(message, "name"), revision)

    @request("endSession")
    async def _end_session(self, viewer: Viewer, message: dict) -> dict:
        return await self._change_session(viewer, message, "end")

    @request("restoreSession")
    async def _restore_session(self, viewer: Viewer, message: dict) -> dict:
        return await self._change_session(viewer, message, "restore")

    @request("deleteSession")
    async def _delete_session(self, viewer: Viewer, message: dict) -> dict:
        return await self._change_session(viewer, message, "delete")

    async def _change_session(self, viewer: Viewer, message: dict, verb: str) -> dict:
        self._check_may_edit(viewer)
        return await self.gateway.with_sessions(lines.changed, viewer.person, verb, text(message, "name"))

    @request("mergeSession")
    async def _merge_session(self, viewer: Viewer, message: dict) -> dict:
        return await self._merge_lines(viewer, message, False)

    @request("updateSession")
    async def _update_session(self, viewer: Viewer, message: dict) -> dict:
        return await self._merge_lines(viewer, message, True)

    async def _merge_lines(self, viewer: Viewer, message: dict, is_update: bool) -> dict:
        self._check_may_edit(viewer)
        takes = message.get("takes", {})
        if not isinstance(takes, dict):
            raise Misused("'takes' must have \"main\" or \"session\" for each conflict")
        wish = lines.Wish(text(message, "name"), is_update, message.get("dryRun") is not False, message.get("keep") is True,
                          {one: _side(side) for one, side in takes.items()},
                          None if message.get("others") is None else _side(message["others"]))
        return await self.gateway.with_sessions(lines.merged, viewer.person, wish)

    # -- what the server offers administrators

    @request("metrics")
    async def _metrics(self, viewer: Viewer, message: dict) -> dict:
        if self.gateway.server.asks_to_sign_in and not viewer.person.may_administer:
            raise usdlive.Error("forbidden", "the metrics are for administrators")
        return {"items": await self.gateway.in_worker(self.gateway.server.metrics, viewer.person)}

    @request("users")
    async def _users(self, viewer: Viewer, message: dict) -> dict:
        if not self.gateway.server.asks_to_sign_in:
            raise usdlive.Error("Unsupported", "the server asks nobody to sign in: it has no users")
        return {"items": await self.gateway.in_worker(self.gateway.server.users, viewer.person)}

    @request("projects")
    async def _projects(self, viewer: Viewer, message: dict) -> dict:
        return {"items": await self.gateway.in_worker(self.gateway.server.projects, viewer.person)}

    @request("people")
    async def _people(self, viewer: Viewer, message: dict) -> dict:
        return {"people": self.gateway.people.others(viewer.id)}

    @request("explain")
    async def _explain(self, viewer: Viewer, message: dict) -> dict:
        """Says what the viewer may do. About others only the server's machine tells (`usdlive access`)."""
        if message.get("user") not in (None, "", viewer.person.name):
            raise usdlive.Error("Unsupported", "the rights of others are told on the server's machine: usdlive access DIR USER LAYER")
        editor = self._editor(viewer, False)
        allowed, reason = await asyncio.wrap_future(editor.call(editor.explain, text(message, "layer"), text(message, "path", "/"),
                                                                text(message, "kind", "")))
        return {"allowed": allowed, "reason": reason}

    # -- editing

    @staticmethod
    def _check_may_edit(viewer: Viewer) -> None:
        if not viewer.person.may_edit:
            raise usdlive.Error("forbidden", f"a {viewer.person.role} may not edit")

    def _editor(self, viewer: Viewer, must_edit: bool = True) -> editing.Editor:
        """The viewer's own connection, which begins when it is first needed."""
        if must_edit:
            self._check_may_edit(viewer)
        if viewer.editor is None or not viewer.editor.is_alive():
            viewer.editor = self.gateway.editor(viewer)
        return viewer.editor

    async def _write(self, viewer: Viewer, verb: str, plan: typing.Callable, *arguments: typing.Any, commit: bool = True) -> dict:
        """Finds out on the stage what to write where, and writes it. The history shows it as the verb and the prim's path."""
        label = f"{verb} {arguments[0]}"[:200]
        editor = self._editor(viewer)
        layer, writes = await self.on_stage(viewer, plan, viewer.picture, *arguments)
        return await asyncio.wrap_future(editor.call(editor.write, layer, writes, label, commit))

    @staticmethod
    def _layer(message: dict) -> str | None:
        return None if message.get("layer") is None else text(message, "layer")

    @request("set")
    async def _set(self, viewer: Viewer, message: dict) -> dict:
        if "value" not in message:
            raise Misused("'value' is missing; null removes the opinion")
        return await self._write(viewer, "Set", editing.setting, text(message, "path"), text(message, "name"), message["value"],
                                 moment(message), self._layer(message))

    @request("transform")
    async def _transform(self, viewer: Viewer, message: dict) -> dict:
        return await self._write(viewer, "Move", editing.moving, text(message, "path"), numbers(message, "matrix", 12), self._layer(message),
                                 commit=message.get("commit") is not False)

    @request("visibility")
    async def _visibility(self, viewer: Viewer, message: dict) -> dict:
        value = "inherited" if _yes(message, "visible") else "invisible"
        return await self._write(viewer, "Show or hide", editing.setting, text(message, "path"), "visibility", value, None, self._layer(message))

    @request("variant")
    async def _variant(self, viewer: Viewer, message: dict) -> dict:
        choice = None if message.get("choice") is None else text(message, "choice")
        return await self._write(viewer, "Choose a variant of", editing.choosing, text(message, "path"), text(message, "set"), choice, self._layer(message))

    @request("activate")
    async def _activate(self, viewer: Viewer, message: dict) -> dict:
        return await self._write(viewer, "Activate or deactivate", editing.activating, text(message, "path"), _yes(message, "active"), self._layer(message))

    @request("lock")
    async def _lock(self, viewer: Viewer, message: dict) -> None:
        editor = self._editor(viewer, False)
        await asyncio.wrap_future(editor.call(editor.lock, text(message, "layer"), _yes(message, "locked")))

    @request("mute")
    async def _mute(self, viewer: Viewer, message: dict) -> None:
        editor = self._editor(viewer, False)
        await asyncio.wrap_future(editor.call(editor.mute, viewer.picture.layer, text(message, "layer"), _yes(message, "muted")))

    @request("undo")
    async def _undo(self, viewer: Viewer, message: dict) -> dict:
        editor = self._editor(viewer)
        return await asyncio.wrap_future(editor.call(editor.take_back, False))

    @request("redo")
    async def _redo(self, viewer: Viewer, message: dict) -> dict:
        editor = self._editor(viewer)
        return await asyncio.wrap_future(editor.call(editor.take_back, True))

    # -- looking

    @request("select")
    async def _select(self, viewer: Viewer, message: dict) -> None:
        viewer.selection = [one[:1024] for one in texts(message, "paths")]
        self._present(viewer)

    @request("camera")
    async def _camera(self, viewer: Viewer, message: dict) -> None:
        viewer.camera = None if message.get("matrix") is None else numbers(message, "matrix", 16)
        self._present(viewer)

    @request("time")
    async def _time(self, viewer: Viewer, message: dict) -> None:
        viewer.time = moment(message)
        await self.on_stage(viewer, viewer.picture.set_time, viewer.time)
        self._present(viewer)

    @staticmethod
    def _present(viewer: Viewer) -> None:
        """Shows it to editors, too, if the viewer has a connection of their own."""
        if viewer.editor is not None:
            viewer.editor.call(viewer.editor.present, viewer.selection, viewer.camera, viewer.time)

    @request("stage")
    async def _stage(self, viewer: Viewer, message: dict) -> None:
        layer = text(message, "layer")
        if layer not in await self.on_stage(viewer, viewer.picture.live.layers):
            raise usdlive.Error("layerNotFound", f"the project has no layer {layer}")
        await self.gateway.look_at(viewer, layer)

    @request("past")
    async def _past(self, viewer: Viewer, message: dict) -> None:
        revision = None if message.get("revision") is None else number(message, "revision")
        await self.gateway.look_at(viewer, None, revision)

    @request("play")
    async def _play(self, viewer: Viewer, message: dict) -> None:
        """Plays the past from where the picture is; 0 stops."""
        speed = message.get("speed", 1.0)
        if isinstance(speed, bool) or not isinstance(speed, (int, float)) or not math.isfinite(speed):
            raise Misused("'speed' must be a number")
        await self.on_stage(viewer, viewer.picture.play, float(speed))
