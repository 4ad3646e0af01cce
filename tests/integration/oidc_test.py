"""Tests signing in with an OpenID Connect issuer, with real processes (AC20-AC26)."""

from __future__ import annotations

import http.client
import json
import os
import pathlib
import subprocess
import threading
import time

import pytest
import usdlive
from conftest import Server, unused_port, wait
from issuer import Issuer
from pxr import Sdf
from tls_test import ROOT, Authority, project  # noqa: F401 (fixture)

@pytest.fixture
def issuer():
    issuer = Issuer(unused_port()).start()
    yield issuer
    issuer.stop()


class Studio:
    """A server with an issuer. Each user has a configuration folder of their own."""

    def __init__(self, issuer, folder, tmp_path, monkeypatch, *options: str):
        self.issuer, self.tmp_path, self.monkeypatch = issuer, tmp_path, monkeypatch
        self.outputs: list[str] = []
        self.server = Server(folder, tmp_path / "server.log", "--oidc-issuer", issuer.url, "--oidc-audience", "usdlive",
                             *options)
        self.server.start()
        self.be("nobody")

    def be(self, name: str) -> pathlib.Path:
        home = self.tmp_path / "homes" / name
        self.monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
        return home / "usdlive" / "servers.json"

    def login(self, approve=True, scheme="") -> subprocess.CompletedProcess:
        """Runs `usdlive login`; the test answers in place of a browser."""
        process = subprocess.Popen([os.environ["USDLIVE_BIN"], "login", f"{scheme}127.0.0.1:{self.server.port}"],
                                   text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if approve:
            threading.Timer(0.3, self.issuer.approve).start()
        output, errors = process.communicate(timeout=40)
        self.outputs += [output, errors]
        return subprocess.CompletedProcess(process.args, process.returncode, output, errors)

    def sign_in(self, name: str, **claims) -> pathlib.Path:
        self.issuer.claims |= {"email": f"{name}@studio.example", "sub": name, **claims}
        file = self.be(name)
        ran = self.login()
        assert ran.returncode == 0, ran.stderr
        return file

    def entry(self, file: pathlib.Path) -> dict:
        return json.loads(file.read_text())["servers"][f"127.0.0.1:{self.server.port}"]

    def get(self, path: str, token: str = "", headers: dict | None = None) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=15)
        connection.request("GET", path, headers=headers or ({"Authorization": f"Bearer {token}"} if token else {}))
        answer = connection.getresponse()
        return answer.status, answer.read().decode()

    def logs(self, text: str) -> bool:
        return text in self.server.log.read_text()


@pytest.fixture
def studio(issuer, project, tmp_path, monkeypatch):
    started: list[Studio] = []

    def start(*options: str) -> Studio:
        started.append(Studio(issuer, project, tmp_path, monkeypatch, *options))
        return started[-1]

    yield start
    for one in started:
        assert one.server.stop() == 0, one.server.log.read_text()


def command(*words: object) -> str:
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *map(str, words)], capture_output=True, text=True, timeout=30)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def radius_of(layer: Sdf.Layer):
    return layer.GetAttributeAtPath("/Ball.radius")


