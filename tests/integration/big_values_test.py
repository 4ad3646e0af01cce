"""B1-B5: editors that drag big values while they edit at random end with the same content, byte for byte."""

import hashlib
import os

import pytest
import wire
from conftest import cat
from oracle_test import EDITOR, ROOT

SEED = int(os.environ.get("USDLIVE_SEED", "1"))

# The values have 0.36, 0.96 and 1.9 MB. Some are common to all editors, so that several upload the same one
# at once. `left` collects the values that a drag left in a spec: its last one, and the last one before the spec
# was removed or moved, because the drag continues with the next spec at its path. A mark shows that the spec is
# still the same one.
DRAGS = """
import hashlib
import numpy
drags, left = 0, set()

def leave(value):
    if value: left.add(hashlib.sha256(len(value).to_bytes(8, 'little') + numpy.array(value).tobytes()).hexdigest())

def drag():
    global drags
    drags += 1
    mesh = stage.DefinePrim('/World/' + rng.choice('MN'), 'Mesh')
    points = mesh.CreateAttribute('points', Sdf.ValueTypeNames.Point3fArray)
    mark, count, written = sys.argv[2], rng.choice([30_000, 80_000, 160_000]), None
    with live.gesture():
        for frame in range(rng.randrange(4, 12)):
            if not points: break  # somebody has removed the mesh
            if points.GetCustomDataByKey(mark) != drags:
                leave(written)
                points.SetCustomDataByKey(mark, drags)
            written = Vt.Vec3fArray(count, Gf.Vec3f(rng.choice([frame + 1, 10 + rng.random()]), 0, 0))
            points.Set(written)
            live.tick()
            time.sleep(0.02)
    leave(written)

def work_and_drag(steps):
    for _ in range(steps):
        step()
        if rng.random() < 0.1: drag()
        if rng.random() < 0.5: live.tick()

def digest():
    return hashlib.sha256(root.ExportToString().encode()).hexdigest()
"""


def stored(project):
    """The names of the big values in the server's store."""
    return {path.name for path in project.rglob("blobs/??/*") if path.is_file()}


@pytest.mark.parametrize("seed", range(SEED, SEED + 1))
def test_b3_four_editors_that_drag_big_values_end_with_the_same(seed, project, serve, editor, capfd):
    print(f"seed {seed}")
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    editors = [editor(server, name, "root.usda") for name in ("ada", "bo", "cy", "di")]
    for index, one in enumerate(editors):
        one.run(EDITOR.format(seed=100 * seed + index) + DRAGS)
    for _ in range(3):
        for one in editors:
            one.process.stdin.write('"work_and_drag(15)"\n')
            one.process.stdin.flush()
        for one in editors:
            one._answer()
    revision = max(one.flush() for one in editors)
    for one in editors:
        one.catch_up(revision)
    text = cat(server, "root.usda")
    digest = hashlib.sha256(text.encode()).hexdigest()
    for one in editors:  # big values may arrive later than the commits that name them
        one.run(f"assert live.wait(lambda: digest() == {digest!r}, 20), 'this editor has something else'")
    for one in editors:
        lost = one.run("result = [e.code for e in happened if isinstance(e, usdlive.events.Lost)]")
        assert "blobNotFound" not in lost and "blobMismatch" not in lost
    with wire.Peer(server.url) as peer:
        named = wire.big_values(peer.log())
    assert named and stored(project) == named, "the store has exactly the values that commits name"
    left = {name for one in editors for name in one.run("result = list(left)")}
    assert named <= left, "intermediate values of a drag are stored"
    drags = sum(one.run("result = drags") for one in editors)
    with capfd.disabled():
        print(f"\nB3 seed {seed}: {drags} drags, {len(named)} big values stored, revision {revision}")
