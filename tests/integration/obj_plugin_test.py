"""The file format plug-in for Wavefront .obj, in stock usd-core and in a served project."""

import os
import pathlib
import subprocess
import sys

import pytest

BUILD = pathlib.Path(os.environ["USDLIVE_BUILD"])
PLUGINS = BUILD / "usd-plugins"

CHAIR = """# made by hand
mtllib chair.mtl
o Seat
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl Red wood
f 1/1/1 2/2/1 3/3/1
usemtl Steel
f 1/1/1 3/3/1 4/4/1
o Left leg
v 0 0 -1 1 0 0
v 0 1 -1 0 1 0
v 1 1 -1 0 0 1
usemtl Steel
f 5 6 7
l 5 6
p 7
"""


@pytest.fixture
def run(tmp_path):
    """run(code) runs code in a Python process that has usd-core and the plug-ins, and nothing else of ours. Names:
    `folder`, pxr's modules, `fails(action)`, which returns the errors of an action."""
    start = f"""
import pathlib, sys
from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade
assert "usdlive" not in sys.modules
folder = pathlib.Path({str(tmp_path)!r})
def fails(action):
    try:
        result = action()
    except Tf.ErrorException as error:
        return str(error)
    raise AssertionError(f"not refused: {{result}}")
"""

    def in_process(code):
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        environment["PXR_PLUGINPATH_NAME"] = str(PLUGINS)
        ran = subprocess.run([sys.executable, "-c", start + code], text=True, capture_output=True, env=environment)
        assert ran.returncode == 0, ran.stderr[-4000:]
        return ran

    return in_process


@pytest.fixture
def chair(tmp_path):
    (tmp_path / "chair.obj").write_text(CHAIR)
    return tmp_path / "chair.obj"


def test_the_library_needs_only_usd_core():
    library = PLUGINS / "usdliveObj" / "usdliveObj.so"
    needed = subprocess.run(["readelf", "-d", library], text=True, capture_output=True, check=True).stdout
    names = [line.split("[")[1].split("]")[0] for line in needed.splitlines() if "(NEEDED)" in line]
    assert not [name for name in names if not name.startswith(
        ("libusd_ms", "libtbb", "libstdc++", "libm.", "libgcc_s", "libc.", "ld-linux"))], names
    exported = subprocess.run(["nm", "-DC", "--defined-only", library], text=True, capture_output=True, check=True)
    assert not [line for line in exported.stdout.splitlines() if " std::" not in line and "__gnu_cxx" not in line
                and "typeinfo" not in line], "it exports no symbols of its own"


def test_a_layer_has_the_content_of_the_file(run, chair):
    run("""
layer = Sdf.Layer.FindOrOpen(str(folder / "chair.obj"))
assert layer.defaultPrim == "Model" and layer.GetFileFormat().formatId == "usdliveObj"
stage = Usd.Stage.Open(layer)
assert UsdGeom.GetStageUpAxis(stage) == "Y"
assert [str(prim.GetPath()) for prim in stage.Traverse()] == [
    "/Model", "/Model/Seat", "/Model/Seat/Red_wood", "/Model/Seat/Steel", "/Model/Left_leg", "/Model/Left_leg_lines",
    "/Model/Left_leg_points", "/Model/Materials", "/Model/Materials/Red_wood", "/Model/Materials/Steel"]
seat, leg = UsdGeom.Mesh.Get(stage, "/Model/Seat"), UsdGeom.Mesh.Get(stage, "/Model/Left_leg")
assert Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == "component"
assert list(seat.GetFaceVertexCountsAttr().Get()) == [3, 3]
assert list(seat.GetFaceVertexIndicesAttr().Get()) == [0, 1, 2, 0, 2, 3]
assert list(leg.GetFaceVertexIndicesAttr().Get()) == [0, 1, 2], "its own points only"
assert leg.GetPointsAttr().Get()[2] == (1, 1, -1)
assert [tuple(color) for color in leg.GetDisplayColorAttr().Get()] == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
assert not seat.GetDisplayColorAttr().HasAuthoredValue()
assert leg.GetPrim().GetDisplayName() == "Left leg"
texture = UsdGeom.PrimvarsAPI(seat).GetPrimvar("st")
assert texture.GetInterpolation() == "faceVarying" and texture.GetTypeName() == "texCoord2f[]"
assert list(texture.ComputeFlattened()) == [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)]
assert len(UsdGeom.PrimvarsAPI(seat).GetPrimvar("normals").Get()) == 1
assert tuple(map(tuple, seat.GetExtentAttr().Get())) == ((0, 0, 0), (1, 1, 0))
assert UsdGeom.BasisCurves.Get(stage, "/Model/Left_leg_lines").GetTypeAttr().Get() == "linear"
binding = UsdShade.MaterialBindingAPI
subsets = binding(seat).GetMaterialBindSubsets()
assert [list(subset.GetIndicesAttr().Get()) for subset in subsets] == [[0], [1]]
assert UsdGeom.Subset.ValidateFamily(seat, "face", "materialBind")[0]
assert binding(subsets[0]).ComputeBoundMaterial()[0].GetPath() == "/Model/Materials/Red_wood"
assert binding(leg).ComputeBoundMaterial()[0].GetPath() == "/Model/Materials/Steel"
""")


