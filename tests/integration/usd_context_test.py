"""UsdContext: every operation in its three forms, its events, its errors; on files and live."""

import asyncio
import gc
import os
import pathlib
import signal
import stat
import subprocess
import sys
import threading
import time

import pytest
from conftest import wait_frames
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, Vt

import usdlive
from usdlive.omni import _layer_content, usd as omni_usd
from usdlive.omni.kit.app import get_app
from usdlive.omni.kit.usd.layers import (LayerErrorType, LayerEventType, get_layer_event_payload,
                                         get_layers)
from usdlive.omni.usd import StageEventType as Event
from usdlive.omni.usd import StageState, UsdContextInitialLoadSet

BALL = '#usda 1.0\n\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'
SAVED = ["SAVING", "SETTINGS_SAVING", "SAVED", "DIRTY_STATE_CHANGED"]


class EventNames(list):
    """The names of a context's events, in the order of their delivery."""

    def __init__(self, ctx):
        self.subscription = ctx.get_stage_event_stream().create_subscription_to_pop(
            lambda event: self.append(Event(event.type).name))

    def take(self):
        taken = list(self)
        self.clear()
        return taken


@pytest.fixture
def context():
    """context(name, **settings) creates a context that is destroyed after the test."""
    names = []

    def make(name="test", **settings):
        names.append(name)
        return omni_usd.create_context(name, **settings)

    yield make
    for name in names:
        assert omni_usd.destroy_context(name)


@pytest.fixture
def ctx(context):
    return context()


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.usda"
    path.write_text(BALL)
    return str(path)


@pytest.fixture(params=["blocking", "callback", "callback without a loop", "async"])
def call(request):
    """call(ctx, "open_stage", *args) in each of the forms; returns the result of the form as a tuple."""

    def blocking(ctx, name, *args):
        return (getattr(ctx, name)(*args),)

    def with_callback(ctx, name, *args):
        results = []
        function = getattr(ctx, name + "_with_callback")

        async def main():
            done = asyncio.Event()
            assert function(*args, on_finish_fn=lambda *r: (results.append(r), done.set()))
            await asyncio.wait_for(done.wait(), 10)

        asyncio.run(main())
        return results[0]

    def without_a_loop(ctx, name, *args):
        results = []
        assert getattr(ctx, name + "_with_callback")(*args, on_finish_fn=lambda *r: results.append(r))
        assert not results
        get_app().update()
        return results[0]

    def asynchronous(ctx, name, *args):
        return asyncio.run(getattr(ctx, name + "_async")(*args))

    return {"blocking": blocking, "callback": with_callback, "callback without a loop": without_a_loop,
            "async": asynchronous}[request.param]


def radius(stage):
    return stage.GetAttributeAtPath("/Ball.radius")


def frames(count=2):
    for _ in range(count):
        get_app().update()


# -- the operations, in all forms


def test_new_open_reopen_close(call, ctx, ball):
    names = EventNames(ctx)
    assert call(ctx, "new_stage")[0] is True
    assert ctx.is_new_stage() and ctx.get_stage().GetRootLayer().anonymous
    assert names.take() == ["OPENING", "OPENED"]
    assert call(ctx, "open_stage", ball)[0] is True
    assert radius(ctx.get_stage()).Get() == 1 and not ctx.is_new_stage()
    assert ctx.get_stage_url() == ball and ctx.get_stage_state() == StageState.OPENED
    assert [e for e in names.take() if "ASSETS" not in e] == ["CLOSING", "CLOSED", "OPENING", "OPENED"]
    radius(ctx.get_stage()).Set(5.0)
    result = call(ctx, "reopen_stage")
    assert result in ((True,), (True, "")) and radius(ctx.get_stage()).Get() == 1
    assert call(ctx, "close_stage")[0] is True
    assert ctx.get_stage() is None and ctx.get_stage_state() == StageState.CLOSED and ctx.get_stage_id() == -1
    assert call(ctx, "reopen_stage")[0] is True, "the one that was open last"


def test_save_writes_changed_layers(call, ctx, ball):
    assert ctx.open_stage(ball)
    radius(ctx.get_stage()).Set(2.0)
    frames()
    names = EventNames(ctx)
    result = call(ctx, "save_stage")
    assert result in ((True,), (True, "", [ball]))
    assert names.take() == SAVED
    assert "radius = 2" in pathlib.Path(ball).read_text() and not ctx.get_stage().GetRootLayer().dirty
    assert call(ctx, "save_stage") in ((True,), (True, "", [])), "nothing to write"


def test_save_as_gives_the_context_the_new_root(call, ctx, ball, tmp_path):
    assert call(ctx, "open_stage", ball)[0]
    radius(ctx.get_stage()).Set(2.0)
    ctx.get_stage().GetSessionLayer().comment = "kept"
    target = str(tmp_path / "other" / "copy.usda")
    result = call(ctx, "save_as_stage", target)
    assert result in ((True,), (True, "", [target]))
    assert ctx.get_stage_url() == target == ctx.get_stage().GetRootLayer().realPath
    assert ctx.get_stage().GetSessionLayer().comment == "kept"
    assert pathlib.Path(ball).read_text() == BALL and "radius = 2" in pathlib.Path(target).read_text()
    assert ctx.get_stage().GetEditTarget().GetLayer() == ctx.get_stage().GetRootLayer()


def test_save_layers_writes_those_alone(call, ctx, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.usda").write_text("#usda 1.0\n")
    (tmp_path / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./a.usda@, @./b.usda@]\n)\n")
    assert ctx.open_stage(str(tmp_path / "root.usda"))
    layers = [Sdf.Layer.Find(str(tmp_path / f"{name}.usda")) for name in ("a", "b")]
    for layer in layers:
        layer.comment = "changed"
    result = call(ctx, "save_layers", "", [layers[1].identifier])
    assert result in ((True,), (True, "", [layers[1].identifier]))
    assert [layer.dirty for layer in layers] == [True, False] and ctx.has_pending_edit()


def test_save_layers_with_a_new_root(call, ctx, ball, tmp_path):
    assert ctx.open_stage(ball)
    target = str(tmp_path / "root2.usda")
    assert call(ctx, "save_layers", target, [ball])[0] is True
    assert ctx.get_stage_url() == target


def test_export_flattens_with_the_session_layer(call, ctx, ball, tmp_path):
    assert call(ctx, "open_stage", ball)[0]
    stage = ctx.get_stage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        radius(stage).Set(7.0)
    target = str(tmp_path / "flat.usdc")
    assert call(ctx, "export_as_stage", target) in ((True,), (True, ""))
    assert radius(Usd.Stage.Open(target)).Get() == 7
    assert ctx.get_stage() == stage and ctx.get_stage_url() == ball


def test_attach_takes_over_a_stage(call, ctx, ball):
    stage = Usd.Stage.Open(ball)
    for given in (stage, UsdUtils.StageCache.Get().Insert(stage).ToLongInt()):
        assert call(ctx, "attach_stage", given)[0] is True
        assert ctx.get_stage() == stage and omni_usd.get_context_from_stage(stage) is ctx
        found = UsdUtils.StageCache.Get().Find(Usd.StageCache.Id.FromLongInt(ctx.get_stage_id()))
        assert found == stage
    assert call(ctx, "attach_stage", 123456)[0] is False


# -- opening


def test_open_with_a_session_layer(ctx, ball, tmp_path):
    session = tmp_path / "session.usda"
    session.write_text('#usda 1.0\n\nover "Ball"\n{\n    double radius = 3\n}\n')
    assert asyncio.run(ctx.open_stage_async(ball, session_layer_url=str(session))) == (True, "")
    assert radius(ctx.get_stage()).Get() == 3
    ok, error = asyncio.run(ctx.open_stage_async(ball, session_layer_url=str(tmp_path / "no.usda")))
    assert not ok and "no.usda" in error
    results = []
    assert ctx.open_stage_with_session_layer(ball, str(session), lambda *r: results.append(r))
    frames()
    assert results == [(True, "")]


def test_payloads_are_loaded_as_asked(ctx, ball, tmp_path):
    (tmp_path / "root.usda").write_text(
        '#usda 1.0\n\ndef "P" (\n    payload = @./ball.usda@</Ball>\n)\n{\n}\n')
    root = str(tmp_path / "root.usda")
    assert ctx.open_stage(root, UsdContextInitialLoadSet.LOAD_NONE)
    assert not ctx.get_stage().GetPrimAtPath("/P").IsLoaded()
    assert ctx.open_stage(root) and ctx.get_stage().GetAttributeAtPath("/P.radius").Get() == 1


