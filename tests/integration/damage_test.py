"""K5: a store with a flipped byte or a file that ends early is served exactly as it was acknowledged, or
refused with a message. There is never a shortened history, a crash or a hang."""

import collections
import concurrent.futures
import os
import pathlib
import random
import shutil
import signal
import subprocess
import time

import pytest
import wire
from conftest import Server, cat

PLACES = int(os.environ.get("USDLIVE_DAMAGES", "120"))
SEED = int(os.environ.get("USDLIVE_SEED", "1"))
AT_ONCE = 2
LAYERS = ("root.usda", "look.usda")
# `lock` has no content, `reserve` only takes space.
PASSED_OVER = ("lock", "LOCK", "reserve", "server.json")


class Truth:
    """The acknowledged content, and the store that holds it."""

    def __init__(self, server: Server, folder: pathlib.Path):
        self.texts = {name: cat(server, name) for name in LAYERS}
        with wire.Peer(server.url) as peer:
            self.epoch = peer.epoch
            self.commits = [(c["revision"], c["client"], c["sequence"], c["hash"]) for c in peer.log()]
        server.kill()
        self.folder = folder
        self.files = sorted(p.relative_to(folder) for p in (folder / ".usdlive").rglob("*")
                            if p.is_file() and p.name not in PASSED_OVER and p.stat().st_size)


def write_by_wire(server: Server) -> None:
    """Several authors whose ids answers_of() can use: they have no secret (ID5)."""
    for name in LAYERS:
        with wire.Peer(server.url) as peer:
            for number in range(1, 21):
                peer.submit(number, name, wire.set_sample("/World.s", 1000 + number, wire.string(peer.client)))
            kind, members = "", {}
            while (kind, members.get("sequence")) != ("Commit", 20):
                kind, members = peer.frame(20)


def a_store(project, serve, editor) -> Truth:
    """Creates a store with tables, a log that is not in them yet, several epochs in this log, big values and
    snapshots."""
    for name in LAYERS:
        many = "".join(f"    double d{i} = {i}\n" for i in range(10_000))  # a snapshot is due at once
        (project / name).write_text('#usda 1.0\n\ndef "World"\n{\n    string s\n' + many + "}\n\n")
    server = serve(project)
    for life in range(3):
        for name in LAYERS:
            one = editor(server, f"ada{life}", name)
            one.run(
                "import random, time\n"
                f"letters = random.Random({life})\n"
                "a = stage.GetAttributeAtPath('/World.s')\n"
                f"a.Set(''.join(letters.choices('abcdefgh', k=300000)), {life})\n"
                "live.flush(20)\n"
                "for i in range(60):\n"
                f" stage.DefinePrim(f'/World/P{life}_{{i}}', 'Xform')\n"
                f" a.Set(str(i) * 50, 10 * {life} + i / 100 + 1)\n"
                " live.tick(); time.sleep(0.001)\n"
                f"e = Usd.NamespaceEditor(stage); e.MovePrimAtPath('/World/P{life}_1', '/World/Q{life}')\n"
                "assert e.ApplyEdits() and live.flush(20)\n")
            one.close()
        write_by_wire(server)
        if life < 2:
            server.kill()
            server.start()
    return Truth(server, project)


def damage(path: pathlib.Path, random_: random.Random) -> str:
    size = path.stat().st_size
    # A crash damages the end of a file, so half of the places are there.
    at = random_.randrange(size) if random_.random() < 0.5 else size - 1 - random_.randrange(min(size, 4096))
    with path.open("r+b") as file:
        if random_.random() < 0.4:
            file.truncate(at)
            return f"{path.name} cut at {at} of {size}"
        file.seek(at)
        old = file.read(1)[0]
        bit = 1 << random_.randrange(8)
        file.seek(at)
        file.write(bytes([old ^ bit]))
        return f"{path.name} byte {at} of {size}: {old:#04x} ^ {bit:#04x}"


class Wrong(Exception):
    pass


def one_line(text: str, folder: pathlib.Path) -> None:
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) != 1 or str(folder / ".usdlive") not in lines[0]:
        raise Wrong(f"does not say in a line which store is damaged:\n{text}")


def log_of(server: Server, truth: Truth) -> str:
    """Returns exactly the history, or a refusal after a beginning of it."""
    with wire.Peer(server.url) as peer:
        if peer.welcome["revision"] != truth.commits[-1][0]:
            raise Wrong(f"serves revision {peer.welcome['revision']} of {truth.commits[-1][0]}")
        if peer.epoch <= truth.epoch:
            raise Wrong(f"epoch {peer.epoch} after {truth.epoch}")
        peer.send(wire.control("requestLog", request=1, **{"from": 1, "to": 0}))
        seen = []
        while True:
            kind, members = peer.frame(20)
            if kind == "errorMessage":
                if not members["code"].startswith("storage"):
                    raise Wrong(f"log: {members}")
                return "refused a part"
            if kind == "logEnd":
                if len(seen) != len(truth.commits):
                    raise Wrong(f"a log of {len(seen)} commits, not {len(truth.commits)}")
                return "served"
            if kind == "Commit":
                seen.append((members["revision"], members["client"], members["sequence"],
                             members["hash"]))
                if seen[-1] != truth.commits[len(seen) - 1]:
                    raise Wrong(f"commit {len(seen)} is another")