def test_a_person_signs_in_and_edits_under_the_issuers_name(studio, issuer):
    """AC22, AC25, AC26"""
    here = studio("--oidc-role", "editor")
    wait(lambda: here.logs("the issuer's keys were read"))
    assert here.get("/sign-in") == (200, json.dumps(
        {"clientId": "usdlive", "issuer": issuer.url, "scopes": "openid email profile offline_access"},
        separators=(",", ":")) + "\n")
    issuer.answers = [{"error": "authorization_pending"}]
    file = here.sign_in("ann")
    assert "WDJB-MJHT" in here.outputs[0] and f"{issuer.url}/enter" in here.outputs[0]
    assert f"You are ann@studio.example at ws://127.0.0.1:{here.server.port}" in here.outputs[0]
    assert file.stat().st_mode & 0o777 == 0o600
    # The issuer does not know offline_access.
    assert [code["scope"] for code in issuer.codes.values()] == ["openid email profile"]
    with usdlive.connect(here.server.url) as ann:
        assert (ann.user, ann.role) == ("ann@studio.example", "editor")
        layer = ann.open_layer("root.usda")
        here.sign_in("bob")
        with usdlive.connect(here.server.url) as bob:
            seen = bob.open_layer("root.usda")
            radius_of(layer).default = 2.0
            assert ann.flush()
            wait(lambda: radius_of(seen).default == 2.0, bob, ann)
        here.be("ann")
        log = subprocess.run([os.environ["USDLIVE_BIN"], "log", here.server.url], capture_output=True, text=True)
        assert "ann@studio.example" in log.stdout, log.stderr
        with pytest.raises(usdlive.Error, match="signed in as ann@studio.example, not as bob"):
            usdlive.connect(here.server.url, user="bob")


def test_what_the_issuer_refuses_is_said(studio, issuer):
    """AC26"""
    here = studio("--oidc-role", "viewer")
    here.be("ann")
    issuer.answers = [{"error": "access_denied"}]
    ran = here.login(approve=False)
    assert ran.returncode == 1 and "the sign-in was refused there" in ran.stderr
    issuer.answers = [{"error": "expired_token"}]
    ran = here.login(approve=False)
    assert ran.returncode == 1 and "nobody has answered in time" in ran.stderr
    issuer.answers = [{"error": "strange\x1b[31m", "error_description": "no\nthing"}]
    ran = here.login(approve=False)
    assert ran.returncode == 1 and "strange?[31m (no?thing)" in ran.stderr
    # The server does not accept the user. Nothing is kept.
    issuer.claims["email_verified"] = False
    ran = here.login()
    assert ran.returncode == 1 and "does not accept the sign-in" in ran.stderr
    assert "another claim can name the user (--oidc-user-claim)" in here.server.log.read_text()
    assert not (here.be("ann")).exists()
    issuer.stop()
    ran = here.login(approve=False)
    assert ran.returncode == 1 and issuer.url in ran.stderr and "refused" in ran.stderr


def test_slow_down_is_respected(studio, issuer):
    """RFC 8628: each slow_down adds 5 s to the pause of 1 s."""
    here = studio("--oidc-role", "viewer")
    issuer.answers = [{"error": "slow_down"}]
    begin = time.monotonic()
    here.sign_in("ann")
    assert time.monotonic() - begin > 6.9


def test_roles_come_from_accounts_and_groups_from_the_issuer(studio, issuer, project):
    """AC6, AC22"""
    command("user", "add", "ann@studio.example", "--role", "viewer", "--at", "127.0.0.1:1", project)
    here = studio()
    # A user without an account is refused, because --oidc-role is none.
    issuer.claims |= {"email": "eve@studio.example"}
    here.be("eve")
    ran = here.login()
    assert ran.returncode == 1 and "usdlive user add eve@studio.example DIR" in ran.stderr
    granted = command("grant", project, "--group", "lighting", "--path", "/Ball/**")
    assert "rule 1 allows everything in /Ball/** to the group lighting" in granted
    asked = ("access", project, "eve", "root.usda", "/Ball", "shading", "--role", "viewer")
    assert "no   shading" in command(*asked)
    assert "yes  shading" in command(*asked, "--group", "film", "--group", "lighting")
    here.sign_in("ann", groups=["film", "lighting"])
    with usdlive.connect(here.server.url) as ann:
        assert ann.role == "viewer"
        layer = ann.open_layer("root.usda")
        assert layer.permissionToEdit  # by the rule for the group (AC8)
        before = ann.revision
        radius_of(layer).default = 3.0
        ann.flush()
        assert ann.revision > before
    here.sign_in("ann", groups=["film"])
    with usdlive.connect(here.server.url) as ann:
        layer = ann.open_layer("root.usda")
        assert not layer.permissionToEdit
        layer.SetPermissionToEdit(True)
        before = ann.revision
        radius_of(layer).default = 4.0
        ann.flush()
        assert ann.revision == before
    # The administrator takes the right away; the session ends within a second (AC4).
    with usdlive.connect(here.server.url) as ann:
        assert "has taken the change" in command("user", "role", "ann@studio.example", "none", project)
        wait(lambda: not ann.connected, ann, timeout=1)


