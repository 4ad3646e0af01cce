"""Finds out who a viewer is, from the server, and whom the gateway answers."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import http.client
import ipaddress
import json
import os
import pathlib
import re
import socket
import ssl
import typing
import urllib.parse

import usdlive

_SECONDS = 5.0
_UNKNOWN_TOKEN = "0" * 64


@dataclasses.dataclass
class Person:
    """A viewer. `token` is empty on a server that asks nobody to sign in; `name` is then what the viewer says."""

    name: str
    role: str
    token: str = ""
    may_edit: bool = True

    @property
    def may_administer(self) -> bool:
        return self.role == "admin"


class Refused(Exception):
    """A viewer has to sign in, with the reason."""


def token_of(text: str) -> str:
    """The token in what a viewer has given: `usdlive-token://NAME@HOST:PORT/TOKEN`, or the token."""
    text = text.strip()
    match = re.fullmatch(r"usdlive-token://[^/]+/([^?]+)(\?.*)?", text)
    found = match.group(1) if match else text
    if not re.fullmatch(r"[A-Za-z0-9._~+/=-]{1,16384}", found):
        raise Refused("this is no token")
    return found


class Server:
    """The server of a project, asked over HTTP with the tokens of viewers. Calls wait: use them on workers."""

    def __init__(self, url: str):
        parts = urllib.parse.urlsplit(url if "://" in url else f"ws://{url}")
        self.url = url
        self.secure = parts.scheme in ("wss", "https")
        self.host, self.port = parts.hostname or "127.0.0.1", parts.port or 7447
        self.asks_to_sign_in = False
        self.project = urllib.parse.unquote(parts.path.strip("/"))
        # The live session that the address names; empty: the main line.
        self.session = urllib.parse.unquote(parts.query.partition("session=")[2])

    def find_out(self) -> None:
        """Finds out whether the server asks viewers to sign in, which it does if it refuses a token that nobody has; and the name
        of the project. A server that does not answer is reported by the connection of the picture."""
        try:
            status, body = self.get("/projects", _UNKNOWN_TOKEN)
            self.asks_to_sign_in = status == 401
            if status == 200:
                self._learn_project(body)
        except (OSError, http.client.HTTPException, ValueError, KeyError) as failed:
            raise usdlive.Error("notConnected", f"cannot reach {self.url}: {failed}. Is `usdlive serve` running there?") from None

    def _learn_project(self, body: bytes) -> None:
        projects = json.loads(body)["projects"]
        if not self.project and len(projects) == 1:
            self.project = projects[0]["name"]

    def get(self, path: str, token: str) -> tuple[int, bytes]:
        connection = self._connection()
        try:
            connection.request("GET", path, headers={"Authorization": f"Bearer {token}"} if token else {})
            answer = connection.getresponse()
            return answer.status, answer.read(16 << 20)
        finally:
            connection.close()

    def person(self, token: str, name: str) -> Person:
        """Returns the user of the token, with the role. Raises Refused."""
        if not self.asks_to_sign_in:
            return Person(name or "viewer", "editor")
        if not token:
            raise Refused("sign in with a token of this server")
        token = token_of(token)
        try:
            status, body = self.get("/sign-in", token)
            if status == 401:
                raise Refused("the server does not know this token")
            if status == 200:
                name = json.loads(body)["user"]
            if not self.project:
                status, body = self.get("/projects", token)
                if status == 200:
                    self._learn_project(body)
            live = usdlive.connect(self.url, user=name, application="page", token=token, timeout=_SECONDS)
        except usdlive.Error as refused:
            raise Refused(refused.message) from None
        except (OSError, http.client.HTTPException, ValueError, KeyError) as failed:
            raise Refused(f"the server cannot be asked who you are: {failed}") from None
        try:
            may_edit = live.role in ("editor", "admin") or any(live.may_edit(layer) for layer in live.layers()[:100])
            return Person(live.user, live.role, token, may_edit)
        finally:
            live.close(timeout=0)

    def metrics(self, person: Person) -> list[dict]:
        """The metrics of the server."""
        items = []
        for line in self._text("/metrics", person).splitlines():
            name, _, value = line.rpartition(" ")
            if name and not line.startswith("#"):
                with contextlib.suppress(ValueError):
                    items.append({"name": name, "value": float(value)})
        return items

    def projects(self, person: Person) -> list[dict]:
        return json.loads(self._text("/projects", person))["projects"]

    def users(self, person: Person) -> list[dict]:
        """The users of the project with their roles (AC27)."""
        place = f"/{urllib.parse.quote(self.project, safe='')}" if self.project else ""
        return json.loads(self._text(f"{place}/users", person))["users"]

    def _text(self, path: str, person: Person) -> str:
        try:
            status, body = self.get(path, person.token)
        except (OSError, http.client.HTTPException) as failed:
            raise usdlive.Error("notConnected", f"the server does not answer: {failed}") from None
        if status != 200:
            raise usdlive.Error("forbidden" if status in (401, 403) else "internal", body.decode(errors="replace").strip()[:500])
        return body.decode(errors="replace")

    def still_in(self, person: Person) -> bool:
        """Whether the server still knows the token. True while it does not answer."""
        if not person.token:
            return True
        try:
            status, _ = self.get("/projects", person.token)
        except (OSError, http.client.HTTPException):
            return True
        return status not in (401, 403)

    def _connection(self) -> http.client.HTTPConnection:
        if not self.secure:
            return http.client.HTTPConnection(self.host, self.port, timeout=_SECONDS)
        pin = self._pin()
        context = ssl.create_default_context(cafile=os.environ.get("USDLIVE_CA") or None)
        if pin:
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection(self.host, self.port, timeout=_SECONDS, context=context)
        connection.connect()
        if pin and hashlib.sha256(connection.sock.getpeercert(binary_form=True)).hexdigest() != pin:
            connection.close()
            raise OSError(f"{self.host}:{self.port} shows another certificate than before")
        return connection

    def _pin(self) -> str:
        """The fingerprint of the certificate that this user's programs know; empty without one, and if an authority has signed
        it."""
        folder = pathlib.Path(os.environ.get("XDG_CONFIG_HOME") or pathlib.Path.home() / ".config")
        try:
            servers = json.loads((folder / "usdlive" / "servers.json").read_text())["servers"]
            pin = str(servers.get(f"{self.host}:{self.port}", {}).get("pin", ""))
            return pin.removeprefix("sha256:").lower() if pin.startswith("sha256:") else ""
        except (OSError, ValueError, KeyError, AttributeError):
            return ""


class Places:
    """The names under which the gateway answers, as the server does (HO1, HO2)."""

    def __init__(self, host: str, allowed: typing.Iterable[str]):
        machine = socket.gethostname()
        self._names = {name.lower().rstrip(".") for name in (host, machine, socket.getfqdn(), *allowed) if name}

    def is_own(self, host: str | None) -> bool:
        """`host`: the header Host; None without it."""
        if not host:
            return True
        name = urllib.parse.urlsplit(f"//{host}").hostname or ""
        try:
            ipaddress.ip_address(name)
            return True
        except ValueError:
            return name == "localhost" or name.endswith(".localhost") or name.rstrip(".") in self._names

    def is_foreign(self, headers: typing.Mapping[str, str]) -> bool:
        """Whether a page of another site makes the request."""
        origin = headers.get("origin")
        if origin is not None:
            return urllib.parse.urlsplit(origin).netloc != headers.get("host") or not origin.startswith(("http://", "https://"))
        return headers.get("sec-fetch-site") in ("cross-site", "same-site") and headers.get("sec-fetch-mode") != "navigate"