def test_as_sublayer_reference_and_payload_with_arguments(run, chair):
    run("""
root = Sdf.Layer.CreateNew(str(folder / "root.usda"))
root.subLayerPaths.append("./chair.obj")
stage = Usd.Stage.Open(root)
referenced, paid = stage.DefinePrim("/Referenced"), stage.DefinePrim("/Paid")
referenced.GetReferences().AddReference("./chair.obj:SDF_FORMAT_ARGS:split=none&upAxis=Z")
paid.GetPayloads().AddPayload("./chair.obj:SDF_FORMAT_ARGS:root=Chair", "/Chair/Seat")
names = lambda path: [prim.GetName() for prim in stage.GetPrimAtPath(path).GetChildren()]
assert names("/Model") == ["Seat", "Left_leg", "Left_leg_lines", "Left_leg_points", "Materials"]
assert names("/Referenced") == ["default", "default_lines", "default_points", "Materials"]
assert names("/Paid") == ["Red_wood", "Steel"] and paid.IsA("Mesh")
used = [layer for layer in stage.GetUsedLayers() if layer.GetFileFormat().formatId == "usdliveObj"]
assert len(used) == 3, "the arguments are part of the identity of a layer"
assert {layer.GetFileFormatArguments().get("upAxis"): layer.pseudoRoot.GetInfo("upAxis") for layer in used} == {
    None: "Y", "Z": "Z"}
again = stage.DefinePrim("/Again")
again.GetReferences().AddReference("./chair.obj:SDF_FORMAT_ARGS:upAxis=Z&split=none")
assert len([layer for layer in stage.GetUsedLayers() if layer in used]) == 3, "equal arguments share one"
stage.GetPrimAtPath("/Paid").Unload()
assert not stage.GetPrimAtPath("/Paid/Steel")

def message(arguments):
    return fails(lambda: Sdf.Layer.FindOrOpen(str(folder / "chair.obj"), arguments))
assert "'upAxis' is Y or Z, not 'X'" in message({"upAxis": "X"})
assert "'metersPerUnit' is a positive number, not '0'" in message({"metersPerUnit": "0"})
assert "'split' is automatic, objects, groups or none, not 'all'" in message({"split": "all"})
assert "'root' is the name of a prim, not '1'" in message({"root": "1"})
scaled = Sdf.Layer.FindOrOpen(str(folder / "chair.obj"), {"metersPerUnit": "0.01"})
assert UsdGeom.GetStageMetersPerUnit(Usd.Stage.Open(scaled)) == 0.01
only = Sdf.Layer.OpenAsAnonymous(str(folder / "chair.obj"), True)
assert only.defaultPrim == "Model" and not only.rootPrims
""")


