"""K3: whatever of the unsynced writes a crash of the machine takes along, what was acknowledged before it is
there, in order and chained, and the store opens."""

import collections
import concurrent.futures
import filecmp
import os
import pathlib
import random
import shutil
import time

import crash
import pytest
import wire
from conftest import Server, cat
from pxr import Sdf
from websockets.exceptions import WebSocketException

# Places in each trace, each with one choice of what is kept.
CRASHES = int(os.environ.get("USDLIVE_CRASHES", "40"))
SEED = int(os.environ.get("USDLIVE_SEED", "1"))
AT_ONCE = 2
INTERPOSER = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "interpose.so"
ROOT = '#usda 1.0\n\ndef "World"\n{\n    string s\n}\n\n'

Acknowledged = collections.namedtuple("Acknowledged", "at epoch revision client sequence hash")


class Author:
    """Writes samples, and knows how long the trace was when it saw each acknowledged: all that comes
    after in the trace was done with that promise given."""

    def __init__(self, server, trace, random_, first):
        self.trace, self.random, self.first = trace, random_, first
        self.peer = wire.Peer(server.url)
        self.sequence = self.waiting = 0
        self.acknowledged = []

    def write(self, count, window, most):
        for _ in range(count):
            self.sequence += 1
            text = self.random.randbytes(self.random.randint(1, most) // 2).hex()
            self.peer.submit(self.sequence, "root.usda",
                             wire.set_sample("/World.s", self.first + self.sequence, wire.string(text)))
            self.waiting += 1
            while self.waiting >= window:
                self.take()
        while self.waiting:
            self.take()

    def take(self):
        commit = self.peer.expect("Commit", 30)
        size = self.trace.stat().st_size
        self.peer.follow(commit)
        self.waiting -= commit["client"] == self.peer.client
        self.acknowledged.append(Acknowledged(size, commit["epoch"], commit["revision"], commit["client"],
                                              commit["sequence"], commit["hash"]))


def record(project, tmp_path, unsynced):
    """Three servers after each other, each killed: (trace, what was acknowledged, history). `unsynced`:
    the first one is killed between a write and its sync, so that the next finds what is not on the disk."""
    random_ = random.Random(SEED)
    server, trace = Server(project, tmp_path / "recorded.log"), tmp_path / "trace"
    acknowledged = []
    try:
        for life in range(3):
            fault = f"sync:{random_.randint(40, 80)}:KILL" if unsynced and life == 0 else None
            server.environment = crash.environment(project, trace, INTERPOSER, fault)
            server.start()
            author = Author(server, trace, random_, 1000 * life)
            try:
                author.write(40, 1, 2000)
                author.write(60, 8, 2000)
                author.write(24, 4, 250_000)
            except (OSError, WebSocketException, EOFError):
                assert fault
            acknowledged += author.acknowledged
            author.peer.close()
            if fault:
                server.process.wait(timeout=20)
            else:
                history = log_of(server)
                at_rest(trace)
                server.kill()
    finally:
        server.kill()
    return trace, acknowledged, history


def at_rest(trace):
    """Snapshots are written beside the commits; a kill in the midst would tear the trace itself."""
    size = -1
    while size != (size := trace.stat().st_size):
        time.sleep(0.3)


def log_of(server):
    with wire.Peer(server.url) as peer:
        if peer.revision == 0:
            return []
        return [(c["revision"], c["client"], c["sequence"], c["hash"]) for c in peer.log()]


class Wrong(Exception):
    pass


def judge(server, acknowledged, history, whole, refusal):
    """How many commits that nobody was told of are there, too; None: it was refused, where that may be."""
    server.launch()
    try:
        end = time.monotonic() + 30
        while not server.port_file.exists():
            if (code := server.process.poll()) is not None:
                said = server.log.read_text().strip()
                if refusal and code == 1 and "\n" not in said and str(server.folder / ".usdlive") in said:
                    return None
                raise Wrong(f"does not open, ended with {code}: {said[-1000:]}")
            if time.monotonic() > end:
                raise Wrong("neither serves nor ends")
            time.sleep(0.005)
        server.port = int(server.port_file.read_text())
        log = log_of(server)
        if len(log) < len(acknowledged):
            raise Wrong(f"{len(acknowledged)} commits were acknowledged, {len(log)} are there")
        if log != history[:len(log)]:
            raise Wrong("the history is another one")
        with wire.Peer(server.url) as peer:
            if acknowledged and peer.epoch <= acknowledged[-1].epoch:
                raise Wrong(f"SE3: epoch {peer.epoch} after {acknowledged[-1].epoch}")
        if whole and log:
            layer = Sdf.Layer.CreateAnonymous(".usda")
            if not layer.ImportFromString(cat(server, "root.usda")):
                raise Wrong("the layer does not parse")
            if layer.GetNumTimeSamplesForPath("/World.s") != sum(bool(c[1]) for c in log):
                raise Wrong("the layer is not that of the history")
        return len(log) - len(acknowledged)
    finally:
        server.process.kill()
        server.process.wait()


def same(one, other):
    compared = filecmp.dircmp(one, other)
    different = compared.left_only + compared.right_only + filecmp.cmpfiles(
        one, other, compared.common_files, shallow=False)[1]
    return different + [name for sub in compared.common_dirs for name in same(one / sub, other / sub)]


def places(records, acknowledged, random_):
    """Ends of records: half anywhere, half where something had just been acknowledged."""
    ends = [one.end for one in records]
    promised = sorted({one.at for one in acknowledged})
    chosen = [random_.choice(ends if number % 2 else promised) for number in range(CRASHES)]
    # The first opening of a store is short in the trace.
    first = promised[0]
    opening = [end for end in ends if end < first]
    return sorted(chosen + random_.sample(opening, min(len(opening), CRASHES // 8)))


@pytest.mark.parametrize("journal,pages,unsynced", [
    pytest.param(True, False, False, id="journal"),
    pytest.param(True, True, False, id="pages"),
    pytest.param(False, False, False, id="posix"),
    pytest.param(True, False, True, id="unsynced"),
])
def test_k3_acknowledged_edits_survive_a_crash_of_the_machine(journal, pages, unsynced, project, tmp_path,
                                                              capfd):
    """Where pages of the last write are kept in any order, the log may have a hole in front of its end, which
    is told as damage: then it may be refused, never shortened."""
    print(f"repeat with USDLIVE_SEED={SEED} USDLIVE_CRASHES={CRASHES}")
    (project / "root.usda").write_text(ROOT)
    before = tmp_path / "before"
    shutil.copytree(project, before)
    trace, acknowledged, history = record(project, tmp_path, unsynced)
    records = list(crash.records(trace))
    disk = crash.Disk(before)
    left = collections.deque(records)

    def crashed(number, folder, promised, place, kept):
        try:
            more = judge(Server(folder, folder.with_suffix(".log")), promised, history, number % 5 == 0,
                         pages)
        except Exception as failure:  # a lost connection is wrong, too
            return (f"{folder.name} at {place} ({kept}), {len(promised)} acknowledged: "
                    f"{type(failure).__name__}: {failure}"), 0
        shutil.rmtree(folder)
        return None, more

    tried = []
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        for number, place in enumerate(places(records, acknowledged, random.Random(SEED))):
            while left and left[0].end <= place:
                disk.take(left.popleft())
            folder = tmp_path / f"crash{number}"
            kept = crash.Kept(random.Random(f"{SEED} {number}"), journal, pages, least=number % 4 == 0)
            disk.write(folder, kept)
            promised = [one for one in acknowledged if one.at <= place]
            tried.append(pool.submit(crashed, number, folder, promised, place, kept))
            if number >= 2 * AT_ONCE:
                tried[number - 2 * AT_ONCE].result()  # not all folders at the same time
    for one in left:
        disk.take(one)
    disk.write(tmp_path / "all", crash.Everything())
    missed = same(tmp_path / "all", project)
    assert not missed, f"the interposer does not see how these are written: {missed}"
    results = [one.result() for one in tried]
    wrong = [one[0] for one in results if one[0]]
    refused = sum(one[1] is None for one in results)
    with capfd.disabled():
        print(f"\nK3 seed {SEED}: {len(results)} crashes over {len(records)} calls, {len(history)} commits, "
              f"{refused} refused, {len(wrong)} wrong")
    assert not wrong, f"{len(wrong)} of {len(results)}:\n" + "\n".join(wrong[:20])
    assert refused <= len(results) // 4, "the places do not say anything"