def test_progress_while_a_stage_opens(ctx, tmp_path):
    """A thread reads the layers; meanwhile the loop continues and sees how many are loaded."""
    for index in range(60):
        layer = Sdf.Layer.CreateNew(str(tmp_path / f"s{index}.usda"))
        with Sdf.ChangeBlock():
            for prim in range(200):
                Sdf.CreatePrimInLayer(layer, f"/P{index}/C{prim}")
        assert layer.Save()
        del layer
    subs = ", ".join(f"@./s{index}.usda@" for index in range(60))
    (tmp_path / "root.usda").write_text(f"#usda 1.0\n(\n    subLayers = [{subs}]\n)\n")
    seen, states = [], set()

    async def main():
        opening = asyncio.create_task(ctx.open_stage_async(str(tmp_path / "root.usda")))
        while not opening.done():
            await asyncio.sleep(0.0005)
            seen.append(ctx.get_stage_loading_status())
            states.add(ctx.get_stage_state())
            assert not ctx.can_close_stage() or opening.done()
        return opening.result()

    assert asyncio.run(main()) == (True, "")
    assert states >= {StageState.OPENING}
    running = [status for status in seen if status[2] == 61]
    assert len({loaded for _, loaded, _ in running}) > 3, seen
    assert [loaded for _, loaded, _ in running] == sorted(loaded for _, loaded, _ in running)
    assert "root.usda" in running[0][0] and ctx.get_stage_loading_status() == ("", 0, 0)


def test_a_package_and_a_layer_with_arguments(ctx, ball, tmp_path):
    assert UsdUtils.CreateNewUsdzPackage(ball, str(tmp_path / "ball.usdz"))
    assert ctx.open_stage(str(tmp_path / "ball.usdz")) and radius(ctx.get_stage()).Get() == 1
    assert not ctx.is_writable() and not ctx.can_save_stage()
    identifier = Sdf.Layer.CreateIdentifier(ball, {"a": "b"})
    assert asyncio.run(ctx.open_stage_async(identifier)) == (True, "")


def test_one_operation_at_a_time(ctx, ball):
    async def main():
        first = asyncio.create_task(ctx.open_stage_async(ball))
        await asyncio.sleep(0)
        assert not ctx.can_open_stage()
        second = await ctx.open_stage_async(ball)
        assert second == (False, "the context is opening a stage") and ctx.close_stage() is False
        assert ctx.open_stage_with_callback(ball) is False
        return await first

    assert asyncio.run(main()) == (True, "")
    assert ctx.can_open_stage() and ctx.can_close_stage() and ctx.can_save_stage()