def test_a_session_ends_with_its_token(studio, issuer):
    """AC23: without a new token the session is over, within a second, and the error says what to do."""
    issuer.lifetime = 4
    here = studio("--oidc-role", "editor")
    file = here.sign_in("ann")
    issuer.refresh_tokens.clear()
    end = json.loads(file.read_text())["servers"][f"127.0.0.1:{here.server.port}"]["renewal"]["endsAt"]
    with usdlive.connect(here.server.url) as ann:
        layer = ann.open_layer("root.usda")
        errors: list[usdlive.events.ServerError] = []
        ann.add_handler(lambda event: errors.append(event) if isinstance(event, usdlive.events.ServerError) else None)
        while time.time() < end + 5 and ann.connected:
            ann.tick()
            time.sleep(0.01)
        assert not ann.connected and end - 0.1 <= time.time() < end + 1.3
        assert [(error.code, "usdlive login HOST:PORT" in error.message) for error in errors] == [("signInRequired", True)]
        assert here.logs("sign-in ended")
        # The work is kept, and sent after the next sign-in.
        radius_of(layer).default = 7.0
        with pytest.raises(usdlive.Error, match=f"Run `usdlive login 127.0.0.1:{here.server.port}`"):
            usdlive.connect(here.server.url)
        issuer.lifetime = 300
        here.sign_in("ann")
        wait(lambda: ann.connected, ann)
        assert ann.flush()
        assert radius_of(layer).default == 7.0


def test_a_token_is_renewed_without_the_user(studio, issuer):
    """AC23, AC26: tokens of 3 s; the editor goes on for 10 s."""
    issuer.lifetime = 3
    here = studio("--oidc-role", "editor")
    file = here.sign_in("ann")
    first = here.entry(file)["token"]
    with usdlive.connect(here.server.url) as ann:
        layer = ann.open_layer("root.usda")
        begin = time.monotonic()
        while time.monotonic() < begin + 10:
            radius_of(layer).default = time.monotonic()
            ann.tick()
            time.sleep(0.05)
        wait(lambda: ann.connected, ann)
        assert ann.flush()
    assert here.entry(file)["token"] != first
    assert here.server.log.read_text().count("sign-in ended") >= 2
    # Ten programs that start at once use one refresh token once.
    issuer.requests.clear()
    listed = [subprocess.Popen([os.environ["USDLIVE_BIN"], "ls", here.server.url], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True) for _ in range(10)]
    for one in listed:
        output, errors = one.communicate(timeout=30)
        assert one.returncode == 0, errors


def test_rotated_keys_are_followed(studio, issuer):
    """AC24: also a key that the server has not seen yet lets its first user in."""
    here = studio("--oidc-role", "viewer")
    wait(lambda: here.logs("the issuer's keys were read"))
    for kind in ("EC", "OKP"):
        assert here.get("/sign-in", issuer.token())[0] == 200
        issuer.rotate(kind)
        token = issuer.token()
        if kind == "EC":
            assert here.get("/sign-in", token) == (200, '{"user":"ann@studio.example"}\n')
    # A second question within 30 s is not asked, whoever sends unknown keys.
    asked = issuer.requests.count("/realms/film/keys")
    assert here.get("/sign-in", token)[0] == 401
    assert issuer.requests.count("/realms/film/keys") == asked == 2


