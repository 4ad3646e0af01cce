"""K1 at the critical places: the server dies at a named point of Faults.h, the first, second or third time
that it reaches it."""

import itertools
import os
import pathlib

import pytest
import wire
from conftest import Server, cat
from pxr import Sdf
from websockets.exceptions import WebSocketException

FAULTY = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "usdlive-server-faults"
KILLED = 9  # the exit status with which Faults.h ends the process
LAYERS = ("one.usda", "two.usda", "three.usda")
ROOT = '#usda 1.0\n\ndef "World"\n{\n    int64 n\n}\n\n'
EDITS = 12  # for each layer
BALLAST = wire.set_field("/World", "comment", wire.string("x" * 200_000))  # large enough to cause snapshots


class Author:
    """Sends one transaction after the other, for each layer in turn, and saves each layer from time to time."""

    def __init__(self, server, resume=None, client=None, history=()):
        self.peer = wire.Peer(server.url, client, resume=resume)
        self.history = list(history)  # the commits that it received

    def take(self, commit):
        self.peer.follow(commit)
        self.history.append((commit["revision"], commit["client"], commit["sequence"], commit["hash"]))

    def write(self, sequence):
        layer = LAYERS[sequence % len(LAYERS)]
        edit = wire.set_sample("/World.n", sequence, wire.int64(7 * sequence))
        self.peer.submit(sequence, layer, edit, BALLAST)
        while True:
            kind, members = self.peer.frame(20)
            if kind == "Commit":
                self.take(members)
                if members["client"] == self.peer.client and members["sequence"] == sequence:
                    return
            elif kind == "alreadyCommitted":
                # M9: it comes after the commit that it names, unless the client joined again.
                named = (self.peer.client, members["sequence"])
                assert not self.peer.welcome["resumed"] or named in {entry[1:3] for entry in self.history}
                if members["sequence"] == sequence:
                    return
            assert kind != "Refusal", members

    def save(self):
        self.peer.send(wire.control("saveLayers", request=1, layers=[]))
        while True:
            kind, members = self.peer.frame(20)
            if kind == "Commit":
                self.take(members)
            elif kind == "layersSaved":
                assert not members["failed"], members
                return


def samples(text):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text), "torn"
    path = Sdf.Path("/World.n")
    return {int(t): layer.QueryTimeSample(path, t) for t in layer.ListTimeSamplesForPath(path)}


def wanted(layer, upto):
    return {n: 7 * n for n in range(1, upto + 1) if LAYERS[n % len(LAYERS)] == layer}


@pytest.mark.parametrize("point,time", list(itertools.product(
    ("append-before", "append-after", "snapshot", "save-before", "save-after", "import"), (1, 2, 3))))
def test_k1_killed_at_a_named_point(point, time, project, tmp_path):
    for name in LAYERS:
        (project / name).write_text(ROOT)
    server = Server(project, tmp_path / "server.log")
    product, server.program = server.program, [str(FAULTY)]
    server.environment = {"USDLIVE_FAULT": f"{point}:{time}"}
    acknowledged = 0
    server.start()
    author = Author(server)
    try:
        for sequence in range(1, EDITS * len(LAYERS) + 1):
            author.write(sequence)
            acknowledged = sequence
            if sequence % 6 == 0:
                author.save()
        pytest.fail(f"{point} was not passed {time} times")
    except (OSError, WebSocketException, EOFError):
        assert server.process.wait(timeout=20) == KILLED, server.log.read_text()
    finally:
        author.peer.close()
        server.kill()

    # Files are complete, with their previous content or that of a requested save.
    for name in LAYERS:
        saved = samples((project / name).read_text())
        newest = max(saved, default=0)
        assert newest <= acknowledged and saved == wanted(name, newest)

    server.program, server.environment = product, {}
    server.start()
    try:
        with wire.Peer(server.url) as peer:
            stored = [(c["revision"], c["client"], c["sequence"], c["hash"]) for c in peer.log()] \
                if peer.revision else []
        assert stored[:len(author.history)] == author.history, "acknowledged and lost, or another history"
        # Transactions that were on their way are sent again, and are committed once.
        resume = author.peer.resume_point() if author.history else None
        again = Author(server, resume, author.peer.client, author.history)
        for sequence in range(acknowledged + 1, EDITS * len(LAYERS) + 1):
            again.write(sequence)
        again.save()
        log = again.peer.log()
        again.peer.close()
        own = [c["sequence"] for c in log if c["client"] == author.peer.client]
        assert own == list(range(1, EDITS * len(LAYERS) + 1)), "doubled, or out of order"
        for name in LAYERS:
            text = cat(server, name)
            assert samples(text) == wanted(name, EDITS * len(LAYERS))
            assert samples((project / name).read_text()) == samples(text)
    finally:
        assert server.stop() == 0
