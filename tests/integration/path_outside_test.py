"""Tests that an editor is notified when it writes a path that others cannot open."""

from __future__ import annotations

import random

import pytest
import usdlive
from conftest import connect, wait
from pxr import Sdf, Usd

ROOT = '#usda 1.0\ndef "A"\n{\n    asset tex\n    asset[] many\n}\n'


@pytest.fixture
def server(serve, project):
    (project / "shot.usda").write_text(ROOT)
    (project / "prop.usda").write_text(ROOT)
    return serve(project)


def reports(live) -> list[tuple[str, str, str, str]]:
    found: list = []

    def happened(event):
        if isinstance(event, usdlive.events.PathOutside):
            found.append((event.layer, event.prim, event.property, event.path))
    live.add_handler(happened)
    return found


def test_an_absolute_path_outside_the_project_is_reported_with_layer_prim_and_property(server, tmp_path):
    with connect(server, "ada") as live, connect(server, "bo") as other:
        stage, found = live.open_stage("shot.usda"), reports(live)
        other.open_stage("shot.usda")
        received = reports(other)
        prim = stage.GetPrimAtPath("/A")
        prim.GetAttribute("tex").Set("/home/ada/brick.png")
        prim.GetAttribute("tex").Set("/home/ada/anim.1.png", 1.0)
        prim.GetAttribute("many").Set(Sdf.AssetPathArray(["./ok.png", "C:\\tex\\b.png", "file:///c.png"]))
        prim.GetReferences().AddReference("/home/ada/chair.usdz")
        prim.GetPayloads().AddPayload("/home/ada/table.usda", "/Table")
        prim.SetAssetInfoByKey("identifier", Sdf.AssetPath("/home/ada/asset.usda"))
        root = stage.GetRootLayer()
        root.subLayerPaths.append("/home/ada/sub.usda")
        assert live.flush(20)
        expected = {
            ("shot.usda", "/A", "tex", "/home/ada/brick.png"),
            ("shot.usda", "/A", "tex", "/home/ada/anim.1.png"),
            ("shot.usda", "/A", "many", "C:\\tex\\b.png"),
            ("shot.usda", "/A", "many", "file:///c.png"),
            ("shot.usda", "/A", "", "/home/ada/chair.usdz"),
            ("shot.usda", "/A", "", "/home/ada/table.usda"),
            ("shot.usda", "/A", "", "/home/ada/asset.usda"),
            ("shot.usda", "/", "", "/home/ada/sub.usda"),
        }
        assert set(found) == expected and len(found) == len(expected), found
        # Neither the removal of such a path nor an edit of somebody else is reported.
        found.clear()
        prim.GetReferences().RemoveReference(Sdf.Reference("/home/ada/chair.usdz"))
        prim.GetAttribute("tex").Clear()
        assert live.flush(20)
        wait(lambda: other.revision >= live.revision, other)
        assert found == [] and received == []


def test_paths_that_others_can_open_are_not_reported(server, project):
    with connect(server, "ada") as live:
        stage, found = live.open_stage("shot.usda"), reports(live)
        prim = stage.GetPrimAtPath("/A")
        addresses = ["./tex/brick.png", "tex/../brick.png", "brick.png", "", "a/b.<UDIM>.png",
                     f"usdlive://127.0.0.1:{server.port}/brick.png", live.identifier("prop.usda")]
        for path in addresses:
            prim.GetAttribute("tex").Set(path)
            assert live.flush(20)
        prim.GetReferences().AddReference("./prop.usda")
        prim.CreateAttribute("text", Sdf.ValueTypeNames.String).Set("/home/ada/brick.png")
        assert live.flush(20)
        assert found == []
    # An absolute path into the project's folder, of an editor that works there.
    stage = Usd.Stage.Open(str(project / "shot.usda"))
    with connect(server, "ada") as live:
        live.attach(stage)
        found = reports(live)
        stage.GetPrimAtPath("/A").GetAttribute("tex").Set(str(project / "tex" / "brick.png"))
        stage.GetPrimAtPath("/A").GetAttribute("many").Set(Sdf.AssetPathArray([f"{project}/../x.png"]))
        assert live.flush(20)
        assert [one[2:] for one in found] == [("many", f"{project}/../x.png")]