def answers_of(server: Server, truth: Truth) -> str:
    """M9: the server knows the committed transactions of every author."""
    last = {client: (sequence, revision) for revision, client, sequence, _ in truth.commits
            if client and not client.startswith("k")}
    assert last
    for client, (sequence, revision) in last.items():
        with wire.Peer(server.url, client) as peer:
            peer.submit(sequence, "root.usda", wire.set_sample("/World.s", 9999, wire.string("twice")))
            while True:
                kind, members = peer.frame(20)
                if kind == "alreadyCommitted" and members["revision"] == revision:
                    break
                # If the answer cannot be read, it is not "no": the session ends, and nothing is committed.
                if kind == "errorMessage" and members["closing"]:
                    return "refused a part"
                if kind in ("alreadyCommitted", "Commit", "Refusal"):
                    raise Wrong(f"M9: sent again, {client} {sequence} is answered by {kind}")
    return "served"


def layers_of(server: Server, truth: Truth) -> str:
    outcome = "served"
    for name, text in truth.texts.items():
        done = subprocess.run([os.environ["USDLIVE_BIN"], "cat", f"{server.url}/{name}"],
                              capture_output=True, text=True, timeout=30, check=False)
        if done.returncode == 0:
            if done.stdout != text:
                raise Wrong(f"{name} is served, and is not what was acknowledged")
        elif done.returncode < 0 or len(done.stderr.strip().splitlines()) != 1:
            raise Wrong(f"cat ended with {done.returncode}: {done.stderr}")
        else:
            outcome = "refused a part"
    return outcome


def start_and_judge(server: Server, truth: Truth) -> str:
    server.launch()
    try:
        end = time.monotonic() + 30
        while not server.port_file.exists():
            code = server.process.poll()
            if code is not None:
                if code <= 0:
                    raise Wrong(f"ended with {code}: {server.log.read_text()}")
                one_line(server.log.read_text(), server.folder)
                return "refused"
            if time.monotonic() > end:
                raise Wrong("neither serves nor ends")
            time.sleep(0.01)
        server.port = int(server.port_file.read_text())
        outcomes = (log_of(server, truth), layers_of(server, truth), answers_of(server, truth))
        server.process.send_signal(signal.SIGTERM)
        if (code := server.process.wait(timeout=20)) != 0:
            raise Wrong(f"was stopped and ended with {code}: {server.log.read_text()[-2000:]}")
        return "refused a part" if "refused a part" in outcomes else "served"
    finally:
        server.process.kill()
        server.process.wait()


def kind_of(name: pathlib.Path) -> str:
    if name.name.startswith(("IDENTITY", "OPTIONS")):  # RocksDB writes these files for people only
        return "for people"
    if "snapshots" in name.parts:
        return "snapshot"
    return "blob" if "blobs" in name.parts else name.suffix or name.name.split("-")[0]


def try_one(number: int, truth: Truth, manifest: bool, folder: pathlib.Path):
    """Returns (kind of file, outcome, fault)."""
    random_ = random.Random(f"{SEED} {number}")
    copy = folder / f"damaged{number}"
    shutil.copytree(truth.folder, copy, ignore=shutil.ignore_patterns("reserve"))
    # Each kind of file is chosen equally often, so that small ones are tested, too.
    kinds = collections.defaultdict(list)
    for name in truth.files:
        if (kind_of(name) == "MANIFEST") == manifest:
            kinds[kind_of(name)].append(name)
    kind = random_.choice(sorted(kinds))
    done = damage(copy / random_.choice(kinds[kind]), random_)
    try:
        outcome, wrong = start_and_judge(Server(copy, folder / f"damaged{number}.log"), truth), None
    except Exception as failure:  # a lost connection is a fault, too
        outcome, wrong = "wrong", f"place {number}, {done}: {type(failure).__name__}: {failure}"
    if not wrong:
        shutil.rmtree(copy)
    return kind, outcome, wrong


@pytest.mark.parametrize("manifest,places", [
    pytest.param(False, PLACES - PLACES // 5, id="tables, logs, values"),
    pytest.param(True, PLACES // 5, id="manifest"),
])
def test_k5_a_damaged_store_is_served_completely_or_refused(manifest, places, project, serve, editor, tmp_path,
                                                       capfd):
    print(f"seed {SEED}")
    truth = a_store(project, serve, editor)
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        results = list(pool.map(lambda number: try_one(number, truth, manifest, tmp_path), range(places)))
    wrong = [one[2] for one in results if one[2]]
    outcomes = collections.Counter(one[1] for one in results)
    kinds = collections.Counter(one[:2] for one in results)
    with capfd.disabled():
        print(f"\nK5 seed {SEED}: {places} places, {dict(outcomes)}")
    for (kind, outcome), count in sorted(kinds.items()):
        print(f"  {kind:10} {outcome:16} {count}")
    assert not wrong, f"{len(wrong)} of {places}:\n" + "\n".join(wrong[:20])
    assert outcomes["refused"], "too few places tested what they should"
    assert manifest or any(kind == "snapshot" for kind, _ in kinds), "the store has no snapshot"
