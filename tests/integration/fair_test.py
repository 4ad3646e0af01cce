"""Tests that one session's work does not delay that of others (SE23), with the real server."""

import threading

import pytest
import wire

ROOT = '#usda 1.0\n\ndef "World"\n{\n    int64 n\n    int64 m\n}\n'
FLOOD, EDITS = 40_000, 20


def flood(peer: wire.Peer, count: int) -> list[bytes]:
    """Messages with thousands of frames each, as no client sends them."""
    frames = [wire.encode("Submit", {"client": peer.client, "sequence": number, "layers": ["root.usda"], "base": 0,
                                     "edits": [wire.set_field("/World.n", "default", wire.int64(number))]})
              for number in range(1, count + 1)]
    return [b"".join(frames[at:at + 4_000]) for at in range(0, count, 4_000)]


def read_all(peer: wire.Peer, ends: threading.Event) -> None:
    while not ends.is_set():
        try:
            peer.frame(0.2)
        except TimeoutError:
            pass


@pytest.mark.alone  # a user who gets no processor for 2 s is not active
def test_se23_edits_do_not_wait_for_thousands_of_another_user(project, serve):
    (project / "root.usda").write_text(ROOT)
    server, ends = serve(project), threading.Event()
    with wire.Peer(server.url, user="script") as script, wire.Peer(server.url, user="ann") as ann:
        ann.submit(1, "root.usda", wire.set_field("/World.m", "default", wire.int64(0)))
        ann.expect("Commit")
        messages = flood(script, FLOOD)
        reader = threading.Thread(target=read_all, args=(script, ends))
        writer = threading.Thread(target=lambda: [script.send(message) for message in messages])
        writer.start()
        reader.start()
        for number in range(2, EDITS + 2):  # each waits for the one before
            ann.submit(number, "root.usda", wire.set_field("/World.m", "default", wire.int64(number)))
            while (commit := ann.expect("Commit", 60))["client"] != ann.client:
                assert commit["sequence"] != FLOOD, f"all of the script's edits came before {number} of ann's"
        last = commit["revision"]
        writer.join()
        while ann.expect("Commit", 60)["sequence"] != FLOOD:
            pass
        ends.set()
        reader.join()
        commits = ann.log()
    assert last < FLOOD / 2, f"the script's first {last} edits came before {EDITS} of ann's"
    # Nothing is lost, and the order of the script's edits is its own.
    assert [one["sequence"] for one in commits if one["client"] == script.client] == list(range(1, FLOOD + 1))
