"""Tests encrypted connections: certificates that clients accept, and what a server does with its own (EN1-EN6)."""

from __future__ import annotations

import hashlib
import http.client
import json
import os
import pathlib
import signal
import socket
import ssl
import subprocess
import time

import pytest
import usdlive
from conftest import connect, shots, synced, unused_port, wait

ROOT = '#usda 1.0\n\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'
PLAIN_ANSWER = "this server speaks TLS: use wss:// or https://"


@pytest.fixture
def project(tmp_path):
    return shots(tmp_path, ROOT)


@pytest.fixture
def known(tmp_path):
    """Returns the entries of the file of known servers."""
    def read():
        file = tmp_path / "config" / "usdlive" / "servers.json"
        return json.loads(file.read_text())["servers"] if file.exists() else {}
    return read


def openssl(*arguments: object) -> None:
    ran = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


class Authority:
    """Signs certificates, in a folder of its own."""

    def __init__(self, folder: pathlib.Path):
        folder.mkdir()
        self.folder, self.file = folder, folder / "authority.pem"
        openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", 30, "-subj",
                "/CN=Studio", "-keyout", folder / "authority.key", "-out", self.file)

    def sign(self, names: str, days: int = 30) -> tuple[str, str]:
        """Returns the files of a certificate for `names` ("DNS:host,IP:address") and of its key."""
        certificate, key, request = (self.folder / f"server.{end}" for end in ("pem", "key", "csr"))
        openssl("req", "-new", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", "/CN=server",
                "-keyout", key, "-out", request)
        extensions = self.folder / "extensions"
        extensions.write_text(f"subjectAltName={names}\n")
        openssl("x509", "-req", "-in", request, "-CA", self.file, "-CAkey", self.folder / "authority.key",
                "-CAcreateserial", "-days", days, "-extfile", extensions, "-out", certificate)
        key.chmod(0o600)
        return str(certificate), str(key)


@pytest.fixture
def authority(tmp_path):
    return Authority(tmp_path / "authority")


def shown(server) -> str:
    """Returns the certificate that new connections get, in PEM."""
    return ssl.get_server_certificate(("127.0.0.1", server.port))


def fingerprint(certificate: str) -> str:
    return "sha256:" + hashlib.sha256(ssl.PEM_cert_to_DER_cert(certificate)).hexdigest()


def ls(url: str, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run([os.environ["USDLIVE_BIN"], "ls", url], capture_output=True, text=True, timeout=60,
                          env={**os.environ, **environment})


def refusal(url: str, **environment: str) -> str:
    ran = ls(url, **environment)
    assert ran.returncode == 1, ran.stdout
    return ran.stderr


def start_error(project: pathlib.Path, *options: str) -> str:
    """Returns the error of a server that does not start."""
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", str(unused_port()), *options],
                         capture_output=True, text=True, timeout=30)
    assert ran.returncode != 0, ran.stdout
    return ran.stderr


def test_en4_editors_work_together_and_remember_the_certificate(project, serve, editor, known, tmp_path):
    server = serve(project, "--tls", "auto")
    ada, bo = editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")
    ada.run("stage.GetPrimAtPath('/Ball').GetAttribute('radius').Set(2.0)")
    bo.run("stage.DefinePrim('/Cube', 'Cube')")
    synced(server, ada, bo)
    assert known() == {f"127.0.0.1:{server.port}": {"pin": fingerprint(shown(server)), "tls": True}}
    # The address needs no scheme any more (EN5).
    assert ls(f"127.0.0.1:{server.port}").stdout == "root.usda\n"
    assert ls(f"usdlive://127.0.0.1:{server.port}").stdout == "root.usda\n"
    assert (tmp_path / "config" / "usdlive" / "servers.json").stat().st_mode & 0o777 == 0o600
    assert "cannot create /proc/none/usdlive" in refusal(server.url, XDG_CONFIG_HOME="/proc/none")
    key = project / ".usdlive" / "tls" / "key.pem"
    assert key.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("way", ["option", "config"])
