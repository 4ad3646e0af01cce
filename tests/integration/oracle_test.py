"""C1: the commit log, replayed by plain pxr.Sdf in Python, results in the text that the server has."""

import os

import pytest
import wire
from conftest import Peer, Server, cat
from oracle import Replay
from values_test import EDITS

ROOT = '#usda 1.0\n\ndef Xform "World"\n{\n    def Xform "Kept"\n    {\n    }\n}\n\n'
# Values that Python cannot build from bytes.
BEYOND = ("spline", "array edit")
REPLAYED = [what for what in EDITS if EDITS[what] and what not in BEYOND]
SEED = int(os.environ.get("USDLIVE_SEED", "1"))


def log_of(server):
    with wire.Peer(server.url) as peer:
        return peer.log()


def replay(commits, text, upto=None):
    made = Replay("root.usda", text)
    for commit in commits:
        if upto is None or commit["revision"] <= upto:
            made.apply(commit)
    return made.layer.ExportToString()


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    """All edits of values_test, one after the other: the log, and the text after each."""
    folder = tmp_path_factory.mktemp("oracle")
    (folder / "project").mkdir()
    (folder / "project" / "root.usda").write_text(ROOT)
    server = Server(folder / "project", folder / "server.log").start()
    ada = Peer(server.url, "ada", "root.usda", folder / "ada.log")
    texts = {}
    for what in REPLAYED:
        ada.run("root = stage.GetRootLayer()\nroot.Clear()\n"
                "p = stage.DefinePrim('/World/P', 'Xform')\n" + EDITS[what])
        texts[what] = (ada.flush(), cat(server, "root.usda"))
    yield log_of(server), texts
    ada.process.kill()
    ada.process.wait()
    assert server.stop() == 0


@pytest.mark.parametrize("what", REPLAYED)
def test_c1_every_kind_of_edit_by_sdf_alone(what, history):
    commits, texts = history
    revision, text = texts[what]
    assert replay(commits, ROOT, revision) == text


EDITOR = """
import random, time
root = stage.GetRootLayer()
rng = random.Random({seed})
names = ['A', 'B', 'C', 'D']

def paths():
    found = []
    root.Traverse('/', lambda path: found.append(path))
    return [p for p in found if p.IsPrimPath() and p != Sdf.Path('/World')]

def step():
    here = rng.choice(paths() or [Sdf.Path('/World')])
    prim, name = stage.GetPrimAtPath(here), rng.choice(names)
    if not prim:
        stage.DefinePrim('/World/' + name)
        return
    what = rng.randrange(15)
    if what < 3:
        if here.pathElementCount < 5: stage.DefinePrim(here.AppendChild(name), rng.choice(['Xform', 'Scope']))
        else: stage.DefinePrim('/World/' + name)
    elif what == 3:
        if here.pathElementCount > 1: stage.RemovePrim(here)
    elif what == 4 or what == 5:
        parent = rng.choice(paths() + [Sdf.Path('/World')])
        to = (here.GetParentPath() if what == 4 else parent).AppendChild(name + str(rng.randrange(3)))
        e = Usd.NamespaceEditor(stage); e.MovePrimAtPath(here, to)
        if not stage.GetPrimAtPath(to) and not to.HasPrefix(here) and e.CanApplyEdits(): e.ApplyEdits()
    elif what == 6:
        spec = root.GetPrimAtPath(here)
        siblings = list((spec.nameParent or root.pseudoRoot).nameChildren.keys())
        to = here.ReplaceName(name + '_')
        b = Sdf.BatchNamespaceEdit(); b.Add(Sdf.NamespaceEdit(here, to, rng.randrange(len(siblings))))
        if to.name not in siblings: root.Apply(b)
    elif what == 7: prim.CreateAttribute(name, Sdf.ValueTypeNames.Double).Set(rng.random())
    elif what == 8: prim.CreateAttribute('s' + name, Sdf.ValueTypeNames.Float3).Set(
        Gf.Vec3f(rng.random(), 0, 1), rng.randrange(5))
    elif what == 9:
        for a in prim.GetAuthoredAttributes()[:1]: prim.RemoveProperty(a.GetName())
    elif what == 10: prim.SetCustomDataByKey(rng.choice(['a:b', 'a:c', 'd']), rng.randrange(9))
    elif what == 11: prim.ClearCustomDataByKey(rng.choice(['a:b', 'a:c', 'd']))
    elif what == 12:
        r = prim.CreateRelationship('r' + name)
        (r.AddTarget if rng.random() < 0.7 else r.RemoveTarget)('/World/' + rng.choice(names))
    elif what == 13:
        r = prim.GetReferences()
        (r.AddReference if rng.random() < 0.6 else r.RemoveReference)(Sdf.Reference(name + '.usda', '/' + name))
    else: prim.SetMetadata('kind', rng.choice(['component', 'group']))

def work(steps):
    for _ in range(steps):
        step()
        if rng.random() < 0.5: live.tick()
        if rng.random() < 0.2: time.sleep(0.003)
    check_stage()
"""


@pytest.mark.parametrize("seed", range(SEED, SEED + 3))
def test_c1_concurrent_edits_replayed_by_sdf_alone(seed, project, serve, editor, capfd):
    """Three authors edit the same few prims. The log holds edits that were carried forward, merged and
    dropped in the form in which they were executed."""
    print(f"seed {seed}")
    (project / "root.usda").write_text(ROOT)
    server = serve(project)
    editors = [editor(server, name, "root.usda") for name in ("ada", "bo", "cy")]
    for index, one in enumerate(editors):
        one.run(EDITOR.format(seed=100 * seed + index))
    for _ in range(6):
        for one in editors:
            one.process.stdin.write('"work(40)"\n')
            one.process.stdin.flush()
        for one in editors:
            one._answer()
    revision = max(one.flush() for one in editors)
    for one in editors:
        one.catch_up(revision)
    text = cat(server, "root.usda")
    assert [one.text("root.usda") for one in editors] == [text] * len(editors)
    commits = log_of(server)
    assert replay(commits, ROOT) == text
    dropped = sum(len(c["dropped"] or ()) for c in commits)
    with capfd.disabled():
        print(f"\nC1 seed {seed}: {len(commits)} commits, {sum(len(c['edits'] or ()) for c in commits)} "
              f"edits, {dropped} dropped, {len(text)} bytes of text")