def test_an_open_that_is_cancelled_leaves_the_context_usable(ctx, ball):
    names = EventNames(ctx)

    async def main():
        opening = asyncio.create_task(ctx.open_stage_async(ball))
        await asyncio.sleep(0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening

    asyncio.run(main())
    assert names.take() == ["OPENING", "OPEN_FAILED"] and ctx.get_stage_state() == StageState.CLOSED
    assert ctx.open_stage(ball)


@pytest.mark.parametrize("content, said", [
    (None, "no such file"), ("#usda 1.0\ndef {{{", "parse error"), ("", "Cannot determine file format"),
    ("folder", "is a folder")])
def test_a_failing_open_names_the_file_and_keeps_the_stage(content, said, ctx, ball, tmp_path):
    bad = tmp_path / "bad.usda"
    if content == "folder":
        bad.mkdir()
    elif content == "":
        bad = tmp_path / "bad.unknown"
        bad.write_text("x")
    elif content:
        bad.write_text(content)
    names = EventNames(ctx)
    ok, error = asyncio.run(ctx.open_stage_async(str(bad)))
    assert ok is False and said in error and bad.name in error
    assert names.take() == ["OPENING", "OPEN_FAILED"] and ctx.get_stage_state() == StageState.CLOSED
    assert ctx.open_stage(ball) and ctx.open_stage(str(bad)) is False
    assert ctx.get_stage_url() == ball and ctx.get_stage_state() == StageState.OPENED


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission(ctx, ball):
    os.chmod(ball, 0)
    ok, error = asyncio.run(ctx.open_stage_async(ball))
    assert not ok and "permission" in error and ball in error


def test_missing_assets_are_reported_and_may_fail_the_open(context, tmp_path):
    root = tmp_path / "root.usda"
    root.write_text("#usda 1.0\n(\n    subLayers = [@./nope.usda@]\n)\n"
                    'def "A" (\n    references = @./none.usda@</X>\n)\n{\n}\n')
    ctx, strict = context("lenient"), context("strict", fail_stage_open_on_asset_errors=True)
    assert ctx.open_stage(str(root))
    assert ctx.get_num_asset_open_diagnostics() == 2
    assert any("none.usda" in text for text in ctx.get_asset_open_diagnostics())
    ok, error = asyncio.run(strict.open_stage_async(str(root)))
    assert not ok and ("none.usda" in error or "nope.usda" in error)
    assert strict.get_num_asset_open_diagnostics() == 2 and strict.get_stage() is None


def test_diagnostics_are_counted_and_the_first_hundred_kept(ctx, tmp_path):
    prims = "".join(f'def "A{i}" (\n    references = @./none{i}.usda@</X>\n)\n{{\n}}\n' for i in range(150))
    (tmp_path / "root.usda").write_text("#usda 1.0\n" + prims)
    assert ctx.open_stage(str(tmp_path / "root.usda"))
    assert (ctx.get_num_asset_open_diagnostics(), len(ctx.get_asset_open_diagnostics())) == (150, 100)


def test_cyclic_sublayers_open_with_a_diagnostic(ctx, tmp_path):
    (tmp_path / "a.usda").write_text("#usda 1.0\n(\n    subLayers = [@./b.usda@]\n)\n")
    (tmp_path / "b.usda").write_text("#usda 1.0\n(\n    subLayers = [@./a.usda@]\n)\n")
    assert ctx.open_stage(str(tmp_path / "a.usda"))
    assert "cycles" in ctx.get_asset_open_diagnostics()[0]
    assert len(ctx.get_stage().GetLayerStack(False)) == 2


# -- events


def test_assets_events_follow_in_the_frame(ctx, ball):
    names = EventNames(ctx)
    ctx.open_stage(ball)
    assert names.take() == ["OPENING", "OPENED"]
    get_app().update()
    assert names.take() == ["ASSETS_LOADING", "ASSETS_LOADED"]


def test_dirty_state_is_notified_at_the_first_edit_and_after_saving(ctx, ball):
    ctx.open_stage(ball)
    frames()
    names = EventNames(ctx)
    for value in range(5):
        radius(ctx.get_stage()).Set(float(value + 10))
        frames()
    assert names.take() == ["DIRTY_STATE_CHANGED"] and ctx.has_pending_edit()
    assert ctx.save_stage() and not ctx.has_pending_edit()
    frames()
    assert names.take() == SAVED
    radius(ctx.get_stage()).Set(1.0)
    frames()
    assert names.take() == ["DIRTY_STATE_CHANGED"]


def test_pending_edit_can_be_set(ctx, ball):
    ctx.open_stage(ball)
    ctx.set_pending_edit(True)
    assert ctx.has_pending_edit()
    assert ctx.save_stage() and not ctx.has_pending_edit()
    radius(ctx.get_stage()).Set(2.0)
    ctx.set_pending_edit(False)
    assert not ctx.has_pending_edit()
    radius(ctx.get_stage()).Set(3.0)
    assert ctx.has_pending_edit(), "False holds until the next edit"


def test_hierarchy_changes_are_notified_once_per_frame(ctx, ball):
    ctx.open_stage(ball)
    frames()
    names = EventNames(ctx)
    for index in range(10):
        ctx.get_stage().DefinePrim(f"/New{index}")
    assert names.take() == []
    frames()
    assert names.take() == ["HIERARCHY_CHANGED", "DIRTY_STATE_CHANGED"]
    radius(ctx.get_stage()).Set(2.0)
    frames()
    assert names.take() == []


def test_a_save_can_be_cancelled_while_it_is_announced(ctx, ball):
    ctx.open_stage(ball)
    radius(ctx.get_stage()).Set(2.0)
    assert ctx.try_cancel_save() is False
    names = EventNames(ctx)
    for kind in (Event.SAVING, Event.SETTINGS_SAVING):
        subscription = ctx.get_stage_event_stream().create_subscription_to_pop_by_type(
            kind, lambda _: ctx.try_cancel_save())
        result = asyncio.run(ctx.save_stage_async())
        assert result == (False, "saving was cancelled", [])
        assert names.take() == ["SAVING", "SETTINGS_SAVING", "SAVE_FAILED"]
        subscription.unsubscribe()
    assert pathlib.Path(ball).read_text() == BALL
    assert ctx.save_stage()


def test_a_task_that_waits_for_events_misses_none(ctx, ball):
    async def wait(until):
        kinds = []
        while until not in kinds:
            kinds.append(Event((await ctx.next_stage_event_async())[0]))
        return [kind.name for kind in kinds]

    async def main():
        waiting = asyncio.create_task(wait(Event.ASSETS_LOADED))
        await asyncio.sleep(0)
        assert await ctx.open_stage_async(ball) == (True, "")
        await get_app().next_update_async()
        opened = await asyncio.wait_for(waiting, 5)
        waiting = asyncio.create_task(wait(Event.CLOSED))
        await asyncio.sleep(0)
        ctx.save_stage()
        ctx.close_stage()  # all at once, before the task runs
        return opened, await asyncio.wait_for(waiting, 5)

    opened, closed = asyncio.run(main())
    assert opened == ["OPENING", "OPENED", "ASSETS_LOADING", "ASSETS_LOADED"]
    assert closed == [*SAVED, "CLOSING", "CLOSED"]


def test_waiting_ignores_earlier_events(ctx, ball):
    async def main():
        ctx.open_stage(ball)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(ctx.next_stage_event_async(), 0.05)
        ctx.close_stage()

    frames()
    asyncio.run(main())


def test_event_names_and_numbers(ctx):
    assert [int(kind) for kind in Event] == list(range(29))
    assert (Event.SAVED, Event.DIRTY_STATE_CHANGED, Event.HIERARCHY_CHANGED, Event.SAVING) == (0, 20, 23, 28)
    assert ctx.stage_event_name(Event.OPENED) == "omni.usd:test:stage:opened"
    assert omni_usd.get_context().stage_event_name(Event.SAVE_FAILED) == "omni.usd::stage:save_failed"


def test_selection(ctx, ball):
    ctx.open_stage(ball)
    ctx.get_stage().DefinePrim("/Xform", "Xform")
    selection, names = ctx.get_selection(), EventNames(ctx)
    assert selection.set_selected_prim_paths(["/Ball", "/Xform"], True)
    assert not selection.set_prim_path_selected("/None", True, False, False, True)
    assert selection.set_prim_path_selected("/Ball", False, False, False, True)
    assert selection.get_selected_prim_paths() == ["/Xform"] and selection.is_prim_path_selected("/Xform")
    selection.select_inverted_prims()
    assert selection.get_selected_prim_paths() == ["/Ball"]
    selection.select_all_prims(["Xform"])
    assert selection.get_selected_prim_paths() == ["/Xform"]

    async def main():
        waiting = asyncio.create_task(ctx.selection_changed_async())
        await asyncio.sleep(0)
        assert not waiting.done()
        await get_app().next_update_async()
        await asyncio.wait_for(waiting, 1)

    asyncio.run(main())
    assert names.take().count("SELECTION_CHANGED") == 1
    assert selection.clear_selected_prim_paths() and not selection.clear_selected_prim_paths()
    selection.select_all_prims()
    ctx.close_stage()
    assert selection.get_selected_prim_paths() == []


# -- contexts


def test_contexts_by_name(context, ball):
    assert omni_usd.get_context() is omni_usd.get_context("") and omni_usd.get_context("nobody") is None
    a, b = context("a"), context("b")
    assert omni_usd.create_context("a") is a and a.get_name() == "a" and omni_usd.get_context("b") is b
    a.open_stage(ball)
    assert omni_usd.get_context_from_stage(a.get_stage()) is a and b.get_stage() is None
    assert omni_usd.get_context_from_stage(Usd.Stage.CreateInMemory()) is None
    assert omni_usd.get_context_from_stage(None) is None
    assert not omni_usd.destroy_context("nobody")


def test_a_second_context_keeps_its_unsaved_edits_out(context, ball):
    """Two contexts with one file share its layer, as stages of USD do."""
    a, b = context("a"), context("b")
    assert a.open_stage(ball) and b.open_stage(ball)
    radius(a.get_stage()).Set(4.0)
    assert radius(b.get_stage()).Get() == 4 and b.has_pending_edit()


# -- saving


def test_saved_layers_are_those_of_the_local_stack(ctx, ball, tmp_path):
    (tmp_path / "sub.usda").write_text("#usda 1.0\n")
    (tmp_path / "locked.usda").write_text("#usda 1.0\n")
    (tmp_path / "root.usda").write_text(
        "#usda 1.0\n(\n    subLayers = [@./sub.usda@, @./locked.usda@]\n)\n"
        'def "A" (\n    references = @./ball.usda@</Ball>\n)\n{\n}\n')
    assert ctx.open_stage(str(tmp_path / "root.usda"))
    layers = {name: Sdf.Layer.Find(str(tmp_path / f"{name}.usda"))
              for name in ("root", "sub", "ball", "locked")}
    for layer in layers.values():
        layer.comment = "changed"
    layers["locked"].customLayerData = {"omni_layer": {"locked": True}}
    ctx.get_stage().GetSessionLayer().comment = "never saved"
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert (ok, error) == (True, "")
    assert sorted(saved) == sorted(layers[name].identifier for name in ("root", "sub"))
    assert layers["ball"].dirty and layers["locked"].dirty
    for identifiers, said in (([layers["ball"].identifier], "not a layer of the local"),
                              (["none.usda"], "none.usda"), ([layers["locked"].identifier], "is locked")):
        ok, error, saved = asyncio.run(ctx.save_layers_async("", identifiers))
        assert not ok and said in error and saved == []


def test_layers_without_a_file_are_reported(ctx):
    for result in (ctx.save_stage_async(), ctx.save_as_stage_async("x.usda"), ctx.save_layers_async("", [])):
        assert asyncio.run(result) == (False, "no stage is open", [])
    assert asyncio.run(ctx.close_stage_async()) == (False, "no stage is open")
    assert asyncio.run(ctx.export_as_stage_async("x.usda")) == (False, "no stage is open")
    assert asyncio.run(ctx.reopen_stage_async())[0] is False
    assert not (ctx.can_close_stage() or ctx.can_save_stage() or ctx.is_writable() or ctx.has_pending_edit())
    ctx.new_stage()
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "save_as_stage" in error and saved == [] and not ctx.can_save_stage()
    ctx.get_stage().DefinePrim("/A")
    assert ctx.has_pending_edit()
    ok, error = asyncio.run(ctx.reopen_stage_async())
    assert not ok and "never saved" in error and ctx.get_stage().GetPrimAtPath("/A")


def test_targets_that_are_refused(ctx, ball, tmp_path):
    (tmp_path / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n)\n")
    root = str(tmp_path / "root.usda")
    ctx.open_stage(root)
    for url, said in ((str(tmp_path / "a.txt"), "cannot be written"), (str(tmp_path), "cannot be written"),
                      (ball, "is a layer of the stage")):
        ok, error, saved = asyncio.run(ctx.save_as_stage_async(url))
        assert not ok and said in error and saved == [], error
    for url, said in ((root, "is used by the stage"), (ball, "is used by the stage"), ("a.png", "cannot be")):
        ok, error = asyncio.run(ctx.export_as_stage_async(url))
        assert not ok and said in error
    assert ctx.get_stage_url() == root and pathlib.Path(ball).read_text() == BALL
    ctx.get_stage().DefinePrim("/X")
    assert asyncio.run(ctx.save_as_stage_async(root)) == (True, "", [root]), "onto itself it is a save"


def test_relative_asset_paths_lead_to_where_they_led(ctx, ball, tmp_path):
    (tmp_path / "root.usda").write_text("""#usda 1.0
(
    subLayers = [@./ball.usda@ (offset = 10; scale = 2), @none.usda@]
)

def "A" (
    references = @ball.usda@</Ball>
    variants = {
        string v = "a"
    }
    prepend variantSets = "v"
)
{
    asset texture = @./textures/a.<UDIM>.png@
    asset tiles = @tiles.<UDIM>.png@
    asset texture.timeSamples = {
        1: @./textures/b.png@,
    }
    asset library = @OmniPBR.mdl@
    asset web = @https://example.com/a.png@
    asset[] many = [@../up.png@, @/absolute.png@, @./pack.usdz[0/a.png]@]
    variantSet "v" = {
        "a" (
            payload = @./ball.usda@</Ball>
        ) {
        }
    }
}
""")
    (tmp_path / "tiles.1001.png").touch()
    ctx.open_stage(str(tmp_path / "root.usda"))
    target = tmp_path / "deep" / "er" / "copy.usda"
    assert asyncio.run(ctx.save_as_stage_async(str(target)))[0]
    text = target.read_text()
    for expected in ("@../../ball.usda@ (offset = 10; scale = 2)", "@none.usda@",
                     "references = @../../ball.usda@</Ball>", "@../../textures/a.<UDIM>.png@",
                     "@../../tiles.<UDIM>.png@",
                     "1: @../../textures/b.png@", "@OmniPBR.mdl@", "@https://example.com/a.png@",
                     "@../../../up.png@", "@/absolute.png@", "@../../pack.usdz[0/a.png]@",
                     "payload = @../../ball.usda@</Ball>"):
        assert expected in text, (expected, text)
    assert radius(ctx.get_stage()).Get() == 1


@pytest.mark.parametrize("name, head", [("a.usda", b"#usda"), ("a.usdc", b"PXR-USDC"), ("text.usd", b"#usda"),
                                        ("binary.usd", b"PXR-USDC")])
def test_a_file_stays_of_its_kind_and_keeps_its_permissions(name, head, ctx, tmp_path):
    path = tmp_path / name
    kind = "usda" if head == b"#usda" else "usdc"
    layer = Sdf.Layer.CreateNew(str(path), args={"format": kind} if name.endswith(".usd") else {})
    Sdf.CreatePrimInLayer(layer, "/A")
    assert layer.Save()
    del layer
    os.chmod(path, 0o640)
    link = tmp_path / ("link-" + name)
    link.symlink_to(path)
    for opened, comment in ((path, "one"), (link, "two")):
        assert ctx.open_stage(str(opened))
        for more in ("", " more"):  # a .usdc is written again although it was read from the file before
            ctx.get_stage().GetRootLayer().comment = comment + more
            assert ctx.save_stage() and not ctx.has_pending_edit()
            assert Sdf.Layer.OpenAsAnonymous(str(path)).comment == comment + more
    assert path.read_bytes().startswith(head) and stat.S_IMODE(path.stat().st_mode) == 0o640
    assert link.is_symlink() and sorted(os.listdir(tmp_path)) == sorted([name, link.name])


def test_edits_during_a_save_are_not_lost(ctx, ball):
    ctx.open_stage(ball)
    radius(ctx.get_stage()).Set(2.0)

    async def main():
        saving = asyncio.create_task(ctx.save_stage_async())
        await asyncio.sleep(0)
        radius(ctx.get_stage()).Set(3.0)
        return await saving

    assert asyncio.run(main()) == (True, "", [ball])
    assert radius(ctx.get_stage()).Get() == 3 and ctx.has_pending_edit()
    assert "radius = 2" in pathlib.Path(ball).read_text()
    assert ctx.save_stage() and "radius = 3" in pathlib.Path(ball).read_text()


def test_a_save_that_is_cancelled_leaves_the_old_file(ctx, ball):
    ctx.open_stage(ball)
    radius(ctx.get_stage()).Set(2.0)
    names = EventNames(ctx)

    async def main():
        saving = asyncio.create_task(ctx.save_stage_async())
        await asyncio.sleep(0)
        saving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await saving

    asyncio.run(main())
    assert names.take() == ["SAVING", "SETTINGS_SAVING", "SAVE_FAILED"]
    assert pathlib.Path(ball).read_text() == BALL and os.listdir(os.path.dirname(ball)) == ["ball.usda"]
    assert ctx.has_pending_edit() and ctx.save_stage()


def test_a_read_only_file_is_left_alone(ctx, ball):
    os.chmod(ball, 0o444)
    ctx.open_stage(ball)
    assert not ctx.is_writable() and not ctx.can_save_stage()
    radius(ctx.get_stage()).Set(2.0)
    names = EventNames(ctx)
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "read-only" in error and ball in error and saved == []
    assert names.take() == ["SAVING", "SETTINGS_SAVING", "SAVE_FAILED", "DIRTY_STATE_CHANGED"]
    assert pathlib.Path(ball).read_text() == BALL and ctx.has_pending_edit()
    os.chmod(ball, 0o644)
    assert ctx.save_stage()


OPEN_AGAIN = {
    "open": lambda ctx, path: ctx.open_stage(path),
    "close and open": lambda ctx, path: ctx.close_stage() and ctx.open_stage(path),
    "reopen": lambda ctx, path: ctx.reopen_stage(),
    "open async": lambda ctx, path: asyncio.run(ctx.open_stage_async(path))[0],
}


@pytest.mark.parametrize("again", OPEN_AGAIN)
@pytest.mark.parametrize("changed", [False, True], ids=["same files", "changed files"])
@pytest.mark.parametrize("edited", [False, True], ids=["clean", "edited"])
@pytest.mark.parametrize("held", ["nothing", "the root", "the sublayer", "the reference", "the stage", "all"])
def test_opening_again_shows_the_files_whatever_a_script_holds(ctx, tmp_path, held, edited, changed, again):
    def write(number):
        for name, text in {"root.usda": f'(subLayers = [@./sub.usda@])\ndef "P" (references = @./ref.usda@</R>)\n{{\n'
                                        f'    int root = {number}\n}}\n',
                           "sub.usda": f'over "P"\n{{\n    int sub = {number}\n}}\n',
                           "ref.usda": f'def "R"\n{{\n    int ref = {number}\n}}\n'}.items():
            (tmp_path / name).write_text("#usda 1.0\n" + text)

    write(1)
    path = str(tmp_path / "root.usda")
    assert ctx.open_stage(path)
    stage = ctx.get_stage()
    layers = {"the root": stage.GetRootLayer(), "the sublayer": stage.GetLayerStack()[-1],
              "the reference": Sdf.Layer.Find(str(tmp_path / "ref.usda")), "the stage": stage}
    script = list(layers.values()) if held == "all" else layers.get(held)
    if edited:
        for layer in list(layers.values())[:3]:
            layer.GetAttributeAtPath(next(f"/{p}.{a}" for p in "PR" for a in ("root", "sub", "ref")
                                          if layer.GetAttributeAtPath(f"/{p}.{a}"))).default = 9
    del stage, layers
    frames()
    if changed:
        time.sleep(0.02)  # files have times of their own
        write(2)
    assert OPEN_AGAIN[again](ctx, path)
    prim = ctx.get_stage().GetPrimAtPath("/P")
    assert [prim.GetAttribute(name).Get() for name in ("root", "sub", "ref")] == [1 + changed] * 3
    del script


@pytest.fixture
def tiny(small_disk):
    return small_disk("300k")


@pytest.mark.parametrize("name", ["a.usda", "a.usdc"])
def test_a_full_disk_leaves_the_old_file_whole(name, ctx, tiny):
    path = tiny / name
    layer = Sdf.Layer.CreateNew(str(path))
    layer.comment = "old"
    assert layer.Save()
    del layer
    old = path.read_bytes()
    (tiny / "sub.usda").write_text("#usda 1.0\n")
    assert ctx.open_stage(str(path))
    root = ctx.get_stage().GetRootLayer()
    root.subLayerPaths.append("./sub.usda")
    sub = Sdf.Layer.Find(str(tiny / "sub.usda"))
    sub.comment = "fits"
    root.documentation = os.urandom(400_000).hex()
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "No space left" in error and saved == [sub.identifier]
    assert path.read_bytes() == old and sorted(os.listdir(tiny)) == sorted([name, "sub.usda"])
    assert ctx.has_pending_edit() and len(root.documentation) == 800_000
    for operation in (ctx.save_as_stage_async, ctx.export_as_stage_async):
        result = asyncio.run(operation(str(tiny / "b.usda")))
        assert not result[0] and "No space left" in result[1]
    assert ctx.get_stage_url() == str(path) and sorted(os.listdir(tiny)) == sorted([name, "sub.usda"])
    root.documentation = "short again"
    assert ctx.save_stage() and path.read_bytes() != old


def test_a_read_only_folder(ctx, tiny):
    (tiny / "a.usda").write_text(BALL)
    assert ctx.open_stage(str(tiny / "a.usda"))
    radius(ctx.get_stage()).Set(2.0)
    subprocess.run(["mount", "-o", "remount,ro", str(tiny)], check=True)
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "read-only" in error and str(tiny) in error and saved == []
    ok, error, saved = asyncio.run(ctx.save_as_stage_async(str(tiny / "b.usda")))
    assert not ok and "read-only" in error and ctx.has_pending_edit()
    ok, error = asyncio.run(ctx.export_as_stage_async(str(tiny / "new" / "b.usda")))
    assert not ok and "Read-only file system" in error
    assert (tiny / "a.usda").read_text() == BALL


def test_content_that_would_not_read_back_is_not_saved(ctx, ball):
    """OpenUSD 26.8 writes a path expression inside a dictionary as text that does not parse."""
    ctx.open_stage(ball)
    ctx.get_stage().GetRootLayer().customLayerData = {"broken": Sdf.PathExpression("/Ball")}
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and saved == [] and pathlib.Path(ball).read_text() == BALL, error
    assert os.listdir(os.path.dirname(ball)) == ["ball.usda"]


@pytest.mark.parametrize("name", ["big.usda", "big.usdc"])
def test_a_process_killed_while_it_saves_leaves_a_whole_file(name, tmp_path):
    path = tmp_path / name
    code = """if True:
        import sys
        from pxr import Sdf
        from usdlive.omni import usd
        layer = Sdf.Layer.CreateNew(sys.argv[1])
        with Sdf.ChangeBlock():
            for i in range(3000): Sdf.CreatePrimInLayer(layer, f"/A/B{i}")
        layer.Save()
        ctx = usd.get_context()
        assert ctx.open_stage(sys.argv[1])
        print("ready", flush=True)
        for i in range(100000):
            layer.comment = str(i)
            assert ctx.save_stage()
    """
    process = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"ready\n"
    first = path.stat().st_ino
    end = time.monotonic() + 20
    while path.stat().st_ino == first:
        assert time.monotonic() < end
    for _ in range(3):  # at three moments within a save, on a machine of any speed
        process.send_signal(signal.SIGSTOP)
        process.send_signal(signal.SIGCONT)
    process.kill()
    process.wait()
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    assert len(layer.GetPrimAtPath("/A").nameChildren) == 3000


# -- shared, discarded and remaining edits


def test_a_layer_that_was_saved_is_not_outdated(ctx, ball):
    assert ctx.open_stage(ball)
    state = get_layers(ctx).get_layers_state()
    assert state.add_auto_reload_layer(ball)
    get_layers(ctx)._native_layers().update(1e15)
    for value in (2.0, 3.0):
        radius(ctx.get_stage()).Set(value)
        assert ctx.save_stage() and not state.is_layer_outdated(ball)
        radius(ctx.get_stage()).Set(value + 10)
        get_layers(ctx)._native_layers().update(2e15 + value * 1e12)
        state.reload_all_outdated_layers()
        assert radius(ctx.get_stage()).Get() == value + 10, "an edit made right after saving"
        assert state.get_all_outdated_layer_identifiers() == []
    pathlib.Path(ball).write_text(BALL.replace("= 1", "= 77"))
    get_layers(ctx)._native_layers().update(9e15)
    get_layers(ctx)._native_layers().update(9e15 + 1000)
    assert radius(ctx.get_stage()).Get() == 77, "what somebody else wrote is news"


def test_an_edit_during_a_save_is_not_outdated(ctx, ball):
    async def main():
        assert (await ctx.open_stage_async(ball))[0]
        state = get_layers(ctx).get_layers_state()
        get_layers(ctx)._native_layers().update(5e14)
        radius(ctx.get_stage()).Set(2.0)
        saving = asyncio.ensure_future(ctx.save_stage_async())
        await asyncio.sleep(0)
        radius(ctx.get_stage()).Set(3.0)
        assert (await saving)[0]
        get_layers(ctx)._native_layers().update(1e15)
        assert not state.is_layer_outdated(ball)
        assert radius(ctx.get_stage()).Get() == 3

    asyncio.run(main())


@pytest.fixture
def authoring(ctx, ball):
    """A stage in auto authoring, after its frame."""
    assert ctx.open_stage(ball)
    layers = get_layers(ctx)
    layers.set_edit_mode(1)
    frames()
    return layers


def unraisable(monkeypatch):
    found = []
    monkeypatch.setattr(sys, "unraisablehook", found.append)
    return found


def test_auto_authoring_distributes_before_a_save(call, authoring, ctx, ball):
    radius(ctx.get_stage()).Set(5.0)
    assert call(ctx, "save_stage")[0] is True and "radius = 5" in pathlib.Path(ball).read_text()
    authoring.get_auto_authoring().suspend()
    radius(ctx.get_stage()).Set(6.0)
    assert call(ctx, "save_stage")[0] is True and "radius = 6" in pathlib.Path(ball).read_text()
    get_layers(ctx).get_specs_locking().lock_spec("/Ball", True)
    root = ctx.get_stage().GetRootLayer()
    root.GetAttributeAtPath("/Ball.radius").default = 9.0
    root.comment = "saved"
    assert call(ctx, "save_stage")[0] is True
    assert "radius = 6" in pathlib.Path(ball).read_text(), "an edit of a locked spec does not reach the disk"


def test_auto_authoring_distributes_before_an_export(call, authoring, ctx, ball, tmp_path):
    get_layers(ctx).get_specs_locking().lock_spec("/Ball", True)
    ctx.get_stage().GetRootLayer().GetAttributeAtPath("/Ball.radius").default = 9.0
    target = str(tmp_path / "flat.usda")
    assert call(ctx, "export_as_stage", target) in ((True,), (True, ""))
    assert radius(Usd.Stage.Open(target)).Get() != 9, "an edit of a locked spec does not reach the disk"


def test_auto_authoring_continues_under_another_name(call, authoring, ctx, ball, tmp_path, monkeypatch):
    raised = unraisable(monkeypatch)
    radius(ctx.get_stage()).Set(5.0)
    other = str(tmp_path / "new" / "other.usda")
    assert call(ctx, "save_as_stage", other)[0] is True
    assert "radius = 5" in pathlib.Path(other).read_text() and "radius = 1" in pathlib.Path(ball).read_text()
    assert ctx.get_stage().GetEditTarget().GetLayer(), "an edit target that is there"
    assert authoring.get_edit_mode() == 1 and authoring.get_auto_authoring().get_default_layer() == other
    radius(ctx.get_stage()).Set(7.0)
    frames()
    assert ctx.get_stage().GetRootLayer().GetAttributeAtPath("/Ball.radius").default == 7
    assert ctx.save_stage() and "radius = 7" in pathlib.Path(other).read_text() and not raised


@pytest.mark.parametrize("end", ["close", "open", "new", "reopen", "attach", "destroy"])
def test_auto_authoring_ends_quietly(end, context, ball, tmp_path, monkeypatch, capfd):
    raised = unraisable(monkeypatch)
    ctx = omni_usd.create_context("ending")
    assert ctx.open_stage(ball)
    get_layers(ctx).set_edit_mode(2)
    frames()
    root = Sdf.Layer.Find(ball)
    radius(ctx.get_stage()).Set(5.0)
    if end == "open":
        (tmp_path / "next.usda").write_text(BALL)
        assert ctx.open_stage(str(tmp_path / "next.usda"))
        assert get_layers(ctx).get_edit_mode() == 0
    elif end == "attach":
        assert ctx.attach_stage(Usd.Stage.CreateInMemory())
    elif end == "reopen":
        assert ctx.reopen_stage() and radius(ctx.get_stage()).Get() == 1
    elif end != "destroy":
        assert ctx.close_stage() if end == "close" else ctx.new_stage()
    assert end in ("destroy", "reopen") or root.GetAttributeAtPath("/Ball.radius").default == 5
    assert omni_usd.destroy_context("ending")
    assert not raised and "Exception ignored" not in capfd.readouterr().err


def test_attaching_takes_nothing_from_its_owner(call, ctx, ball):
    stage, cache = Usd.Stage.Open(ball), UsdUtils.StageCache.Get()
    assert call(ctx, "attach_stage", stage)[0] is True and not cache.Contains(stage)
    assert call(ctx, "attach_stage", stage)[0] is True and ctx.get_stage() == stage, "what is attached already"
    assert call(ctx, "close_stage")[0] is True
    assert stage and radius(stage).Get() == 1, "the stage is its owner's"
    assert call(ctx, "attach_stage", stage)[0] is True and ctx.get_stage_id() == ctx.get_stage_id() >= 0
    assert ctx.close_stage() and stage and cache.Contains(stage)
    radius(stage).Set(6.0)
    assert ctx.attach_stage(stage) and ctx.close_stage() and ctx.open_stage(ball)
    assert radius(stage).Get() == 6 == radius(ctx.get_stage()).Get(), "nor its unsaved edits"
    assert ctx.close_stage()
    cache.Erase(stage)
    assert call(ctx, "attach_stage", stage)[0] is False, "it has expired"


def test_a_stage_of_two_contexts_outlives_the_first(context, ball):
    a, b = context("a"), context("b")
    assert a.open_stage(ball) and b.attach_stage(a.get_stage())
    assert a.close_stage() and radius(b.get_stage()).Get() == 1


@pytest.mark.parametrize("again", ["reopen_stage", "open_stage"])
def test_discarded_edits_do_not_come_back(again, ctx, ball):
    assert ctx.open_stage(ball)
    held = ctx.get_stage().GetRootLayer()
    radius(ctx.get_stage()).Set(5.0)
    assert ctx.close_stage()
    assert held.GetAttributeAtPath("/Ball.radius").default == 5, "who holds the layer may still look at it"
    assert ctx.reopen_stage() if again == "reopen_stage" else ctx.open_stage(ball)
    assert radius(ctx.get_stage()).Get() == 1 and not ctx.has_pending_edit()
    assert ctx.save_stage() and "radius = 1" in pathlib.Path(ball).read_text()


def test_a_layer_after_the_one_with_discarded_edits_keeps_its_own(ctx, ball):
    assert ctx.open_stage(ball)
    radius(ctx.get_stage()).Set(5.0)
    assert ctx.close_stage()
    gc.collect()
    assert Sdf.Layer.Find(ball) is None
    stage = Usd.Stage.Open(ball)
    radius(stage).Set(6.0)
    assert ctx.open_stage(ball) and radius(stage).Get() == 6 == radius(ctx.get_stage()).Get()


@pytest.mark.parametrize("how", ["subLayers = [@./ball.usda@]", "references"])
@pytest.mark.parametrize("again", ["reopen_stage", "open_stage"])
def test_discarded_edits_of_layers_below_do_not_come_back(how, again, ctx, ball, tmp_path):
    root = tmp_path / "root.usda"
    below = "(\n    prepend references = @./ball.usda@</Ball>\n)\n" if how == "references" else ""
    head = "" if how == "references" else f"(\n    {how}\n)\n"
    root.write_text(f'#usda 1.0\n{head}\nover "Ball" {below}{{\n}}\n')
    assert ctx.open_stage(str(root))
    held = Sdf.Layer.FindOrOpen(ball)
    held.GetAttributeAtPath("/Ball.radius").default = 5.0
    assert ctx.close_stage()
    assert ctx.reopen_stage() if again == "reopen_stage" else ctx.open_stage(str(root))
    assert radius(ctx.get_stage()).Get() == 1
    assert ctx.save_stage() and "radius = 1" in pathlib.Path(ball).read_text()


def test_edits_of_another_context_are_not_dropped(context, ball, tmp_path):
    a, b = context("a"), context("b")
    (tmp_path / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n)\n")
    assert a.open_stage(ball) and b.open_stage(str(tmp_path / "root.usda"))
    layer = Sdf.Layer.Find(ball)
    layer.GetAttributeAtPath("/Ball.radius").default = 5.0
    for operation in (lambda: a.reopen_stage_async(), lambda: a.open_stage_async(ball)):
        assert layer.dirty and layer in a.get_stage().GetUsedLayers() and layer in b.get_stage().GetUsedLayers()
        done, why = asyncio.run(operation())
        assert not done and "ball.usda" in why and "'b'" in why
        assert radius(a.get_stage()).Get() == 5 == radius(b.get_stage()).Get(), "nothing was closed"
    del layer
    assert a.close_stage()
    done, why = asyncio.run(a.open_stage_async(ball))
    assert not done and "'b'" in why and radius(b.get_stage()).Get() == 5
    assert b.save_layers("", [ball]) and a.open_stage(ball) and radius(a.get_stage()).Get() == 5


def test_a_lock_is_in_the_locked_layers_file(ctx, ball, tmp_path):
    (tmp_path / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n)\n")
    (tmp_path / "other.usda").write_text("#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n)\n")
    assert ctx.open_stage(str(tmp_path / "root.usda"))
    state = get_layers(ctx).get_layers_state()
    state.set_layer_lock_state(ball, True)
    assert ctx.has_pending_edit() and ctx.save_stage()
    assert not ctx.has_pending_edit() and not state.is_layer_outdated(ball)
    assert ctx.open_stage(str(tmp_path / "other.usda"))
    assert get_layers(ctx).get_layers_state().is_layer_locked(ball), "by its own file"
    get_layers(ctx).get_layers_state().set_layer_lock_state(ball, False)
    assert ctx.save_stage() and "locked" not in pathlib.Path(ball).read_text().replace("locked = 0", "")

    get_layers(ctx).get_layers_state()
    layer = Sdf.Layer.Find(ball)
    layer.GetAttributeAtPath("/Ball.radius").default = 8.0
    get_layers(ctx).get_layers_state().set_layer_lock_state(ball, True)
    assert ctx.save_stage()
    assert "locked = 1" in pathlib.Path(ball).read_text() and "radius = 1" in pathlib.Path(ball).read_text()
    assert ctx.has_pending_edit() and layer.dirty, "an edit that the lock keeps from being saved is not saved"
    frames()
    assert not get_layers(ctx).get_layers_state().is_layer_outdated(ball)
    get_layers(ctx).get_layers_state().set_layer_lock_state(ball, False)
    assert ctx.save_stage() and "radius = 8" in pathlib.Path(ball).read_text() and not ctx.has_pending_edit()


@pytest.mark.parametrize("name", ["root.usda", "another.usda"])
def test_saving_as_writes_the_locks(name, ctx, ball, tmp_path):
    root = tmp_path / "root.usda"
    root.write_text("#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n)\n")
    assert ctx.open_stage(str(root))
    get_layers(ctx).get_layers_state().set_layer_lock_state(ball, True)
    assert ctx.save_as_stage(str(tmp_path / name))
    assert "locked = 1" in pathlib.Path(ball).read_text()
    assert not ctx.has_pending_edit()


def test_the_layer_one_authored_in_is_restored(ctx, ball, tmp_path):
    (tmp_path / "root.usda").write_text(
        "#usda 1.0\n(\n    subLayers = [@./ball.usda@]\n"
        '    customLayerData = {\n        dictionary omni_layer = {\n            string authoring_layer = "./ball.usda"\n'
        '            dictionary specs_linking = { string[] "/Ball" = ["./ball.usda"] }\n'
        '            dictionary muteness = { bool "./ball.usda" = 1 }\n'
        '            dictionary locked = { bool "./gone.usda" = 1 }\n        }\n    }\n)\n')
    assert ctx.open_stage(str(tmp_path / "root.usda"))
    assert ctx.get_stage().GetEditTarget().GetLayer().identifier == ball
    other = tmp_path / "deep" / "er" / "other.usda"
    assert ctx.save_as_stage(str(other))
    data = ctx.get_stage().GetRootLayer().customLayerData["omni_layer"]
    assert data["authoring_layer"] == "../../ball.usda" and data["muteness"] == {"../../ball.usda": True}
    assert data["locked"] == {"../../gone.usda": True}
    assert [str(one) for one in data["specs_linking"]["/Ball"]] == ["../../ball.usda"]
    assert get_layers(ctx).get_layers_state().is_layer_globally_muted(ball)


def test_file_urls_open_and_save(ctx, ball, tmp_path):
    spaced = tmp_path / "a shot.usda"
    spaced.write_text(BALL)
    assert ctx.open_stage("file://" + str(spaced).replace(" ", "%20"))
    assert ctx.get_stage_url() == str(spaced)
    assert ctx.save_as_stage(f"file://{tmp_path}/another%20one.usda") and (tmp_path / "another one.usda").exists()
    assert ctx.export_as_stage(f"file://localhost{tmp_path}/flat.usda") and (tmp_path / "flat.usda").exists()


# -- live


@pytest.fixture
def live(project, serve):
    (project / "shot.usda").write_text(BALL)
    (project / "sub").mkdir()
    (project / "sub" / "look.usda").write_text("#usda 1.0\n")
    server = serve(project)
    return server, f"usdlive://127.0.0.1:{server.port}/shot.usda"


def test_a_live_stage_is_edited_by_two_and_saved_by_the_server(live, editor, call, ctx, project):
    server, url = live
    names = EventNames(ctx)
    assert call(ctx, "open_stage", url)[0] is True
    assert ctx.is_omni_stage() and ctx.is_writable() and ctx.can_save_stage() and not ctx.has_pending_edit()
    assert ctx.get_stage_url() == url and ctx.live.connected
    assert [e for e in names.take() if "ASSETS" not in e] == ["OPENING", "OPENED"]
    ada = editor(server, "ada", "shot.usda")
    ada.run("stage.GetAttributeAtPath('/Ball.radius').Set(5.0)")
    ada.flush()
    wait_frames(lambda: radius(ctx.get_stage()).Get() == 5)
    wait_frames(ctx.has_pending_edit)
    assert call(ctx, "save_stage")[0]
    wait_frames(lambda: not ctx.has_pending_edit())
    radius(ctx.get_stage()).Set(6.0)
    assert ctx.has_pending_edit(), "at once"
    result = call(ctx, "save_stage")
    root = ctx.get_stage().GetRootLayer().identifier
    assert result in ((True,), (True, "", [root])), result
    assert "radius = 6" in (project / "shot.usda").read_text()
    assert call(ctx, "save_stage") in ((True,), (True, "", [])), "nothing has changed since"
    wait_frames(lambda: not ctx.has_pending_edit())
    assert ada.run("live.wait(lambda: stage.GetAttributeAtPath('/Ball.radius').Get() == 6.0)\n"
                   "result = stage.GetAttributeAtPath('/Ball.radius').Get()") == 6
    assert call(ctx, "close_stage")[0] is True and ctx.live is None
    assert ada.run("assert live.wait(lambda: live.layer_states()['shot.usda'].editors == ('ada',), 10)\n"
                   "result = 1") == 1


@pytest.mark.parametrize("operation", ["open_stage_async", "reopen_stage_async", "close_stage_async",
                                       "attach_stage_async"])
def test_another_thread_does_not_leave_a_live_stage(operation, live, editor, ctx, ball):
    server, url = live
    assert ctx.open_stage(url)
    stage = ctx.get_stage()
    arguments = {"open_stage_async": (ball,), "attach_stage_async": (Usd.Stage.Open(ball),)}.get(operation, ())
    answers = []
    thread = threading.Thread(target=lambda: answers.append(asyncio.run(getattr(ctx, operation)(*arguments))))
    thread.start()
    thread.join()
    done, why = answers[0]
    assert not done and url in why and "thread" in why
    assert ctx.get_stage() == stage and ctx.can_close_stage()
    ada = editor(server, "ada", "shot.usda")
    ada.run("stage.GetAttributeAtPath('/Ball.radius').Set(5.0)")
    ada.flush()
    wait_frames(lambda: radius(stage).Get() == 5)
    assert ctx.close_stage()


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize("operation", ["new_stage_async", "open_stage_async", "reopen_stage_async",
                                       "close_stage_async", "attach_stage_async"])
def test_another_thread_does_not_open_a_stage_whose_layers_are_used(operation, is_open, ctx, ball, capfd):
    state = get_layers(ctx).get_layers_state()
    if is_open:
        assert ctx.open_stage(ball) and ctx.save_stage()
    stage = ctx.get_stage()
    arguments = {"open_stage_async": (ball,), "attach_stage_async": (Usd.Stage.Open(ball),)}.get(operation, ())
    answers = []
    thread = threading.Thread(target=lambda: answers.append(asyncio.run(getattr(ctx, operation)(*arguments))))
    thread.start()
    thread.join()
    done, why = answers[0]
    assert not done and why and ("thread" in why or not is_open and operation in ("reopen_stage_async", "close_stage_async"))
    assert ctx.get_stage() == stage
    get_app().update()
    assert ctx.open_stage(ball) and state.get_local_layer_identifiers() == [ctx.get_stage().GetRootLayer().identifier]
    assert "Traceback" not in capfd.readouterr().err


def test_a_live_stage_opens_beside_the_event_loop(live, ctx):
    """Other tasks run while the layers of a live stage arrive, and a layer that is not there is a failure."""
    _, url = live

    async def main(address):
        opening = asyncio.create_task(ctx.open_stage_async(address))
        frames = 0
        while not opening.done():
            await asyncio.sleep(0)
            frames += ctx.get_stage_state() == StageState.OPENING
        return opening.result(), frames

    result, frames = asyncio.run(main(url))
    assert result == (True, "") and frames > 10
    assert radius(ctx.get_stage()).Get() == 1
    assert ctx.close_stage()
    (opened, error), _ = asyncio.run(main(url.replace("shot.usda", "none.usda")))
    assert not opened and "none.usda" in error


def test_a_stage_opens_over_dds(dds_domain, project, serve, ctx):
    (project / "a shot.usda").write_text(BALL)
    serve(project, "--dds", "--dds-domain", str(dds_domain))
    for name in ("a shot.usda", "a%20shot.usda"):
        assert asyncio.run(ctx.open_stage_async(f"dds://{project.name}/{name}")) == (True, "")
        assert ctx.is_omni_stage() and radius(ctx.get_stage()).Get() == 1


def test_closing_waits_until_all_edits_are_confirmed(live, ctx, editor):
    server, url = live
    assert ctx.open_stage(url)
    radius(ctx.get_stage()).Set(9.0)
    assert asyncio.run(ctx.close_stage_async()) == (True, "")
    ada = editor(server, "ada", "shot.usda")
    assert ada.run("result = stage.GetAttributeAtPath('/Ball.radius').Get()") == 9


BIG = 1_000_000  # points: 12 MB, which are encoded beside the frame


def write_points(ctx, value):
    mesh = UsdGeom.Points.Define(ctx.get_stage(), "/Cloud")
    mesh.GetPointsAttr().Set(Vt.Vec3fArray(BIG, Gf.Vec3f(value)))


def test_a_big_array_is_saved(live, ctx, call, project):
    assert ctx.open_stage(live[1])
    write_points(ctx, 3)
    assert call(ctx, "save_stage")[0]
    saved = Usd.Stage.Open(str(project / "shot.usda"))
    points = UsdGeom.Points.Get(saved, "/Cloud").GetPointsAttr().Get()
    assert len(points) == BIG and points[0] == Gf.Vec3f(3)
    assert ctx.close_stage()


def test_closing_waits_for_a_big_array(live, ctx, editor):
    server, url = live
    assert ctx.open_stage(url)
    write_points(ctx, 5)
    assert ctx.close_stage()
    ada = editor(server, "ada", "shot.usda")
    assert ada.run("assert live.wait(lambda: stage.GetAttributeAtPath('/Cloud.points').Get(), 20)\n"
                   "result = stage.GetAttributeAtPath('/Cloud.points').Get()[0][0]") == 5


def test_a_live_stage_whose_server_is_gone(live, ctx, tmp_path):
    server, url = live
    assert ctx.open_stage(url)
    radius(ctx.get_stage()).Set(2.0)
    server.kill()
    wait_frames(lambda: not ctx.live.connected)
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "connection" in error and saved == []
    ok, error = asyncio.run(ctx.close_stage_async())
    assert not ok and "not confirmed" in error and radius(ctx.get_stage()).Get() == 2, "nothing is lost"
    assert not ctx.open_stage(url) and not ctx.new_stage() and ctx.get_stage_state() == StageState.OPENED
    assert ctx.export_as_stage(str(tmp_path / "copy.usda")), "what the text says can be done"
    server.start()
    wait_frames(lambda: ctx.live.connected and not ctx.live.pending)
    assert ctx.close_stage()
    assert ctx.open_stage(url) and radius(ctx.get_stage()).Get() == 2
    radius(ctx.get_stage()).Set(3.0)
    server.kill()
    wait_frames(lambda: not ctx.live.connected)
    assert not ctx.close_stage()
    ctx.set_pending_edit(False)
    assert ctx.close_stage(), "discarded when one says so"
    server.start()


def test_auto_authoring_reaches_the_server_before_a_stage_is_left(live, ctx, editor):
    server, url = live
    assert ctx.open_stage(url)
    get_layers(ctx).set_edit_mode(1)
    frames()
    radius(ctx.get_stage()).Set(9.0)
    assert ctx.close_stage()
    assert editor(server, "ada", "shot.usda").run("result = stage.GetAttributeAtPath('/Ball.radius').Get()") == 9


def test_live_states_and_refusals_are_notified(live, ctx, editor):
    server, url = live
    assert ctx.open_stage(url)
    layers = get_layers(ctx)
    root, received = ctx.get_stage().GetRootLayer().identifier, []
    kept = layers.get_event_stream().create_subscription_to_pop(  # noqa: F841
        lambda event: received.append(get_layer_event_payload(event)))
    ada = editor(server, "ada", "shot.usda")

    def of_kind(kind):
        return [one for one in received if one.event_type == kind]

    ada.run("stage.GetAttributeAtPath('/Ball.radius').Set(5.0)")
    ada.flush()
    wait_frames(lambda: of_kind(LayerEventType.DIRTY_STATE_CHANGED))
    assert of_kind(LayerEventType.DIRTY_STATE_CHANGED)[0].identifiers_or_spec_paths == [root]
    assert layers.get_layers_state().get_dirty_layer_identifiers() == [root]
    received.clear()
    assert ctx.save_stage()
    wait_frames(lambda: of_kind(LayerEventType.DIRTY_STATE_CHANGED))
    assert layers.get_layers_state().get_dirty_layer_identifiers() == []

    ada.run("live.lock('shot.usda')")
    ada.flush()
    radius(ctx.get_stage()).Set(8.0)
    wait_frames(lambda: of_kind(LayerEventType.EDITS_REFUSED))
    refused = layers.get_auto_authoring().refused_edits[-1]
    assert refused.path == "/Ball.radius" and refused.layer_identifier == root and "ada" in refused.reason
    assert refused.error_type == LayerErrorType.READ_ONLY and radius(ctx.get_stage()).Get() == 5


@pytest.mark.parametrize("is_live", [False, True])
def test_opening_again_keeps_the_edit_target(is_live, project, serve, ctx):
    for name in ("anim", "look"):
        (project / f"{name}.usda").write_text("#usda 1.0\n")
    (project / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./anim.usda@, @./look.usda@]\n)\n")
    url = f"usdlive://127.0.0.1:{serve(project).port}/root.usda" if is_live else str(project / "root.usda")
    assert ctx.open_stage(url)

    def target():
        return os.path.basename(ctx.get_stage().GetEditTarget().GetLayer().identifier)

    for name in ("root.usda", "look.usda", "anim.usda"):
        [layer] = [one for one in ctx.get_stage().GetLayerStack(False) if one.identifier.endswith(name)]
        ctx.get_stage().SetEditTarget(layer)
        assert ctx.save_stage() and target() == name and ctx.reopen_stage() and target() == name
    [layer] = [one for one in ctx.get_stage().GetLayerStack(False) if one.identifier.endswith("anim.usda")]
    assert get_layers(ctx).get_layers_state().set_layer_lock_state(layer.identifier, True)
    assert ctx.save_stage() and ctx.reopen_stage() and target() == "root.usda", "a locked layer is no edit target"
    ctx.get_stage().SetEditTarget(ctx.get_stage().GetSessionLayer())
    assert ctx.reopen_stage() and target() == "root.usda", "the session layer is a new one"


