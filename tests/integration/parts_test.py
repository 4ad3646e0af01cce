"""FR8: a transaction that no frame can hold is sent in parts, and is one commit for everybody."""

import json
import os
import threading
import time

import pytest
from conftest import cat, run

EMPTY = "#usda 1.0\n"
PRIMS = 12_000  # some 5 MiB in frames of at most 1 MiB
# Pastes like an editor: everything in one frame.
PASTE = f"""
source = Sdf.Layer.CreateAnonymous()
for index in range({PRIMS}):
    prim = Sdf.CreatePrimInLayer(source, f'/Set/Group{{index // 100}}/Prop{{index}}')
    prim.specifier = Sdf.SpecifierDef
    prim.typeName = 'Xform'
    prim.SetInfo('comment', 'pasted number %d of a set that is large' % index)
root = stage.GetRootLayer()
assert Sdf.CopySpec(source, '/Set', root, '/Set')
"""
# A follower never sees a part of it: after each frame it has all or nothing.
WATCH = f"""
def pasted():
    set_ = stage.GetRootLayer().GetPrimAtPath('/Set')
    return len(set_.nameChildren) if set_ else 0
seen = set()
live.add_handler(lambda event: seen.add(pasted()))
"""
SEEN = f"""
assert live.wait(lambda: pasted() == {PRIMS} // 100, 60), pasted()
assert seen <= {{0, {PRIMS} // 100}}, seen
result = live.revision
"""


def test_fr8_a_paste_that_no_frame_can_hold_is_one_commit(project, serve, editor):
    (project / "root.usda").write_text(EMPTY)
    server = serve(project, "--max-frame-mib", "1")
    ada, bo = editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")
    bo.run(WATCH)
    before = ada.flush()
    ada.run(PASTE)
    assert ada.run("assert live.flush(60); result = live.revision") == before + 1
    assert bo.run(SEEN) == before + 1
    text = cat(server, "root.usda")
    assert ada.text("root.usda") == bo.text("root.usda") == text
    bo.run("stage.DefinePrim('/After'); assert live.flush(20)")

    logged = [json.loads(line) for line in run("log", server.url, "--json").splitlines()]
    assert logged[-1]["revision"] == before + 2
    late = editor(server, "cy", "root.usda")
    saved = late.run("saved = []\nlive.add_handler(lambda e: saved.append(e) if isinstance(e, usdlive.events.Saved) else None)\n"
                     "live.save('root.usda')\nassert live.wait(lambda: saved, 30)\nresult = len(saved[0].failed)")
    assert saved == 0
    assert (project / "root.usda").read_text() == late.text("root.usda")

    # The content before the commit, and with it: from the store.
    assert cat(server, "root.usda", "--revision", str(before + 1)) == text
    server.stop()
    server.start()
    assert cat(server, "root.usda", "--revision", str(before + 1)) == text
    bo.run("assert live.wait(lambda: live.connected, 20); stage.DefinePrim('/Later'); assert live.flush(20)")
    assert cat(server, "root.usda") == bo.text("root.usda")


def test_fr8_an_editor_that_was_away_reads_it_from_the_store(project, serve, editor):
    (project / "root.usda").write_text(EMPTY)
    server = serve(project, "--max-frame-mib", "1")
    ada, bo = editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")
    bo.run(WATCH)
    os.kill(bo.process.pid, 19)  # SIGSTOP
    try:
        ada.run(PASTE)
        ada.run("assert live.flush(60)")
        ada.run("stage.DefinePrim('/After'); assert live.flush(20)")
    finally:
        os.kill(bo.process.pid, 18)
    bo.run(SEEN)
    bo.catch_up(ada.flush())
    assert ada.text("root.usda") == bo.text("root.usda") == cat(server, "root.usda")


@pytest.mark.parametrize("kills", [12])
def test_fr8_a_server_killed_between_parts_has_all_or_nothing(project, serve, editor, kills):
    (project / "root.usda").write_text(EMPTY)
    server = serve(project, "--max-frame-mib", "1")
    ada, bo = editor(server, "ada", "root.usda"), editor(server, "bo", "root.usda")
    bo.run(WATCH)
    begin = ada.flush()
    ending = threading.Event()

    def killing():
        for number in range(kills):
            time.sleep(0.02 * (number + 1))
            server.kill()
            server.start()
        ending.set()

    ada.run(PASTE)
    killer = threading.Thread(target=killing)
    killer.start()
    while not ending.is_set():
        ada.run("import time\nfor _ in range(20):\n    live.tick()\n    time.sleep(0.001)")
    killer.join()
    ada.run("assert live.flush(60), live.pending_transactions")
    bo.run(SEEN)
    revision = ada.flush()
    assert revision == begin + 1, "it was committed once"
    assert ada.text("root.usda") == bo.text("root.usda") == cat(server, "root.usda")


def test_fr8_a_too_large_transaction_comes_back_with_the_limit(project, serve, editor):
    (project / "root.usda").write_text(EMPTY)
    server = serve(project, "--max-frame-mib", "1", "--max-transaction-mib", "1")
    ada = editor(server, "ada", "root.usda")
    ada.run(PASTE)
    ada.run("assert live.flush(60)")
    lost = ada.run("result = [e.message for e in happened if isinstance(e, usdlive.events.Lost)]")
    assert len(lost) == 1 and "--max-transaction-mib" in lost[0], lost
    assert ada.run("result = bool(stage.GetPrimAtPath('/Set'))") is False
    ada.run("stage.DefinePrim('/After'); assert live.flush(20)")
    assert "After" in cat(server, "root.usda")
