"""Tests compact frames (FR9-FR11) with a real server and peers that share no code with it."""

import contextlib

import pytest
import wire

LAYER = "root.usda"
COMPACT = ["compact", "parts"]


@pytest.fixture
def served(project, serve):
    (project / LAYER).write_text('#usda 1.0\n\ndef "World"\n{\n    int64 number\n    def "Gone"\n    {\n'
                                 "        int64 number\n    }\n}\n")
    server = serve(project)
    with wire.Peer(server.url) as first:  # a commit imports the layer
        first.send(wire.control("openLayer", request=1, layer=LAYER, revision=0))
        first.expect("layerOpened")
    return server


@pytest.fixture
def peers(served):
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(wire.Peer(served.url, features=features))
               for features in (COMPACT, COMPACT, [])]


def value(number):
    return wire.set_field("/World.number", "default", wire.int64(number))


def next_commit(peer):
    while True:
        kind, members = peer.frame()
        assert kind != "Refusal", members
        if kind in ("Commit", "Acceptance"):
            peer.follow(members)
            return kind, members


def plain(edits):
    return [(edit["path"], edit["action"][0], edit["action"][1].get("value")) for edit in edits]


def test_every_peer_reads_the_same_commits(peers):
    author, other, older = peers
    for number in range(1, 6):
        author.submit_compact(number, LAYER, value(number))
        kinds, commits = zip(*(next_commit(peer) for peer in peers))
        assert kinds == ("Acceptance", "Commit", "Commit")
        assert [plain(commit["edits"]) for commit in commits] == [plain([value(number)])] * 3
        # FR9: the hash in the compact frame is that of the stored commit, which the older peer has computed.
        assert author.hash == other.hash == older.hash
    assert other.reader.names and author.writer.numbers


def test_a_peer_that_joins_later_is_told_the_names(served, peers):
    author, other, _ = peers
    for number in range(1, 4):
        author.submit_compact(number, LAYER, value(number))
        for peer in peers:
            next_commit(peer)
    with wire.Peer(served.url, features=COMPACT) as late:
        author.submit_compact(4, LAYER, value(4))
        commits = [next_commit(peer) for peer in (author, other, late)]
        assert plain(commits[2][1]["edits"]) == plain(commits[1][1]["edits"]) == plain([value(4)])
        assert set(late.reader.names.values()) <= set(other.reader.names.values())


def test_the_author_gets_what_it_did_not_send(served, peers):
    author, other, _ = peers
    other.submit_compact(1, LAYER, {"path": "/World/Gone", "action": ("DeleteSpec", {})})
    base = author.revision
    for peer in peers:
        next_commit(peer)
    # M4: dropped. The transaction is a commit all the same.
    gone = wire.set_field("/World/Gone.number", "default", wire.int64(1))
    author.submit_compact(1, LAYER, value(1), gone, base=base)
    kind, commit = next_commit(author)
    assert (kind, plain(commit["edits"])) == ("Commit", plain([value(1)]))
    assert [(one["index"], one["reason"]) for one in commit["dropped"]] == [(1, "specDeleted")]
    # M3: moved by somebody else.
    move = {"path": "/World.number", "action": ("MoveSpec", {"parent": {"path": "/World"}, "name": "count"})}
    other.submit_compact(2, LAYER, move)
    author.submit_compact(2, LAYER, value(2), base=author.revision)
    seen = [next_commit(author) for _ in range(2)]
    own = next((kind, commit) for kind, commit in seen if commit["client"] == author.client)
    if plain(own[1]["edits"])[0][0] == "/World.count":
        assert own[0] == "Commit"
    # The session did not send it: after a resume its commit comes whole.
    place = author.resume_point()
    other.submit(3, LAYER, wire.set_field("/World", "comment", wire.string("x")))
    with wire.Peer(served.url, client=author.client, resume=place, features=COMPACT) as resumed:
        kind, commit = next_commit(resumed)
        assert (kind, commit["sequence"]) == ("Commit", 3)
        resumed.submit_compact(3, LAYER, wire.set_field("/World", "comment", wire.string("y")))
        assert next_commit(resumed)[0] == "Acceptance"


def test_a_session_without_the_feature_sends_none(peers):
    older = peers[2]
    older.submit_compact(1, LAYER, value(1))
    assert older.expect_error()["code"] == "unknownFrame"


@pytest.mark.parametrize("content, code", [
    (bytes([1, 4, 0, 0, 1, 0x41, 7]), "malformedFrame"),   # a number that was not told
    (bytes([0x0B]), "unknownFrame"),
    (bytes([5]), "unknownFrame"),                           # only a server accepts
])
def test_a_malformed_frame_ends_the_session(peers, content, code):
    if content == bytes([5]):
        content = bytes([5]) + bytes(44)
    content = content.ljust(16, b"\0")
    peers[0].send(len(content).to_bytes(4, "little") + content)
    error = peers[0].expect_error()
    assert (error["code"], error["closing"]) == (code, True)
