"""K3: whichever unsynced writes a crash of the machine loses, everything acknowledged before it is there, in
order and chained, and the store opens. Also while a base replaces commits and unused big values are removed."""

import collections
import concurrent.futures
import filecmp
import hashlib
import json
import os
import pathlib
import random
import shutil
import time

import crash
import pytest
import wire
from conftest import Server, cat, run, wait
from pxr import Sdf
from websockets.exceptions import WebSocketException

# The number of places in each trace; each is tried with one choice of kept writes.
CRASHES = int(os.environ.get("USDLIVE_CRASHES", "12"))
SEED = int(os.environ.get("USDLIVE_SEED", "1"))
AT_ONCE = 2
INTERPOSER = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "interpose.so"
ROOT = '#usda 1.0\n\ndef "World"\n{\n    string s\n}\n\n'

BIG_SAMPLE = -1  # the sample that big values are written to, in turn
Acknowledged = collections.namedtuple("Acknowledged", "at epoch revision client sequence hash")
Compacted = collections.namedtuple("Compacted", "asked done base")  # the places in the trace, and to which revision
Recorded = collections.namedtuple("Recorded", "trace acknowledged history compacted big")


class Author:
    """Writes samples, and notes the length of the trace when it received each acknowledgement: everything
    later in the trace happened after this promise."""

    def __init__(self, server, trace, random_, first):
        self.trace, self.random, self.first = trace, random_, first
        self.peer = wire.Peer(server.url)
        self.sequence = self.waiting = 0
        self.acknowledged = []
        self.big = {}  # big values by the transaction that names them: (client, sequence)

    def write_big(self, count):
        for _ in range(count):
            content = wire.string_bytes(self.random.randbytes(150_000).hex())
            self.sequence += 1
            self.big[self.peer.client, self.sequence] = hashlib.sha256(content).hexdigest()
            self.waiting += 1
            while self.waiting:
                # Again, if the server has removed the value before a transaction named it (B6).
                self.peer.upload(content)
                self.peer.submit(self.sequence, "root.usda",
                                 wire.set_sample("/World.s", BIG_SAMPLE, wire.big_string(content)))
                self.take()

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
        """Notes the next commit. Returns also if a big value was removed before it was named."""
        kind, commit = self.peer.expect_one_of({"Commit", "Refusal"}, 30)
        if kind == "Refusal":
            assert commit["code"] == "blobNotFound", commit
            return
        size = self.trace.stat().st_size
        self.peer.follow(commit)
        self.waiting -= commit["client"] == self.peer.client
        self.acknowledged.append(Acknowledged(size, commit["epoch"], commit["revision"], commit["client"],
                                              commit["sequence"], commit["hash"]))


def record(project, tmp_path, unsynced, compacts):
    """Runs three servers one after the other, each of them killed. `unsynced`: the first one is killed
    between a write and its sync, so that the next one finds data that is not on the disk."""
    random_ = random.Random(SEED)
    options = ("--keep-unused-blobs", "0") if compacts else ()
    server, trace = Server(project, tmp_path / "recorded.log", *options), tmp_path / "trace"
    made = Recorded(trace, [], [], [], {})
    try:
        for life in range(3):
            fault = f"sync:{random_.randint(40, 80)}:KILL" if unsynced and life == 0 else None
            server.environment = crash.environment(project, trace, INTERPOSER, fault)
            server.start()
            author = Author(server, trace, random_, 1000 * life)
            try:
                author.write(40, 1, 2000)
                if compacts:
                    author.write_big(3)
                    compact(server, made)
                    author.write_big(2)
                author.write(60, 8, 2000)
                author.write(24, 4, 250_000)
            except (OSError, WebSocketException, EOFError):
                assert fault
            made.acknowledged.extend(author.acknowledged)
            made.big.update(author.big)
            author.peer.close()
            if fault:
                server.process.wait(timeout=20)
            else:
                follow(server, made)
                if compacts:
                    # Values that were replaced in this run are not named any more: two remain, and those of
                    # the base.
                    wait(lambda: len(values(project)) <= 3, timeout=30)
                at_rest(trace)
                server.kill()
    finally:
        server.kill()
    return made


def follow(server, made):
    base, log = log_of(server)
    made.history.extend(log[len(made.history) - base:])


def compact(server, made):
    """Replaces all commits so far with a base."""
    follow(server, made)
    asked = made.trace.stat().st_size
    base = json.loads(run("compact", server.url, "--days", "0", "--json"))["base"]
    assert base == len(made.history)
    made.compacted.append(Compacted(asked, made.trace.stat().st_size, base))


def values(project):
    return {path.name: path for path in (project / ".usdlive/blobs").glob("??/*") if len(path.name) == 64}


def at_rest(trace):
    """Waits until no snapshot is being written: they are written beside the commits, and a kill in between
    would cut the trace itself."""
    size = -1
    while size != (size := trace.stat().st_size):
        time.sleep(0.3)


def log_of(server):
    """Returns (base, commits after it)."""
    with wire.Peer(server.url) as peer:
        base = peer.welcome["base"]
        if peer.revision == base:
            return base, []
        return base, [(c["revision"], c["client"], c["sequence"], c["hash"]) for c in peer.log(0)]


class Wrong(Exception):
    pass


