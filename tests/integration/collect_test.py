"""B6, B7: big values that nothing names are removed, also by a server that is killed again and again; values
that something names stay, and an editor whose work names a removed value loses nothing."""

import hashlib
import os
import random
import re
import time
import urllib.request

import wire
from conftest import cat, wait

ROOT = '#usda 1.0\n\ndef Mesh "M"\n{\n}\n\ndef Mesh "N"\n{\n}\n'
SOON = ("--keep-unused-blobs", "0")

# The values have 1 MiB; some of them are the same in each editor.
WRITE = """
import hashlib

def points(prim):
    return stage.GetPrimAtPath(prim).CreateAttribute('points', Sdf.ValueTypeNames.Point3fArray)

def value(number, count=87_400):
    return Vt.Vec3fArray(count, Gf.Vec3f(number, 0, 0))

def digest():
    return hashlib.sha256(stage.GetRootLayer().ExportToString().encode()).hexdigest()

def drag(prim, seconds, first=0):
    '''60 Hz, shown to all and committed once.'''
    number, end = first, time.monotonic() + seconds
    with live.gesture():
        while time.monotonic() < end:
            number += 1
            points(prim).Set(value(number))
            live.tick()
            time.sleep(1 / 60)
    return number - first

def write(prim, seconds, numbers):
    '''60 Hz, each a transaction.'''
    count, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        points(prim).Set(value(numbers[count % len(numbers)]))
        live.tick()
        count += 1
        time.sleep(1 / 60)
    return count
"""


def values(project):
    return {path.name: path for path in (project / ".usdlive/blobs").glob("??/*") if len(path.name) == 64}


def named_by_commits(server):
    """Values that were replaced before they were sent (SE15) may be stored, too; no commit names them."""
    with wire.Peer(server.url) as peer:
        return wire.big_values(peer.log())


def bytes_of(project):
    return sum(path.stat().st_size for path in (project / ".usdlive/blobs").rglob("*") if path.is_file())


def same(server, editors, layer="root.usda"):
    """All have, byte for byte, the same content as the server, with every big value."""
    text = hashlib.sha256(cat(server, layer).encode()).hexdigest()
    for one in editors:
        one.run("import time")
        one.run(f"assert live.wait(lambda: digest() == {text!r}, 30), 'this editor has something else'")


def test_b6_unnamed_values_are_removed_and_named_ones_stay(project, serve, editor, capfd):
    (project / "root.usda").write_text(ROOT)
    (project / "locked.usda").write_text(ROOT)
    server = serve(project, *SOON)
    ada, bo, cy = editor(server, "ada", "root.usda"), editor(server, "bo", "locked.usda"), editor(server, "cy", "locked.usda")
    for one in (ada, bo, cy):
        one.run("import time\n" + WRITE)
    bo.run("live.lock('locked.usda'); assert live.flush(20)")
    cy.run("layer = stage.GetRootLayer(); assert live.wait(lambda: not layer.permissionToEdit, 20)\n"
           "layer.SetPermissionToEdit(True)  # like an editor that ignores the lock")
    ada.process.stdin.write('"result = drag(\'/M\', 4)"\n')
    cy.process.stdin.write('"result = write(\'/M\', 4, range(1, 400))"\n')
    for one in (ada, cy):
        one.process.stdin.flush()
    frames, refused = ada._answer(), cy._answer()
    most = bytes_of(project)
    for one in (ada, cy):
        one.flush()
    lost = cy.run("result = len([e for e in happened if isinstance(e, usdlive.events.Lost)])")
    assert lost > 0, "the layer is locked"
    # The final content of ada is everything that was committed.
    wait(lambda: len(values(project)) == 1, timeout=30)
    late = editor(server, "late", "root.usda")
    late.run(WRITE)
    same(server, [ada, late])
    assert len(values(project)) == 1
    with capfd.disabled():
        print(f"\nB6: {frames} frames dragged and {refused} refused of 1 MiB; {most >> 20} MiB stored on the way, "
              f"{bytes_of(project) >> 20} MiB in the end")


