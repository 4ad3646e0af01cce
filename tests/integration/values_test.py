"""Every value type and every kind of edit, in both directions between pxr.Usd processes."""

import re

import pytest
from conftest import cat
from pxr import Sdf

SCALARS = {
    "bool": "True", "uchar": "200", "int": "-7", "uint": "4000000000", "int64": "-2**60",
    "uint64": "2**63 + 5", "half": "1.5", "float": "0.1", "double": "1/3", "timecode": "Sdf.TimeCode(24)",
    "string": "'ünï \"quoted\" \\n line'", "token": "'word'", "asset": "Sdf.AssetPath('./tex/a.png')",
    "pathExpression": "Sdf.PathExpression('/World//{isa:Mesh} - //Hidden')",
    "matrix2d": "Gf.Matrix2d(1, 2, 3, 4)", "matrix3d": "Gf.Matrix3d(2)", "matrix4d": "Gf.Matrix4d(3)",
    "quath": "Gf.Quath(1, 2, 3, 4)", "quatf": "Gf.Quatf(1, 2, 3, 4)", "quatd": "Gf.Quatd(1, 2, 3, 4)",
    "int2": "Gf.Vec2i(1, 2)", "half2": "Gf.Vec2h(1, 2)", "float2": "Gf.Vec2f(1, 2)",
    "double2": "Gf.Vec2d(1, 2)", "int3": "Gf.Vec3i(1, 2, 3)", "half3": "Gf.Vec3h(1, 2, 3)",
    "float3": "Gf.Vec3f(1, 2, 3)", "double3": "Gf.Vec3d(1, 2, 3)", "int4": "Gf.Vec4i(1, 2, 3, 4)",
    "half4": "Gf.Vec4h(1, 2, 3, 4)", "float4": "Gf.Vec4f(1, 2, 3, 4)",
    "double4": "Gf.Vec4d(1, 2, 3, 4)", "color3f": "Gf.Vec3f(1, 0, 0.5)",
    "point3d": "Gf.Vec3d(1e300, -0.0, 3)", "frame4d": "Gf.Matrix4d(1)", "texCoord2f": "Gf.Vec2f(0, 1)",
}