def test_an_issuer_that_is_down_at_the_start(studio, issuer):
    """AC24"""
    issuer.stop()
    here = studio("--oidc-role", "viewer")
    wait(lambda: here.logs("the issuer does not give its keys; nobody can sign in"))
    status, text = here.get("/sign-in", issuer.token())
    assert status == 503 and "issuer does not answer" in text
    issuer.start()
    wait(lambda: here.logs("the issuer's keys were read"), timeout=20)
    assert here.get("/sign-in", issuer.token())[0] == 200
    # It is down again: the last keys count.
    issuer.stop()
    assert here.get("/projects", issuer.token())[0] == 200


def test_keys_in_a_file(studio, issuer, tmp_path):
    """AC24: without a network."""
    issuer.stop()
    file = tmp_path / "keys.json"
    file.write_text(json.dumps(issuer.published()))
    here = studio("--oidc-role", "viewer", "--oidc-jwks", str(file))
    assert here.get("/sign-in", issuer.token())[0] == 200
    issuer.rotate("EC")
    assert here.get("/sign-in", issuer.token())[0] == 401
    file.write_text("{}")
    wait(lambda: here.logs("the issuer's keys stay as they were"))
    file.write_text(json.dumps(issuer.published()))
    wait(lambda: here.get("/sign-in", issuer.token())[0] == 200)
    assert issuer.requests == []


def test_wrong_tokens_over_the_wire(studio, issuer):
    """AC21: the answer is the same whatever is wrong. The log says it, with nothing of the token."""
    here = studio("--oidc-role", "viewer")
    wait(lambda: here.logs("the issuer's keys were read"))
    good = issuer.token()
    assert here.get("/projects", good)[0] == 200
    header, claims, signature = good.split(".")
    answers = set()
    for token, why in ((issuer.token(aud="secret-other"), "it is for another audience"),
                       (issuer.token(iss=issuer.url + "/"), "it is from another issuer"),
                       (issuer.token(exp=int(time.time()) - 1), "it has expired"),
                       (f"{header}.{claims[::-1]}.{signature}", "its signature is wrong"),
                       ("eyJhbGciOiJub25lIn0." + claims + ".AA", "its algorithm is none of")):
        answers.add(here.get("/projects", token))
        assert here.logs(why), why
        assert "secret-other" not in here.server.log.read_text()
    assert len(answers) == 1
    status, text = answers.pop()
    assert status == 401 and "usdlive login" in text and "secret-other" not in text
    # A token may have 16 KiB.
    wait(lambda: here.get("/projects", issuer.token(x="x" * 11_000))[0] == 200)
    assert here.get("/projects", issuer.token(x="x" * 16_000))[0] in (401, 431)


def test_everything_encrypted(tmp_path, project, monkeypatch):
    """EN4, EN5, AC24, AC26: an issuer with a studio's own authority, and a server with its own certificate."""
    authority = Authority(tmp_path / "authority")
    issuer = Issuer(unused_port(), certificate=authority.sign("IP:127.0.0.1")).start()
    here = Studio(issuer, project, tmp_path, monkeypatch, "--oidc-role", "viewer", "--tls", "auto")
    wait(lambda: here.logs("the issuer does not give its keys"))  # nobody has certified it
    assert here.server.stop() == 0
    monkeypatch.setenv("USDLIVE_CA", str(authority.file))
    here.server.start()
    file = here.be("ann")
    assert "this server speaks TLS: use wss://" in here.login(approve=False).stderr
    assert not file.exists()
    ran = here.login(scheme="wss://")
    assert ran.returncode == 0, ran.stderr
    entry = here.entry(file)
    assert entry["tls"] and entry["pin"].startswith("sha256:")
    monkeypatch.delenv("USDLIVE_CA")  # the server is known by its certificate
    assert "root.usda" in command("ls", f"127.0.0.1:{here.server.port}")
    plain = subprocess.run([os.environ["USDLIVE_BIN"], "ls", f"ws://127.0.0.1:{here.server.port}"],
                           capture_output=True, text=True)
    assert plain.returncode == 1 and "speaks TLS" in plain.stderr
    # Without the authority, nobody renews the token at an issuer that could be anybody.
    servers = json.loads(file.read_text())
    servers["servers"][f"127.0.0.1:{here.server.port}"]["renewal"]["endsAt"] = int(time.time()) - 1
    file.write_text(json.dumps(servers))
    asked = len(issuer.requests)
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "ls", f"127.0.0.1:{here.server.port}"], capture_output=True,
                         text=True)
    assert ran.returncode == 1 and "could not be renewed" in ran.stderr and len(issuer.requests) == asked
    monkeypatch.setenv("USDLIVE_CA", str(authority.file))
    assert "root.usda" in command("ls", f"127.0.0.1:{here.server.port}")
    assert issuer.requests[asked:] == ["/realms/film/token"]
    assert here.server.stop() == 0
    issuer.stop()