def test_a_paste_of_many_such_paths_is_reported_to_a_bound(server):
    with connect(server, "ada") as live:
        stage, found = live.open_stage("shot.usda"), reports(live)
        with Sdf.ChangeBlock():
            for number in range(1_500):
                spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), f"/P{number}")
                Sdf.AttributeSpec(spec, "tex", Sdf.ValueTypeNames.Asset).default = Sdf.AssetPath(f"/x/{number}.png")
        assert live.flush(20)
        assert len(found) == 1_000


# --- every place that can name a path, and every kind of path ------------------------------------------


def arc(kind, edit):
    def write(stage, path):
        prim = stage.OverridePrim("/A/B")
        edit(prim.GetReferences() if kind is Sdf.Reference else prim.GetPayloads(), kind(path, "/A"))
        return "/A/B", ""
    return write


def attribute(edit, name="tex"):
    def write(stage, path):
        edit(stage.GetPrimAtPath("/A").GetAttribute(name), path)
        return "/A", name
    return write


def metadata(edit):
    def write(stage, path):
        edit(stage.GetPrimAtPath("/A"), path)
        return "/A", ""
    return write


def clips(**entries):
    def write(stage, path):
        made = {key: make(path) for key, make in entries.items()}
        Usd.ClipsAPI(stage.GetPrimAtPath("/A")).SetClips({"default": {"primPath": "/A", **made}})
        return "/A", ""
    return write


def sublayer(stage, path):
    stage.GetRootLayer().subLayerPaths.append(path)
    return "/", ""


def in_a_variant(stage, path):
    prim = stage.GetPrimAtPath("/A")
    prim.GetVariantSets().AddVariantSet("v").AddVariant("one")
    prim.GetVariantSet("v").SetVariantSelection("one")
    with prim.GetVariantSet("v").GetVariantEditContext():
        prim.GetAttribute("tex").Set(Sdf.AssetPath(path))
    return "/A{v=one}", "tex"


def pasted(stage, path):
    copied = Sdf.Layer.CreateAnonymous()
    Sdf.AttributeSpec(Sdf.CreatePrimInLayer(copied, "/P"), "tex", Sdf.ValueTypeNames.Asset).default = Sdf.AssetPath(path)
    assert Sdf.CopySpec(copied, "/P", stage.GetRootLayer(), "/A/P")
    return "/A/P", "tex"


def layer_data(stage, path):
    stage.GetRootLayer().customLayerData = {"studio": {"look": Sdf.AssetPath(path)}}
    return "/", ""


def many(path):
    return Sdf.AssetPathArray([path, *(f"./tex/{number:020}.png" for number in range(20_000))])


def edited(path):
    builder = Sdf.AssetPathArrayEditBuilder()
    builder.Append(Sdf.AssetPath(path))
    return builder.FinalizeAndReset()