@pytest.mark.parametrize("is_live", [False, True])
def test_the_edit_target_of_a_save_is_restored_when_the_stage_is_opened(is_live, project, serve, ctx):
    (project / "sub").mkdir()
    (project / "sub" / "anim.usda").write_text("#usda 1.0\n")
    (project / "look.usda").write_text("#usda 1.0\n")
    root = "#usda 1.0\n(\n    subLayers = [@./sub/anim.usda@, @./look.usda@]\n)\n"
    (project / "root.usda").write_text(root)
    url = f"usdlive://127.0.0.1:{serve(project).port}/root.usda" if is_live else str(project / "root.usda")
    assert ctx.open_stage(url)

    def layer(name):
        return next(one for one in ctx.get_stage().GetLayerStack(False) if one.identifier.endswith(name))

    def saved_with(name):
        ctx.get_stage().SetEditTarget(layer(name))
        ctx.get_stage().DefinePrim(f"/Of_{name[:4]}")
        assert ctx.save_stage() and ctx.close_stage() and ctx.open_stage(url)
        assert ctx.get_stage().GetEditTarget().GetLayer() == layer(name)
        return (project / "root.usda").read_text()

    assert "authoring_layer" not in saved_with("root.usda")
    # Kit's key and form: relative to the root layer.
    assert 'string authoring_layer = "./sub/anim.usda"' in saved_with("anim.usda")
    assert 'string authoring_layer = "./look.usda"' in saved_with("look.usda")
    assert 'string authoring_layer = "./root.usda"' in saved_with("root.usda")
    assert "./sub/anim.usda" in saved_with("anim.usda")
    get_layers(ctx).set_edit_mode(1)
    ctx.get_stage().DefinePrim("/More")
    assert ctx.save_stage()
    assert "./sub/anim.usda" in (project / "root.usda").read_text(), "the delegate is no edit target to return to"
    get_layers(ctx).set_edit_mode(0)
    ctx.get_stage().SetEditTarget(layer("look.usda"))
    assert get_layers(ctx).get_layers_state().set_layer_lock_state(layer("look.usda").identifier, True)
    assert ctx.save_stage() and ctx.close_stage() and ctx.open_stage(url)
    assert ctx.get_stage().GetEditTarget().GetLayer() == layer("root.usda"), "it is locked"


