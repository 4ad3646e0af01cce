"""N1, N4: loss, delay and a partition between editors and their server, over both transports. Editors on both
sides end with the same content, byte for byte, and each edit was committed once."""

import os
import threading
import time

import network
import pytest
from conftest import Peer, Server
from flapping_test import WORK
from pxr import Sdf

SEED = int(os.environ.get("USDLIVE_SEED", "1"))
ROOT = '#usda 1.0\ndef "ada"\n{\n    int64 n\n}\ndef "bo"\n{\n    int64 n\n}\n'


@pytest.fixture
def near_and_far():
    """The namespace of the server, the other one, and the link between them."""
    made = []
    try:
        for address in ("10.77.0.1", "10.77.0.2"):
            made.append(network.Namespace(address))
    except network.Refused as refusal:
        for one in made:
            one.close()
        pytest.skip(f"this kernel does not let the test make a network of its own: {refusal}")
    line = network.Line(*made, SEED)
    yield *made, line
    try:
        line.end()
    finally:
        for one in made:
            one.close()


@pytest.fixture(params=["websocket", "dds"])
def world(request, near_and_far, tmp_path, monkeypatch):
    """An editor beside the server and one at the far end."""
    near, far, line = near_and_far
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "root.usda").write_text(ROOT)
    monkeypatch.setenv("USDLIVE_DDS_INTERFACE", network.INTERFACE)
    server = Server(folder, tmp_path / "server.log", "--host", near.address, "--insecure", "--dds", "--dds-interface",
                    network.INTERFACE)
    server.program = [*near.enter, *server.program]
    server.start()
    url = "dds://project" if request.param == "dds" else f"ws://{near.address}:{server.port}"
    peers = [Peer(url, user, "root.usda", tmp_path / f"{user}.log", where.enter)
             for user, where in (("ada", near), ("bo", far))]
    yield line, peers
    for peer in peers:
        peer.process.kill()
        peer.process.wait()
    assert server.stop() == 0, server.log.read_text()


def edit(peers, seconds, meanwhile=None):
    """Both edit for some seconds; returns the edits of each."""
    written = {}
    threads = []
    for name, peer in zip(("ada", "bo"), peers):
        def work(name=name, peer=peer):
            written[name] = peer.run(WORK.format(name=name, seconds=seconds))
        threads.append(threading.Thread(target=work, daemon=True))
        threads[-1].start()
    if meanwhile:
        meanwhile()
    for thread in threads:
        thread.join(seconds + 60)
    assert set(written) == {"ada", "bo"}, "an editor did not reconnect"
    return written


def wait_until_equal(peers, written, within):
    """Waits until all have the same content, within some seconds, and checks that each edit is there once."""
    begin = time.monotonic()
    revision = max(peer.flush() for peer in peers)
    for peer in peers:
        peer.catch_up(revision)
    took = time.monotonic() - begin
    assert took < within, f"it took {took:.1f} s"
    texts = {peer.text("root.usda") for peer in peers}
    assert len(texts) == 1
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(texts.pop())
    for name, peer in zip(("ada", "bo"), peers):
        assert peer.run("result = mine") == list(range(1, written[name] + 1)), f"{name}: not once each"
        path = Sdf.Path(f"/{name}.n")
        assert {int(t): layer.QueryTimeSample(path, t) for t in layer.ListTimeSamplesForPath(path)} == {
            n: n * 7 for n in range(1, written[name] + 1)}
        assert peer.run("result = [e.code for e in happened if type(e).__name__ == 'Lost']") == []
    return took


@pytest.mark.parametrize("loss", [0.02, 0.10])
def test_n1_loss(world, loss):
    line, peers = world
    line.loss = loss
    written = edit(peers, 6)
    wait_until_equal(peers, written, 20)
    assert line.lost > 20 and min(written.values()) > 50


def test_n1_delay_and_reordering(world):
    line, peers = world
    line.delay, line.jitter = 0.06, 0.03
    written = edit(peers, 6)
    wait_until_equal(peers, written, 10)
    assert min(written.values()) > 50


def test_n4_a_partition_that_heals(world):
    """The partition lasts longer than the time after which a silent peer is disconnected: both sides notice,
    and the far editor reconnects."""
    line, peers = world

    def cut_and_heal():
        time.sleep(2)
        line.is_cut = True
        time.sleep(18)
        line.is_cut = False
        line.loss = 0.02

    written = edit(peers, 21, cut_and_heal)
    wait_until_equal(peers, written, 30)
    assert peers[1].run("result = [type(e).__name__ for e in happened].count('Disconnected')") >= 1
    assert peers[0].run("result = [type(e).__name__ for e in happened].count('Disconnected')") == 0


def test_dd15_a_change_of_address(world, near_and_far):
    """The far editor's machine gets another address while both edit: it comes back without help, and says why it was
    away."""
    _, peers = world
    far = near_and_far[1]

    def change():
        time.sleep(1)
        far.move("10.77.0.3")
        time.sleep(1)

    written = edit(peers, 3, change)
    wait_until_equal(peers, written, 30)
    dropped = peers[1].run("result = [e.message for e in happened if type(e).__name__ == 'Disconnected']")
    assert dropped
    if peers[1].run("import sys; result = sys.argv[1]").startswith("dds"):
        assert "10.77.0.2" in dropped[0] and "10.77.0.3" in dropped[0], dropped
    assert peers[0].run("result = [type(e).__name__ for e in happened].count('Disconnected')") == 0