def test_the_token_is_nowhere_else(studio, issuer, tmp_path):
    """Tokens travel in one header; they are in no log, metric, error, process list or journal."""
    here = studio("--oidc-role", "editor", "--log-level", "debug")
    file = here.sign_in("ann")
    entry = here.entry(file)
    secrets = [entry["token"], entry["token"].split(".")[2], entry["renewal"]["refreshToken"]]
    processes = ""
    with usdlive.connect(here.server.url) as ann:
        layer = ann.open_layer("root.usda")
        radius_of(layer).default = 8.0
        ann.tick()
        for folder in pathlib.Path("/proc").glob("[0-9]*"):
            for name in ("cmdline", "environ"):
                try:
                    processes += (folder / name).read_bytes().decode(errors="replace")
                except OSError:
                    pass
        metrics = here.get("/metrics", entry["token"])[1]
        with pytest.raises(usdlive.Error) as error:
            usdlive.connect(here.server.url, user="bob")
    texts = [processes, metrics, str(error.value), *here.outputs]
    for one in tmp_path.rglob("*"):
        if one.is_file() and one != file:
            texts.append(one.read_bytes().decode(errors="replace"))
    for secret in secrets:
        assert secret and not any(secret in text for text in texts)
    assert any("usdlive_refused_sign_ins_total" in text for text in texts)


def test_options_name_what_is_missing(project, issuer, tmp_path):
    def refused(*options: str) -> str:
        ran = subprocess.run([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0", *options],
                             capture_output=True, text=True, timeout=20)
        assert ran.returncode != 0, ran.stdout
        return ran.stderr

    assert "needs --oidc-audience" in refused("--oidc-issuer", issuer.url)
    assert "--oidc-audience needs --oidc-issuer" in refused("--oidc-audience", "usdlive")
    with_issuer = ("--oidc-issuer", issuer.url, "--oidc-audience", "usdlive")
    assert "begin with https" in refused("--oidc-issuer", "http://id.example", "--oidc-audience", "usdlive")
    assert "JSON pointer" in refused(*with_issuer, "--oidc-groups-claim", "/a~2")
    keys = tmp_path / "none.json"
    assert str(keys) in refused(*with_issuer, "--oidc-jwks", str(keys))
    # A server with an issuer has users, and still wants encryption.
    assert "--tls auto" in refused(*with_issuer, "--host", "0.0.0.0")


def test_a_server_without_an_issuer_says_so(project, serve, tmp_path, monkeypatch):
    server = serve(project)
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "login", f"127.0.0.1:{server.port}"], capture_output=True,
                         text=True)
    assert ran.returncode == 1 and "usdlive join" in ran.stderr
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "login", "ws://render.example:7447"], capture_output=True,
                         text=True)
    assert ran.returncode == 1 and "wss://render.example:7447" in ran.stderr