def test_a_root_layer_that_cannot_be_saved_is_not_changed_for_the_edit_target(project, ctx):
    (project / "look.usda").write_text("#usda 1.0\n")
    (project / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./look.usda@]\n)\n")
    (project / "root.usda").chmod(0o444)
    assert ctx.open_stage(str(project / "root.usda"))
    ctx.get_stage().SetEditTarget(Sdf.Layer.Find(str(project / "look.usda")))
    ctx.get_stage().DefinePrim("/New")
    assert ctx.save_stage() and not ctx.get_stage().GetRootLayer().dirty
    assert "New" in (project / "look.usda").read_text()


def test_a_refused_port_is_said_soon(context):
    ctx, begin = context("patient", connect_timeout=60), time.monotonic()
    done, error = asyncio.run(ctx.open_stage_async("usdlive://127.0.0.1:1/shot.usda"))
    assert not done and "127.0.0.1:1" in error and "refused" in error.lower()
    assert time.monotonic() - begin < 20


def test_addresses_that_lead_nowhere(context, live):
    server, url = live
    ctx = context("short", connect_timeout=0.5)
    for address, said in ((url.replace("shot", "none"), "none.usda"),
                          ("usdlive://127.0.0.1:1/shot.usda", "127.0.0.1:1"),
                          ("usdlive://127.0.0.1:1", "names no layer"), (url + "/../../x", "..")):
        ok, error = asyncio.run(ctx.open_stage_async(address))
        assert not ok and said in error, error
        assert ctx.get_stage_state() == StageState.CLOSED
    assert ctx.open_stage(url) and not ctx.open_stage(url.replace("shot", "none"))
    assert ctx.get_stage_url() == url and ctx.live.connected, "the stage that is open stays"


