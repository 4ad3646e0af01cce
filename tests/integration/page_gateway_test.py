"""Tests who the gateway of the page answers, and how it lives through failures."""

import contextlib
import json
import os
import pathlib
import re
import signal
import socket
import ssl
import subprocess
import threading
import time
import types
import urllib.request

import pytest
from conftest import cat, connect, run, unused_port, wait
from page_client import Page
from pxr import Sdf
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect as websocket

ROOT = """#usda 1.0

def Xform "World"
{
    def Cube "Box"
    {
        double3 xformOp:translate = (0, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def moved_to(page, x: float) -> bool:
    return page.at("/World/Box")["matrix"][9] == x


def moving(x: float, commit: bool = True) -> dict:
    return {"path": "/World/Box", "matrix": [1, 0, 0, 0, 1, 0, 0, 0, 1, x, 0, 0], "commit": commit}


@pytest.fixture
def root(project):
    (project / "root.usda").write_text(ROOT)
    return project


def test_the_address_is_printed_and_the_process_ends_when_asked(root, serve, gateway):
    one = gateway(serve(root))
    assert one.process.stdout.readline() == f"The page is at {one.address}/\n"
    assert one.get("/health")[0] == 200
    assert one.stop() == 0


@pytest.mark.parametrize("words, message", [
    (["ws://127.0.0.1:1"], "cannot reach ws://127.0.0.1:1.*Is `usdlive serve` running there"),
    (["URL", "--stage", "none.usda"], "none.usda"), (["dds://shots"], "WebSocket"), (["URL", "--host", "0.0.0.0"], "--insecure"),
    (["URL", "--host", "192.0.2.1"], "cannot listen"), (["URL/nothing"], "nothing")])
def test_wrong_words_are_errors(root, serve, words, message):
    url = serve(root).url
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "page", *(word.replace("URL", url) for word in words)], capture_output=True,
                         text=True, timeout=60)
    assert ran.returncode == 1 and re.search(message, ran.stderr), ran.stderr
    assert len(ran.stderr.splitlines()) == 1 and ran.stderr.startswith("usdlive: ")


def test_an_unknown_option_is_an_error():
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "page", "--colour"], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 2 and re.fullmatch("usdlive: .*--colour.*`usdlive help page` explains the usage\n", ran.stderr)


def test_a_page_of_another_site_and_another_host_get_nothing(root, serve, gateway):
    one = gateway(serve(root))
    for headers in ({"Host": "evil.example"}, {"Host": "evil.example:1"}):
        assert one.get("/", **headers)[0] == 421
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"},
                    {"Origin": f"http://127.0.0.1:{one.port + 1}"}):
        assert one.get("/health", **headers)[0] == 403
    assert one.get("/health", Origin=one.address)[0] == 200
    address = f"ws://127.0.0.1:{one.port}/live"
    for options in ({"origin": "http://evil.example"}, {"additional_headers": {"Host": "evil.example"}}):
        if "additional_headers" in options:
            # The library sets Host itself; say it by hand.
            with socket.create_connection(("127.0.0.1", one.port)) as line:
                line.sendall(b"GET /live HTTP/1.1\r\nHost: evil.example\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n")
                assert b" 421 " in line.recv(200)
            continue
        with pytest.raises(InvalidStatus) as refused:
            websocket(address, **options)
        assert refused.value.response.status_code == 403
    Page(one, origin=one.address).opened().close()


def test_the_headers_protect_the_page(root, serve, gateway):
    one = gateway(serve(root))
    for path in ("/", "/health", "/blob/" + "0" * 64, "/nothing"):
        headers = one.get(path)[1]
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
    for path in ("/../../../../etc/passwd", "/%2e%2e/command.py", "/assets/../../app.py", "/blob/../health", "/app.py"):
        assert one.get(path)[0] == 404, path


@pytest.mark.parametrize("first, code", [("no json", 4400), ('{"type": "select"}', 4400), ("[1]", 4400), ('{"a":' * 20000, 4400)])
def test_a_page_that_says_no_hello(root, serve, gateway, first, code):
    one = gateway(serve(root))
    with websocket(f"ws://127.0.0.1:{one.port}/live") as line:
        line.send(first)
        with pytest.raises(Exception) as closed:
            line.recv(timeout=20)
        assert closed.value.rcvd.code == code
    Page(one).opened().close()


def test_requests_that_make_no_sense_are_answered(root, serve, gateway, page):
    one = page(gateway(serve(root)))
    for request, fields in (("children", {"path": 1}), ("children", {"path": "no path"}), ("children", {"path": "/World", "from": "a"}),
                            ("search", {}), ("camera", {"matrix": [1]}), ("camera", {"matrix": ["a"] * 16}), ("select", {"paths": [1]}),
                            ("set", {"path": "/World/Box", "name": "size"}), ("transform", {"path": "/World/Box", "matrix": [1] * 11}),
                            ("past", {"revision": "x"}), ("past", {"revision": 99999}), ("stage", {"layer": "none.usda"}),
                            ("revert", {"revisions": []}), ("log", {"limit": "x"}), ("log", {"since": "nonsense"}),
                            ("time", {"time": "now"}), ("bounds", {"paths": ["/none"]}), ("nonsense", {})):
        with pytest.raises(RuntimeError):
            one.ask(request, **fields)
    with pytest.raises(RuntimeError, match="Unsupported.*it has no users"):
        one.ask("users")
    one.socket.send('{"type": "children", "id": 1e400}')
    one.socket.send("{}")
    one.socket.send('{"id": [1]}')
    assert one.ask("children", path="/")["total"] == 1


def test_people_see_each_other(root, serve, gateway, page, editor):
    server = serve(root)
    shared = gateway(server)
    vera, otto = page(shared, {"name": "vera"}), page(shared, {"name": "<img src=x>"})
    ada = editor(server, "ada", "root.usda")
    ada.run("live.show_presence(['/World/Box'], camera=[1,0,0,0, 0,1,0,0, 0,0,1,0, 7,8,9,1])")
    camera = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]
    vera.ask("select", paths=["/World"])
    vera.ask("camera", matrix=camera)

    def others(one) -> dict:
        ada.run("live.tick()")
        return {person["user"]: person for person in one.messages.get("presence", {}).get("people", [])}

    otto.wait(lambda one: others(one).get("vera", {}).get("camera") == camera and
              others(one).get("ada", {}).get("selection") == ["/World/Box"])
    assert others(otto)["vera"]["selection"] == ["/World"] and others(otto)["vera"]["viewer"] and not others(otto)["ada"]["viewer"]
    assert re.fullmatch("#[0-9a-f]{6}", others(otto)["vera"]["color"]) and set(others(otto)) == {"vera", "ada"}
    vera.wait(lambda one: set(others(one)) == {"<img src=x>", "ada"})
    vera.close()
    otto.wait(lambda one: set(others(one)) == {"ada"})
    # A viewer who edits is a person for editors, too.
    otto.ask("transform", **moving(1))
    otto.ask("select", paths=["/World/Box"])
    ada.run("assert live.wait(lambda: any(one.user == '<img src=x>' and one.selection == ('/World/Box',) for one in live.presences()), 20)")
    otto.wait(lambda one: set(others(one)) == {"ada"})


def test_two_viewers_and_an_editor_drag_one_prim(root, serve, gateway, page, editor):
    server = serve(root)
    shared = gateway(server)
    pages = [page(shared, {"name": "vera"}), page(shared, {"name": "otto"})]
    ada = editor(server, "ada", "root.usda")
    for step in range(1, 20):
        for number, one in enumerate(pages):
            one.ask("transform", **moving(100 * (number + 1) + step, step % 7 == 0))
        ada.run(f"stage.GetAttributeAtPath('/World/Box.xformOp:translate').Set(({300 + step}, 0, 0))\nlive.tick()")
    for one in pages:
        one.ask("transform", **moving(500))
    pages[0].wait(lambda one: moved_to(one, 500))
    ada.flush()
    end = cat(server, "root.usda")
    x = float(re.search(r"translate = \(([-0-9.]+)", end).group(1))
    for one in pages:
        one.wait(lambda page: moved_to(page, x))
    assert float(ada.run("result = stage.GetAttributeAtPath('/World/Box.xformOp:translate').Get()[0]")) == x


def test_the_server_dies_and_comes_back(root, serve, gateway, page, editor):
    server = serve(root)
    shared = gateway(server)
    one = page(shared, {"name": "vera"})
    one.ask("transform", **moving(1))
    one.wait(lambda page: moved_to(page, 1))
    server.kill()
    one.wait(lambda page: not page.messages["state"]["connected"])
    assert one.messages["state"]["message"]
    assert json.loads(shared.get("/health")[2])["live"] is False
    late = page(shared)  # a page that opens meanwhile sees what there was
    assert moved_to(late, 1) and not late.messages["state"]["connected"]
    one.ask("transform", **moving(2))  # kept, and sent later
    server.start()
    for each in (one, late):
        each.wait(lambda page: page.messages["state"]["connected"] and moved_to(page, 2), 40)
    assert one.messages["state"]["message"] == ""
    ada = editor(server, "ada", "root.usda")
    ada.run("stage.GetAttributeAtPath('/World/Box.xformOp:translate').Set((3, 0, 0))\nassert live.flush(20)")
    late.wait(lambda page: moved_to(page, 3))
    shared.process.send_signal(signal.SIGTERM)
    assert shared.process.wait(20) == 0


def test_a_page_that_does_not_read_gets_a_newer_state_and_delays_nobody(root, serve, gateway, page):
    """A page that reads nothing gets few batches later, however many were made, and the same end."""
    server = serve(root)
    shared = gateway(server)
    quick = page(shared)
    narrow = socket.socket()
    narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16384)
    narrow.connect(("127.0.0.1", shared.port))
    slow = Page(shared, ping_interval=None, sock=narrow, max_queue=4).opened()

    def edit():
        with connect(server, "mover") as live:
            layer = live.open_layer("root.usda")
            with Sdf.ChangeBlock():
                for number in range(2000):
                    spec = Sdf.CreatePrimInLayer(layer, f"/World/c{number}")
                    spec.specifier, spec.typeName = Sdf.SpecifierDef, "Xform"
                    Sdf.AttributeSpec(spec, "xformOp:translate", Sdf.ValueTypeNames.Double3).default = (0, 0, 0)
                    Sdf.AttributeSpec(spec, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform).default = ["xformOp:translate"]
            assert live.flush(300)
            for step in range(1, 41):
                with Sdf.ChangeBlock():
                    for number in range(2000):
                        layer.GetAttributeAtPath(f"/World/c{number}.xformOp:translate").default = (step, 0, 0)
                live.tick()
                time.sleep(0.02)
            assert live.flush(300)

    def is_at_the_end(one) -> bool:
        return one.has("/World/c1999") and one.at("/World/c1999")["matrix"][9] == 40

    mover = threading.Thread(target=edit)
    mover.start()
    quick.wait(lambda _: not mover.is_alive(), 600)
    for one in (quick, slow):
        one.wait(is_at_the_end, 60)
    assert all(item["matrix"][9] == 40 for item in slow.items.values() if item["path"].startswith("/World/c"))
    # Each step moves 2,000 items; smaller batches are those of items that were just made.
    assert slow.resets == 1 and 0 < sum(len(batch.get(1, ())) > 1000 for batch in slow.batches) <= 20
    slow.close()


# -- signing in


@pytest.fixture
def guarded(root, serve, gateway):
    """A server with users, its gateway, and the tokens of the users."""
    server, tokens = serve(root), {}
    for name, role in (("vera", "viewer"), ("eddy", "editor"), ("adam", "admin")):
        text = run("user", "add", name, "--service", "--role", role, str(root))
        tokens[name] = re.search(r"usdlive-token://\S+", text).group()
    server.stop()
    server.start()  # with users, who have to sign in
    return server, gateway(server), tokens


def test_nobody_sees_anything_without_a_token(guarded):
    _, shared, tokens = guarded
    for hello in ({}, {"token": ""}, {"token": "0" * 64}, {"token": "nonsense with spaces"}, {"token": tokens["vera"][:-1]}, {"name": "adam"}):
        stranger = Page(shared, hello)
        assert stranger.closed() == 4401
        assert [one["type"] for one in stranger.all] == ["signIn"]


def test_a_token_says_who_somebody_is_and_the_server_what_they_may(guarded, page, editor):
    server, shared, tokens = guarded
    vera, eddy = page(shared, {"token": tokens["vera"], "name": "adam"}), page(shared, {"token": tokens["eddy"]})
    assert vera.messages["welcome"]["you"] | {"id": ""} == {"id": "", "user": "vera", "role": "viewer", "mayEdit": False,
                                                            "mayAdminister": False}
    assert eddy.messages["welcome"]["project"] == "project"
    assert eddy.messages["welcome"]["you"]["user"] == "eddy" and eddy.messages["welcome"]["you"]["mayEdit"]
    for request, fields in (("transform", moving(1)), ("set", {"path": "/World/Box", "name": "size", "value": 1}), ("undo", {}),
                            ("activate", {"path": "/World", "active": False}), ("lock", {"layer": "root.usda", "locked": True}),
                            ("mute", {"layer": "root.usda", "muted": True}), ("checkpoint", {"name": "x"}), ("metrics", {}), ("users", {}),
                            *((f"{verb}Session", {"name": "x"}) for verb in ("create", "end", "restore", "delete", "merge", "update"))):
        with pytest.raises(RuntimeError, match="forbidden|may not"):
            vera.ask(request, **fields)
    with pytest.raises(RuntimeError):
        vera.ask("revert", revisions=[1], dryRun=False)
    before = cat(server, "root.usda")
    eddy.ask("transform", **moving(5))
    vera.wait(lambda one: moved_to(one, 5))
    assert vera.ask("log", limit=1)["commits"][0]["user"] == "eddy" and cat(server, "root.usda") != before
    adam = page(shared, {"token": tokens["adam"]})
    assert adam.messages["welcome"]["you"]["mayAdminister"]
    assert any(one["name"].startswith("usdlive_sessions") for one in adam.ask("metrics")["items"])
    assert adam.ask("users")["items"] == [{"name": "adam", "role": "admin"}, {"name": "eddy", "role": "editor"},
                                          {"name": "vera", "role": "viewer"}]
    # Live sessions are changed with the token of the viewer, too.
    eddy.ask("createSession", name="dusk")
    assert [one["creator"] for one in vera.ask("sessions")["items"]] == ["eddy"]
    eddy.ask("endSession", name="dusk")
    assert adam.ask("deleteSession", name="dusk")["name"] == "dusk"
    assert adam.ask("explain", layer="root.usda")["allowed"] and not vera.ask("explain", layer="root.usda")["allowed"]


def test_the_page_of_a_removed_user_ends(guarded, page, root):
    _, shared, tokens = guarded
    eddy = page(shared, {"token": tokens["eddy"]})
    eddy.ask("transform", **moving(1))
    run("user", "remove", "eddy", str(root))
    assert eddy.closed() == 4401


def test_tokens_are_in_no_log_and_in_no_answer(guarded, page):
    _, shared, tokens = guarded
    secret = tokens["eddy"].rsplit("/", 1)[-1]
    eddy, vera = page(shared, {"token": tokens["eddy"]}), page(shared, {"token": tokens["vera"]})
    eddy.ask("transform", **moving(1))
    eddy.ask("select", paths=["/World"])
    eddy.ask("createSession", name="dusk")
    eddy.ask("mergeSession", name="dusk")
    with pytest.raises(RuntimeError):
        eddy.ask("restoreSession", name="dusk")
    vera.wait(lambda one: moved_to(one, 1))
    assert secret not in json.dumps(vera.all) + json.dumps(eddy.all) + shared.log.read_text()


# -- usdlive serve --page


def test_the_server_starts_the_page_and_ends_it(root, serve, tmp_path):
    port = unused_port()
    server = serve(root, "--page", "--page-port", str(port))
    page = types.SimpleNamespace(port=port, address=f"http://127.0.0.1:{port}")

    def health() -> dict | None:
        with contextlib.suppress(OSError, ValueError):
            return json.loads(urllib.request.urlopen(f"{page.address}/health", timeout=5).read())

    wait(lambda: health() == {"live": True, "revision": 1}, timeout=40)
    Page(page).opened().close()
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/") as welcome:
        assert f"Browser:  {page.address}/" in welcome.read().decode()
    gateway = children_of(server.process.pid)
    assert len(gateway) == 1
    os.kill(gateway[0], signal.SIGKILL)  # it is started again
    wait(lambda: children_of(server.process.pid) not in ([], gateway) and health() is not None, timeout=40)
    again = children_of(server.process.pid)
    assert server.stop() == 0
    wait(lambda: not is_alive(again[0]), timeout=20)
    server.start()
    wait(lambda: health() is not None, timeout=40)
    last = children_of(server.process.pid)
    server.kill()
    wait(lambda: not is_alive(last[0]), timeout=20)


def test_the_server_says_how_to_get_the_page(root, serve):
    server = serve(root)
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/") as welcome:
        assert "usdlive serve DIR --page" in welcome.read().decode()
    several = subprocess.run([os.environ["USDLIVE_BIN"], "serve", "--projects", str(root), "--page"], capture_output=True, text=True)
    assert several.returncode == 2 and "usdlive page ws://HOST:PORT/PROJECT" in several.stderr


def children_of(process: int) -> list[int]:
    return [int(one) for one in pathlib.Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def is_alive(process: int) -> bool:
    with contextlib.suppress(OSError):
        return pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def test_encrypted_servers_and_pages(root, serve, gateway, tmp_path):
    server = serve(root, "--tls", "auto")
    own = root / ".usdlive" / "tls"
    first = gateway(server)  # remembers the certificate
    Page(first).opened().close()
    second = gateway(server, "--ca", str(own / "certificate.pem"), "--tls", str(own / "certificate.pem"), str(own / "key.pem"))
    trusting = ssl.create_default_context(cafile=own / "certificate.pem")
    with urllib.request.urlopen(f"https://127.0.0.1:{second.port}/health", context=trusting) as answer:
        assert json.loads(answer.read())["live"]
    with websocket(f"wss://127.0.0.1:{second.port}/live", ssl=trusting, origin=f"https://127.0.0.1:{second.port}") as line:
        line.send('{"type": "hello"}')
        assert json.loads(line.recv(timeout=20))["type"] == "welcome"
