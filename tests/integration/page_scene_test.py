"""Tests what the gateway of the page tells when a stage changes, for all kinds of prims."""

import math

import numpy
import pytest
from page_geometry_test import compare
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

HEAD = '#usda 1.0\n(\n    upAxis = "Z"\n    metersPerUnit = 1\n    startTimeCode = 1\n    endTimeCode = 10\n)\n\n'
TRIANGLE = """
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
"""


@pytest.fixture
def shown(project, serve, gateway, page, editor):
    """shown(text, **files) serves a stage, and returns a page of it and an editor."""

    def start(text: str, **files: str):
        (project / "root.usda").write_text(HEAD + text)
        for name, content in files.items():
            (project / f"{name}.usda").write_text(HEAD + content)
        server = serve(project)
        ada = editor(server, "ada", "root.usda")
        run = ada.run
        ada.run = lambda code: run(f"{code}\nassert live.flush(20)")
        return page(gateway(server, "--stage", "root.usda")), ada

    return start


def same_as_the_editor(page, ada, tmp_path, time=Usd.TimeCode.Default()) -> int:
    """Compares the page with the stage of the editor, saved."""
    ada.run(f"stage.Flatten().Export({str(tmp_path / 'flat.usda')!r})")
    return compare(page, Usd.Stage.Open(str(tmp_path / "flat.usda")), time)


def test_a_moved_prim_is_one_matrix(shown):
    children = "".join(f'        def Cube "c{n}"\n        {{\n        }}\n' for n in range(50))
    one, ada = shown(f'def Xform "World"\n{{\n    def Xform "Group"\n    {{\n        double3 xformOp:translate = (0, 0, 0)\n'
                     f'        uniform token[] xformOpOrder = ["xformOp:translate"]\n{children}    }}\n}}\n')
    before = len(one.all)
    one.batches.clear()
    ada.run("stage.GetAttributeAtPath('/World/Group.xformOp:translate').Set((1, 2, 3))")
    one.wait(lambda page: page.batches)
    group = one.at("/World/Group")
    assert list(one.batches[0]) == [1] and list(one.batches[0][1]) == [group["id"]]
    assert one.batches[0][1][group["id"]].tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 2, 3]
    one.wait(lambda page: "changed" in page.messages)
    assert one.messages["changed"]["paths"] == ["/World/Group"] and not one.messages["changed"]["structure"]
    assert not [message for message in one.all[before:] if message["type"] == "scene"]
    assert one.world(one.at("/World/Group/c7"))[3, :3].tolist() == [1, 2, 3]


def test_changes_of_structure(shown, tmp_path):
    one, ada = shown('def Xform "World"\n{\n    def Cube "A"\n    {\n    }\n}\n')
    first = one.at("/World/A")["id"]
    ada.run("UsdGeom.Sphere.Define(stage, '/World/B/C')\nUsdGeom.Cylinder.Define(stage, '/World/B/D').AddTranslateOp().Set((1, 2, 3))")
    one.wait(lambda page: page.has("/World/B/D") and page.at("/World/B/D")["matrix"][9] == 1)
    assert same_as_the_editor(one, ada, tmp_path) == 3
    ada.run("stage.GetPrimAtPath('/World/A').SetTypeName('Sphere')")
    one.wait(lambda page: page.drawn(page.at("/World/A")).shape[0] > 100)
    assert one.at("/World/A")["id"] == first
    ada.run("stage.RemovePrim('/World/B')")
    one.wait(lambda page: not page.has("/World/B/C") and not page.has("/World/B"))
    ada.run("UsdGeom.Xformable(stage.GetPrimAtPath('/World/A')).AddScaleOp().Set((1, 2, 3))")
    one.wait(lambda page: page.at("/World/A")["matrix"][4] == 2)
    ada.run("UsdGeom.Xformable(stage.GetPrimAtPath('/World/A')).SetResetXformStack(True)")
    one.wait(lambda page: page.at("/World/A")["resetsStack"])
    ada.run("UsdGeom.Imageable(stage.GetPrimAtPath('/World')).GetPurposeAttr().Set('proxy')")
    one.wait(lambda page: page.at("/World/A")["purpose"] == "proxy")
    ada.run("UsdGeom.Gprim(stage.GetPrimAtPath('/World/A')).CreateDisplayColorAttr([(1, 0, 0)])")
    one.wait(lambda page: page.at("/World/A").get("color") == [1, 0, 0])
    one.batches.clear()
    ada.run("UsdGeom.Gprim(stage.GetPrimAtPath('/World/A')).GetDisplayColorAttr().Set([(0, 0.5, 0)])")
    one.wait(lambda page: page.at("/World/A").get("color") == [0, 0.5, 0])
    assert any(3 in batch for batch in one.batches)