PLACES = {
    "default": attribute(lambda one, path: one.Set(path)),
    "sample": attribute(lambda one, path: one.Set(path, 2.0)),
    "array": attribute(lambda one, path: one.Set(Sdf.AssetPathArray(["./a", path])), "many"),
    "sample of an array": attribute(lambda one, path: one.Set(Sdf.AssetPathArray(["./a", path]), 3.0), "many"),
    "edit of an array": attribute(lambda one, path: one.Set(edited(path)), "many"),
    "big array": attribute(lambda one, path: one.Set(many(path)), "many"),
    "metadata of an attribute": attribute(lambda one, path: one.SetCustomDataByKey("a", Sdf.AssetPath(path))),
    "asset info": metadata(lambda one, path: one.SetAssetInfoByKey("identifier", Sdf.AssetPath(path))),
    "nested dictionary": metadata(lambda one, path: one.SetCustomData({"a": {"b": {"c": Sdf.AssetPath(path)}}})),
    "key of a dictionary": metadata(lambda one, path: one.SetCustomDataByKey("x:y", Sdf.AssetPathArray([path]))),
    "metadata of a layer": layer_data,
    "prepended reference": arc(Sdf.Reference, lambda arcs, one: arcs.AddReference(one)),
    "appended reference": arc(Sdf.Reference, lambda arcs, one: arcs.AddReference(one, Usd.ListPositionBackOfAppendList)),
    "explicit references": arc(Sdf.Reference, lambda arcs, one: arcs.SetReferences([one])),
    "payload": arc(Sdf.Payload, lambda arcs, one: arcs.AddPayload(one)),
    "explicit payloads": arc(Sdf.Payload, lambda arcs, one: arcs.SetPayloads([one])),
    "sublayer": sublayer,
    "clips": clips(assetPaths=lambda path: Sdf.AssetPathArray(["./a.usda", path])),
    "manifest of clips": clips(manifestAssetPath=Sdf.AssetPath),
    "template of clips": clips(templateAssetPath=str),
    "variant": in_a_variant,
    "pasted prim": pasted,
}
# `{}` is a name. The folder of the project is called "project".
OUTSIDE = ["/home/ada/{}", "//nas/tex/{}", "file:///home/{}", "file:{}", "FILE:///home/{}", "C:/tex/{}", "c:\\tex\\{}", "C:{}",
           "\\\\nas\\tex\\{}", "../{}", "./../../{}", "tex/../../{}", "..\\tex\\{}", "../project/{}", "./../project/tex/{}",
           "anon:0x7f33aa:{}", "/home/{}:SDF_FORMAT_ARGS:a=b", "../{}:SDF_FORMAT_ARGS:a=b", "/home/pack.usdz[{}]",
           "../pack.usdz[{}]", '`"/home/${{SHOT}}/{}"`', '`"../${{SHOT}}/{}"`']
INSIDE = ["{}", "./{}", "tex/{}", "./tex/../{}", "a..b/{}", "...{}", "tex\\{}", "anon:edf:{}", "http://example.org/../{}",
          "https://example.org/{}", "usdlive://example.org/shot/{}", "omniverse://nucleus/{}", "s3+https://bucket/{}",
          "./{}:SDF_FORMAT_ARGS:a=../b", "pack.usdz[{}]", '`"./${{SHOT}}/{}"`', '`"${{ROOT}}/{}"`']


@pytest.mark.parametrize("seed", range(4))
def test_every_place_reports_every_path_that_others_cannot_open(server, seed):
    """Compares relative paths with Sdf, too, which joins them to the address of a layer."""
    choose = random.Random(seed)
    with connect(server, "ada") as live:
        stage, found = live.open_stage("shot.usda"), reports(live)
        for place, write in sorted(PLACES.items(), key=lambda _: choose.random()):
            for number in range(6):
                is_outside = choose.random() < 0.6
                name = f"{place}{number}.usda".replace(" ", "")
                path = choose.choice(OUTSIDE if is_outside else INSIDE).format(name)
                if path.startswith("."):
                    joined = Sdf.ComputeAssetPathRelativeToLayer(stage.GetRootLayer(), path.replace("\\", "/"))
                    assert is_outside == ("/../" in joined.partition(":SDF")[0]), (path, joined)
                found.clear()
                written = write(stage, path)
                assert live.flush(20)
                assert found == ([("shot.usda", *written, path)] if is_outside else []), (place, path)


def test_a_relative_path_is_relative_to_its_layer(serve, project):
    (project / "sets" / "room").mkdir(parents=True)
    (project / "sets" / "room" / "room.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada") as live:
        stage, found = live.open_stage("sets/room/room.usda"), reports(live)
        for path, is_outside in {"../a.png": False, "../../a.png": False, "../../../a.png": True, "../../sets/a.png": False,
                                 "../../../project/a.png": True}.items():
            stage.GetPrimAtPath("/A").GetAttribute("tex").Set(path)
            assert live.flush(20)
            assert [one[3] for one in found] == ([path] if is_outside else [])
            found.clear()
