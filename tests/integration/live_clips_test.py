"""Tests value clips in live stages: the layers of the clips are read as files, with their values."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import clip_stages
import pytest
import usdlive
from conftest import connect, tick_without_answers, wait, without_answers
from pxr import Sdf, Tf, Usd, Vt
from stage_dump import Dump, differences
from stage_following import shown
from stage_watch import WatchedStage

TIMES = (0, 2, 4)
SEEDS = 40


def fill_clip(layer: Sdf.Layer, first: float) -> None:
    attribute = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, "/Model"), "x", Sdf.ValueTypeNames.Double)
    for time_code in range(6):
        layer.SetTimeSample(attribute.path, time_code, first + time_code)


def write_clips(folder, numbers=(1, 2)) -> None:
    folder.mkdir(exist_ok=True)
    for number in numbers:
        clip = Sdf.Layer.CreateNew(str(folder / f"clip.{number:03}.usda"))
        clip.comment = str(folder)  # another content in each test: a process has one cache
        fill_clip(clip, 10.0 * number)
        assert clip.Save()
    manifest = Sdf.Layer.CreateNew(str(folder / "manifest.usda"))
    Sdf.AttributeSpec(Sdf.CreatePrimInLayer(manifest, "/Model"), "x", Sdf.ValueTypeNames.Double)
    assert manifest.Save()


def explicit(folder: str = "./clips/") -> dict:
    assets = [Sdf.AssetPath(f"{folder}clip.{number:03}.usda") for number in (1, 2)]
    return {"primPath": "/Model", "assetPaths": Sdf.AssetPathArray(assets), "active": Vt.Vec2dArray([(0, 0), (3, 1)])}


def template(folder: str = "./clips/", last: float = 3) -> dict:
    return {"primPath": "/Model", "templateAssetPath": f"{folder}clip.###.usda", "templateStartTime": 1.0,
            "templateEndTime": float(last), "templateStride": 1.0}


def with_manifest(clips: dict, folder: str = "./clips/") -> dict:
    return clips | {"manifestAssetPath": Sdf.AssetPath(folder + "manifest.usda")}


SETS = {"explicit": explicit(), "explicit-manifest": with_manifest(explicit()), "template": template(),
        "template-manifest": with_manifest(template()), "search-path": explicit("clips/")}


def add_model(layer: Sdf.Layer, clips: dict | None) -> None:
    prim = Sdf.CreatePrimInLayer(layer, "/Model")
    prim.specifier = Sdf.SpecifierDef
    Sdf.AttributeSpec(prim, "x", Sdf.ValueTypeNames.Double)
    if clips is not None:
        prim.SetInfo("clips", {"default": clips})


def write_shot(project, clips: dict | None) -> list:
    write_clips(project / "clips")
    shot = Sdf.Layer.CreateNew(str(project / "shot.usda"))
    add_model(shot, clips)
    assert shot.Save()
    return values(Usd.Stage.Open(str(project / "shot.usda")))


def values(stage: Usd.Stage) -> list:
    attribute = stage.GetAttributeAtPath("/Model.x")
    return [attribute.Get(time_code) if attribute else None for time_code in TIMES]


@pytest.mark.parametrize("clips", SETS.values(), ids=SETS.keys())
def test_a_stage_shows_the_values_of_clips_at_once(serve, project, clips):
    wanted = write_shot(project, clips)
    assert None not in wanted and len(set(wanted)) > 1
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        assert values(stage) == wanted
        for _ in range(20):
            ada.tick()
            time.sleep(0.02)
        assert values(stage) == wanted
        # They are files, which are not filled later, and nobody would get edits of them.
        assert ada.opened_layer("clips/clip.001.usda") is None
        assert ada.pending == 0
        clip = Sdf.Layer.Find(ada.identifier("clips/clip.001.usda"))
        wait(lambda: not clip.permissionToEdit, ada, timeout=20)
        with pytest.raises(Tf.ErrorException, match="not editable"):
            clip.SetTimeSample(Sdf.Path("/Model.x"), 0, 3.0)
        assert ada.open_layer("clips/clip.001.usda") == clip
        assert values(stage) == wanted
        clip.SetTimeSample(Sdf.Path("/Model.x"), 0, 3.0)
        assert clip.Save()
        wait(lambda: "0: 3," in (project / "clips" / "clip.001.usda").read_text(), ada, timeout=20)


def test_a_clip_that_is_opened_live_or_referenced_is_live(serve, project):
    wanted = write_shot(project, explicit())
    shot = Sdf.Layer.FindOrOpen(str(project / "shot.usda"))
    other = Sdf.CreatePrimInLayer(shot, "/Other")
    other.referenceList.Prepend(Sdf.Reference("./clips/clip.001.usda", "/Model"))
    shot.Save()
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        stage = ada.open_stage("shot.usda")
        assert values(stage) == wanted
        assert ada.opened_layer("clips/clip.001.usda")
        assert ada.opened_layer("clips/clip.002.usda") is None
        second = ada.open_layer("clips/clip.002.usda")
        assert values(stage) == wanted
        theirs = bo.open_stage("shot.usda")
        second.SetTimeSample(Sdf.Path("/Model.x"), 4, 77.0)
        assert values(stage)[2] == 77
        assert ada.flush(20)
        # For this one it is a file that has changed.
        wait(lambda: values(theirs)[2] == 77, ada, bo, timeout=30)
        # Now it is live here, too.
        with Sdf.ChangeBlock():
            prim = Sdf.CreatePrimInLayer(theirs.GetRootLayer(), "/Third")
            prim.referenceList.Prepend(Sdf.Reference("./clips/clip.002.usda", "/Model"))
        wait(lambda: bo.opened_layer("clips/clip.002.usda"), ada, bo, timeout=30)
        second.SetTimeSample(Sdf.Path("/Model.x"), 4, 78.0)
        wait(lambda: values(theirs)[2] == 78, ada, bo, timeout=30)
        assert theirs.GetAttributeAtPath("/Third.x").Get(4) == 78


@pytest.mark.parametrize("clips", [explicit(), with_manifest(template())], ids=["explicit", "template"])
def test_an_editor_adds_clips(serve, project, clips):
    write_shot(project, None)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        mine, theirs = ada.open_stage("shot.usda"), bo.open_stage("shot.usda")
        assert values(mine) == [None] * 3
        model = mine.GetPrimAtPath("/Model")
        for key, value in clips.items():  # UsdClipsAPI writes it like this
            model.SetMetadataByDictKey("clips", f"default:{key}", value)
        wanted = values(mine)
        assert None not in wanted
        assert ada.flush(20)
        wait(lambda: values(theirs) == wanted, ada, bo, timeout=30)
        assert ada.opened_layer("clips/clip.001.usda") is None and bo.opened_layer("clips/clip.001.usda") is None


@pytest.mark.parametrize("clips", [explicit(), template()], ids=["explicit", "template"])
def test_a_tick_does_not_wait_for_clips(serve, project, clips):
    wanted = write_shot(project, clips)
    (project / "shot.usda").write_text('#usda 1.0\n')
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        mine, theirs = ada.open_stage("shot.usda"), bo.open_layer("shot.usda")  # only one composes
        for _ in range(5):
            ada.tick()
            time.sleep(0.2)
        with Sdf.ChangeBlock():
            add_model(theirs, clips)
        assert bo.flush(20)
        time.sleep(0.5)  # the edit is here, and waits for the next tick
        with without_answers(server):
            tick_without_answers(ada)
            assert mine.GetPrimAtPath("/Model")
        wait(lambda: values(mine) == wanted, ada, timeout=30)


def test_clips_that_change_and_come_later(serve, project):
    write_shot(project, with_manifest(template(last=4)))
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        before = values(stage)
        changed: list[str] = []
        ada.add_handler(lambda event: changed.extend(getattr(event, "files", [])))
        clip = Sdf.Layer.FindOrOpen(str(project / "clips" / "clip.002.usda"))
        clip.SetTimeSample(Sdf.Path("/Model.x"), 2, 55.0)
        assert clip.Save()
        wait(lambda: values(stage)[1] == 55, ada, timeout=30)
        assert "clips/clip.002.usda" in changed
        # It is removed, and comes back.
        saved = (project / "clips" / "clip.002.usda").read_text()
        (project / "clips" / "clip.002.usda").unlink()
        wait(lambda: "clips/clip.002.usda" not in ada.layers(), ada, timeout=30)
        for wanted in (56.0, 57.0):
            (project / "clips" / "clip.002.usda").write_text(saved.replace("2: 55", f"2: {wanted:g}"))
            wait(lambda wanted=wanted: values(stage)[1] == wanted, ada, timeout=30)
        (project / "clips" / "clip.002.usda").write_text(saved)
        wait(lambda: values(stage)[1] == 55, ada, timeout=30)
        # The template finds one that is new.
        new = ada.create_layer("clips/clip.004.usda")
        fill_clip(new, 40.0)
        wait(lambda: values(stage) == [before[0], 55, 44], ada, timeout=30)
        assert ada.pending == 0 or ada.flush(20)


def test_clips_without_a_connection(serve, project):
    wanted = write_shot(project, with_manifest(explicit()))
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda")
        attribute = stage.GetAttributeAtPath("/Model.x")
        assert attribute.Get(0) == wanted[0]  # opens the first clip only
        server.kill()
        wait(lambda: not ada.connected, ada, timeout=30)
        assert attribute.Get(0) == wanted[0]
        # A warning says why. A tick may have fetched the second clip before the server was gone.
        assert attribute.Get(4) in (None, wanted[2])
        server.start()
        wait(lambda: stage.GetAttributeAtPath("/Model.x").Get(4) == wanted[2], ada, timeout=30)


SHOWN_LATER = """
import json, sys, time, usdlive
with usdlive.connect(sys.argv[1], user="ada") as ada:
    seen = []
    for folder in sys.argv[2:]:
        stage = ada.open_stage(folder + "/shot.usda")
        seen.append([])
        for frame in range(8):
            if frame == 4:  # the stage composes its clips again
                ada.open_layer(folder + "/clips/clip.001.usda")
            attribute = stage.GetAttributeAtPath("/Model.x")
            seen[-1].append([attribute.Get(float(time_code)) for time_code in TIMES])
            ada.tick()
            time.sleep(0.02)
    json.dump(seen, sys.stdout)
