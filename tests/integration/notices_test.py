"""An editor's stage never reports others' edits more broadly than their authors' stages did: a viewport
rebuilds only the edited prims."""

import os
import random
import time

import pytest
from conftest import connect, wait
from pxr import Gf, Sdf, Tf, Usd

from usdlive import events

LAYERS = {
    "asset.usda": """#usda 1.0
(
    defaultPrim = "Chair"
)

def Xform "Chair" (
    variants = {
        string look = "wood"
    }
    prepend variantSets = "look"
)
{
    def Xform "Seat"
    {
        double size = 1
        def Mesh "Cushion"
        {
            color3f[] primvars:displayColor = [(1, 0, 0)]
        }
    }
    def Xform "Legs"
    {
        def Mesh "L0"
        {
        }
        def Mesh "L1"
        {
        }
    }
    variantSet "look" = {
        "metal" {
            over "Seat"
            {
                double size = 2
                def Mesh "Bolt"
                {
                }
            }
        }
        "wood" {
            over "Seat"
            {
                double size = 3
            }
        }
    }
}
""",
    "room.usda": """#usda 1.0

def Xform "World"
{
    def Xform "Set" (
        prepend references = @./asset.usda@
    )
    {
        over "Seat"
        {
            def Mesh "Pillow"
            {
                double size = 4
            }
        }
    }
    def Xform "Heavy" (
        prepend payload = @./asset.usda@
    )
    {
    }
    def Xform "InstA" (
        instanceable = true
        prepend references = @./asset.usda@
    )
    {
    }
    def Xform "InstB" (
        instanceable = true
        prepend references = @./asset.usda@
    )
    {
    }
    def Scope "Looks"
    {
        def Material "Oak"
        {
            double rough = 0.5
            rel near = </World/Looks/Pine>
        }
        def Material "Pine"
        {
        }
    }
    class "_base"
    {
        double shared = 1
    }
    def Xform "Child" (
        inherits = </World/_base>
    )
    {
    }
}
""",
    "anim.usda": "#usda 1.0\n",
    "shot.usda": """#usda 1.0
(
    subLayers = [
        @./anim.usda@,
        @./room.usda@
    ]
)
""",
}


PROTOTYPE = Sdf.Path("/__Prototype")


class Reports:
    """The reports of one stage: paths that were resynced, and paths whose values changed."""

    def __init__(self, stage):
        self.stage, self.notices = stage, 0
        self.instances = [prim.GetPath() for prim in stage.TraverseAll() if prim.IsInstance()]
        self._key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._changed, stage)
        self.clear()

    def clear(self):
        self.resynced, self.changed, self.notices = set(), set(), 0

    def _changed(self, notice, _sender):
        self.notices += 1
        self.resynced.update(self._named(path) for path in notice.GetResyncedPaths())
        self.changed.update(self._named(path) for path in notice.GetChangedInfoOnlyPaths())

    def _named(self, path):
        """Stages number their prototypes in the order of creation."""
        root = path.GetPrefixes()[0] if path != Sdf.Path.absoluteRootPath else path
        if not Usd.Prim.IsPathInPrototype(path):
            return path
        return path.ReplacePrefix(root, PROTOTYPE)

    def broader_than(self, other):
        resynced = set(other.resynced)
        # A stage makes a prototype from the first instance that it meets, and makes it again when that
        # instance changes.
        if any(instance.HasPrefix(path) for path in resynced for instance in other.instances):
            resynced.add(PROTOTYPE)

        def covered(path):
            return any(path.HasPrefix(above) for above in resynced)
        return ([path for path in self.resynced if not covered(path)],
                [path for path in self.changed if not covered(path) and path not in other.changed])

    def __str__(self):
        return f"resynced {sorted(map(str, self.resynced))}, changed {sorted(map(str, self.changed))}"