def test_a_mesh_with_values_of_corners_subsets_and_holes(shown):
    one, ada = shown("""
def Xform "World"
{
    def Mesh "M" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        uniform token subdivisionScheme = "none"
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
        int[] faceVertexCounts = [4, 4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2, 0, 1, 2]
        int[] holeIndices = [2]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "faceVarying"
        )
        int[] primvars:st:indices = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (
            interpolation = "uniform"
        )
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (
            interpolation = "vertex"
        )
        def GeomSubset "right" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </World/Red>
        }
    }
    def Material "Red"
    {
        token outputs:surface.connect = </World/Red/shader.outputs:surface>
        def Shader "shader"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (1, 0, 0)
            float inputs:roughness = 0.25
            token outputs:surface
        }
    }
}
""")
    item = one.at("/World/M")
    arrays = one.geometry(item)
    assert arrays["indices"].size == 12 and "problem" not in item
    place = arrays["indices"].reshape(-1)
    points, uvs, colours = arrays["positions"][place], arrays["uvs"][place], arrays["colours"][place]
    faces = arrays["faces"].reshape(-1)
    assert sorted(set(faces.tolist())) == [0, 1]
    for triangle, face in enumerate(faces):
        assert (colours[3 * triangle:3 * triangle + 3] == [[1, 0, 0], [0, 1, 0]][face]).all()
    assert (uvs == points[:, :2] - numpy.where(numpy.repeat(faces, 3)[:, None] == 1, [[1.0, 0.0]], [[0.0, 0.0]])).all()
    normal = numpy.cross(points[1] - points[0], points[2] - points[0])
    assert normal[2] > 0  # counter-clockwise seen from outside
    subset = item["subsets"][0]
    assert subset["count"] == 6 and set(faces[subset["start"] // 3:subset["start"] // 3 + 2].tolist()) == {0}
    red = one.materials[subset["material"]]
    assert red["color"] == [1, 0, 0] and red["roughness"] == 0.25
    one.batches.clear()
    before = len(one.all)
    ada.run("stage.GetAttributeAtPath('/World/Red/shader.inputs:diffuseColor').Set((0, 0, 1))")
    one.wait(lambda page: page.materials[subset["material"]]["color"] == [0, 0, 1])
    assert not any(message["add"] for message in one.all[before:] if message["type"] == "scene")
    ada.run("stage.GetAttributeAtPath('/World/M.orientation').Set('leftHanded')")
    one.wait(lambda page: page.at("/World/M")["geometry"] != item["geometry"] or page.batches)
    flipped = one.geometry(one.at("/World/M"))
    points = flipped["positions"][flipped["indices"].reshape(-1)]
    assert numpy.cross(points[1] - points[0], points[2] - points[0])[2] < 0
    ada.run("stage.GetAttributeAtPath('/World/M/right.indices').Set([0, 1])")
    one.wait(lambda page: page.at("/World/M")["subsets"][0]["count"] == 12)
    ada.run("stage.GetPrimAtPath('/World/M/right').GetRelationship('material:binding').SetTargets([])")
    one.wait(lambda page: page.at("/World/M")["subsets"][0]["material"] == "")


INSTANCED = """
def Xform "World"
{
    def "i1" (
        instanceable = true
        prepend references = @./lib.usda@</P>
    )
    {
        double3 xformOp:translate = (5, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def "i2" (
        instanceable = true
        prepend references = @./lib.usda@</P>
    )
    {
    }
}
"""
LIBRARY = """
def Xform "P"
{
    def Cube "c"
    {
        double size = 3
        double3 xformOp:translate = (0, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def test_native_instances_share_geometry_and_change_together(shown):
    one, ada = shown(INSTANCED, lib=LIBRARY)
    assert one.at("/World/i1/c")["geometry"] == one.at("/World/i2/c")["geometry"]
    assert one.drawn(one.at("/World/i1/c")).max(axis=0).tolist() == [6.5, 2.5, 1.5]
    ada.run("layer('lib.usda').GetAttributeAtPath('/P/c.size').default = 5.0")
    one.wait(lambda page: page.drawn(page.at("/World/i1/c")).max(axis=0).tolist() == [7.5, 3.5, 2.5] and
             page.drawn(page.at("/World/i2/c")).max(axis=0).tolist() == [2.5, 3.5, 2.5])
    ada.run("layer('lib.usda').GetAttributeAtPath('/P/c.xformOp:translate').default = (0, 2, 0)")
    one.wait(lambda page: all(page.at(f"/World/{name}/c")["matrix"][10] == 2 for name in ("i1", "i2")))
    ada.run("from pxr import Sdf\nspec = Sdf.CreatePrimInLayer(layer('lib.usda'), '/P/d')\nspec.specifier = Sdf.SpecifierDef\n"
            "spec.typeName = 'Sphere'")
    one.wait(lambda page: page.has("/World/i1/d") and page.has("/World/i2/d"))
    ada.run("stage.GetPrimAtPath('/World/i1').SetInstanceable(False)")
    one.wait(lambda page: page.has("/World/i1/d") and page.complete)
    ada.run("stage.GetAttributeAtPath('/World/i1/c.size').Set(7.0)")
    one.wait(lambda page: page.drawn(page.at("/World/i1/c")).max(axis=0)[0] == 8.5)
    assert one.drawn(one.at("/World/i2/c")).max(axis=0)[0] == 2.5


def test_a_point_instancer(shown):
    one, ada = shown("""
def Xform "World"
{
    def PointInstancer "I"
    {
        rel prototypes = [</World/I/Box>, </_classes/Ball>]
        int[] protoIndices = [0, 1, 0]
        point3f[] positions = [(0, 0, 0), (10, 0, 0), (20, 0, 0)]
        float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 1)]
        double3 xformOp:translate = (0, 0, 7)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Box"
        {
            double3 xformOp:translate = (0, 0.5, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
}
class "_classes"
{
    def Sphere "Ball"
    {
    }
}
""")
    one.wait(lambda page: page.instances)
    item = one.at("/World/I")
    assert item["kind"] == "instancer"
    box, ball = (one.items[number] for number in item["instances"]["prototypes"])
    assert box["path"] == "/World/I/Box" and box["prototypeOf"] == item["id"] == ball["prototypeOf"]
    matrices, prototypes = one.instances[item["id"]]
    assert prototypes.tolist() == [0, 1, 0] and matrices[:, 9].tolist() == [0, 10, 20] and matrices[1, 0] == 2
    ada.run("stage.GetAttributeAtPath('/World/I.positions').Set([(0, 0, 1), (10, 0, 1), (30, 0, 1)])")
    one.wait(lambda page: page.instances[item["id"]][0][2, 9] == 30)
    ada.run("stage.GetAttributeAtPath('/World/I.invisibleIds').Set([1])\n")
    one.wait(lambda page: page.instances[item["id"]][1].tolist() == [0, 0])
    ada.run("stage.GetAttributeAtPath('/World/I.protoIndices').Set([0, 1, 9])\nstage.GetAttributeAtPath('/World/I.invisibleIds').Set([])")
    one.wait(lambda page: "problem" in page.at("/World/I") and page.instances[item["id"]][1].tolist() == [0, 1])


def test_curves_points_cameras_and_lights(shown):
    one, ada = shown("""
def BasisCurves "Line"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [3, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (5, 0, 0), (6, 0, 0)]
}
def BasisCurves "Round"
{
    uniform token type = "cubic"
    uniform token basis = "bezier"
    int[] curveVertexCounts = [4]
    point3f[] points = [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)]
}
def Points "Dots"
{
    point3f[] points = [(0, 0, 0), (1, 2, 3)]
    float[] widths = [0.5, 0.25]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (
        interpolation = "vertex"
    )
}
def Camera "Cam"
{
    float focalLength = 35
    float2 clippingRange = (0.1, 1000)
    token projection = "orthographic"
}
def SphereLight "Lamp"
{
    float inputs:intensity = 500
    color3f inputs:color = (1, 0.5, 0)
    float inputs:radius = 2
}
def Skeleton "Bones"
{
}
""")
    line = one.geometry(one.at("/Line"))
    assert line["kind"] == 2 and line["indices"].reshape(-1).tolist() == [0, 1, 1, 2, 3, 4]
    curve = one.geometry(one.at("/Round"))["positions"]
    assert curve[0].tolist() == [0, 0, 0] and curve[-1].tolist() == [1, 0, 0] and curve[:, 1].max() == pytest.approx(0.75, abs=0.01)
    dots = one.geometry(one.at("/Dots"))
    assert dots["kind"] == 3 and dots["widths"].reshape(-1).tolist() == [0.5, 0.25] and dots["colours"].tolist() == [[1, 0, 0], [0, 1, 0]]
    camera = one.at("/Cam")["camera"]
    assert camera["focal"] == 35 and camera["projection"] == "orthographic" and camera["near"] == pytest.approx(0.1)
    light = one.at("/Lamp")["light"]
    assert (light["type"], light["intensity"], light["color"], light["radius"]) == ("sphere", 500, [1, 0.5, 0], 2)
    assert one.at("/Bones")["kind"] == "skeleton"
    ada.run("stage.GetAttributeAtPath('/Lamp.inputs:intensity').Set(100)\nstage.GetAttributeAtPath('/Cam.focalLength').Set(85)")
    one.wait(lambda page: page.at("/Lamp")["light"]["intensity"] == 100 and page.at("/Cam")["camera"]["focal"] == 85)


def test_time_samples(shown, tmp_path):
    one, ada = shown("""
def Xform "World"
{
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 10: (9, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    token visibility.timeSamples = { 1: "inherited", 5: "invisible" }
    def Mesh "M"
    {
        point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 10: [(0, 0, 0), (10, 0, 0), (0, 10, 0)] }
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }
    def Cube "Still"
    {
    }
}
""")
    assert one.messages["welcome"]["endTime"] == 10 and one.messages["welcome"]["time"] is None
    still = one.at("/World/Still")["geometry"]
    one.ask("time", time=5.5)
    one.wait(lambda page: page.messages["state"]["time"] == 5.5 and not page.at("/World")["visible"])
    one.wait(lambda page: page.drawn(page.at("/World/M"))[:, 0].max() == pytest.approx(4.5 + 5.5))
    assert one.world(one.at("/World"))[3, 0] == 4.5 and one.at("/World/Still")["geometry"] == still
    same_as_the_editor(one, ada, tmp_path, Usd.TimeCode(5.5))
    one.ask("time", time=None)
    one.wait(lambda page: page.messages["state"]["time"] is None)


SKINNED = """
def SkelRoot "Root"
{
    def Skeleton "Skel" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {
        uniform token[] joints = ["a", "a/b"]
        uniform matrix4d[] bindTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2,0,1))]
        uniform matrix4d[] restTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2,0,1))]
        rel skel:animationSource = </Root/Skel/Anim>
        double3 xformOp:translate = (3, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def SkelAnimation "Anim"
        {
            uniform token[] joints = ["a", "a/b"]
            float3[] translations = [(0, 0, 0), (0, 2, 0)]
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
            quatf[] rotations.timeSamples = { 1: [(1, 0, 0, 0), (1, 0, 0, 0)], 10: [(1, 0, 0, 0), (0.7071068, 0, 0, 0.7071068)] }
        }
    }
    def Mesh "Arm" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 4, 0), (0, 4, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        rel skel:skeleton = </Root/Skel>
        matrix4d primvars:skel:geomBindTransform = ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))
        int[] primvars:skel:jointIndices = [0, 0, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        float[] primvars:skel:jointWeights = [1, 1, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def baked(project, time: float) -> numpy.ndarray:
    """The points in the world as UsdSkel bakes them."""
    layer = Sdf.Layer.CreateAnonymous(".usda")  # baking writes into it
    layer.ImportFromString((project / "root.usda").read_text())
    stage = Usd.Stage.Open(layer)
    # Between the samples of the animation, OpenUSD sometimes bakes the pose of the sample before.
    for attribute in stage.GetPrimAtPath("/Root/Skel/Anim").GetAttributes():
        if attribute.GetNumTimeSamples():
            attribute.Set(attribute.Get(time), time)
    UsdSkel.BakeSkinning(stage.Traverse(), Gf.Interval(time, time))
    prim = stage.GetPrimAtPath("/Root/Arm")
    world = UsdGeom.XformCache(Usd.TimeCode(time)).GetLocalToWorldTransform(prim)
    return numpy.array([world.Transform(Gf.Vec3d(*map(float, point))) for point in prim.GetAttribute("points").Get(time)])


def test_skinned_meshes(shown, project):
    one, ada = shown(SKINNED)
    for time in (1.0, 5.5, 10.0):
        one.ask("time", time=time)
        wanted = baked(project, time)
        one.wait(lambda page: numpy.allclose(page.drawn(page.at("/Root/Arm")), wanted, atol=1e-4))
    ada.run("from pxr import Gf\nstage.GetAttributeAtPath('/Root/Skel/Anim.translations').Set([(0, 0, 0), (0, 3, 0)])")
    one.wait(lambda page: page.drawn(page.at("/Root/Arm"))[:, 1].max() > 3.5)


def test_textures(shown, project):
    (project / "tex").mkdir()
    png = bytes.fromhex("89504e470d0a1a0a0000000d4948445200000001000000010806000000"
                        "1f15c4890000000d49444154789c6360000002000001e221bc330000000049454e44ae426082")
    (project / "tex" / "wood.png").write_bytes(png)
    (project / "tex" / "odd.exr").write_bytes(b"v/1\x01 nothing")
    shader = """
    def Material "M"
    {{
        token outputs:surface.connect = </World/M/surface.outputs:surface>
        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/M/texture.outputs:rgb>
            token outputs:surface
        }}
        def Shader "texture"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{file}@
            token inputs:wrapS = "mirror"
            float2 inputs:st.connect = </World/M/turn.outputs:result>
            float3 outputs:rgb
        }}
        def Shader "turn"
        {{
            uniform token info:id = "UsdTransform2d"
            float inputs:rotation = 90
            float2 inputs:scale = (2, 3)
            float2 outputs:result
        }}
    }}
"""
    one, ada = shown('def Xform "World"\n{\n    def Mesh "S" (\n        prepend apiSchemas = ["MaterialBindingAPI"]\n    )\n    {\n'
                     f"        rel material:binding = </World/M>\n{TRIANGLE}    }}\n{shader.format(file='./tex/wood.png')}}}\n")
    name = one.at("/World/S")["material"]
    one.wait(lambda page: page.materials[name]["textures"]["color"]["hash"])
    texture = one.materials[name]["textures"]["color"]
    assert texture["wrapS"] == "mirror" and texture["rotate"] == 90 and texture["uvScale"] == [2, 3] and texture["srgb"]
    status, headers, content = one.gateway.get(f"/blob/{texture['hash']}")
    assert (status, headers["content-type"], content) == (200, "image/png", png)
    for file, problem in (("./tex/none.png", "was not found"), ("./tex/odd.exr", "no image that browsers show"), ("./t.<UDIM>.png", "tiles")):
        ada.run(f"from pxr import Sdf\nstage.GetAttributeAtPath('/World/M/texture.inputs:file').Set(Sdf.AssetPath({file!r}))")
        one.wait(lambda page: problem in page.materials[name].get("problem", ""))
    ada.run("stage.GetAttributeAtPath('/World/M/texture.inputs:file').Set(Sdf.AssetPath('./tex/wood.png'))")
    one.wait(lambda page: page.materials[name]["textures"]["color"]["hash"] == texture["hash"])


HOSTILE = """
def Xform "World"
{
    def Mesh "Nan"
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (nan, 1, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 1, 3]
    }
    def Mesh "Counts"
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3, 500, -1]
        int[] faceVertexIndices = [0, 1, 2]
    }
    def Mesh "Indices"
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3, 3, 2]
        int[] faceVertexIndices = [0, 1, 2, 0, 1, 99, 0, 1]
    }
    def Mesh "Empty"
    {
    }
    def Mesh "Short"
    {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        texCoord2f[] primvars:st = [(0, 0)] (
            interpolation = "faceVarying"
        )
    }
    def Cube "Infinite"
    {
        double size = inf
        matrix4d xformOp:transform = ((nan,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))
        uniform token[] xformOpOrder = ["xformOp:transform"]
    }
    def BasisCurves "Curves"
    {
        int[] curveVertexCounts = [7, -3]
        point3f[] points = [(0, 0, 0)]
    }
    def NurbsPatch "Patch"
    {
    }
    def Unheard "Schema"
    {
        def Cube "Below"
        {
        }
    }
    def PointInstancer "Broken"
    {
        rel prototypes = [</World/None>]
        int[] protoIndices = [0, 1, -1]
        point3f[] positions = [(0, 0, 0)]
    }
    def Scope "Cycle" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        rel material:binding = </World/Cycle.other>
        rel other = </World/Cycle.material:binding>
    }
    def Material "Loop"
    {
        token outputs:surface.connect = </World/Loop.outputs:surface>
    }
    def Cube "Bound" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        rel material:binding = </World/Loop>
    }
    def Cube "Self" (
        prepend references = </World/Self>
    )
    {
    }
    def DistantLight "Light"
    {
        float inputs:intensity = nan
    }
    def Camera "Camera"
    {
        float2 clippingRange = (nan, inf)
    }
    def Cube "Good"
    {
        string note = "<script>alert(1)</script>"
        double strange = nan
    }
}
"""


def test_what_cannot_be_drawn_says_so_and_stops_nothing(shown):
    one, ada = shown(HOSTILE)
    problems = {item["path"].rsplit("/", 1)[-1]: item["problem"] for item in one.items.values() if "problem" in item}
    assert set(problems) >= {"Nan", "Counts", "Indices", "Short", "Infinite", "Curves", "Patch", "Broken"}, problems
    assert set(problems).isdisjoint({"Good", "Below", "Light", "Camera", "World"}), problems
    assert one.geometry(one.at("/World/Nan"))["indices"].size == 3  # the good triangle is drawn
    assert one.geometry(one.at("/World/Indices"))["indices"].size == 3
    assert all(map(math.isfinite, one.at("/World/Infinite")["matrix"]))
    assert one.at("/World/Light")["light"]["intensity"] == 1 and one.at("/World/Camera")["camera"]["far"] == 1e6
    assert one.drawn(one.at("/World/Good")).max() == 1 and one.has("/World/Schema/Below")
    found = {prop["name"]: prop for prop in one.ask("properties", path="/World/Good")["properties"]}
    assert found["strange"]["value"] == "nan" and found["note"]["value"] == "<script>alert(1)</script>"
    for item in list(one.items.values()):
        one.ask("properties", path=item["path"])
    one.ask("bounds", paths=["/World", "/World/Infinite", "/World/Nan"])
    # It still follows.
    ada.run("UsdGeom.Xformable(stage.GetPrimAtPath('/World/Good')).AddTranslateOp().Set((float('nan'), 0, 0))")
    one.wait(lambda page: "problem" in page.at("/World/Good"))
    ada.run("stage.GetAttributeAtPath('/World/Good.xformOp:translate').Set((4, 0, 0))\nstage.GetAttributeAtPath('/World/Infinite.size').Set(1.0)")
    one.wait(lambda page: page.at("/World/Good")["matrix"][9] == 4 and "problem" not in page.at("/World/Good"))


def test_a_million_points(shown, project):
    numbers = ", ".join(f"({n % 1000}, {n // 1000}, 0)" for n in range(1_000_000))
    one, ada = shown(f'def Points "P"\n{{\n    point3f[] points = [{numbers}]\n}}\ndef Cube "C"\n{{\n}}\n')
    assert len(one.geometry(one.at("/P"))["positions"]) == 1_000_000
    ada.run("UsdGeom.Xformable(stage.GetPrimAtPath('/C')).AddTranslateOp().Set((1, 0, 0))")
    one.wait(lambda page: page.at("/C")["matrix"][9] == 1)