"""


def test_clips_without_a_cache(serve, project, monkeypatch):
    """A clip that came late is composed again from what has come, also if no folder keeps it. Several stages, because
    without it only some of them lose a clip."""
    folders = {f"shot{number}": template() if number % 2 else explicit() for number in range(12)}
    wanted = []
    for name, clips in folders.items():
        (project / name).mkdir()
        wanted.append([write_shot(project / name, clips)] * 8)
    server = serve(project)
    monkeypatch.setenv("USDLIVE_CACHE", "/proc/none")
    done = subprocess.run([sys.executable, "-c", f"TIMES = {TIMES}\n{SHOWN_LATER}", server.url, *folders],
                          capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == wanted
    assert "the cache /proc/none cannot be written" in done.stderr


def test_stages_with_clips_show_what_their_folder_shows(serve, project):
    wanted, names = {}, [f"stage{seed}" for seed in range(SEEDS)]
    for seed, name in enumerate(names):
        folder = project / name
        folder.mkdir()
        wanted[name] = Dump(Usd.Stage.Open(clip_stages.Maker(seed, str(folder)).make()), str(folder)).all()
    server = serve(project)
    with connect(server, "ada") as ada:
        for name in names:
            stage = ada.open_stage(f"{name}/root.usda")
            base = ada.identifier(f"{name}/root.usda").removesuffix("/root.usda")
            ours = WatchedStage(stage.GetRootLayer())
            for dump in (Dump(stage, base).all(), ours.dump(base)):
                seen = json.loads(json.dumps(dump).replace(base, "$BASE"))
                assert list(differences(shown(wanted[name]), shown(seen))) == [], name
            ours.close()
            assert not any(layer for layer in ada.layers()
                           if ada.opened_layer(layer) and layer.startswith(f"{name}/clip."))


def read_for(live, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        live.tick()
        time.sleep(0.02)


def test_layers_that_arcs_name_as_well_are_live(serve, project):
    wanted = write_shot(project, None)
    for name in ("a", "b"):
        (project / f"{name}.usda").write_text("#usda 1.0\n")
    (project / "set.usda").write_text("#usda 1.0\n(\n    subLayers = [@./a.usda@, @./b.usda@]\n)\n")
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        mine = ada.open_stage("set.usda")
        theirs = bo.open_stage("set.usda")
        first, second = (Sdf.Layer.Find(bo.identifier(name)) for name in ("a.usda", "b.usda"))
        with Sdf.ChangeBlock():  # they arrive in one tick
            prim = Sdf.CreatePrimInLayer(first, "/Ref")
            prim.specifier = Sdf.SpecifierDef
            prim.referenceList.Prepend(Sdf.Reference("./clips/clip.001.usda", "/Model"))
            add_model(second, explicit())
        assert bo.flush(20)
        for live, stage in ((ada, mine), (bo, theirs)):
            wait(lambda stage=stage: None not in values(stage) and stage.GetAttributeAtPath("/Ref.x"), ada, bo, timeout=30)
            assert stage.GetAttributeAtPath("/Ref.x").Get(0) == 10
            wait(lambda live=live: live.opened_layer("clips/clip.001.usda"), ada, bo, timeout=30)
        assert ada.opened_layer("clips/clip.002.usda") is None
    assert wanted == [None] * 3


def test_an_arc_that_is_composed_later(serve, project):
    """A variant that is not selected, then clips that name its layer, then the selection."""
    write_shot(project, None)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        mine, theirs = ada.open_stage("shot.usda"), bo.open_stage("shot.usda")
        prim = theirs.DefinePrim("/Ref")
        variants = prim.GetVariantSets().AddVariantSet("model")
        for name in ("none", "one"):
            variants.AddVariant(name)
        variants.SetVariantSelection("one")
        with variants.GetVariantEditContext():
            prim.GetReferences().AddReference("./clips/clip.001.usda", "/Model")
        variants.SetVariantSelection("none")
        assert bo.flush(20)
        read_for(ada, 0.5)
        theirs.GetPrimAtPath("/Model").SetMetadata("clips", {"default": explicit()})
        assert bo.flush(20)
        wait(lambda: None not in values(mine), ada, timeout=30)
        mine.GetPrimAtPath("/Ref").GetVariantSets().GetVariantSet("model").SetVariantSelection("one")
        wait(lambda: ada.opened_layer("clips/clip.001.usda"), ada, timeout=30)
        wait(lambda: mine.GetAttributeAtPath("/Ref.x").Get(0) == 10, ada, timeout=30)


def test_a_payload_that_is_not_loaded_names_a_clip(serve, project):
    wanted = write_shot(project, explicit())
    shot = Sdf.Layer.FindOrOpen(str(project / "shot.usda"))
    Sdf.CreatePrimInLayer(shot, "/Ref").payloadList.Prepend(Sdf.Payload("./clips/clip.001.usda", "/Model"))
    assert shot.Save()
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usda", Usd.Stage.LoadNone)
        wait(lambda: values(stage) == wanted, ada, timeout=30)


def test_clips_that_are_written_without_notices(serve, project):
    """A binary layer takes another's content as a whole: composition opens the clips before the client knows them."""
    wanted = write_shot(project, explicit())
    text = Sdf.Layer.OpenAsAnonymous(str(project / "shot.usda"))
    (project / "shot.usda").unlink()
    Sdf.Layer.CreateNew(str(project / "shot.usdc")).Save()
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("shot.usdc")
        stage.GetRootLayer().TransferContent(text)
        wait(lambda: values(stage) == wanted, ada, timeout=30)


