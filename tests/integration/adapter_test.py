"""Programs whose scenes are plain dictionaries stay in sync with each other and with the stage, by the adapter."""

import contextlib
import random

import pytest
from conftest import connect, run, wait
from documents import blocks
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

import usdlive
from usdlive.adapter import Adapter, Change, Mesh, Part

SHOT = """#usda 1.0
(
    subLayers = [@./set.usda@]
)

def Xform "World"
{
    def Mesh "Wall" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        rel material:binding = </Looks/Red>
    }
}
"""
SET = """#usda 1.0

def Scope "Looks"
{
    def Material "Red"
    {
        float inputs:roughness = 0.5
        def Shader "Surface"
        {
            float inputs:metallic = 0
        }
    }
    def Material "Blue"
    {
    }
}

over "World"
{
    def Xform "Group"
    {
        double3 xformOp:translate = (1, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Sphere "Ball"
        {
        }
    }
    def "One" (
        instanceable = true
        references = </Kit>
    )
    {
    }
    def "Two" (
        instanceable = true
        references = </Kit>
    )
    {
    }
}

def Xform "Kit"
{
    def Cube "Part"
    {
    }
}
"""


class Scene:
    """A program: objects by path, each a dictionary. It knows USD only by the adapter."""

    def __init__(self, adapter: Adapter):
        self.adapter, self.objects = adapter, {}

    def frame(self) -> list[Change]:
        changes = self.adapter.changes()
        for change in changes:
            self.apply(change)
        return changes

    def apply(self, change: Change) -> None:
        if change.kind == "removed":
            del self.objects[change.path]
        elif change.kind == "renamed":
            inside = [path for path in self.objects if path == change.former or path.startswith(change.former + "/")]
            for path in inside:
                self.objects[change.path + path[len(change.former):]] = self.objects.pop(path)
        elif change.path != "/":
            if change.kind == "created":
                assert change.path not in self.objects
                self.objects[change.path] = {}
            self.read(change.path, change.parts)

    def read(self, path: str, parts: Part) -> None:
        adapter, one = self.adapter, self.objects[path]
        if parts & Part.TRANSFORM:
            one["matrix"] = adapter.matrix(path)
        if parts & Part.VISIBILITY:
            one["visible"] = adapter.visible(path)
        if parts & Part.MESH:
            one["mesh"] = adapter.mesh(path)
        if parts & Part.MATERIAL:
            one["material"] = adapter.material(path)
        # Which part these are depends on the type of the prim.
        for name, part in (("radius", Part.MESH), ("roughness", Part.MATERIAL), ("note", Part.MATERIAL)):
            if parts & (part | Part.OTHER):
                one[name] = value_of(adapter.prim(path), "inputs:roughness" if name == "roughness" else name)


def value_of(prim: Usd.Prim, name: str):
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute else None


def shown(stage: Usd.Stage) -> dict:
    """The content of a stage that was just opened."""
    found = {}
    cache = UsdGeom.XformCache()
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        mesh = tuple(value_of(prim, name) or () for name in ("points", "faceVertexCounts", "faceVertexIndices"))
        material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        found[str(prim.GetPath())] = {
            "matrix": cache.GetLocalTransformation(prim)[0] if prim.IsA(UsdGeom.Xformable) else Gf.Matrix4d(1),
            "visible": not prim.IsA(UsdGeom.Imageable) or value_of(prim, "visibility") != "invisible", "mesh": mesh if prim.GetTypeName() == "Mesh" else None,
            "radius": value_of(prim, "radius"), "material": str(material.GetPath()) if material and Usd.PrimDefaultPredicate(material.GetPrim()) else "",
            "roughness": value_of(prim, "inputs:roughness"), "note": value_of(prim, "note")}
    return found


def plain(objects: dict) -> dict:
    """With numbers in place of Vt arrays, which compare by their types."""
    def of(value):
        return tuple(tuple(map(tuple, one) if len(one) and hasattr(one[0], "__len__") else one) for one in value) if value else None
    return {path: {**one, "mesh": of(one["mesh"])} for path, one in objects.items()}