EDITS = {
    "every scalar": "\n".join(
        f"p.CreateAttribute('s_{name}', Sdf.ValueTypeNames.Find({name!r})).Set({value})"
        for name, value in SCALARS.items()),
    "every array": "\n".join(
        f"p.CreateAttribute('a_{name}', Sdf.ValueTypeNames.Find({name + '[]'!r})).Set([{value}] * 3)"
        for name, value in SCALARS.items()),
    "empty arrays": "\n".join(
        f"p.CreateAttribute('e_{name}', Sdf.ValueTypeNames.Find({name + '[]'!r})).Set([])"
        for name in SCALARS),
    "opaque and group": "p.CreateAttribute('o', Sdf.ValueTypeNames.Opaque)\n"
                        "p.CreateAttribute('g', Sdf.ValueTypeNames.Group)",
    "not a number": "p.CreateAttribute('nan', Sdf.ValueTypeNames.Double).Set(float('nan'))\n"
                    "p.CreateAttribute('inf', Sdf.ValueTypeNames.Float).Set(float('-inf'))",
    "block": "a = p.CreateAttribute('b', Sdf.ValueTypeNames.Float); a.Set(1.0); a.Block()",
    "animation block": "a = p.CreateAttribute('ab', Sdf.ValueTypeNames.Float); a.BlockAnimation()"
                       if hasattr(Sdf, "AnimationBlock") else "",
    "array edit": "b = Vt.IntArrayEditBuilder()\nb.Append(5)\n"
                  "p.CreateAttribute('ae', Sdf.ValueTypeNames.IntArray).Set(b.FinalizeAndReset())",
    "time samples": "a = p.CreateAttribute('t', Sdf.ValueTypeNames.Double)\n"
                    "for i in range(10): a.Set(i / 3, i)\n"
                    "a.ClearAtTime(4)\na.Set(Sdf.ValueBlock(), 20)",
    "spline": "a = p.CreateAttribute('sp', Sdf.ValueTypeNames.Double); s = Ts.Spline()\n"
              "for i in range(3):\n k = Ts.Knot(); k.SetTime(i); k.SetValue(i * 2.0); s.SetKnot(k)\n"
              "a.SetSpline(s)",
    "dictionaries": "p.SetCustomDataByKey('a:b:c', 3)\np.SetCustomDataByKey('a:b:d', 'x')\n"
                    "p.SetCustomDataByKey('list', Vt.DoubleArray([1, 2]))\n"
                    "p.ClearCustomDataByKey('a:b:c')\np.SetAssetInfoByKey('version', '7')",
    "metadata": "p.SetMetadata('comment', 'said')\np.SetDocumentation('doc')\np.SetHidden(True)\n"
                "p.SetMetadata('kind', 'component')\np.SetActive(False)\np.SetActive(True)\n"
                "p.SetInstanceable(True)\np.ClearInstanceable()",
    "references": "r = p.GetReferences()\nr.AddReference('./a.usda', '/X', Sdf.LayerOffset(10, 2))\n"
                  "r.AddInternalReference('/Other')\n"
                  "r.AddReference(Sdf.Reference('b.usda', customData={'k': 1}))\n"
                  "r.RemoveReference(Sdf.Reference('./a.usda', '/X', Sdf.LayerOffset(10, 2)))",
    "payloads": "p.GetPayloads().AddPayload('./p.usda', '/P', Sdf.LayerOffset(1, 1))",
    "arcs": "p.GetInherits().AddInherit('/_class')\np.GetSpecializes().AddSpecialize('/_base')",
    "api schemas": "UsdShade.MaterialBindingAPI.Apply(p)\nUsdGeom.ModelAPI.Apply(p)\n"
                   "p.RemoveAPI(UsdShade.MaterialBindingAPI)",
    "targets": "r = p.CreateRelationship('r')\nr.AddTarget('/A')\nr.AddTarget('/B')\n"
               "r.RemoveTarget('/A')\nq = p.CreateRelationship('q'); q.SetTargets(['/C', '/D'])",
    "connections": "a = p.CreateAttribute('c', Sdf.ValueTypeNames.Float)\na.AddConnection('/A.x')\n"
                   "a.SetConnections(['/A.y', '/A.z'])",
    "variants": "v = p.GetVariantSets().AddVariantSet('look')\nv.AddVariant('red')\nv.AddVariant('blue')\n"
                "v.SetVariantSelection('red')\nwith v.GetVariantEditContext():\n"
                " UsdGeom.Sphere.Define(stage, p.GetPath().AppendChild('InRed'))\n"
                "v.SetVariantSelection('blue')",
    "sublayers": "root.subLayerPaths.append('one.usda')\nroot.subLayerPaths.append('two.usda')\n"
                 "root.subLayerOffsets[1] = Sdf.LayerOffset(5, 2)\nroot.subLayerPaths.insert(0, 'zero.usda')\n"
                 "del root.subLayerPaths[1]",
    "relocates": "root.relocates = [('/World/X/From', '/World/X/To')]",
    "layer metadata": "stage.SetStartTimeCode(1); stage.SetEndTimeCode(99)\n"
                      "stage.SetTimeCodesPerSecond(30)\nroot.comment = 'of the layer'\n"
                      "root.customLayerData = {'a': {'b': 1}}\nstage.SetMetadata('upAxis', 'Z')\n"
                      "stage.SetDefaultPrim(p)",
    "create and delete": "stage.DefinePrim('/World/Gone/Deep', 'Xform')\nstage.RemovePrim('/World/Gone')\n"
                         "stage.DefinePrim('/World/Gone', 'Scope')",
    "rename and reparent": "UsdGeom.Xform.Define(stage, '/World/Old/Kid')\n"
                           "e = Usd.NamespaceEditor(stage)\n"
                           "e.MovePrimAtPath('/World/Old', '/World/New'); assert e.ApplyEdits()\n"
                           "e = Usd.NamespaceEditor(stage)\n"
                           "e.MovePrimAtPath('/World/New/Kid', '/World/Kid'); assert e.ApplyEdits()",
    "rename properties": "p.CreateAttribute('was', Sdf.ValueTypeNames.Int).Set(3)\n"
                         "e = Usd.NamespaceEditor(stage)\n"
                         "e.MovePropertyAtPath('/World/P.was', '/World/P.is'); assert e.ApplyEdits()",
    "reorder": "for n in 'abcd': stage.DefinePrim('/World/' + n)\n"
               "w = root.GetPrimAtPath('/World'); w.nameChildrenOrder = ['d', 'a']\n"
               "e = Sdf.BatchNamespaceEdit(); e.Add('/World/d', '/World/d2', 0); assert root.Apply(e)",
    "copy": "stage.DefinePrim('/World/Src/In').CreateRelationship('me').SetTargets(['/World/Src'])\n"
            "assert Sdf.CopySpec(root, '/World/Src', root, '/World/Copy')",
    "transfer": "other = Sdf.Layer.CreateAnonymous('.usda')\n"
                "UsdGeom.Sphere.Define(Usd.Stage.Open(other), '/World/Ball')\nroot.TransferContent(other)",
}


@pytest.mark.parametrize("what", [what for what, code in EDITS.items() if code])
def test_an_edit_arrives_as_it_was_made(what, pair):
    """One editor makes the edit after the other; both and the server have the same text, and it is correct."""
    server, ada, bo = pair
    for author, other in ((ada, bo), (bo, ada)):
        author.run("root = stage.GetRootLayer()\nroot.Clear()\n"
                   "p = stage.DefinePrim('/World/P', 'Xform')\n" + EDITS[what])
        made = author.text("root.usda")
        revision = author.flush()
        assert author.text("root.usda") == made, "committing changed the author's own layer"
        other.catch_up(revision)
        assert other.text("root.usda") == made
        assert cat(server, "root.usda") == made
        assert not author.run("result = [str(e) for e in happened if type(e).__name__ == 'Lost']")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """One server and two editors for all edits of this file."""
    from conftest import Peer, Server
    folder = tmp_path_factory.mktemp("values")
    (folder / "project").mkdir()
    (folder / "project" / "root.usda").write_text('#usda 1.0\n')
    server = Server(folder / "project", folder / "server.log").start()
    ada = Peer(server.url, "ada", "root.usda", folder / "ada.log")
    bo = Peer(server.url, "bo", "root.usda", folder / "bo.log")
    yield server, ada, bo
    ada.process.kill()
    bo.process.kill()
    assert server.stop() == 0


def test_every_scalar_type_of_sdf_is_in_the_list():
    """A type that a newer OpenUSD adds is noticed."""
    known = {str(getattr(Sdf.ValueTypeNames, n)) for n in dir(Sdf.ValueTypeNames)
             if isinstance(getattr(Sdf.ValueTypeNames, n), Sdf.ValueTypeName)}
    scalars = {name for name in known if not name.endswith("[]")}
    roles = re.compile(r"^(point|vector|normal|color|texCoord)\d[hfd]$|^(opaque|group)$")
    assert {name for name in scalars if not roles.match(name)} <= set(SCALARS)