def test_a_clip_that_was_open_is_a_file_again(serve, project, tmp_path):
    wanted = write_shot(project, explicit())
    server = serve(project)
    for _ in range(2):  # the second connection has the same address as the first
        with usdlive.connect(server.url, user="ada", cache_folder=str(tmp_path / "folder")) as ada:
            stage = ada.open_stage("shot.usda")
            assert values(stage) == wanted
            clip = ada.open_layer("clips/clip.001.usda")
            assert clip.permissionToEdit and clip.permissionToSave
            ada.close_layer("clips/clip.001.usda")
            del clip, stage
            stage = ada.open_stage("shot.usda")
            assert values(stage) == wanted
            del stage


def test_a_server_that_is_away_when_values_are_read_first(serve, project):
    wanted = write_shot(project, with_manifest(explicit()))
    server = serve(project)
    with connect(server, "ada") as ada:
        root = ada.open_layer("shot.usda")
        server.kill()
        wait(lambda: not ada.connected, ada, timeout=30)
        stage = Usd.Stage.Open(root)
        assert values(stage) == [None] * 3
        server.start()
        wait(lambda: values(stage) == wanted, ada, timeout=30)


def test_a_change_of_a_clip_composes_nothing_else(serve, project):
    write_shot(project, explicit())
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        stage = ada.open_stage("shot.usda")
        assert values(stage)[0] == 10
        clip = bo.open_layer("clips/clip.001.usda")
        seen: list = []
        key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, lambda notice, _: seen.extend(
            [*notice.GetResyncedPaths(), *notice.GetResolvedAssetPathsResyncedPaths()]), stage)
        clip.SetTimeSample(Sdf.Path("/Model.x"), 0, 3.0)
        assert bo.flush(20)
        wait(lambda: values(stage)[0] == 3, ada, bo, timeout=30)
        assert seen == []
        key.Revoke()
