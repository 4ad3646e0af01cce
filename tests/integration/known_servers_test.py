"""Tests requests for files of a server that demands TLS and a token, by the resolver and by the command line tool."""

from __future__ import annotations

import hashlib
import json
import ssl

import pytest
import usdlive
from conftest import run
from edf_museum_test import certificate
from pxr import Ar
from resolver_test import cache, plain  # fixtures
from strange_servers_test import READ, SHOT, Strange, head

TOKEN = "a-token_of.ada"


class Guarded(Strange):
    """A server with a certificate that answers nobody without the token."""

    def __init__(self, file):
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.load_cert_chain(file)
        super().__init__({})

    @property
    def name(self):
        return f"localhost:{self.socket.getsockname()[1]}"

    def _serve(self, connection):
        try:
            with self.context.wrap_socket(connection, server_side=True) as secure:
                request = secure.recv(65536).decode()
                if f"\r\nAuthorization: Bearer {TOKEN}\r\n" in request:
                    self._answer(secure, request.split(" ")[1])
                else:
                    self._send(secure, head(0, status="401 Unauthorized"))
        except OSError:
            pass  # the client has ended the connection


@pytest.fixture
def guarded(tmp_path):
    return Guarded(certificate(tmp_path, "DNS:localhost"))


@pytest.fixture
def know(tmp_path):
    """Returns a function that writes what this user knows about a server."""
    file = tmp_path / "config" / "usdlive" / "servers.json"
    file.parent.mkdir(parents=True)

    def write(server, **entry):
        file.write_text(json.dumps({"servers": {server.name: entry}}))
        file.chmod(0o600)
        return file
    return write


def pin(tmp_path):
    der = ssl.PEM_cert_to_DER_cert((tmp_path / "DNS-localhost.pem").read_text().partition("-----BEGIN PRIVATE")[0])
    return "sha256:" + hashlib.sha256(der).hexdigest()


def test_a_known_server_is_asked_over_tls_with_the_token(guarded, know, plain, tmp_path):
    know(guarded, token=TOKEN, pin=pin(tmp_path), tls=True)
    got = plain(READ, guarded.url).value(60)
    assert got["x"] == 1 and got["t"] == hashlib.sha256(b"texture").hexdigest(), got


@pytest.mark.parametrize("entry, cause", [
    ({"tls": True, "token": "another"}, "Sign in with `usdlive join INVITATION`"),
    ({"tls": True}, "Sign in with `usdlive join INVITATION`"),
    ({"tls": True, "token": TOKEN, "pin": "sha256:" + "0" * 64}, "has changed (was sha256:000"),
    ({"tls": True, "token": TOKEN, "pin": ""}, "is self-signed and not known yet"),
    ({"tls": False, "token": TOKEN}, "no answer"),
])
def test_what_keeps_a_user_from_a_server_is_said(guarded, know, plain, tmp_path, entry, cause):
    know(guarded, **{"pin": pin(tmp_path), **entry})
    said = plain(READ, guarded.url).value(60)["error"]
    assert cause in said and f"usdlive://{guarded.name}/shot.usda" in said, said


def test_an_authority_of_the_user_is_trusted(guarded, know, plain, tmp_path):
    file = know(guarded, token=TOKEN, tls=True)
    got = plain(READ, guarded.url, USDLIVE_CA=str(tmp_path / "DNS-localhost.pem")).value(60)
    assert got["x"] == 1, got
    assert json.loads(file.read_text())["servers"][guarded.name]["pin"] == "authority"


def test_a_file_with_tokens_that_others_can_read_is_not_used(guarded, know, plain, tmp_path):
    file = know(guarded, token=TOKEN, pin=pin(tmp_path), tls=True)
    file.chmod(0o644)
    said = plain(READ, guarded.url).value(60)["error"]
    assert f"chmod 600 {file}" in said, said


@pytest.fixture
def encrypted(serve, project):
    (project / "shot.usda").write_bytes(SHOT)
    (project / "t.png").write_bytes(b"texture")
    return serve(project, "--tls", "auto")


def test_the_files_of_a_live_stage_come_over_tls(encrypted, recwarn):
    with usdlive.connect(encrypted.url, user="ada", application="test") as live:
        stage = live.open_stage("shot.usda")
        with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
            found = Ar.ResolvedPath(stage.GetAttributeAtPath("/A.t").Get().resolvedPath)
            assert bytes(Ar.GetResolver().OpenAsset(found).GetBuffer()) == b"texture"
    assert not [one for one in recwarn if "files of the project" in str(one.message)]


def test_a_tool_that_reads_over_http_reads_over_tls(encrypted, plain):
    assert "double x = 1" in run("flatten", encrypted.url, "shot.usda")
    name = encrypted.url.partition("//")[2]
    got = plain(READ, f"usdlive://{name}/shot.usda").value(60)
    assert got["x"] == 1 and got["t"] == hashlib.sha256(b"texture").hexdigest(), got