def composed(stage):
    def properties(prim):
        return [(p.GetName(), p.Get() if isinstance(p, Usd.Attribute) else p.GetTargets(),
                 p.GetTimeSamples() if isinstance(p, Usd.Attribute) else ()) for p in prim.GetProperties()]
    predicate = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    return {prim.GetPath(): (prim.GetTypeName(), prim.GetSpecifier(), prim.IsActive(), prim.GetKind(),
                             prim.GetCustomData(), properties(prim))
            for prim in Usd.PrimRange(stage.GetPseudoRoot(), predicate)}


class Two:
    """An author and a follower, each with a stage of its own copies of the layers."""

    def __init__(self, server):
        self.author, self.follower = connect(server, "ada"), connect(server, "bo")
        self.kept = self.follower.open_stage("shot.usda")  # sees all edits
        self.author.open_stage("shot.usda")
        self.follow()
        self.open()

    def open(self):
        """Opens new stages: the instance that a prototype is made from depends on the earlier content of a
        stage."""
        self.stages = [Usd.Stage.Open(self.layer("shot.usda", live)) for live in (self.author, self.follower)]
        self.wrote, self.saw = map(Reports, self.stages)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.wrote = self.saw = self.stages = self.kept = None
        self.author.close()
        self.follower.close()

    def layer(self, name, of=None):
        return Sdf.Layer.Find((of or self.author).identifier(name))

    def follow(self):
        assert self.author.flush()
        wait(lambda: self.follower.revision >= self.author.revision, self.follower)

    def flush(self, live):
        assert live.flush(20)
        wait(lambda: max(self.author.revision, self.follower.revision) ==
             min(self.author.revision, self.follower.revision), self.author, self.follower)

    def edit(self, function, *arguments):
        """Edits in one change block; returns the reports of both stages."""
        self.wrote.clear(), self.saw.clear()
        with Sdf.ChangeBlock():
            function(*arguments)
        after = self.wrote.notices
        self.follow()
        assert self.wrote.notices == after, "the author's own edits came back to it"

    def check(self, what=""):
        resynced, changed = self.saw.broader_than(self.wrote)
        assert not resynced and not changed, (
            f"{what}\nthe author's stage: {self.wrote}\nthe follower's: {self.saw}\nbroader: {resynced} {changed}")
        for stage in (self.kept, self.stages[1]):
            here, afresh = composed(stage), composed(Usd.Stage.Open(stage.GetRootLayer()))
            assert here == afresh, (what, [(str(path), here.get(path), afresh.get(path))
                                           for path in {*here, *afresh} if here.get(path) != afresh.get(path)])


@pytest.fixture
def two(project, serve):
    for name, text in LAYERS.items():
        (project / name).write_text(text)
    with Two(serve(project)) as pair:
        yield pair


def override(layer, path, value):
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.SetInfo("customData", {"note": value})


def place(layer, path, value):
    property = Sdf.Path(path).AppendProperty("xformOp:translate")
    Sdf.JustCreatePrimAttributeInLayer(layer, property, Sdf.ValueTypeNames.Double3)
    layer.GetAttributeAtPath(property).default = Gf.Vec3d(value)


@pytest.mark.parametrize("write", [override, place])
def test_a_first_override_resyncs_nothing_above_it(two, write):
    two.edit(write, two.layer("anim.usda"), "/World/Set/Seat/Cushion", 1)
    assert Sdf.Path("/World/Set/Seat/Cushion") not in two.saw.resynced
    assert not any(path.IsPrimPath() for path in two.saw.resynced), two.saw
    two.check()


def remove_all(layer):
    for prim in list(layer.rootPrims):
        del layer.rootPrims[prim.name]


def test_overrides_that_are_removed_resync_no_more_than_for_their_author(two):
    def clean(layer, path):
        spec = layer.GetPrimAtPath(path)
        spec.ClearInfo("customData")
        layer.ScheduleRemoveIfInert(spec)
    anim = two.layer("anim.usda")
    two.edit(override, anim, "/World/Set/Seat/Cushion", 1)
    two.edit(clean, anim, "/World/Set/Seat/Cushion")
    assert not anim.rootPrims and not two.saw.resynced, two.saw
    two.check()