def test_a_file_in_an_attached_folder_is_live(live, ctx, project, editor):
    server, url = live
    omni_usd.attach_project(str(project), f"usdlive://127.0.0.1:{server.port}")
    try:
        assert asyncio.run(ctx.open_stage_async(str(project / "shot.usda"))) == (True, "")
        assert ctx.is_omni_stage() and ctx.get_stage_url() == str(project / "shot.usda")
        editor(server, "ada", "shot.usda").run(
            "stage.GetAttributeAtPath('/Ball.radius').Set(5.0)\nassert live.flush()")
        wait_frames(lambda: radius(ctx.get_stage()).Get() == 5)
        ok, error, saved = asyncio.run(ctx.save_as_stage_async(str(project / "other.usda")))
        assert not ok and "export_as_stage" in error
        assert ctx.export_as_stage(str(project.parent / "copy.usda"))
    finally:
        omni_usd.detach_project(str(project))
    assert ctx.open_stage(str(project / "shot.usda")) and not ctx.is_omni_stage()


def test_a_live_stage_follows_global_mutes_in_global_scope(project, serve, ctx):
    """The scope decides, as in Kit."""
    (project / "sub.usda").write_text("#usda 1.0\n")
    (project / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./sub.usda@]\n)\n")
    server = serve(project)
    assert ctx.open_stage(f"usdlive://127.0.0.1:{server.port}/root.usda")
    with usdlive.connect(server.url, user="ada") as ada:
        ada.open_stage("root.usda")
        ada.mute("root.usda", "sub.usda")
        assert ada.flush()
        state = get_layers(ctx).get_layers_state()
        sub = ctx.get_stage().GetRootLayer().ComputeAbsolutePath("./sub.usda")
        wait_frames(lambda: state.is_layer_globally_muted(sub))
        assert not ctx.get_stage().GetMutedLayers()
        state.set_muteness_scope(True)
        wait_frames(lambda: len(ctx.get_stage().GetMutedLayers()) == 1)
        ada.unmute("root.usda", "sub.usda")
        assert ada.flush()
        wait_frames(lambda: not ctx.get_stage().GetMutedLayers())