@pytest.mark.parametrize("text, where", [
    (CHAIR.replace("f 5 6 7", "f 5 6 8"), "line 22: uses vertex 8, and the file has 7"),
    (CHAIR.replace("v 1 1 0\n", "v 1 1\n"), "line 6: 'v' needs 3 numbers, and has 2"),
    ("PXR-USDC", "line 1: unknown statement 'PXR-USDC'"),
    (CHAIR + "curv2 1 2\n", "line 25: 'curv2': free-form geometry is not supported"),
])
def test_bad_input_is_an_error_with_file_line_and_reason(run, tmp_path, chair, text, where):
    (tmp_path / "bad.obj").write_text(text)
    (tmp_path / "root.usda").write_text(
        '#usda 1.0\ndef "Bad" (references = @./bad.obj@) {}\ndef "Good" (references = @./chair.obj@) {}\n')
    run(f"""
error = fails(lambda: Sdf.Layer.FindOrOpen(str(folder / "bad.obj")))
assert str(folder / "bad.obj") in error and {where!r} in error, error
assert not Sdf.Layer.Find(str(folder / "bad.obj")), "nothing is half read"
stage = Usd.Stage.Open(str(folder / "root.usda"))
assert stage.GetPrimAtPath("/Good/Seat") and not stage.GetPrimAtPath("/Bad").GetChildren()
(error,) = stage.GetCompositionErrors()
assert "bad.obj" in str(error), error
""")


def test_a_file_that_becomes_bad_keeps_the_layer(run, chair):
    run("""
path = folder / "chair.obj"
layer = Sdf.Layer.FindOrOpen(str(path))
stage = Usd.Stage.Open(layer)
before, text = layer.ExportToString(), path.read_text()
path.write_text(text.replace("f 5 6 7", "f 5 6 8"))
assert "line 22" in fails(lambda: layer.Reload(force=True))
assert layer.ExportToString() == before
path.write_text(text.replace("v 1 1 -1", "v 2 2 -2"))
layer.Reload(force=True)
mesh = UsdGeom.Mesh.Get(stage, "/Model/Left_leg")
assert mesh.GetPointsAttr().Get()[2] == (2, 2, -2), "the stage has what the file has"
""")


def test_exports_have_the_content_of_the_layer(run, chair):
    run("""
layer = Sdf.Layer.FindOrOpen(str(folder / "chair.obj"))
for name in ("copy.usda", "copy.usdc", "copy.obj"):
    assert layer.Export(str(folder / name))
    copy = Sdf.Layer.FindOrOpen(str(folder / name))
    if name == "copy.obj":
        # The order of the parts may change.
        assert sorted(copy.ExportToString().splitlines()) == sorted(layer.ExportToString().splitlines())
    else:
        assert copy.ExportToString() == layer.ExportToString(), name
again = Sdf.Layer.FindOrOpen(str(folder / "copy.obj"))
again.Export(str(folder / "third.obj"))
assert (folder / "third.obj").read_text() == (folder / "copy.obj").read_text()
text = Sdf.Layer.CreateAnonymous(".obj")
assert text.ImportFromString(layer.ExportToString()) and text.ExportToString() == layer.ExportToString()
assert layer.GetPrimAtPath("/Model/Seat").GetAsText().startswith('def Mesh "Seat"')
""")


def test_edits_are_saved(run, chair):
    run("""
from pxr import Vt
layer = Sdf.Layer.FindOrOpen(str(folder / "chair.obj"))
stage = Usd.Stage.Open(layer)
seat = UsdGeom.Mesh.Get(stage, "/Model/Seat")
seat.GetPointsAttr().Set([(0, 0, 0.1), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
# Other interpolations, and values without indices, are stored as well.
st = UsdGeom.PrimvarsAPI(seat).GetPrimvar("st")
st.BlockIndices(); seat.GetPrim().RemoveProperty("primvars:st:indices")
st.Set(Vt.Vec2fArray([(0, 0), (.25, 0), (.5, 0), (.75, 0)])); st.SetInterpolation("vertex")
for name in ("primvars:normals", "primvars:normals:indices"):
    seat.GetPrim().RemoveProperty(name)
seat.CreateNormalsAttr([(0, 1, 0), (0, 0, 1)]); seat.SetNormalsInterpolation("uniform")
new = UsdGeom.Mesh.Define(stage, "/Model/New")
new.CreatePointsAttr([(0, 0, 0), (0, 0, 1), (0, 1, 1)])
new.CreateFaceVertexCountsAttr([3]); new.CreateFaceVertexIndicesAttr([0, 1, 2])
new.CreateSubdivisionSchemeAttr("none")
stage.RemovePrim("/Model/Left_leg_points")
assert layer.Save() and not layer.dirty
fresh = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(folder / "chair.obj")))
assert [prim.GetName() for prim in fresh.GetPrimAtPath("/Model").GetChildren()] == [
    "Left_leg_lines", "New", "Seat", "Left_leg", "Materials"]
seat = UsdGeom.Mesh.Get(fresh, "/Model/Seat")
assert list(UsdGeom.PrimvarsAPI(seat).GetPrimvar("st").ComputeFlattened()) == [
    (0, 0), (.25, 0), (.5, 0), (0, 0), (.5, 0), (.75, 0)]
assert list(UsdGeom.PrimvarsAPI(seat).GetPrimvar("normals").ComputeFlattened()) == [(0, 1, 0)] * 3 + [(0, 0, 1)] * 3
for split in ("automatic", "none"):
    (folder / "cloud.obj").write_text("v 0 0 0 1 0 0\\nv 1 1 1 0 1 0\\n")
    cloud = Sdf.Layer.FindOrOpen(str(folder / "cloud.obj"), {"split": split})
    assert cloud.GetPrimAtPath("/Model/default").typeName == "Points" and cloud.Save(True)
created = Sdf.Layer.CreateNew(str(folder / "new.obj"))
empty = Sdf.Layer.OpenAsAnonymous(str(folder / "new.obj"))
assert (folder / "new.obj").read_text() == "" and not empty.rootPrims
""")