class Edits:
    """Random edits of a layer, each of its own kind."""

    def __init__(self, seed, pair):
        self.random = random.Random(seed)
        self.pair = pair
        self.log = []

    def belongs_to_a_prototype(self, path):
        """An opinion below an instance matters only to a stage that made a prototype from this instance."""
        stage = self.pair.stages[0]
        return any(prim and (prim.IsInstance() or prim.IsInstanceProxy()) for prim in
                   (stage.GetPrimAtPath(above) for above in path.GetParentPath().StripAllVariantSelections().GetPrefixes()))

    def path(self, layer, existing=None):
        paths = []
        layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
        prims = [p for p in paths if (p.IsPrimPath() or p.IsPrimVariantSelectionPath()) and layer.GetPrimAtPath(p)
                 and not self.belongs_to_a_prototype(p)]
        if existing or (existing is None and prims and self.random.random() < 0.6):
            return self.random.choice(prims) if prims else None
        names = ["/World/Set/Seat", "/World/Set/Seat/Cushion", "/World/Set/Legs/L0", "/World/Heavy/Legs",
                 "/World/InstA", "/World/InstB", "/World/Looks/Oak", "/World/Child",
                 "/World/_base", "/World/New", "/World/New/Deep", "/Chair/Seat", "/World/Set"]
        return Sdf.Path(self.random.choice(names))

    def one(self, layer):
        kinds = [kind for kind in dir(self) if kind.startswith("do_")]
        kind = self.random.choice(kinds)
        details = getattr(self, kind)(layer)
        self.log.append((layer.GetDisplayName(), kind, details))

    def spec(self, layer):
        path = self.path(layer)
        return layer.GetPrimAtPath(path) or Sdf.CreatePrimInLayer(layer, path)

    def do_note(self, layer):
        spec = self.spec(layer)
        spec.customData[self.random.choice("ab")] = self.random.random()
        return spec.path

    def do_attribute(self, layer):
        spec = self.spec(layer)
        name = self.random.choice(["size", "x", "xformOp:translate", "primvars:w"])
        attribute = spec.attributes.get(name) or Sdf.AttributeSpec(
            spec, name, Sdf.ValueTypeNames.Double, declaresCustom=self.random.random() < 0.3)
        attribute.default = self.random.random()
        return attribute.path

    def do_sample(self, layer):
        spec = self.spec(layer)
        if not spec.attributes.get("x"):
            Sdf.AttributeSpec(spec, "x", Sdf.ValueTypeNames.Double)
        layer.SetTimeSample(spec.path.AppendProperty("x"), self.random.randrange(4), self.random.random())
        return spec.path

    def do_clear(self, layer):
        spec = self.spec(layer)
        for field in spec.ListInfoKeys():
            if field in ("customData", "kind", "active", "variantSelection", "typeName"):
                spec.ClearInfo(field)
        layer.ScheduleRemoveIfInert(spec)
        return spec.path

    def do_remove(self, layer):
        path = self.path(layer, existing=True)
        spec = path and layer.GetPrimAtPath(path)
        if not spec or not path.IsPrimPath():
            return None
        siblings = spec.nameParent.nameChildren if spec.nameParent else layer.rootPrims
        del siblings[spec.name]
        return path

    def do_remove_property(self, layer):
        spec = self.spec(layer)
        if not spec.properties:
            return None
        victim = self.random.choice(list(spec.properties))
        path = victim.path
        spec.RemoveProperty(victim)
        layer.ScheduleRemoveIfInert(spec)
        return path

    def do_define(self, layer):
        parent = self.spec(layer)
        name = self.random.choice(["N0", "N1", "Seat", "Legs"])
        if name in parent.nameChildren or self.belongs_to_a_prototype(parent.path.AppendChild(name)):
            return None
        spec = Sdf.PrimSpec(parent, name, self.random.choice([Sdf.SpecifierDef, Sdf.SpecifierOver]),
                            self.random.choice(["", "Xform"]))
        return spec.path

    def do_specifier(self, layer):
        spec = self.spec(layer)
        spec.specifier = self.random.choice([Sdf.SpecifierDef, Sdf.SpecifierOver])
        return spec.path

    def do_type(self, layer):
        spec = self.spec(layer)
        spec.typeName = self.random.choice(["Xform", "Scope", "Mesh"])
        return spec.path

    def do_kind(self, layer):
        spec = self.spec(layer)
        spec.kind = self.random.choice(["component", "group"])
        return spec.path

    def do_active(self, layer):
        spec = self.spec(layer)
        spec.active = self.random.random() < 0.5
        return spec.path

    def do_reference(self, layer):
        spec = self.spec(layer)
        if layer.GetDisplayName() == "asset.usda":
            return None
        references = spec.referenceList.prependedItems
        if references:
            del references[0]
        else:
            references.append(Sdf.Reference("./asset.usda", self.random.choice(["", "/Chair/Seat"])))
        return spec.path

    def do_payload(self, layer):
        spec = self.spec(layer)
        if layer.GetDisplayName() == "asset.usda":
            return None
        payloads = spec.payloadList.prependedItems
        if payloads:
            del payloads[0]
        else:
            payloads.append(Sdf.Payload("./asset.usda"))
        return spec.path

    def do_instanceable(self, layer):
        spec = self.spec(layer)
        spec.instanceable = self.random.random() < 0.5
        return spec.path

    def do_select(self, layer):
        spec = self.spec(layer)
        spec.variantSelections["look"] = self.random.choice(["wood", "metal", "none"])
        return spec.path

    def do_variant(self, layer):
        path = self.path(layer)
        if not path.IsPrimPath():
            return None
        name = self.random.choice(["wood", "metal", "glass"])
        spec = Sdf.CreateVariantInLayer(layer, path, "look", name)
        if self.random.random() < 0.5 and "V" not in spec.primSpec.nameChildren:
            Sdf.PrimSpec(spec.primSpec, "V", Sdf.SpecifierDef, "Scope")
        return spec.path

    def do_remove_variant(self, layer):
        path = self.path(layer, existing=True)
        spec = path and layer.GetPrimAtPath(path)
        sets = spec.variantSets if spec else {}
        if "look" not in sets or not sets["look"].variants:
            return None
        variant = self.random.choice(list(sets["look"].variants))
        sets["look"].RemoveVariant(variant)
        return path

    def do_target(self, layer):
        spec = self.spec(layer)
        relationship = spec.relationships.get("near") or Sdf.RelationshipSpec(spec, "near")
        target = Sdf.Path(self.random.choice(["/World/Set", "/World/Looks", "/World/Child"]))
        if target in relationship.targetPathList.prependedItems:
            relationship.targetPathList.prependedItems.remove(target)
        else:
            relationship.targetPathList.prependedItems.insert(0, target)
        return relationship.path

    def do_connect(self, layer):
        spec = self.spec(layer)
        attribute = spec.attributes.get("x") or Sdf.AttributeSpec(spec, "x", Sdf.ValueTypeNames.Double)
        attribute.connectionPathList.prependedItems[:] = [
            Sdf.Path(self.random.choice(["/World/Set.size", "/World/Looks/Oak.rough"]))]
        return attribute.path

    def do_order(self, layer):
        spec = self.spec(layer)
        names = list(spec.nameChildren.keys())
        self.random.shuffle(names)
        spec.nameChildrenOrder = names
        return spec.path

    def do_namespace(self, layer):
        path = self.path(layer, existing=True)
        if not path or not path.IsPrimPath() or path.pathElementCount < 2:
            return None
        edit = Sdf.BatchNamespaceEdit()
        what = self.random.choice(["rename", "reparent", "reorder", "front"])
        parent = path.GetParentPath()
        if what == "rename":
            edit.Add(Sdf.NamespaceEdit.Rename(path, self.random.choice(["R0", "Seat", "Set2"])))
        elif what == "reorder":
            edit.Add(Sdf.NamespaceEdit.Reorder(path, self.random.randrange(3)))
        else:
            other = self.path(layer, existing=True)
            if (other.HasPrefix(path) or other == parent or not other.IsPrimPath()
                    or self.belongs_to_a_prototype(other.AppendChild(path.name))):
                return None
            edit.Add(Sdf.NamespaceEdit.Reparent(path, other, 0 if what == "front" else -1))
        if layer.CanApply(edit) == Sdf.NamespaceEditDetail.Okay:
            layer.Apply(edit)
        return what, path

    def do_metadata(self, layer):
        layer.comment = str(self.random.random())

    def do_default_prim(self, layer):
        layer.defaultPrim = self.random.choice(["Chair", "World"])

    def do_offset(self, layer):
        if layer.subLayerPaths:
            layer.subLayerOffsets[0] = Sdf.LayerOffset(self.random.randrange(3))


    def some(self, layers, most=4):
        for _ in range(self.random.randint(1, most)):
            self.one(self.pair.layer(self.random.choice(layers)))


