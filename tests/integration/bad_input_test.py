"""Tests hostile or broken peers and installations: each gets a code and a message, and others are not
affected."""

import hashlib
import json
import os
import socket
import struct
import subprocess
import urllib.error
import urllib.request

import pytest
import wire
from conftest import cat
from wire import Peer, control
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

ROOT = '#usda 1.0\n\ndef "World"\n{\n}\n\n'


@pytest.fixture
def served(project, serve):
    (project / "root.usda").write_text(ROOT)
    return serve(project)


def closing_error(socket_) -> str:
    """The code of the error that ends the session. Control frames contain their JSON as plain text, so this
    test needs no FlatBuffers."""
    seen = ""
    try:
        while True:
            message = socket_.recv(timeout=10)
            start = message.rfind(b'{"')
            if start >= 0 and b'"error' in message:
                text = message[message.find(b'{"'):]
                seen = json.JSONDecoder().raw_decode(text.decode("utf-8", "replace"))[0].get("code", "")
    except ConnectionClosed:
        return seen


@pytest.mark.parametrize("message,code", [
    ("hello in text", "textFrame"),
    (b"\x00\x01\x02\x03", "malformedFrame"),
    (struct.pack("<I", 12) + b"not a frame!", "malformedFrame"),
    (struct.pack("<I", 2**31) + b"x", "frameTooLarge"),
    (b"", "malformedFrame"),
])
def test_nonsense_is_answered_and_the_session_closed(message, code, served):
    with connect(f"{served.url}/live", compression=None) as ws:
        ws.send(message)
        assert closing_error(ws) == code
    assert cat(served, "root.usda") == ROOT


def test_a_message_over_the_limit_is_cut(project, serve):
    (project / "root.usda").write_text(ROOT)
    server = serve(project, "--max-frame-mib", "1")
    with connect(f"{server.url}/live", compression=None, max_size=None) as ws:
        with pytest.raises(ConnectionClosed):
            ws.send(struct.pack("<I", 3 << 20) + b"x" * (3 << 20))
            ws.recv(timeout=10)
            ws.recv(timeout=10)
    assert cat(server, "root.usda") == ROOT


@pytest.mark.parametrize("path,status", [("/nowhere", 404), ("/healthz", 200), ("/metrics", 200)])
def test_http(path, status, served):
    url = served.url.replace("ws://", "http://") + path
    try:
        with urllib.request.urlopen(url, timeout=10) as answer:
            assert answer.status == status
            body = answer.read().decode()
    except urllib.error.HTTPError as error:
        assert error.code == status
        return
    assert json.loads(body)["status"] == "ok" if path == "/healthz" else "usdlive_" in body


@pytest.mark.parametrize("name", ["../secret.usda", "/etc/passwd.usda", "link/secret.usda", "no.usda",
                                  "root.usda/x.usda", "a\\..\\b.usda", "nul\x00.usda"])
def test_names_that_lead_out_are_refused(name, project, serve, tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.usda").write_text('#usda 1.0\ndef "Secret" {}\n')
    (tmp_path / "secret.usda").write_text('#usda 1.0\ndef "Secret" {}\n')
    (project / "root.usda").write_text(ROOT)
    (project / "link").symlink_to(tmp_path / "outside")
    server = serve(project)
    import usdlive
    with usdlive.connect(server.url) as live:
        assert live.layers() == ["root.usda"]
        with pytest.raises((usdlive.Error, ValueError)) as refused:
            live.open_layer(name)
        if isinstance(refused.value, usdlive.Error):
            assert refused.value.code in ("invalidLayerName", "layerNotFound")


LEADING_OUT = ["../secret.usda", "%2e%2e/secret.usda", "/etc/passwd.usda", "link/secret.usda",
               "a\\..\\secret.usda", "nul\x00.usda", "CON.usda", "http://127.0.0.1/a.usda",
               "file:///etc/passwd.usda", "//host/share.usda", "\uff0e\uff0e/secret.usda",
               "root.usda:SDF_FORMAT_ARGS:a=b.usda"]


def test_f5_names_that_lead_out_are_refused_by_the_server_itself(project, serve, tmp_path):
    (tmp_path / "secret.usda").write_text('#usda 1.0\ndef "Secret" {}\n')
    (project / "root.usda").write_text(ROOT)
    (project / "link").symlink_to(tmp_path)
    server = serve(project)
    for name in LEADING_OUT:
        with Peer(server.url) as peer:
            peer.send(control("openLayer", request=1, layer=name, revision=0))
            assert peer.expect_error()["code"] in ("invalidLayerName", "layerNotFound"), name
    assert cat(server, "root.usda") == ROOT


def test_f5_the_server_fetches_nothing_that_a_layer_names(project, serve):
    with socket.socket() as elsewhere:
        elsewhere.bind(("127.0.0.1", 0))
        elsewhere.listen()
        elsewhere.settimeout(1)
        url = f"http://127.0.0.1:{elsewhere.getsockname()[1]}/a.usda"
        text = (f'#usda 1.0\n(\n    subLayers = [\n        @{url}@\n    ]\n)\n\n'
                f'def "World" (\n    prepend references = @{url}@\n)\n{{\n    asset map = @{url}@\n}}\n\n')
        (project / "root.usda").write_text(text)
        server = serve(project)
        assert cat(server, "root.usda").count(url) == 3
        with pytest.raises(TimeoutError):
            elsewhere.accept()


def test_a_layer_that_does_not_parse_leaves_the_others_served(project, serve):
    (project / "bad.usda").write_text("#usda 1.0\ndef {{{\n")
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    import usdlive
    with usdlive.connect(server.url) as live:
        with pytest.raises(usdlive.Error) as refused:
            live.open_layer("bad.usda")
        assert refused.value.code == "layerUnreadable" and "bad.usda" in refused.value.message
        assert live.open_layer("root.usda").ExportToString() == ROOT


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True,
                          timeout=60, check=False)