REFUSALS = {
    "UsdGeom.Sphere.Define(stage, '/Model/Ball')": "</Model/Ball> cannot be stored",
    "stage.DefinePrim('/Other', 'Xform')": "</Other> cannot be stored",
    "UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/Model')).SetTranslate((1, 0, 0))": "xformOp:translate",
    "seat.GetPointsAttr().Set(seat.GetPointsAttr().Get(), 1)": "'timeSamples' of </Model/Seat.points>",
    "seat.GetSubdivisionSchemeAttr().Set('catmullClark')": "</Model/Seat> is a subdivision surface",
    "seat.GetDoubleSidedAttr().Set(True)": "</Model/Seat.doubleSided> cannot be stored",
    "seat.GetPrim().SetMetadata('comment', 'look')": "'comment' of </Model/Seat>",
    "seat.GetPrim().SetActive(False)": "'active' of </Model/Seat>",
    "seat.GetPrim().GetReferences().AddReference('a.usda')": "'references' of </Model/Seat>",
    "seat.GetFaceVertexIndicesAttr().Set([0, 1, 2, 0, 2, 9])": "'faceVertexIndices' has 9, and there are 4 points",
    "seat.GetFaceVertexCountsAttr().Set([3])": "the sum of 'faceVertexCounts' is 3, and there are 6 corners",
    "seat.GetFaceVertexCountsAttr().Set([2, 4])": "'faceVertexCounts' has 2",
    "seat.GetPointsAttr().Set([(0, 0, 0)] * 5)": "'default' of </Model/Seat.points>",
    "UsdGeom.PrimvarsAPI(seat).GetPrimvar('st').Set([(0, 0)])": "primvars:st> has too few values",
    "UsdGeom.PrimvarsAPI(seat).CreatePrimvar('heat', Sdf.ValueTypeNames.FloatArray)": "primvars:heat> cannot",
    "stage.GetPrimAtPath('/Model').GetVariantSets().AddVariantSet('look').AddVariant('a')": "'variantSetChildren' of </Model>",
    "stage.SetMetadata('upAxis', 'Z')": "Z would be read as Y",
    "stage.SetMetadata('metersPerUnit', 0.5)": "'metersPerUnit' of </>",
    "stage.GetPrimAtPath('/Model/Materials/Steel').SetMetadata('kind', 'x')": "'kind' of </Model/Materials/Steel>",
    "UsdShade.Shader.Define(stage, '/Model/Materials/Steel/Shader')": "</Model/Materials/Steel/Shader> cannot",
    "stage.DefinePrim('/Model/Materials/Unused', 'Material')": "</Model/Materials/Unused> cannot be stored",
    "seat.GetPrim().SetDisplayName('Chair')": "'displayName' of </Model/Seat>",
    "seat.GetPrim().SetMetadata('customData', {'a': 1})": "'customData' of </Model/Seat>",
    "seat.GetPrim().GetRelationship('proxyPrim').SetTargets(['/Model'])": "proxyPrim> cannot be stored",
    "seat.GetPointsAttr().AddConnection('/Model/Left_leg.points')": "'connectionPaths' of </Model/Seat.points>",
}


