"""N2: a connection that is cut again and again, often before a message has arrived completely. In the end all
have the same content, and each edit was committed once."""

import contextlib
import os
import random
import selectors
import socket
import threading
import time

import wire
from conftest import cat, unused_port
from pxr import Sdf

SECONDS = float(os.environ.get("USDLIVE_FLAPPING", "20"))
SEED = int(os.environ.get("USDLIVE_SEED", "1"))
NAMES = ("ada", "bo", "cleo")


class Line(threading.Thread):
    """A connection to the server that is cut for some time again and again: data on its way is lost with the
    connections, and new connections are refused during the cut."""

    def __init__(self, port, random_):
        super().__init__(daemon=True)
        self.port, self.random = port, random_
        self.cuts = self.made = 0
        self.selector = selectors.DefaultSelector()
        self.listener = None
        self.address = unused_port()  # nobody takes it during a cut
        self.listen(socket.create_server(("127.0.0.1", self.address)))
        self.pairs = {}
        self.flapping, self.whole_for_good = threading.Event(), threading.Event()
        self.done = threading.Event()
        self.failure = None
        self.start()

    def listen(self, listener):
        self.listener = listener
        self.selector.register(listener, selectors.EVENT_READ)

    def run(self):
        try:
            change = None
            while not self.done.is_set():
                self.carry()
                if change is None and self.flapping.is_set():  # everybody is connected
                    change = time.monotonic() + self.random.uniform(1, 3)
                if change is None or time.monotonic() < change:
                    continue
                if self.listener and not self.whole_for_good.is_set():
                    self.cut()
                    change = time.monotonic() + self.random.uniform(0.2, 1.5)
                elif not self.listener:
                    self.listen(socket.create_server(("127.0.0.1", self.address)))
                    change = time.monotonic() + self.random.uniform(1, 3)
        except BaseException as failure:  # raised again by end()
            self.failure = failure

    def carry(self):
        for key, _ in self.selector.select(0.02):
            one = key.fileobj
            if one is self.listener:
                self.accept()
                continue
            other = self.pairs.get(one)
            if other is None:  # closed in this turn
                continue
            try:
                data = one.recv(65536)
                if data:
                    other.sendall(data)
            except OSError:
                data = b""
            if not data:
                self.close(one)

    def accept(self):
        near = self.listener.accept()[0]
        far = socket.create_connection(("127.0.0.1", self.port))
        self.made += 1
        for one, other in ((near, far), (far, near)):
            self.pairs[one] = other
            self.selector.register(one, selectors.EVENT_READ)

    def close(self, one, reset=False):
        for end in (one, self.pairs.pop(one)):
            self.pairs.pop(end, None)
            self.selector.unregister(end)
            if reset:  # without a goodbye and without sending the rest
                with contextlib.suppress(OSError):
                    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            end.close()

    def cut(self):
        self.cuts += 1
        self.selector.unregister(self.listener)
        self.listener.close()
        self.listener = None
        while self.pairs:
            self.close(next(iter(self.pairs)), reset=self.random.random() < 0.5)

    def end(self):
        self.done.set()
        self.join(10)
        if self.failure:
            raise self.failure


class Through:
    """Gives Peer what it needs of a server, through a Line."""

    def __init__(self, line):
        self.url = f"ws://127.0.0.1:{line.address}"


WORK = (
    "import time\n"
    "a = stage.GetAttributeAtPath('/{name}.n')\n"
    "written, mine = 0, []\n"
    "def note(event):\n"
    " if type(event).__name__ == 'Committed' and event.client == live.id:\n"
    "  mine.extend(int(e.part) for e in event.edits if e.field == 'timeSamples')\n"
    "live.add_handler(note)\n"
    "end = time.monotonic() + {seconds}\n"
    "while time.monotonic() < end:\n"
    " if live.pending < 200:\n"
    "  written += 1\n"
    "  a.Set(written * 7, written)\n"
    "  if written % 50 == 0:\n"
    "   stage.DefinePrim('/{name}/P%d' % written, 'Xform')\n"
    " live.tick(); time.sleep(0.005)\n"
    "result = written")


def test_n2_a_flapping_line_loses_and_doubles_nothing(project, serve, editor, capfd):
    print(f"repeat with USDLIVE_SEED={SEED} USDLIVE_FLAPPING={SECONDS}")
    (project / "root.usda").write_text("#usda 1.0\n" + "".join(
        f'def "{name}"\n{{\n    int64 n\n}}\n' for name in NAMES))
    server = serve(project)
    random_ = random.Random(SEED)
    lines = {name: Line(server.port, random.Random(random_.random())) for name in NAMES}
    try:
        editors = {name: editor(Through(line), name, "root.usda") for name, line in lines.items()}
        for line in lines.values():
            line.flapping.set()
        threads, written = [], {}
        for name, one in editors.items():
            def work(name=name, one=one):
                written[name] = one.run(WORK.format(name=name, seconds=SECONDS))
            threads.append(threading.Thread(target=work, daemon=True))
            threads[-1].start()
        for thread in threads:
            thread.join(SECONDS + 60)
        assert set(written) == set(NAMES), "an editor did not reconnect"
        for line in lines.values():
            line.whole_for_good.set()
        healed = time.monotonic()
        revision = max(one.flush() for one in editors.values())
        for one in editors.values():
            one.catch_up(revision)
        took = time.monotonic() - healed
        text = cat(server, "root.usda")
        assert [one.text("root.usda") for one in editors.values()] == [text] * len(editors)
        stored = Sdf.Layer.CreateAnonymous(".usda")
        assert stored.ImportFromString(text)
        for name, one in editors.items():
            assert one.run("result = mine") == list(range(1, written[name] + 1)), f"{name}: not once each"
            path = Sdf.Path(f"/{name}.n")
            assert {int(t): stored.QueryTimeSample(path, t) for t in stored.ListTimeSamplesForPath(path)} == {
                n: n * 7 for n in range(1, written[name] + 1)}
            for number in range(50, written[name] + 1, 50):
                assert stored.GetPrimAtPath(f"/{name}/P{number}")
            assert one.run("result = [e.code for e in happened if type(e).__name__ == 'Lost']") == []
        with wire.Peer(server.url) as peer:
            commits = [(c["client"], c["sequence"]) for c in peer.log()]
        assert len(set(commits)) == len(commits) == peer.welcome["revision"], "committed twice"
    finally:
        for line in lines.values():
            line.end()
    with capfd.disabled():
        print(f"\nN2 seed {SEED}: {sum(written.values())} edits, {len(commits)} commits, "
              f"{sum(line.cuts for line in lines.values())} cuts, "
              f"{sum(line.made for line in lines.values())} connections, all there {took:.1f} s after the last")
    assert all(line.cuts >= SECONDS / 8 for line in lines.values())