def test_b6_values_that_are_uploaded_while_they_are_removed(project, serve, editor):
    """Two editors write the same values at the same time. The writes of one of them are refused, and their
    values removed again and again."""
    (project / "root.usda").write_text(ROOT)
    (project / "locked.usda").write_text(ROOT)
    server = serve(project, *SOON)
    ada, bo, cy = editor(server, "ada", "root.usda"), editor(server, "bo", "locked.usda"), editor(server, "cy", "locked.usda")
    for one in (ada, bo, cy):
        one.run("import time\n" + WRITE)
    bo.run("live.lock('locked.usda'); assert live.flush(20)")
    cy.run("layer = stage.GetRootLayer(); assert live.wait(lambda: not layer.permissionToEdit, 20)\n"
           "layer.SetPermissionToEdit(True)  # like an editor that ignores the lock")
    for round in range(4):
        numbers = list(range(round * 10, round * 10 + 10))
        for one in (ada, cy):
            one.process.stdin.write(f'"result = write(\'/M\', 1.2, {numbers})"\n')
            one.process.stdin.flush()
        ada._answer(), cy._answer()
    for one in (ada, cy):
        one.flush()
    lost = ada.run("result = [e.code for e in happened if isinstance(e, usdlive.events.Lost)]")
    assert lost == []
    late = editor(server, "late", "root.usda")
    late.run(WRITE)
    same(server, [ada, late])
    wait(lambda: len(values(project)) <= 40, timeout=30)


def test_b6_work_that_waits_longer_than_its_values_are_kept(project, serve, editor):
    """The first value is removed while the second one is still on its way; then it is uploaded again."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project, *SOON)
    ada = editor(server, "ada", "root.usda")
    ada.run("import time\n" + WRITE)
    ada.run("points('/M').Set(value(1)); points('/N').Set(value(2, 12_000_000)); live.tick()")
    ada.flush()
    assert ada.run("result = [e.code for e in happened if isinstance(e, usdlive.events.Lost)]") == []
    late = editor(server, "late", "root.usda")
    late.run(WRITE)
    same(server, [ada, late])


def test_b6_killed_while_it_removes(project, serve, editor):
    """Unused values are removed in the end; named values never are."""
    (project / "root.usda").write_text(ROOT)
    server = serve(project, *SOON)
    ada = editor(server, "ada", "root.usda")
    ada.run("import time\n" + WRITE)
    ada.run("result = write('/M', 1, range(1, 1000))")
    ada.flush()
    named = named_by_commits(server)
    assert named and named <= set(values(project))
    rng = random.Random(int(os.environ.get("USDLIVE_SEED", "1")))
    left, kills = 3_000, 0
    while kills < 12:
        server.kill()
        kills += 1
        for number in range(left if kills in (1, 6) else 50):
            name = hashlib.sha256(f"{kills} {number}".encode()).hexdigest()
            folder = project / ".usdlive/blobs" / name[:2]
            folder.mkdir(exist_ok=True)
            (folder / name).write_bytes(b"left behind")
        server.start()
        time.sleep(0.45 + rng.random() * 0.4)
        assert named <= set(values(project))
    wait(lambda: set(values(project)) == named, timeout=60)
    late = editor(server, "late", "root.usda")
    late.run(WRITE)
    same(server, [late])
    page = urllib.request.urlopen(server.url.replace("ws:", "http:") + "/metrics").read().decode()
    removed = re.search(r"^usdlive_removed_blobs_total (\d+)", page, re.M)
    assert removed and int(removed[1]) > 0
    assert "unused big values removed" in server.log.read_text()


def test_b7_a_drag_leaves_little_on_the_authors_disk(project, serve, editor, tmp_path, monkeypatch):
    """This also covers an editor that is killed: the next one removes its temporary folder."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    ada = editor(server, "ada", "root.usda")
    ada.run("import time\n" + WRITE)

    def used(folder):
        total = 0
        for path in folder.rglob("*"):
            try:
                total += path.stat().st_size if path.is_file() else 0
            except FileNotFoundError:
                pass
        return total

    ada.process.stdin.write('"result = drag(\'/M\', 5)"\n')
    ada.process.stdin.flush()
    most, state = 0, tmp_path / "state"
    end = time.monotonic() + 4.5
    while time.monotonic() < end:
        most = max(most, used(temporary) + used(state))
        time.sleep(0.05)
    frames = ada._answer()
    assert frames > 60
    assert most < 60 << 20, f"{most >> 20} MiB for {frames} frames of 1 MiB"
    ada.flush()
    wait(lambda: used(temporary) < 4 << 20, timeout=20)
    ada.run("points('/N').Set(value(7)); live.tick()")
    folders = [path for path in temporary.iterdir() if path.is_dir()]
    assert len(folders) == 1
    bo = editor(server, "bo", "root.usda")
    assert len([path for path in temporary.iterdir() if path.is_dir()]) == 2, "of one that lives"
    ada.process.kill()
    ada.process.wait()
    cy = editor(server, "cy", "root.usda")
    wait(lambda: not folders[0].exists())
    bo.close(), cy.close()
    assert list(temporary.iterdir()) == []
