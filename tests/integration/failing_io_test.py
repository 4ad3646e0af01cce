"""A system call of the server fails, or writes less than requested. Acknowledged edits are on the disk all
the same, others are refused with a code, and the store contains nothing wrong afterwards."""

import collections
import concurrent.futures
import os
import pathlib
import random
import shutil
import signal
import time

import crash
import pytest
import wire
from conftest import Server
from websockets.exceptions import WebSocketException

# Failing calls of each kind.
FAILURES = int(os.environ.get("USDLIVE_FAILURES", "6"))
SEED = int(os.environ.get("USDLIVE_SEED", "1"))
AT_ONCE = 2
INTERPOSER = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "interpose.so"
ROOT = '#usda 1.0\n\ndef "World"\n{\n    string s\n}\n\n'
EDITS = 30

# The record that the trace has for a call of the failing kind.
KINDS = {"sync": "s", "write": "w", "rename": "r", "create": "o"}
OPENING = 24  # about how many syncs a new store makes before anything is acknowledged


class Wrong(Exception):
    pass


class Author:
    """Writes samples, four at a time, and notes the answer to each."""

    def __init__(self, server, patience):
        self.peer, self.patience = wire.Peer(server.url), patience
        self.acknowledged, self.refused = [], collections.Counter()
        self.written = self.answered = 0
        self.random = random.Random(SEED)

    def write(self, count):
        for _ in range(count):
            self.written += 1
            text = "x" * self.random.choice((10, 1000, 70_000))
            self.peer.submit(self.written, "root.usda",
                             wire.set_sample("/World.s", self.written, wire.string(text)))
            while self.written - self.answered >= 4:
                self.take()
        while self.answered < self.written:
            self.take()

    def take(self):
        kind, members = self.peer.frame(self.patience)
        if kind == "Commit":
            self.peer.epoch = max(self.peer.epoch, members["epoch"])  # SE12: the store may have been opened again
            self.peer.follow(members)
            self.acknowledged.append(
                (members["revision"], members["client"], members["sequence"], members["hash"]))
            self.answered += members["client"] == self.peer.client
        elif kind == "Refusal":
            self.answered += 1
            self.refused[members["code"]] += 1
        elif kind == "errorMessage" and members["closing"]:
            raise Wrong(f"the session is ended: {members['code']}: {members['message']}")


def log_of(server):
    with wire.Peer(server.url) as peer:
        return [(c["revision"], c["client"], c["sequence"], c["hash"])
                for c in (peer.log() if peer.revision else [])]


def up(server, seconds=20):
    """Returns True once the server serves, False if it ended."""
    server.launch()
    end = time.monotonic() + seconds
    while not server.port_file.exists():
        if server.process.poll() is not None:
            return False
        if time.monotonic() > end:
            raise Wrong("neither serves nor ends")
        time.sleep(0.005)
    server.port = int(server.port_file.read_text())
    return True


def ended(server, *codes):
    code = server.process.wait(timeout=20)
    if code not in codes:
        raise Wrong(f"ended with {code}: {server.log.read_text()[-1500:]}")


def audit(folder, acknowledged, where):
    server = Server(folder, folder.with_suffix(f".{where}.log"))
    try:
        if not up(server):
            raise Wrong(f"{where}: does not open: {server.log.read_text()[-1000:]}")
        log = log_of(server)
        if log[:len(acknowledged)] != acknowledged:
            raise Wrong(f"{where}: {len(acknowledged)} commits were acknowledged, {len(log)} are there, "
                        f"{sum(a == b for a, b in zip(log, acknowledged))} of them the same")
    finally:
        server.process.kill()
        server.process.wait()


def new_client_waits(server):
    """Only the store knows whether an edit of a new client was committed before: it waits."""
    newcomer = Author(server, 3)
    try:
        newcomer.write(1)
    except TimeoutError:
        pass
    finally:
        newcomer.peer.close()
    if newcomer.answered:
        raise Wrong(f"SE8: a newcomer was answered: {newcomer.acknowledged or newcomer.refused}")


def is_refused(author):
    """SE8, for a client that has no transactions on their way."""
    author.write(1)
    if author.refused != {"storageFailed": 1}:
        raise Wrong(f"SE8: answered by {author.acknowledged or author.refused}")