def judge(server, made, place, whole, refusal):
    """Returns how many commits without an acknowledgement are there, too; None if the store was refused,
    where that is allowed."""
    acknowledged = [one for one in made.acknowledged if one.at <= place]
    newest = acknowledged[-1].revision if acknowledged else 0
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
        base, log = log_of(server)
        bases = [one.base for one in made.compacted if one.asked <= place]
        promised = [one.base for one in made.compacted if one.done <= place]
        if base not in [*promised[-1:], *bases[len(promised):], *([] if promised else [0])]:
            raise Wrong(f"the history begins after {base}: {promised} were done, {bases} asked for")
        head = base + len(log)
        if head < newest:
            raise Wrong(f"revision {newest} was acknowledged, {head} is there")
        if log != made.history[base:head]:
            raise Wrong("the history differs from the acknowledged one")
        with wire.Peer(server.url) as peer:
            if acknowledged and peer.epoch <= acknowledged[-1].epoch:
                raise Wrong(f"SE3: epoch {peer.epoch} after {acknowledged[-1].epoch}")
        big = [(one[0], made.big[one[1:3]]) for one in made.history[:head] if one[1:3] in made.big]
        named = {value for revision, value in big if revision > base} | {value for _, value in big[-1:]}
        for value in named:
            path = values(server.folder).get(value)
            if not path or hashlib.sha256(path.read_bytes()).hexdigest() != value:
                raise Wrong(f"the big value {value} is not there")
        if whole and head:
            layer = Sdf.Layer.CreateAnonymous(".usda")
            if not layer.ImportFromString(cat(server, "root.usda")):
                raise Wrong("the layer does not parse")
            small = sum(bool(one[1]) and one[1:3] not in made.big for one in made.history[:head])
            if layer.GetNumTimeSamplesForPath("/World.s") != small + bool(big):
                raise Wrong("the layer differs from the history")
            if big:
                text = wire.string_bytes(layer.QueryTimeSample("/World.s", BIG_SAMPLE))
                if hashlib.sha256(text).hexdigest() != big[-1][1]:
                    raise Wrong("the layer has another big value")
        return head - newest
    finally:
        server.process.kill()
        server.process.wait()


def same(one, other):
    compared = filecmp.dircmp(one, other)
    different = compared.left_only + compared.right_only + filecmp.cmpfiles(
        one, other, compared.common_files, shallow=False)[1]
    return different + [name for sub in compared.common_dirs for name in same(one / sub, other / sub)]


def places(records, made, random_):
    """Returns ends of records: half of them anywhere, or while a base replaces commits; half of them right
    after an acknowledgement."""
    ends = [one.end for one in records]
    if made.compacted:
        ends = [end for end in ends
                if any(one.asked <= end <= one.done + (one.done - one.asked) for one in made.compacted)]
    promised = sorted({one.at for one in made.acknowledged})
    chosen = [random_.choice(ends if number % 2 else promised) for number in range(CRASHES)]
    # The first opening of a store takes a short part of the trace.
    first = promised[0]
    opening = [end for end in ends if end < first]
    return sorted(chosen + random_.sample(opening, min(len(opening), CRASHES // 8)))


@pytest.mark.parametrize("journal,pages,unsynced,compacts", [
    pytest.param(True, False, False, False, id="journal"),
    pytest.param(True, True, False, False, id="pages"),
    pytest.param(False, False, False, False, id="posix"),
    pytest.param(True, False, True, False, id="unsynced"),
    pytest.param(True, False, False, True, id="compacted"),
    pytest.param(False, False, False, True, id="compacted-posix"),
])
def test_k3_acknowledged_edits_survive_a_crash_of_the_machine(journal, pages, unsynced, compacts, project,
                                                              tmp_path, capfd):
    """If the pages of the last write are kept in any order, the log may have a hole before its end, which is
    reported as damage. Then the store may be refused, but never shortened."""
    print(f"repeat with USDLIVE_SEED={SEED} USDLIVE_CRASHES={CRASHES}")
    (project / "root.usda").write_text(ROOT)
    before = tmp_path / "before"
    shutil.copytree(project, before)
    made = record(project, tmp_path, unsynced, compacts)
    records = list(crash.records(made.trace))
    disk = crash.Disk(before)
    left = collections.deque(records)

    def crashed(number, folder, place, kept):
        try:
            more = judge(Server(folder, folder.with_suffix(".log")), made, place, compacts or number % 5 == 0,
                         pages)
        except Exception as failure:  # a lost connection is a fault, too
            return f"{folder.name} at {place} ({kept}): {type(failure).__name__}: {failure}", 0
        shutil.rmtree(folder)
        return None, more

    tried = []
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        for number, place in enumerate(places(records, made, random.Random(SEED))):
            while left and left[0].end <= place:
                disk.take(left.popleft())
            folder = tmp_path / f"crash{number}"
            kept = crash.Kept(random.Random(f"{SEED} {number}"), journal, pages, least=number % 4 == 0)
            disk.write(folder, kept)
            tried.append(pool.submit(crashed, number, folder, place, kept))
            if number >= 2 * AT_ONCE:
                tried[number - 2 * AT_ONCE].result()  # limits the number of folders that exist at the same time
    for one in left:
        disk.take(one)
    disk.write(tmp_path / "all", crash.Everything())
    missed = same(tmp_path / "all", project)
    assert not missed, f"the interposer does not see how these are written: {missed}"
    results = [one.result() for one in tried]
    wrong = [one[0] for one in results if one[0]]
    refused = sum(one[1] is None for one in results)
    with capfd.disabled():
        print(f"\nK3 seed {SEED}: {len(results)} crashes over {len(records)} calls, {len(made.history)} commits, "
              f"{refused} refused, {len(wrong)} wrong")
    assert not wrong, f"{len(wrong)} of {len(results)}:\n" + "\n".join(wrong[:20])
    assert refused <= len(results) // 4, "too few places tested what they should"