def one_line(done: subprocess.CompletedProcess, *words: str) -> None:
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in lines[0]


def test_starting_on_a_path_that_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    one_line(run("serve", str(tmp_path / "file"), "--port", "0"), str(tmp_path / "file"))
    one_line(run("serve", str(tmp_path / "absent"), "--port", "0"), str(tmp_path / "absent"))


def test_starting_on_a_port_in_use(project):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        one_line(run("serve", str(project), "--port", port), port)


def test_starting_on_a_store_of_a_newer_version(project, serve):
    server = serve(project)
    server.stop()
    (project / ".usdlive" / "store" / "format").write_bytes(with_checksum((1_000_000).to_bytes(4, "little")))
    one_line(run("serve", str(project), "--port", "0"), str(project), "1000000")


def with_checksum(content: bytes) -> bytes:
    """Encodes a small file like the store: the content, then its SHA-256."""
    return content + hashlib.sha256(content).digest()


def test_two_servers_of_one_project(served):
    one_line(run("serve", str(served.folder), "--port", "0"), str(served.folder))


def test_fr7_a_commit_that_nobody_could_decode_is_refused(project, serve, tmp_path):
    """The transaction repeats the names, so the bounds of its size allow them. The commit would contain each name
    only once, and would exceed its bounds."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    path = [f"{part:02}" + "k" * 126 for part in range(64)]

    def edits(count):
        return [wire.set_field("/World", "customData", wire.int64(number),
                               ("DictionaryKey", {"path": [*path[:-1], f"k{number}"]})) for number in range(count)]

    with Peer(server.url) as peer:
        peer.submit(1, "root.usda", *edits(5_000))
        refusal = peer.expect("Refusal", 60)
        assert refusal["code"] == "transactionTooLarge", refusal
        peer.submit(2, "root.usda", *edits(500))
        peer.follow(peer.expect("Commit", 60))
    text = cat(server, "root.usda")
    assert "k499" in text
    server.kill()
    server.start()
    assert cat(server, "root.usda") == text


def test_unknown_options_and_wrong_configuration(project, tmp_path):
    config = tmp_path / "config.json"
    config.write_text('{"prot": 1}')
    one_line(run("serve", str(project), "--config", str(config)), "prot")
    config.write_text('{"port": "many"}')
    one_line(run("serve", str(project), "--config", str(config)), "port")
    config.write_text("{")
    one_line(run("serve", str(project), "--config", str(config)), str(config))


@pytest.mark.parametrize("command", [["ls", "ws://127.0.0.1:1"], ["ls", "http:/nonsense"],
                                     ["cat", "ws://127.0.0.1:1/a.usda"]])
def test_tools_report_errors(command):
    one_line(run(*command))


def test_a_layer_with_time_codes_per_second_of_zero_harms_nobody(served):
    import usdlive
    with usdlive.connect(served.url) as live:
        stage = live.open_stage("root.usda")
        lost = []
        live.add_handler(lambda e: lost.append(e) if isinstance(e, usdlive.events.Lost) else None)
        stage.GetRootLayer().timeCodesPerSecond = 0
        assert live.flush(10)
        assert [e.code for e in lost] == ["forbiddenValue"]
        assert not stage.GetRootLayer().HasTimeCodesPerSecond()
    assert cat(served, "root.usda") == ROOT