ALL = ["anim.usda", "anim.usda", "room.usda", "asset.usda", "shot.usda"]
SEEDS = int(os.environ.get("USDLIVE_NOTICE_SEEDS", "2"))
FIRST = int(os.environ.get("USDLIVE_NOTICE_FIRST", "0"))
each_seed = pytest.mark.parametrize("seed", range(FIRST, FIRST + SEEDS))


@each_seed
def test_random_edits_are_reported_as_narrowly_as_by_their_author(two, seed):
    edits = Edits(seed, two)
    for _ in range(30):
        edits.log.clear()
        two.open()
        two.edit(edits.some, ALL)
        two.check(edits.log)


@each_seed
def test_refused_edits_are_reverted_as_narrowly_as_they_were_written(two, seed):
    for name in LAYERS:
        two.follower.lock(name)
    two.flush(two.follower)
    lost = []
    two.author.add_handler(lambda event: lost.append(event) if isinstance(event, events.Lost) else None)
    edits = Edits(seed, two)
    for _ in range(20):
        edits.log.clear()
        two.open()
        two.wrote.clear()
        for layer in two.stages[0].GetUsedLayers():
            layer.SetPermissionToEdit(True)  # like an editor that ignores the locks
        with Sdf.ChangeBlock():
            edits.some(ALL)
        two.saw, two.stages[1] = Reports(two.stages[0]), two.stages[0]
        assert two.author.flush(20)
        two.check(edits.log)
    assert sum(event.count for event in lost) > 10 and all(event.refused for event in lost)


@each_seed
def test_a_layer_that_is_joined_again_reports_the_same_as_others(two, seed):
    edits = Edits(seed, two)
    for _ in range(10):
        edits.log.clear()
        two.open()
        for name in LAYERS:
            two.follower.close_layer(name)
        two.wrote.clear(), two.saw.clear()
        with Sdf.ChangeBlock():
            edits.some(ALL)
        assert two.author.flush(20)
        for name in LAYERS:
            two.follower.open_layer(name)
        two.check(edits.log)


def test_a_frame_gets_no_more_events_than_it_has_time_for(two):
    seen = []

    def slow(event):
        seen.append(event)
        time.sleep(0.004)

    def revisions():
        return [event.revision for event in seen if isinstance(event, events.Committed)]

    two.follower.add_handler(slow)
    layer = two.layer("anim.usda")
    for number in range(20):
        override(layer, "/World/Set", number)
        assert two.author.flush()
    time.sleep(0.3)
    assert two.follower.tick(5.0) and 0 < len(seen) < 20
    wait(lambda: len(revisions()) == 20, two.follower)
    assert revisions() == sorted(revisions())