def test_the_server_names_its_address_and_fingerprint(project, tmp_path, way):
    port, config = unused_port(), tmp_path / "config.json"
    config.write_text('{"tls": "auto"}')
    options = ["--tls", "auto"] if way == "option" else ["--config", str(config)]
    with subprocess.Popen([os.environ["USDLIVE_BIN"], "serve", *options, str(project), "--port", str(port)],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            first, second = server.stdout.readline(), server.stdout.readline()
            certificate = ssl.get_server_certificate(("127.0.0.1", port))
            assert f" at wss://127.0.0.1:{port}\n" in first
            assert second == f"fingerprint {fingerprint(certificate)}\n"
            assert f"is already served at wss://127.0.0.1:{port}" in start_error(project)
        finally:
            server.terminate()


def test_en4_a_changed_certificate_is_refused_until_it_is_forgotten(project, serve):
    server = serve(project, "--tls", "auto")
    assert ls(server.url).returncode == 0
    before = fingerprint(shown(server))
    assert server.stop() == 0
    server.start()
    assert fingerprint(shown(server)) == before, "the certificate is made once"
    assert server.stop() == 0
    for file in (project / ".usdlive" / "tls").iterdir():
        file.unlink()
    server.start()
    now, name = fingerprint(shown(server)), f"127.0.0.1:{server.port}"
    assert now != before
    for url in (server.url, name):
        assert f"the certificate of {name} has changed (was {before}, is {now})" in refusal(url)
    assert f"usdlive forget {name}" in refusal(server.url)
    with pytest.raises(usdlive.Error, match="has changed"):
        usdlive.connect(server.url, user="ada", timeout=2)
    forgotten = subprocess.run([os.environ["USDLIVE_BIN"], "forget", name], capture_output=True, text=True)
    assert (forgotten.returncode, forgotten.stdout) == (0, f"forgot the certificate and the token of {name}\n")
    assert ls(server.url).returncode == 0


def test_en1_tls_1_2_and_1_3_only(project, serve):
    server = serve(project, "--tls", "auto")

    def spoken(version: str) -> str:
        ran = subprocess.run(["openssl", "s_client", "-connect", f"127.0.0.1:{server.port}", version, "-cipher",
                              "ALL:@SECLEVEL=0"], input="", capture_output=True, text=True, timeout=20)
        return ran.stdout if ran.returncode == 0 else ""

    assert "Cipher is ECDHE" in spoken("-tls1_2")
    assert "New, TLSv1.3" in spoken("-tls1_3")
    assert not spoken("-tls1_1")
    assert not spoken("-tls1")


def test_en3_a_certificate_of_an_authority_is_for_its_host(project, serve, authority, known):
    certificate, key = authority.sign("DNS:localhost,DNS:vm.example")
    server = serve(project, "--tls", certificate, key)
    trusting = {"USDLIVE_CA": str(authority.file)}
    assert ls(f"wss://localhost:{server.port}", **trusting).stdout == "root.usda\n"
    assert known() == {f"localhost:{server.port}": {"pin": "authority", "tls": True}}
    by_option = subprocess.run([os.environ["USDLIVE_BIN"], "ls", f"wss://localhost:{server.port}", "--ca", authority.file],
                               capture_output=True, text=True, timeout=60)
    assert by_option.stdout == "root.usda\n", by_option.stderr
    # It is not needed that something can be kept.
    assert ls(f"wss://localhost:{server.port}", XDG_CONFIG_HOME="/proc/none", **trusting).returncode == 0
    unknown = refusal(f"wss://localhost:{server.port}")
    assert "an authority that is not known here" in unknown and "USDLIVE_CA" in unknown
    assert "is for another host" in refusal(f"wss://127.0.0.1:{server.port}", **trusting)
    missing = refusal(f"wss://localhost:{server.port}", USDLIVE_CA="/missing.pem")
    assert "/missing.pem" in missing and "USDLIVE_CA" in missing


def test_en4_a_self_signed_certificate_does_not_replace_that_of_an_authority(project, serve, authority):
    server = serve(project, "--tls", *authority.sign("IP:127.0.0.1"))
    assert ls(server.url, USDLIVE_CA=str(authority.file)).returncode == 0
    assert server.stop() == 0
    server.options = ("--tls", "auto")
    server.start()
    assert "has changed (was signed by a known authority, is sha256:" in refusal(
        server.url, USDLIVE_CA=str(authority.file))


def test_en3_an_expired_certificate_is_refused(project, authority, monkeypatch):
    """The server of usdlive does not start with one, so another one shows it."""
    certificate, key = authority.sign("IP:127.0.0.1", days=-1)
    monkeypatch.setenv("USDLIVE_CA", str(authority.file))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    with socket.create_server(("127.0.0.1", unused_port())) as listener:
        listening = subprocess.Popen([os.environ["USDLIVE_BIN"], "who", f"wss://127.0.0.1:{listener.getsockname()[1]}"],
                                     stderr=subprocess.PIPE, text=True)
        with pytest.raises(ssl.SSLError):
            context.wrap_socket(listener.accept()[0], server_side=True).recv(1)
        assert "has expired" in listening.communicate(timeout=20)[1]


def test_a_server_that_does_not_answer_the_handshake_is_given_up():
    with socket.create_server(("127.0.0.1", unused_port())) as listener:
        silent = f"wss://127.0.0.1:{listener.getsockname()[1]}"
        ran = subprocess.run([os.environ["USDLIVE_BIN"], "who", silent], capture_output=True, text=True, timeout=60)
    assert "cannot encrypt the connection" in ran.stderr and "timed out" in ran.stderr


def test_en6_sighup_replaces_the_certificate_under_running_sessions(project, serve, editor, authority, monkeypatch):
    monkeypatch.setenv("USDLIVE_CA", str(authority.file))
    certificate, key = authority.sign("IP:127.0.0.1")
    server = serve(project, "--tls", certificate, key)
    ada = editor(server, "ada", "root.usda")
    first = shown(server)

    authority.sign("IP:127.0.0.1")  # in the same files
    server.process.send_signal(signal.SIGHUP)
    wait(lambda: shown(server) != first)
    second = shown(server)
    bo = editor(server, "bo", "root.usda")
    for number, one in enumerate((ada, bo)):
        one.run(f"stage.DefinePrim('/Prim{number}')")
    synced(server, ada, bo)

    pathlib.Path(certificate).write_text("not a certificate")
    server.process.send_signal(signal.SIGHUP)
    wait(lambda: "the certificate was not replaced" in server.log.read_text())
    assert certificate in server.log.read_text()
    assert shown(server) == second
    ada.run("assert live.connected and not [one for one in happened if type(one).__name__ == 'Disconnected']")


def test_en1_plain_and_encrypted_do_not_meet(project, tmp_path, serve):
    encrypted = serve(project, "--tls", "auto")
    connection = http.client.HTTPConnection("127.0.0.1", encrypted.port, timeout=20)
    connection.request("GET", "/projects")
    answer = connection.getresponse()
    assert (answer.status, answer.read().decode()) == (400, PLAIN_ANSWER + "\n")
    assert PLAIN_ANSWER in refusal(f"ws://127.0.0.1:{encrypted.port}")

    (tmp_path / "other").mkdir()
    plain = serve(tmp_path / "other")
    assert f"does not speak TLS. Connect to ws://127.0.0.1:{plain.port}" in refusal(f"wss://127.0.0.1:{plain.port}")
    with pytest.raises(ssl.SSLError):
        shown(plain)


def test_en5_a_token_of_an_encrypted_server_is_not_sent_in_plain_text(tmp_path):
    file = tmp_path / "config" / "usdlive" / "servers.json"
    file.parent.mkdir(parents=True)

    def request(is_tls: bool) -> bytes:
        # A listener of its own: the client of another request may have connected again.
        with socket.create_server(("127.0.0.1", unused_port())) as listener:
            listener.settimeout(20)
            port = listener.getsockname()[1]
            file.write_text(json.dumps({"servers": {f"127.0.0.1:{port}": {"token": "secret", "tls": is_tls}}}))
            file.chmod(0o600)
            client = subprocess.Popen([os.environ["USDLIVE_BIN"], "who", f"ws://127.0.0.1:{port}"],
                                      stderr=subprocess.DEVNULL)
            here, _ = listener.accept()
            with here:
                text = here.recv(4096)
            client.wait(timeout=20)
            return text

    assert b"Authorization: Bearer secret" in request(is_tls=False)
    assert b"secret" not in request(is_tls=True)


def test_files_are_downloaded_over_https(project, serve):
    content = os.urandom(5_000_000)
    (project / "noise.bin").write_bytes(content)
    server = serve(project, "--tls", "auto")
    trusting = ssl.create_default_context(cafile=str(project / ".usdlive" / "tls" / "certificate.pem"))

    def get(**headers: str) -> bytes:
        connection = http.client.HTTPSConnection("localhost", server.port, timeout=20, context=trusting)
        connection.request("GET", "/files/noise.bin", headers=headers)
        return connection.getresponse().read()

    assert get() == content
    assert get(Range="bytes=1000000-3999999") == content[1_000_000:4_000_000]


def test_big_values_travel_over_wss(project, serve):
    server = serve(project, "--tls", "auto")
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        layer = ada.open_layer("root.usda")
        layer.customLayerData = {"text": "x" * 20_000_000}
        assert ada.flush(60)
        other = bo.open_layer("root.usda")
        wait(lambda: len(other.customLayerData.get("text", "")) == 20_000_000, bo)


def test_a_key_that_others_can_read_is_refused_with_the_command_that_mends_it(project, serve, authority):
    certificate, key = authority.sign("DNS:localhost")
    os.chmod(key, 0o644)
    error = start_error(project, "--tls", certificate, key)
    command = f"chmod 600 {key}"
    assert f"other users can read it. Run `{command}`" in error
    subprocess.run(command, shell=True, check=True)
    serve(project, "--tls", certificate, key)


@pytest.mark.parametrize("names, days, words", [
    ("DNS:localhost", -1, ["it expired on", "openssl req -x509"]),
    ("DNS:render.example", 30, ["it is for render.example", "--allow-host render.example"]),
])
def test_a_certificate_that_no_client_would_accept_is_refused_at_the_start(project, authority, names, days, words):
    error = start_error(project, "--tls", *authority.sign(names, days))
    assert all(word in error for word in words), error


def test_files_that_do_not_belong_together_are_refused_at_the_start(project, tmp_path):
    one, other = Authority(tmp_path / "one"), Authority(tmp_path / "other")
    certificate, key = one.sign("DNS:localhost")[0], other.sign("DNS:localhost")[1]
    assert "It has to be the key of" in start_error(project, "--tls", certificate, key)
    assert "/missing.pem" in start_error(project, "--tls", "/missing.pem", key)
    assert "/missing.key" in start_error(project, "--tls", certificate, "/missing.key")
    assert "of its key" in start_error(project, "--tls", certificate)


def test_a_key_with_a_passphrase_is_refused_without_asking_for_it(project, authority):
    certificate, key = authority.sign("DNS:localhost")
    openssl("ec", "-in", key, "-aes256", "-passout", "pass:secret", "-out", key)
    assert "without a passphrase" in start_error(project, "--tls", certificate, key)


def test_en2_a_handshake_that_does_not_end_is_closed(project, serve):
    server = serve(project, "--tls", "auto", "--guest-seconds", "1")
    hello = b"\x16\x03\x01\x02\x00\x01"  # the rest of the record, 511 bytes, is missing
    for sent in (b"", hello[:1], hello):
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as peer:
            peer.sendall(sent)
            assert peer.recv(1) == b"", "closed"
    assert ls(server.url).returncode == 0


def test_en2_unfinished_handshakes_leave_room_for_others(project, serve):
    server = serve(project, "--tls", "auto", "--max-guests", "4", "--guest-seconds", "3600")
    idle = [socket.create_connection(("127.0.0.1", server.port), timeout=20) for _ in range(8)]
    for one in idle:
        one.sendall(b"\x16\x03\x01")
    time.sleep(1)  # the time after which a guest without progress gives way
    assert ls(server.url).returncode == 0
    for one in idle:
        one.close()