def test_what_the_format_cannot_store_is_refused_and_the_file_stays(run, chair):
    run(f"refusals = {REFUSALS!r}\n" + """
path = folder / "chair.obj"
text = path.read_text()
for code, part in refusals.items():
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    stage = Usd.Stage.Open(layer)
    seat = UsdGeom.Mesh.Get(stage, "/Model/Seat")
    exec(code)
    error = fails(lambda: layer.Export(str(path)))
    assert part in error and str(path) in error, (code, error)
    assert path.read_text() == text, code
assert [entry.name for entry in folder.iterdir() if entry.is_file()] == ["chair.obj"], "no temporary file is left"
""")


def test_a_hundred_thousand_vertices_open_quickly(run, tmp_path):
    side = 320
    lines = [f"v {x} {y} {(x * y) % 7}\n" for y in range(side) for x in range(side)]
    lines += [f"f {a} {a + 1} {a + side + 1} {a + side}\n"
              for y in range(side - 1) for a in range(y * side + 1, (y + 1) * side)]
    (tmp_path / "grid.obj").write_text("".join(lines))
    run(f"""
import time
begin = time.process_time()
stage = Usd.Stage.Open(str(folder / "grid.obj"))
assert len(UsdGeom.Mesh.Get(stage, "/Model/default").GetPointsAttr().Get()) == {side * side}
assert time.process_time() - begin < 5
""")


def test_a_referenced_file_is_live_on_an_attached_stage(project, serve):
    import time

    import usdlive
    from pxr import Usd, UsdGeom
    chair = project / "chair.obj"
    chair.write_text(CHAIR)
    (project / "root.usda").write_text('''#usda 1.0
def "Chair" (
    references = @./chair.obj@
)
{
}
def "Turned" (
    references = @./chair.obj:SDF_FORMAT_ARGS:upAxis=Z@
)
{
}
''')
    server = serve(project)
    stage = Usd.Stage.Open(str(project / "root.usda"))
    with usdlive.connect(server.url, user="ada") as ada:
        assert ada.attach(stage) == ["root.usda"]

        def points(path):
            return UsdGeom.Mesh.Get(stage, path + "/Left_leg").GetPointsAttr().Get()[2]

        def wait(condition):
            end = time.monotonic() + 20
            while not condition():
                assert time.monotonic() < end, (points("/Chair"), points("/Turned"))
                ada.tick()
                time.sleep(0.01)

        over = UsdGeom.Mesh.Get(stage, "/Chair/Seat")
        over.GetDoubleSidedAttr().Set(True)
        assert ada.flush()
        chair.write_text(CHAIR.replace("v 1 1 -1", "v 2 2 -2"))
        wait(lambda: points("/Chair") == points("/Turned") == (2, 2, -2))
        assert over.GetDoubleSidedAttr().Get(), "opinions of the project's layers stay"
        # A program may write a file in several steps.
        chair.write_text(CHAIR + "f 1 2")
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            ada.tick()
            time.sleep(0.01)
        assert points("/Chair") == (2, 2, -2)
        chair.unlink()
        ada.tick()
        chair.write_text(CHAIR.replace("v 1 1 -1", "v 3 3 -3"))
        wait(lambda: points("/Chair") == points("/Turned") == (3, 3, -3))
        # A second attach changes nothing; a file that the stage uses later is followed, too.
        ada.attach(stage)
        table = project / "table.obj"
        table.write_text(CHAIR)
        stage.DefinePrim("/Table").GetReferences().AddReference("./table.obj")
        assert ada.flush() and points("/Table") == (1, 1, -1)
        time.sleep(0.6)
        ada.tick()
        table.write_text(CHAIR.replace("v 1 1 -1", "v 4 4 -4"))
        wait(lambda: points("/Table") == (4, 4, -4))
        # Unsaved edits of the file are not lost.
        (layer,) = [layer for layer in stage.GetUsedLayers()
                    if layer.identifier.endswith("chair.obj") and layer.realPath]
        layer.GetAttributeAtPath("/Model/Left_leg.points").default = [(0, 0, -1), (0, 1, -1), (9, 9, -9)]
        chair.write_text(CHAIR)
        wait(lambda: points("/Turned") == (1, 1, -1))
        assert points("/Chair") == (9, 9, -9)
