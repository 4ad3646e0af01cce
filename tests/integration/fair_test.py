"""Tests that one user's sessions do not delay those of others (SE23), with the real server."""

import contextlib
import threading

import wire
from conftest import without_answers

ROOT = '#usda 1.0\n\ndef "World"\n{\n    int64 n\n    int64 m\n}\n'
SESSIONS, EDITS_EACH, EDITS = 16, 1_000, 20
FLOOD = SESSIONS * EDITS_EACH


def flood(peer: wire.Peer) -> bytes:
    """A message of many frames, as no client sends it."""
    return b"".join(wire.encode("Submit", {
        "client": peer.client, "sequence": number, "layers": ["root.usda"], "base": 0,
        "edits": [wire.set_field("/World.n", "default", wire.int64(number))]}) for number in range(1, EDITS_EACH + 1))


def read_all(peer: wire.Peer) -> None:
    """The server sends nothing more to a session that does not read."""
    with contextlib.suppress(TimeoutError):
        while True:
            peer.socket.recv(timeout=5)


def test_se23_edits_do_not_wait_for_sixteen_sessions_of_another_user(project, serve):
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    with wire.Peer(server.url, user="ann") as ann, contextlib.ExitStack() as opened:
        script = [opened.enter_context(wire.Peer(server.url, user="script")) for _ in range(SESSIONS)]
        messages = [flood(peer) for peer in script]
        readers = [threading.Thread(target=read_all, args=(peer,)) for peer in script]
        with without_answers(server):  # all of it waits when the server goes on, however slow this process is
            for peer, message in zip(script, messages):
                peer.send(message)
            for number in range(1, EDITS + 1):  # a message each
                ann.submit(number, "root.usda", wire.set_field("/World.m", "default", wire.int64(number)))
        for reader in readers:
            reader.start()
        for _ in range(FLOOD + EDITS):
            ann.expect("Commit", 60)
        for reader in readers:
            reader.join()
        commits = ann.log()
    last = max(one["revision"] for one in commits if one["client"] == ann.client)
    assert last < FLOOD / 2, f"{last - EDITS} edits of the script came before the last of {EDITS} of ann's"
    # Nothing is lost, and the order of a session's edits is its own.
    for peer in script:
        assert [one["sequence"] for one in commits if one["client"] == peer.client] == list(range(1, EDITS_EACH + 1))