def test_a_live_layer_is_outdated_and_reloaded_by_its_server(live, ctx, project):
    server, url = live
    assert ctx.open_stage(url)
    state = get_layers(ctx).get_layers_state()
    root = ctx.get_stage().GetRootLayer().identifier
    wait_frames(lambda: state.get_layer_owner(root))
    assert state.is_layer_writable(root) and not state.is_layer_outdated(root)
    (project / "shot.usda").write_text(BALL.replace("radius = 1", "radius = 123"))
    wait_frames(lambda: state.is_layer_outdated(root))
    state.reload_all_outdated_layers(not_in_session=False)
    wait_frames(lambda: radius(ctx.get_stage()).Get() == 123)
    wait_frames(lambda: not state.is_layer_outdated(root))


def test_a_file_changed_behind_the_server_is_not_overwritten(live, ctx, project):
    server, url = live
    assert ctx.open_stage(url)
    wait_frames(lambda: "shot.usda" in ctx.live.layer_states())
    (project / "shot.usda").write_text(BALL.replace("1", "123"))
    changed = (project / "shot.usda").read_text()
    wait_frames(lambda: ctx.live.layer_states()["shot.usda"].outdated)
    radius(ctx.get_stage()).Set(2.0)
    ok, error, saved = asyncio.run(ctx.save_stage_async())
    assert not ok and "shot.usda" in error and saved == []
    assert (project / "shot.usda").read_text() == changed and ctx.has_pending_edit()


