"""The ASGI application: files of the page, blobs, and the WebSocket of each viewer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import pathlib
import typing

import usdlive
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from . import wire
from .access import Places, Refused
from .gateway import Gateway, TooMany
from .requests import Requests
from .viewer import SIGN_IN, Viewer

STATIC = pathlib.Path(__file__).parent / "static"
POLICY = ("default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
          "worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'")
_HEADERS = [(b"content-security-policy", POLICY.encode()), (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"), (b"cross-origin-resource-policy", b"same-origin")]
_NOT_BUILT = """The page is not built. In the sources of usdlive: ./run page
The gateway works without it: a program can connect to the WebSocket /live (docs/page.md).
"""
_HELLO_SECONDS = 10.0
_BAD_MESSAGE, _NO_HELLO, _TOO_MANY, _NOT_HERE = 4400, 4408, 4429, 4503
MOST_MESSAGE_BYTES = 1 << 20
_TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".mjs": "text/javascript", ".css": "text/css",
          ".svg": "image/svg+xml", ".png": "image/png", ".ico": "image/x-icon", ".json": "application/json",
          ".woff2": "font/woff2", ".wasm": "application/wasm", ".map": "application/json"}

Send = typing.Callable[[dict], typing.Awaitable[None]]
Receive = typing.Callable[[], typing.Awaitable[dict]]


class Guard:
    """Answers only requests for the gateway itself that no page of another site makes, and adds the headers that protect the
    page (HO1, HO2)."""

    def __init__(self, app: typing.Callable, places: Places):
        self._app, self._places = app, places

    async def __call__(self, scope: dict, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        headers = Headers(scope=scope)
        refused = None
        if not self._places.is_own(headers.get("host")):
            refused = 421, "this gateway has another name; --allow-host allows it"
        elif self._places.is_foreign(headers):
            refused = 403, "a page of another site has asked"
        if refused is not None:
            return await self._refuse(scope, receive, send, *refused)

        async def guarded(message: dict) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
            await send(message)

        await self._app(scope, receive, guarded)

    @staticmethod
    async def _refuse(scope: dict, receive: Receive, send: Send, status: int, why: str) -> None:
        if scope["type"] == "http":
            return await PlainTextResponse(why + "\n", status)(scope, receive, send)
        await send({"type": "websocket.http.response.start", "status": status, "headers": [(b"content-type", b"text/plain")]})
        await send({"type": "websocket.http.response.body", "body": why.encode()})


class Live:
    """The WebSocket of one viewer."""

    def __init__(self, gateway: Gateway):
        self._gateway = gateway
        self._requests = Requests(gateway)

    async def __call__(self, scope: dict, receive: Receive, send: Send) -> None:
        await receive()  # websocket.connect
        await send({"type": "websocket.accept"})
        try:
            hello = await asyncio.wait_for(_message(receive), _HELLO_SECONDS)
        except asyncio.TimeoutError:
            return await _close(send, _NO_HELLO, "the page has not said hello")
        if hello is None:
            return
        if hello.get("type") != "hello":
            return await _close(send, _BAD_MESSAGE, "the first message must be hello")
        try:
            person = await self._gateway.person(_text(hello, "token"), _text(hello, "name")[:200])
            viewer = await self._gateway.enter(person)
        except Refused as refused:
            await send({"type": "websocket.send", "text": wire.text({"type": "signIn", "message": str(refused)})})
            return await _close(send, SIGN_IN, "sign in")
        except TooMany as bound:
            return await _close(send, _TOO_MANY, str(bound))
        except usdlive.Error as failed:  # the stage is closing
            return await _close(send, _NOT_HERE, failed.message)
        await self._serve(viewer, receive, send)

    async def _serve(self, viewer: Viewer, receive: Receive, send: Send) -> None:
        sending = asyncio.ensure_future(viewer.send_all(send))
        receiving = asyncio.ensure_future(self._receive(viewer, receive))
        try:
            await asyncio.wait([sending, receiving], return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._gateway.leave(viewer)
            for task in (sending, receiving):
                task.cancel()
            for task in (sending, receiving):
                with contextlib.suppress(asyncio.CancelledError, Exception):
                    await task
            await _close(send, *viewer.closing)

    async def _receive(self, viewer: Viewer, receive: Receive) -> None:
        while (message := await _message(receive)) is not None:
            self._requests.take(viewer, message)


async def _message(receive: Receive) -> dict | None:
    """The next message; None when the page has gone. One that is no object of JSON is empty."""
    message = await receive()
    if message["type"] != "websocket.receive":
        return None
    try:
        found = json.loads(message.get("text") or "")
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


async def _close(send: Send, code: int, why: str) -> None:
    with contextlib.suppress(Exception):
        await send({"type": "websocket.close", "code": code, "reason": why.encode()[:120].decode(errors="ignore")})


def _text(message: dict, name: str) -> str:
    value = message.get(name)
    return value if isinstance(value, str) else ""


def create(gateway: Gateway, places: Places, static: pathlib.Path = STATIC) -> typing.Callable:
    """Returns the application for a gateway that has started."""

    async def blob(request: Request) -> Response:
        found = gateway.blobs.get(request.path_params["name"])
        if found is None:
            return PlainTextResponse("there is no such blob\n", 404)
        return Response(found.content, media_type=found.type, headers={"Cache-Control": "public, max-age=31536000, immutable"})

    async def health(_: Request) -> Response:
        return JSONResponse(gateway.main.health, headers={"Cache-Control": "no-store"})

    async def file(request: Request) -> Response:
        name = request.path_params.get("path", "")
        path = (static / (name or "index.html")).resolve()
        if not (static / "index.html").is_file():
            return PlainTextResponse(_NOT_BUILT, 200 if not name else 404)
        if not path.is_relative_to(static.resolve()) or not path.is_file() or path.suffix not in _TYPES:
            return PlainTextResponse("there is nothing here\n", 404)
        immutable = name.startswith("assets/")
        return FileResponse(path, media_type=_TYPES[path.suffix],
                            headers={"Cache-Control": "public, max-age=31536000, immutable" if immutable else "no-store"})

    live = Live(gateway)
    app = Starlette(routes=[Route("/blob/{name}", blob), Route("/health", health), Route("/", file), Route("/{path:path}", file)])

    async def routed(scope: dict, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            if scope["path"] == "/live":
                return await live(scope, receive, send)
            return await Guard._refuse(scope, receive, send, 404, "there is nothing here")
        await app(scope, receive, send)

    return Guard(routed, places)
