"""What a page asks for. Each message with a number is answered once."""

from __future__ import annotations

import asyncio
import logging
import math
import typing

import usdlive
from pxr import Tf

from . import tree
from .gateway import Gateway, TooMany
from .viewer import Viewer

_log = logging.getLogger("usdlive.page")

MOST_REQUESTS = 64  # of a page that wait for an answer
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
    if not isinstance(value, str):
        raise Misused(f"'{name}' must be a text")
    return value


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

    def _present(self, viewer: Viewer) -> None:
        """Shows it to editors, too, if the viewer has a connection of their own."""

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
