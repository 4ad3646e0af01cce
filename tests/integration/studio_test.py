"""Projects of a studio's size: many layers, of which each client needs few."""

import re
import time
import urllib.request

from conftest import connect, wait
from pxr import Sdf, Usd
from wire import Peer, control

PAYLOADS = 60


def write_shot(folder) -> None:
    """Writes a root layer with a reference that has a payload of its own, and many payloads."""
    payloads = "\n".join(f'def "p{i}" (payload = @./props/p{i}.usda@</Prop>)\n{{\n}}' for i in range(PAYLOADS))
    (folder / "shot.usda").write_text(
        f'#usda 1.0\n(\n    subLayers = [@./under.usda@]\n)\ndef "World" (references = @./set.usda@</Set>)\n{{\n}}\n'
        f'{payloads}\n')
    (folder / "under.usda").write_text('#usda 1.0\ndef "Under"\n{\n}\n')
    (folder / "set.usda").write_text('#usda 1.0\ndef "Set" (payload = @./props/p0.usda@</Prop>)\n{\n}\n')
    (folder / "props").mkdir()
    for i in range(PAYLOADS):
        (folder / "props" / f"p{i}.usda").write_text(f'#usda 1.0\ndef "Prop"\n{{\n    int size = {i}\n}}\n')


def opened(watcher, user: str) -> set[str]:
    """The layers that somebody has joined, from the server."""
    watcher.tick()
    return {name for name, state in watcher.layer_states().items() if user in state.editors}


def test_a_stage_without_payloads_joins_only_opened_layers(project, serve):
    write_shot(project)
    server = serve(project)
    with connect(server, "watcher") as watcher, connect(server, "ada") as ada, connect(server, "bo") as bo:
        stage = ada.open_stage("shot.usda", Usd.Stage.LoadNone)
        used = {"shot.usda", "under.usda", "set.usda"}
        wait(lambda: opened(watcher, "ada") == used, watcher, ada)
        assert stage.GetPrimAtPath("/Under")
        for _ in range(10):
            ada.tick()
            time.sleep(0.03)
        assert opened(watcher, "ada") == used

        stage.Load("/p7")
        wait(lambda: stage.GetPrimAtPath("/p7").GetAttribute("size").Get() == 7, ada, watcher)
        wait(lambda: opened(watcher, "ada") == used | {"props/p7.usda"}, watcher, ada)
        bo.open_layer("props/p7.usda").GetAttributeAtPath("/Prop.size").default = 70
        bo.flush()
        wait(lambda: stage.GetPrimAtPath("/p7").GetAttribute("size").Get() == 70, ada)
        stage.GetPrimAtPath("/p7").GetAttribute("size").Set(77)
        assert ada.flush()

        # A layer that was opened without its payloads is opened with them.
        full = Usd.Stage.Open(ada.open_layer("shot.usda"))
        assert full.GetPrimAtPath("/p9").GetAttribute("size").Get() == 9
        assert full.GetPrimAtPath("/World").GetAttribute("size").Get() == 0


def test_an_attached_stage_without_payloads_joins_only_loaded_layers(project, serve):
    write_shot(project)
    server = serve(project)
    with connect(server, "watcher") as watcher, connect(server, "ada") as ada:
        stage = Usd.Stage.Open(str(project / "shot.usda"), Usd.Stage.LoadNone)
        assert ada.attach(stage) == ["set.usda", "shot.usda", "under.usda"]
        wait(lambda: opened(watcher, "ada") == {"shot.usda", "under.usda", "set.usda"}, watcher, ada)
        stage.Load("/p3")
        wait(lambda: "props/p3.usda" in opened(watcher, "ada"), watcher, ada)


def metric(server, name: str) -> float:
    page = urllib.request.urlopen(server.url.replace("ws://", "http://") + "/metrics").read().decode()
    return float(re.search(rf"^{name} (\S+)$", page, re.MULTILINE).group(1))


def write_many_fields(file, prims: int) -> None:
    layer = Sdf.Layer.CreateNew(str(file))
    with Sdf.ChangeBlock():
        for i in range(prims):
            spec = Sdf.CreatePrimInLayer(layer, f"/World/p{i}")
            Sdf.AttributeSpec(spec, "x", Sdf.ValueTypeNames.Double).default = i / 3
    layer.Save()


def seconds_to_join(server, layer: str) -> float:
    begin = time.monotonic()
    with Peer(server.url) as peer:
        peer.send(control("openLayer", request=1, layer=layer, revision=0))
        peer.expect("layerOpened", timeout=60)
    return time.monotonic() - begin


def test_readers_of_old_checkpoints_delay_no_join(project, serve):
    """Two clients read as much as the server allows, and one joins."""
    write_many_fields(project / "big.usda", 40_000)
    for name in ("one.usda", "two.usda"):
        (project / name).write_text('#usda 1.0\ndef "World"\n{\n}\n')
    server = serve(project)
    seconds_to_join(server, "big.usda")
    alone = seconds_to_join(server, "one.usda")
    reads = 16
    with Peer(server.url) as first, Peer(server.url) as second:
        for reader in (first, second):
            for request in range(1, 1 + reads):
                reader.send(control("openLayer", request=request, layer="big.usda", revision=1))
        first.expect("layerOpened", timeout=60)  # they have begun
        begin = time.monotonic()
        imported, stored = seconds_to_join(server, "two.usda"), seconds_to_join(server, "one.usda")
        joined = time.monotonic() - begin
        begin = time.monotonic()
        second.timeout = 120
        for _ in range(reads):
            second.expect("layerOpened", timeout=120)
        left = time.monotonic() - begin
    # The readers took much longer, and the clients that joined did not wait for them.
    assert left > 2 * joined, (left, joined)
    assert max(imported, stored) < 1 + 5 * alone, (imported, stored, alone)


def test_layers_that_nobody_has_open_are_unloaded(project, serve):
    layers, fields = 60, 4_000
    for i in range(layers):
        write_many_fields(project / f"layer{i:03}.usdc", fields)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "watcher") as watcher:
        first = ada.open_layer("layer000.usdc")
        first.GetAttributeAtPath("/World/p1.x").default = 5.0
        ada.lock("layer000.usdc")
        assert ada.flush()
        ada.close_layer("layer000.usdc")
        wait(lambda: not opened(watcher, "ada"), ada, watcher)
        for i in range(1, layers):
            with Peer(server.url, user="bo") as peer:
                peer.send(control("openLayer", request=1, layer=f"layer{i:03}.usdc", revision=0))
                peer.expect("layerOpened", timeout=60)
        wait(lambda: metric(server, "usdlive_unloaded_layers_total") > 0, ada, watcher, timeout=100)
        # The state of a layer stays without its content, and a client that needs the content gets it again.
        watcher.tick()
        state = watcher.layer_states()["layer000.usdc"]
        assert state.dirty and state.locked and state.holder == "ada" and not state.editors
        again = watcher.open_layer("layer000.usdc")
        assert again.GetAttributeAtPath("/World/p1.x").default == 5.0
        assert watcher.save("layer000.usdc").failed[0][1] == "locked"