def test_a_connection_of_ones_own_is_attached_and_left_open(live, ctx):
    server, _ = live
    with usdlive.connect(server.url, user="ada") as own:
        stage = own.open_stage("shot.usda")
        assert asyncio.run(ctx.attach_stage_async(stage, live=own)) == (True, "")
        UsdGeom.Sphere(stage.GetPrimAtPath("/Ball")).GetRadiusAttr().Set(3.0)
        wait_frames(lambda: own.revision and not own.pending)
        assert ctx.save_stage() and ctx.close_stage() and own.connected


def test_a_tile_of_any_number_makes_a_path_one_beside_its_layer(live, ctx, project):
    (project / "skin.1042.png").write_bytes(b"tile")
    server, url = live
    assert ctx.open_stage(url)
    root = ctx.get_stage().GetRootLayer()
    for name, expected in (("skin", "../skin.<UDIM>.png"), ("none", "none.<UDIM>.png")):
        content = Sdf.Layer.CreateAnonymous()
        prim = Sdf.CreatePrimInLayer(content, "/A")
        Sdf.AttributeSpec(prim, "tiles", Sdf.ValueTypeNames.Asset).default = Sdf.AssetPath(f"{name}.<UDIM>.png")
        look = ctx.live.open_layer("sub/look.usda")
        _layer_content.reanchor(content, root, look)
        assert content.GetAttributeAtPath("/A.tiles").default.path == expected