def work(server, folder, goes_on=False, refusals=False):
    """Returns (acknowledged, outcome) of a server in which something fails. With `goes_on` it works again
    afterwards; with `refusals` new edits are refused and the server can be stopped."""
    if not up(server):
        ended(server, 1)
        said = [line for line in server.log.read_text().splitlines() if not line.startswith("{")]
        if len(said) != 1 or str(folder) not in said[0]:
            raise Wrong(f"does not say in a line what failed: {said}")
        return [], "does not start"
    author = Author(server, 3 if goes_on else 15)
    other = Author(server, 10)
    outcome = "goes on"
    try:
        if refusals:
            other.write(1)
        author.write(EDITS)
        outcome = "refuses some" if author.refused else outcome
        if author.refused and not goes_on:
            accepted_again(author)
    except TimeoutError:
        # Before the store can be opened again, nobody knows whether they are on the disk.
        if not goes_on:
            raise Wrong(f"not answered: {server.log.read_text()[-1000:]}") from None
        new_client_waits(server)
        # It also waits when its own edit is on its way: the commit of the import may have been acknowledged
        # alone.
        if other.written and other.answered == other.written:
            is_refused(other)
        outcome = "leaves some unanswered"
    except (OSError, WebSocketException, EOFError):
        ended(server, 1)
        return author.acknowledged, "ends"
    finally:
        author.peer.close()
        other.peer.close()
    if not set(author.refused) <= {"storageFailed", "storageFull"}:
        raise Wrong(f"refused with {dict(author.refused)}")
    if not goes_on or refusals:
        begin = time.monotonic()
        server.process.send_signal(signal.SIGTERM)
        ended(server, 0)
        if time.monotonic() - begin > 5:
            raise Wrong("a stop took more than 5 s")
    return author.acknowledged, outcome


def accepted_again(author):
    end = time.monotonic() + 10
    while not author.acknowledged or author.acknowledged[-1][2] != author.written:
        if time.monotonic() > end:
            raise Wrong("the fault is over, and edits are still refused")
        time.sleep(0.1)
        author.write(1)


def try_one(folder, fault, machine, refusals):
    """Returns (outcome, fault)."""
    project, trace = folder / "project", folder / "trace"
    project.mkdir(parents=True)
    (project / "root.usda").write_text(ROOT)
    disk = crash.Disk(project)
    server = Server(project, folder / "server.log")
    server.environment = crash.environment(project, trace, INTERPOSER, fault)
    try:
        acknowledged, outcome = work(server, project, fault.endswith("+"), refusals)
        server.kill()
        if machine:
            for record in crash.records(trace):
                disk.take(record)
            disk.write(folder / "crashed", crash.Kept(random.Random(SEED), least=True))
            audit(folder / "crashed", acknowledged, "after a crash of the machine")
        audit(project, acknowledged, "started again")
    except Exception as failure:  # a lost connection is a fault, too
        return "wrong", f"{fault}: {type(failure).__name__}: {failure}"
    finally:
        server.process.kill()
        server.process.wait()
    shutil.rmtree(folder)
    return outcome, None


def calls(tmp_path):
    """Returns how many calls of each kind the work makes when nothing fails."""
    project, trace = tmp_path / "project", tmp_path / "trace"
    project.mkdir()
    (project / "root.usda").write_text(ROOT)
    server = Server(project, tmp_path / "counted.log")
    server.environment = crash.environment(project, trace, INTERPOSER)
    assert work(server, project)[1] == "goes on"
    return collections.Counter(one.did for one in crash.records(trace)
                               if one.did != "o" or one.number & crash.CREATES)


@pytest.mark.parametrize("chosen,begin,machine,refusals", [
    pytest.param(["write:EIO", "write:SHORT", "write:TORN", "write:ENOSPC", "rename:EIO", "create:ENOSPC"],
                 0, True, False, id="once"),
    pytest.param(["sync:EIO"], 0, False, False, id="sync"),
    pytest.param(["sync:EIO+", "write:EIO+"], 0, True, False, id="stays"),
    pytest.param(["sync:EIO"], OPENING, True, False, id="sync, then the machine crashes"),
    pytest.param(["sync:EIO+"], OPENING, False, True, id="stays, refused"),
])
def test_d2_a_failing_call_loses_nothing_that_was_acknowledged(chosen, begin, machine, refusals, tmp_path,
                                                               capfd):
    """`machine`: checks also what a crash of the machine leaves. A failed sync has lost its data, although it
    can be read until the crash."""
    print(f"repeat with USDLIVE_SEED={SEED} USDLIVE_FAILURES={FAILURES}")
    random_ = random.Random(SEED)
    counted = calls(tmp_path)
    faults = []
    for one in chosen:
        kind, what = one.split(":")
        possible = range(begin + 1, counted[KINDS[kind]])
        places = sorted(random_.sample(possible, min(FAILURES, len(possible))))
        faults += [f"{kind}:{place}:{what}" for place in places]
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        results = list(pool.map(
            lambda fault: try_one(tmp_path / fault.replace(":", "-"), fault, machine, refusals), faults))
    wrong = [one[1] for one in results if one[1]]
    with capfd.disabled():
        print(f"\nD2 seed {SEED}: {len(faults)} calls failed ({', '.join(chosen)}) of "
              f"{sum(counted.values())}: {dict(collections.Counter(one[0] for one in results))}")
    print(*(f"  {fault}: {one[0]}" for fault, one in zip(faults, results)), sep="\n")
    assert not wrong, f"{len(wrong)} of {len(faults)}:\n" + "\n".join(wrong)
