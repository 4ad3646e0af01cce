"""Tests sessions whose client shows its token in the first message, as browsers have to (AC13)."""

from __future__ import annotations

import contextlib
import json
import time

import pytest
import websockets.sync.client
import wire
from browser_test import Site, site, visit  # noqa: F401 (fixture)
from studio import Studio, invited, project, studio, usdlive_, user  # noqa: F401 (fixtures)

SUBPROTOCOL = "usdlive.showToken"
PAGE = """<!doctype html><title>a page</title><pre id="found"></pre><script>
const bytes = text => Uint8Array.from(text.match(/../g), pair => parseInt(pair, 16));
const found = {};
const socket = new WebSocket("ws://127.0.0.1:PORT/live", "usdlive.showToken");
socket.binaryType = "arraybuffer";
socket.onopen = () => { socket.send(bytes("TOKEN")); socket.send(bytes("HELLO")); };
const show = () => {
  document.getElementById("found").textContent = JSON.stringify(found);
  document.title = "done";
};
socket.onmessage = message => {
  found.text = (found.text || "") + new TextDecoder().decode(new Uint8Array(message.data));
  found.subprotocol = socket.protocol;
  show();
};
socket.onclose = () => { found.closed = true; show(); };
</script>"""


class Session:
    """A session that sends these messages first."""

    def __init__(self, url, *messages, subprotocols=(SUBPROTOCOL,)):
        self.socket = websockets.sync.client.connect(f"{url}/live", subprotocols=list(subprotocols) or None,
                                                     compression=None, close_timeout=0.5)
        with contextlib.suppress(websockets.exceptions.ConnectionClosed):  # refused after the first one
            for message in messages:
                self.socket.send(bytes(message))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def control(self):
        """Returns the next control message."""
        while True:
            for frame in wire.split(self.socket.recv(timeout=10)):
                kind, members = wire.decode(bytes(frame))
                if kind == "Control":
                    return json.loads(members["json"])

    def refusal(self):
        error = self.control()
        assert error["type"] == "errorMessage" and error["closing"], error
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            self.socket.recv(timeout=10)
        return error["code"], error["message"]


def token_message(token):
    return wire.control("showToken", token=token)


def hello(user):
    return wire.hello(wire.new_client(), user)


def test_a_token_in_the_first_message(studio):
    studio.join("ann", "viewer").close()
    with Session(studio.server.url, token_message(studio.token("ann")), hello("ann")) as session:
        assert session.socket.subprotocol == SUBPROTOCOL
        welcome = session.control()
        assert (welcome["type"], welcome["role"]) == ("welcome", "viewer")
    # The name is the one of the token.
    with Session(studio.server.url, token_message(studio.token("ann")), hello("chief")) as session:
        assert session.refusal() == ("signInRequired", "you are signed in as ann, not as chief. Connect without naming a user")
    assert studio.token("ann") not in studio.server.log.read_text()


def test_whoever_shows_nothing_or_something_else_stays_outside(studio):
    wrong = "0" * 64
    for first in (token_message(wrong), token_message(""), token_message("x" * 100_000), hello("ann"),
                  wire.control("hello"), b"\x00" * 64, b"",
                  token_message(wrong) + hello("ann")):  # two frames in the first message
        with Session(studio.server.url, first, hello("ann")) as session:
            code, message = session.refusal()
            assert code == "signInRequired", (first[:40], message)
            assert wrong not in message
    assert wrong not in studio.server.log.read_text()
    # Without the subprotocol nothing has changed.
    with pytest.raises(websockets.exceptions.InvalidStatus, match="401"):
        Session(studio.server.url, subprotocols=())
    with pytest.raises(websockets.exceptions.InvalidStatus, match="401"):
        Session(studio.server.url, subprotocols=("usdlive.show", "token"))


def test_guesses_wait_like_those_in_a_header(studio):
    """AC5"""
    times = []
    for _ in range(4):
        with Session(studio.server.url, token_message("0" * 64)) as session:
            begin = time.monotonic()
            session.refusal()
            times.append(time.monotonic() - begin)
    assert times[-1] > 0.5, times


def test_a_signed_in_session_shows_no_token_again(studio):
    studio.join("ann", "editor").close()
    token = studio.token("ann")
    with Session(studio.server.url, token_message(token), hello("ann")) as session:
        assert session.control()["type"] == "welcome"
        session.socket.send(bytes(token_message(token)))
        code, message = "", ""
        while code == "":
            received = session.control()
            if received["type"] == "errorMessage":
                code, message = received["code"], received["message"]
        assert code == "malformedControl" and "first message" in message


def test_a_removed_user_is_out(studio, project):  # noqa: F811
    """AC4"""
    studio.join("ann", "editor").close()
    with Session(studio.server.url, token_message(studio.token("ann")), hello("ann")) as session:
        assert session.control()["type"] == "welcome"
        user("remove", "ann", project)
        code = ""
        while code == "":
            code = session.control().get("code", "")
        assert code == "signInRequired"


def test_a_stranger_is_not_told_which_projects_there_are(tmp_path, serve, monkeypatch):
    for name in ("film", "secret"):
        (tmp_path / "all" / name).mkdir(parents=True)
        (tmp_path / "all" / name / "root.usda").write_text("#usda 1.0\n")
    folder = tmp_path / "all"
    user("add", "ann", "--role", "none", "--at", "127.0.0.1:1", folder)
    user("role", "ann", "editor", "--project", "film", folder)
    server = serve(f"--projects={folder}")
    invitation = invited("invite", "ann", folder).replace("127.0.0.1:1/", f"127.0.0.1:{server.port}/")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "ann"))
    assert usdlive_("join", invitation).returncode == 0
    servers = json.loads((tmp_path / "ann" / "usdlive" / "servers.json").read_text())["servers"]
    token = next(iter(servers.values()))["token"]
    base = f"ws://127.0.0.1:{server.port}"
    answers = set()
    for name in ("film", "secret", "other", "a%20b", ""):
        with Session(f"{base}/{name}".rstrip("/"), token_message("0" * 64)) as session:
            answers.add(session.refusal())
    assert len(answers) == 1, answers
    for name in ("secret", "other"):
        with Session(f"{base}/{name}", token_message(token), hello("ann")) as session:
            code, message = session.refusal()
            assert code == "invalidArgument" and f'no project "{name}" here' in message and "film" in message
    with Session(f"{base}/film", token_message(token), hello("ann")) as session:
        assert session.control()["type"] == "welcome"


def test_a_page_in_a_browser_signs_in(site, project, serve, tmp_path, monkeypatch):  # noqa: F811
    allowing = Studio(project, lambda folder: serve(folder, "--allow-origin", site.origin), tmp_path, monkeypatch)
    allowing.join("ann", "editor").close()
    site.page = (PAGE.replace("PORT", str(allowing.server.port))
                 .replace("TOKEN", bytes(token_message(allowing.token("ann"))).hex())
                 .replace("HELLO", bytes(hello("ann")).hex()))
    found = visit(site.origin)
    assert '"type":"welcome"' in found["text"] and found["subprotocol"] == SUBPROTOCOL, found