def differences(one: dict, other: dict) -> dict:
    """By path: what differs, or None for an object that only one of them has."""
    found = {path: None for path in one.keys() ^ other.keys()}
    for path in one.keys() & other.keys():
        if one[path] != other[path]:
            found[path] = {name: (one[path][name], other[path][name]) for name in one[path] if one[path][name] != other[path][name]}
    return found


@pytest.fixture
def served(project, serve):
    (project / "shot.usda").write_text(SHOT)
    (project / "set.usda").write_text(SET)
    return serve(project)


@pytest.fixture
def programs(served):
    """Two programs, in connections of their own."""
    with contextlib.ExitStack() as stack:
        found = []
        for user in ("ada", "bob"):
            live = stack.enter_context(connect(served, user))
            live.add_handler(lambda event: None)
            found.append(Scene(Adapter(live, live.open_stage("shot.usda"))))
            found[-1].frame()
        yield found
        for scene in found:
            scene.adapter.close()


def synced(scenes: list[Scene]) -> None:
    lives = [scene.adapter.live for scene in scenes]
    for live in lives:
        assert live.flush(20)
    revision = max(live.revision for live in lives)
    for live in lives:
        assert live.wait(lambda: live.revision >= revision and not live._undelivered, 20)
    for scene in scenes:
        scene.frame()


def fresh(project) -> dict:
    return plain(shown(Usd.Stage.Open(str(project / "shot.usda"), Usd.Stage.LoadAll)))


def change_of(changes: list[Change], path: str) -> Change:
    found = [one for one in changes if one.path == path]
    assert len(found) == 1, (path, changes)
    return found[0]


def made_by(programs: list[Scene], edit) -> list[Change]:
    """The changes that bob gets of an edit of ada. Both are the same as a new stage afterwards."""
    ada, bob = programs
    edit(ada.adapter)
    assert ada.adapter.live.flush(20)
    ada.frame()
    revision = ada.adapter.live.revision
    assert bob.adapter.live.wait(lambda: bob.adapter.live.revision >= revision and not bob.adapter.live._undelivered)
    changes = bob.frame()
    assert plain(ada.objects) == plain(bob.objects)
    return changes


def test_the_first_changes_are_all_prims(programs):
    for scene in programs:
        assert {"/World", "/World/Wall", "/World/Group/Ball", "/World/One/Part", "/Looks/Red/Surface"} <= set(scene.objects)
        assert plain(scene.objects) == plain(shown(scene.adapter.stage))
        assert list(scene.objects) == scene.adapter.paths()
        assert not scene.frame()


EDITS = {
    "transform": (lambda one: one.move("/World/Group", Gf.Matrix4d().SetTranslate(Gf.Vec3d(4, 5, 6))), "/World/Group", Part.TRANSFORM),
    "visibility": (lambda one: one.show("/World/Group", False), "/World/Group", Part.VISIBILITY),
    "mesh": (lambda one: one.set_mesh("/World/Wall", Mesh([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [4], [0, 1, 2, 3])),
             "/World/Wall", Part.MESH),
    "shape": (lambda one: one.set("/World/Group/Ball", "radius", 3.0), "/World/Group/Ball", Part.MESH),
    "material": (lambda one: one.set("/Looks/Red", "inputs:roughness", 0.25), "/Looks/Red", Part.MATERIAL),
    "shader": (lambda one: one.set("/Looks/Red/Surface", "inputs:metallic", 1.0), "/Looks/Red", Part.MATERIAL),
    "binding": (lambda one: one.bind("/World/Wall", "/Looks/Blue"), "/World/Wall", Part.MATERIAL),
    "instances": (lambda one: one.set("/Kit/Part", "size", 4.0), "/World/Two/Part", Part.MESH),
}


@pytest.mark.parametrize("name", EDITS)
def test_a_change_names_its_part(name, programs, project):
    edit, path, part = EDITS[name]
    change = change_of(made_by(programs, edit), path)
    assert change.kind == "changed" and change.parts & part
    if name not in ("binding", "material"):
        assert change.parts == part and change.names
    programs[0].adapter.live.save()
    assert plain(programs[1].objects) == fresh(project)


def test_an_inherited_binding_changes_what_is_below(programs):
    changes = made_by(programs, lambda one: one.bind("/World", "/Looks/Blue"))
    assert change_of(changes, "/World/Group/Ball").parts & Part.MATERIAL
    assert programs[1].objects["/World/Group/Ball"]["material"] == "/Looks/Blue"
    made_by(programs, lambda one: one.bind("/World", ""))
    assert programs[1].objects["/World/Group/Ball"]["material"] == ""


def test_a_material_that_goes_and_returns_is_bound_or_not(programs):
    """The prim with the binding does not change on the stage."""
    wall = [scene.objects["/World/Wall"] for scene in programs]
    for active, material in ((False, ""), (True, "/Looks/Red")):
        made_by(programs, lambda one: one.stage.GetPrimAtPath("/Looks/Red").SetActive(active))
        assert [one["material"] for one in wall] == [material, material]


def test_what_changes_within_and_above_is_told_once(programs, project):
    """In an instance whose type changes, while its prototype gets a prim."""
    def edit(adapter):
        adapter.create("/Kit/New", "Cube")
        adapter.stage.GetPrimAtPath("/World/One").SetTypeName("Scope")
    changes = made_by(programs, edit)
    assert [one.kind for one in changes if one.path == "/World/One/Part"] == ["removed", "created"]
    assert [one.kind for one in changes if one.path == "/World/One/New"] == ["created"]
    programs[0].adapter.live.save()
    assert plain(programs[1].objects) == fresh(project)


def test_a_renamed_object_stays_the_same_object(programs):
    before = [(scene.objects["/World/Group"], scene.objects["/World/Group/Ball"]) for scene in programs]
    changes = made_by(programs, lambda one: one.rename("/World/Group", "/Crowd"))
    assert [(one.kind, one.path, one.former) for one in changes if one.kind != "changed"] == [("renamed", "/Crowd", "/World/Group")]
    for scene, (group, ball) in zip(programs, before):
        assert scene.objects["/Crowd"] is group and scene.objects["/Crowd/Ball"] is ball
    ada = programs[0]
    ada.adapter.rename("/Crowd", "/World/Again")
    ada.frame()  # before it is committed
    assert ada.objects["/World/Again"] is before[0][0]


def test_grouped_objects_stay_the_same_objects(programs):
    """The new parent is made by the same commit."""
    walls = [scene.objects["/World/Wall"] for scene in programs]
    def group(adapter):
        adapter.create("/World/New", "Xform")
        adapter.rename("/World/Wall", "/World/New/Wall")
    changes = made_by(programs, group)
    assert [(one.kind, one.path) for one in changes if one.kind != "changed"] == [("created", "/World/New"), ("renamed", "/World/New/Wall")]
    assert [scene.objects["/World/New/Wall"] is wall for scene, wall in zip(programs, walls)] == [True, True]


def test_another_type_is_another_object(programs):
    def edit(adapter):
        adapter.stage.GetPrimAtPath("/World/Group/Ball").SetTypeName("Cube")
    changes = made_by(programs, edit)
    assert [one.kind for one in changes if one.path == "/World/Group/Ball"] == ["removed", "created"]


def test_opinions_are_exact(programs, project):
    ada = programs[0].adapter
    ada.set("/World/Wall", "note", "é", Sdf.ValueTypeNames.String, layer="set.usda")
    ada.set("/World/Wall", "doubleSided", True, layer="shot.usda")
    ada.set("/World/Wall", "visibility", "invisible", time=4.0, layer="set.usda")
    assert not ada.live.save().failed
    weaker = Sdf.Layer.OpenAsAnonymous(str(project / "set.usda"))
    assert weaker.GetAttributeAtPath("/World/Wall.note").default == "é"
    assert weaker.QueryTimeSample("/World/Wall.visibility", 4.0) == "invisible"
    stronger = Sdf.Layer.OpenAsAnonymous(str(project / "shot.usda"))
    assert stronger.GetAttributeAtPath("/World/Wall.doubleSided").default is True
    assert not stronger.GetAttributeAtPath("/World/Wall.note")
    ada.clear("/World/Wall", "visibility", time=4.0, layer="set.usda")
    assert not ada.live.save().failed
    weaker = Sdf.Layer.OpenAsAnonymous(str(project / "set.usda"))
    assert not weaker.ListTimeSamplesForPath("/World/Wall.visibility")


def test_a_time_shows_the_samples(programs):
    ada, bob = programs
    made_by(programs, lambda one: one.set("/World/Group", "xformOp:translate", Gf.Vec3d(9, 9, 9), time=10.0))
    bob.adapter.set_time(10.0)
    assert change_of(bob.frame(), "/World/Group").parts == Part.TRANSFORM
    assert bob.objects["/World/Group"]["matrix"].ExtractTranslation() == (9, 9, 9)
    bob.adapter.set_time(10.0)
    assert not bob.frame()


def test_what_cannot_be_written_is_an_error(programs, served):
    ada = programs[0].adapter
    for call, code in ((lambda: ada.move("/None", Gf.Matrix4d(1)), "specNotFound"), (lambda: ada.set("/World", "none", 1), "invalidArgument"),
                       (lambda: ada.set("/World/One/Part", "size", 1.0), "invalidArgument"),
                       (lambda: ada.create("/World/Wall", "Mesh"), "specExists"), (lambda: ada.create("no path", "Mesh"), "invalidArgument"),
                       (lambda: ada.show("/World", True, layer="none.usda"), "layerNotFound"),
                       (lambda: ada.set_mesh("/World", Mesh([], [], [])), "invalidArgument"),
                       (lambda: ada.rename("/World/Wall", "/World/Group"), "invalidArgument"),
                       (lambda: ada.rename("/World/Wall", "no path"), "invalidArgument")):
        with pytest.raises(usdlive.Error) as raised:
            call()
        assert raised.value.code == code, raised.value
    run("lock", served.url, "set.usda", "--user", "eve")
    wait(lambda: ada.live.layer_states()["set.usda"].locked if "set.usda" in ada.live.layer_states() else False, ada.live)
    with pytest.raises(usdlive.Error, match="set.usda is locked by eve") as raised:
        ada.show("/World/Group", False, layer="set.usda")
    assert raised.value.code == "forbidden" and ada.live.flush()


class Artist:
    """Makes random edits in a program's scene, or on the stage below it."""

    def __init__(self, rng: random.Random, scene: Scene, name: str):
        self.rng, self.scene, self.adapter, self.name = rng, scene, scene.adapter, name
        self.made = self.done = 0  # names, edits

    def path(self, *types: str) -> str:
        return self.rng.choice([path for path in self.scene.objects if not types or self.adapter.prim(path).GetTypeName() in types])

    def new_name(self) -> str:
        self.made += 1
        return f"{self.name}{self.made}"

    def edit(self) -> None:
        with contextlib.suppress(usdlive.Error, IndexError):
            self.rng.choice([self.create, self.create, self.remove, self.rename, self.move, self.move, self.show, self.mesh, self.bind,
                             self.note, self.radius, self.roughness, self.clear, self.deactivate, self.retype])()
            self.done += 1

    def create(self):
        self.adapter.create(f"{self.path()}/{self.new_name()}", self.rng.choice(["Xform", "Mesh", "Sphere", "Material"]),
                            layer=self.rng.choice([None, "shot.usda", "set.usda"]))

    def remove(self):
        path = self.path()
        if path not in ("/World", "/Looks", "/Kit"):
            self.adapter.remove(path)

    def rename(self):
        old, parent = self.path(), self.path()
        self.adapter.rename(old, f"{self.rng.choice([parent, old.rpartition('/')[0]])}/{self.new_name()}")

    def move(self):
        self.adapter.move(self.path(), Gf.Matrix4d().SetTranslate(Gf.Vec3d(*[self.rng.randint(-9, 9) for _ in range(3)])))

    def show(self):
        self.adapter.show(self.path(), self.rng.random() < 0.5)

    def mesh(self):
        count = self.rng.randint(3, 6)
        self.adapter.set_mesh(self.path("Mesh"), Mesh(Vt.Vec3fArray([(self.rng.randint(0, 9), one, 0) for one in range(count)]), [count],
                                                      list(range(count))))

    def bind(self):
        """Not to a material in an instance: where such a target leads from within a prototype depends on the instance of which
        OpenUSD has made it, which differs between a stage that follows edits and a new one."""
        material = self.path("Material")
        if not self.adapter.prim(material).IsInstanceProxy():
            self.adapter.bind(self.path(), self.rng.choice(["", material]))

    def note(self):
        self.adapter.set(self.path(), "note", str(self.rng.random()), Sdf.ValueTypeNames.String)

    def radius(self):
        self.adapter.set(self.path("Sphere"), "radius", float(self.rng.randint(1, 9)))

    def roughness(self):
        self.adapter.set(self.path("Material"), "inputs:roughness", self.rng.random(), Sdf.ValueTypeNames.Float)

    def clear(self):
        self.adapter.clear(self.path(), self.rng.choice(["note", "radius", "visibility", "points"]))

    def deactivate(self):
        prim = self.adapter.prim(self.path())
        if not prim.IsInstanceProxy() and prim.GetPath().pathElementCount > 1:
            prim.SetActive(False)

    def retype(self):
        prim = self.adapter.prim(self.path("Xform", "Sphere"))
        if not prim.IsInstanceProxy() and prim.GetPath().pathElementCount > 1:
            prim.SetTypeName(self.rng.choice(["Xform", "Sphere"]))


@pytest.mark.parametrize("seed", range(6))
def test_random_edits_of_two_programs_show_the_same_as_a_new_stage(seed, programs, project):
    rng = random.Random(seed)
    artists = [Artist(rng, scene, name) for scene, name in zip(programs, ("a", "b"))]
    for _ in range(4):
        for _ in range(25):
            artist = rng.choice(artists)
            artist.scene.frame()
            artist.edit()
            if rng.random() < 0.5:
                rng.choice(artists).adapter.live.tick()
        synced(programs)
        assert not programs[0].adapter.live.save().failed
        expected = fresh(project)
        for scene in programs:
            assert not differences(plain(scene.objects), expected)
            assert set(scene.adapter.paths()) == set(expected)
    assert sum(artist.done for artist in artists) > 30


class Enough(Exception):
    pass


def test_the_loop_of_the_document_runs(served):
    """With functions that the document leaves to its reader."""
    code = next(block.code for block in blocks("docs/embedding.md") if block.code.startswith("import usdlive.adapter"))
    objects, frames, wanted = {}, [], Gf.Matrix4d().SetTranslate(Gf.Vec3d(7, 8, 9))

    def moved_by_the_user():
        frames.append(1)
        if len(frames) == 3:
            raise Enough
        return [("/World/Wall", wanted)] if len(frames) == 1 else []

    with connect(served, "ada") as live, pytest.raises(Enough):
        exec(code, {"live": live, "place_object": objects.__setitem__, "moved_by_the_user": moved_by_the_user})  # noqa: S102 - our own text
    assert objects["/World/Wall"] == wanted and objects["/World/Group"].ExtractTranslation() == (1, 2, 3)
