"""Tests omni.kit.usd.layers as scripts use it: each method and event on local stages, and the shared state on
live ones."""

from __future__ import annotations

import asyncio
import gc
import inspect
import os
import stat
import threading
import weakref

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from stage_context import StageContext

import usdlive
import usdlive.omni.kit.usd.layers as layers
from usdlive.omni.kit.app import get_app
from usdlive.omni.kit.usd.layers import LayerEditMode, LayerErrorType, LayerEventType, LayerUtils
from usdlive.omni.usd import ContextSettings, create_context, destroy_context


class Scene:
    """root.usda over strong.usda and weak.usda, which has /A.x and /A/B.y, and /R of asset.usda."""

    def __init__(self, folder):
        self.folder = folder
        self._write("asset.usda", '#usda 1.0\n(\n    defaultPrim = "Asset"\n)\ndef "Asset"\n{\n    double a = 1\n}\n')
        self._write("weak.usda", '#usda 1.0\ndef "A"\n{\n    double x = 1\n    def "B"\n    {\n        double y = 2\n'
                    '    }\n}\ndef "R" (\n    references = @./asset.usda@\n)\n{\n}\n')
        self._write("strong.usda", "#usda 1.0\n")
        self._write("root.usda", "#usda 1.0\n(\n    subLayers = [@./strong.usda@, @./weak.usda@]\n)\n")
        self.stage = Usd.Stage.Open(self.path("root.usda"))
        self.root, self.session = self.stage.GetRootLayer(), self.stage.GetSessionLayer()
        self.strong, self.weak = (Sdf.Layer.Find(self.path(f"{n}.usda")) for n in ("strong", "weak"))
        self.context = StageContext(self.stage)
        self.layers = layers.get_layers(self.context)
        self.events = []
        self.subscription = layers.get_event_stream(self.context).create_subscription_to_pop(
            lambda event: self.events.append(layers.get_layer_event_payload(event)))
        self.frame()

    def path(self, name):
        return str(self.folder / name)

    def _write(self, name, text):
        (self.folder / name).write_text(text)

    def frame(self, seconds=0.6):
        """Runs a frame after the interval in which files are checked. Returns its events."""
        self.events.clear()
        native = self.layers._native_layers()
        native.update(Scene.now + seconds * 1000)
        Scene.now += seconds * 1000
        self.layers.deliver_queued_events()
        return list(self.events)

    def types(self):
        return [event.event_type for event in self.frame()]

    def edit(self, mode=LayerEditMode.AUTO_AUTHORING):
        self.layers.set_edit_mode(mode)
        self.frame()

    now = 1e12  # later than any clock, so that frames of the app itself check no files


@pytest.fixture
def scene(tmp_path):
    return Scene(tmp_path)


# -- the entry points


def test_entry_points_take_names_and_contexts(scene):
    assert layers.get_layers(scene.context) is scene.layers
    assert layers.get_layers(None) is None
    assert scene.layers.usd_context is scene.context
    parts = {layers.get_layers_state: "get_layers_state", layers.get_auto_authoring: "get_auto_authoring",
             layers.get_specs_linking: "get_specs_linking", layers.get_specs_locking: "get_specs_locking",
             layers.get_event_stream: "get_event_stream"}
    for function, method in parts.items():
        assert function(scene.context) is getattr(scene.layers, method)()
    assert scene.layers.get_layers_state().usd_context is scene.context
    assert layers.get_last_error_type(scene.context) == LayerErrorType.SUCCESS
    assert layers.get_last_error_string(scene.context) == ""
    assert scene.layers.get_event_key() == "test"
    scene.layers.get_layers_state().is_layer_writable("nowhere.usda")
    assert scene.layers.get_last_error_type() == LayerErrorType.NOT_FOUND
    assert "nowhere.usda" in scene.layers.get_last_error_string()


def test_another_thread_gets_an_error_and_changes_nothing(scene):
    root = scene.root.identifier
    state, authoring = scene.layers.get_layers_state(), scene.layers.get_auto_authoring()
    linking, locking = scene.layers.get_specs_linking(), scene.layers.get_specs_locking()
    calls = [lambda: state.is_layer_writable(root), lambda: state.set_layer_lock_state(scene.weak.identifier, True),
             lambda: state.set_muteness_scope(True), state.get_local_layer_identifiers,
             lambda: authoring.set_default_layer(root), authoring.suspend, lambda: linking.link_spec("/A", root),
             linking.get_all_spec_links, lambda: locking.lock_spec("/A"), locking.get_all_locked_specs,
             scene.layers.get_edit_mode, lambda: scene.edit(), scene.layers.deliver_queued_events]
    errors = []

    def work():
        for call in calls:
            try:
                call()
            except usdlive.Error as error:
                errors.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert len(errors) == len(calls)
    assert all(error.code == "invalidArgument" and "another thread" in error.message for error in errors)
    assert scene.layers.get_edit_mode() == LayerEditMode.NORMAL
    assert not state.is_muteness_global() and not state.is_layer_locked(scene.weak.identifier)
    assert linking.get_all_spec_links() == {} and locking.get_all_locked_specs() == []
    assert locking.lock_spec("/A") and scene.layers.get_last_error_string() == ""


def test_names_and_texts():
    for kind in LayerEventType:
        name = layers.layer_event_name(kind)
        assert name.startswith("omni.kit.usd.layers::layer:") and layers.layer_event_type(name) == kind
    assert layers.layer_event_name(LayerEventType.SPECS_LINKING_CHANGED).endswith(":specs_linking_changed")
    assert layers.layer_event_type("something else") is None
    assert int(LayerErrorType.UNKNOWN) == 13 and LayerErrorType.LIVE_SESSOIN_INVALID == 6
    assert layers.get_short_user_name("Ada Lovelace") == "AL"
    assert layers.get_short_user_name("") == ""
    link = "omniverse://host/a.usd?live_session_name=Default"
    assert layers.get_live_session_name_from_shared_link(link) == "Default"
    assert layers.get_live_session_name_from_shared_link("omniverse://host/a.usd") is None


def test_a_context_without_a_stage_answers(scene):
    scene.context.stage = None
    assert scene.layers.get_edit_mode() == LayerEditMode.NORMAL
    assert scene.layers.get_last_error_type() == LayerErrorType.INVALID_STAGE
    state = scene.layers.get_layers_state()
    assert state.get_local_layer_identifiers() == [] and not state.is_layer_locked("x")
    get_app().update()


def test_the_contexts_stage_is_followed(scene, tmp_path):
    scene.edit()
    state = scene.layers.get_layers_state()
    state.set_muteness_scope(True)
    state.add_auto_reload_layer(scene.weak.identifier)
    other = Sdf.Layer.CreateAnonymous("other.usda")
    old, scene.context.stage = scene.stage, Usd.Stage.Open(other)
    assert state.get_local_layer_identifiers() == [other.identifier]
    assert scene.layers.get_edit_mode() == LayerEditMode.NORMAL
    assert old.GetEditTarget().GetLayer() == scene.root
    assert not old.GetSessionLayer().subLayerPaths
    assert state.is_muteness_global() and state.get_auto_reload_layers() == []


def test_layers_go_with_their_context(scene):
    context = StageContext(scene.stage)
    instance = layers.get_layers(context)
    gone = weakref.ref(instance)
    del context, instance
    gc.collect()
    assert gone() is None
    get_app().update()


def test_nothing_is_missed_before_the_first_frame(scene):
    def listen(context):
        received = []
        stream = layers.get_event_stream(context)
        return received, stream.create_subscription_to_pop(lambda event: received.append(event.type))

    weak = scene.weak.identifier

    def change(stage, name):
        kept = Sdf.Layer.FindOrOpen(weak)
        Sdf.PrimSpec(kept, name, Sdf.SpecifierDef)
        stage.MuteLayer(weak)
        get_app().update()

    expected = {LayerEventType.PRIM_SPECS_CHANGED, LayerEventType.MUTENESS_STATE_CHANGED}
    early = StageContext(scene.stage, "early")
    received, _early = listen(early)
    change(scene.stage, "First")
    assert expected <= set(received)

    context = create_context("early")
    try:
        received, _late = listen(context)  # there is no stage yet
        assert context.open_stage(scene.root.identifier)
        change(context.get_stage(), "Second")
        assert expected <= set(received)
    finally:
        destroy_context("early")


# -- states


def test_locks(scene):
    state = scene.layers.get_layers_state()
    assert state.is_layer_writable(scene.weak.identifier)
    state.set_layer_lock_state(scene.weak.identifier, True)
    assert state.is_layer_locked(scene.weak.identifier) and not state.is_layer_writable(scene.weak.identifier)
    assert not state.is_layer_savable(scene.weak.identifier)
    assert not state.is_layer_readonly_on_disk(scene.weak.identifier)
    assert scene.weak.customLayerData["omni_layer"]["locked"] is True
    assert scene.root.customLayerData["omni_layer"]["locked"] == {"./weak.usda": True}
    received = [e for e in scene.frame() if e.event_type == LayerEventType.LOCK_STATE_CHANGED]
    assert len(received) == 1 and received[0].identifiers_or_spec_paths == [scene.weak.identifier]
    assert received[0].is_layer_influenced(scene.weak) and not received[0].is_layer_influenced(scene.root)
    state.set_layer_lock_state(scene.root.identifier, True)
    assert layers.get_last_error_type(scene.context) == LayerErrorType.INVALID_PARAM
    assert not state.is_layer_locked(scene.root.identifier)
    state.set_layer_lock_state(scene.weak.identifier, False)
    assert not state.is_layer_locked(scene.weak.identifier)
    assert scene.root.customLayerData["omni_layer"]["locked"] == {"./weak.usda": False}


def test_muteness(scene):
    state = scene.layers.get_layers_state()
    weak = scene.weak.identifier
    scene.stage.MuteLayer(weak)
    assert state.is_layer_locally_muted(weak) and not state.is_layer_writable(weak), "at once"
    assert LayerEventType.MUTENESS_STATE_CHANGED in scene.types()
    assert state.is_layer_locally_muted(weak) and not state.is_layer_globally_muted(weak)
    state.set_muteness_scope(True)
    assert state.is_muteness_global() and not scene.stage.IsLayerMuted(weak)
    assert {LayerEventType.MUTENESS_SCOPE_CHANGED, LayerEventType.MUTENESS_STATE_CHANGED} <= set(scene.types())
    assert state.set_layer_global_muteness(weak, True) and scene.stage.IsLayerMuted(weak)
    assert scene.root.customLayerData["omni_layer"]["muteness"] == {"./weak.usda": True}
    assert LayerUtils.get_layer_global_muteness(scene.root, weak)
    LayerUtils.set_layer_global_muteness(scene.root, weak, False)
    scene.frame()
    assert not scene.stage.IsLayerMuted(weak)
    scene.stage.MuteLayer(weak)
    assert state.is_layer_globally_muted(weak)
    scene.frame()
    assert LayerUtils.get_layer_global_muteness(scene.root, weak), "a mute in global scope was not stored"
    scene.stage.UnmuteLayer(weak)
    scene.frame()
    state.set_muteness_scope(False)
    assert scene.stage.IsLayerMuted(weak) and state.is_layer_locally_muted(weak)


def test_muteness_is_found_again(scene):
    state = scene.layers.get_layers_state()
    assert state.set_layer_global_muteness(scene.weak.identifier, True)
    other = StageContext(Usd.Stage.Open(scene.root), "second")
    again = layers.get_layers_state(other)
    assert again.is_layer_globally_muted(scene.weak.identifier)
    assert not other.stage.IsLayerMuted(scene.weak.identifier)
    LayerUtils.restore_muteness_from_custom_data(other.stage)
    assert other.stage.IsLayerMuted(scene.weak.identifier)


def test_names_owner_lists(scene):
    state = scene.layers.get_layers_state()
    assert state.get_layer_name(scene.root.identifier) == "Root Layer"
    assert state.get_layer_name(scene.session.identifier) == "Session Layer"
    assert state.get_layer_name(scene.weak.identifier) == "weak.usda"
    state.set_layer_name(scene.weak.identifier, "Layout")
    assert state.get_layer_name(scene.weak.identifier) == "Layout"
    assert scene.weak.customLayerData["omni_layer"]["custom_name"] == "Layout"
    assert state.get_layer_owner(scene.weak.identifier) != ""
    local = [scene.root.identifier, scene.strong.identifier, scene.weak.identifier]
    assert state.get_local_layer_identifiers() == local
    assert state.get_local_layer_identifiers(True) == [*local, scene.session.identifier]
    assert state.get_local_layer_identifiers(True, False) == local
    scene.root.subLayerPaths.append("./missing.usda")
    assert state.get_local_layer_identifiers(include_invalid_layers=True)[-1] == scene.path("missing.usda")
    assert state.has_local_layer(scene.weak.identifier)
    asset = scene.path("asset.usda")
    assert state.has_used_layer(asset) and not state.has_local_layer(asset)


def test_dirty_outdated_reload_and_permission(scene):
    state, weak = scene.layers.get_layers_state(), scene.weak.identifier
    asset = scene.path("asset.usda")
    assert state.get_dirty_layer_identifiers() == []
    scene.weak.comment = "mine"
    assert LayerEventType.DIRTY_STATE_CHANGED in scene.types()
    assert state.get_dirty_layer_identifiers() == [weak] == LayerUtils.get_dirty_layers(scene.stage)
    scene.weak.Save()
    assert LayerEventType.OUTDATE_STATE_CHANGED not in scene.types() and state.get_dirty_layer_identifiers() == []

    for path in (weak, asset):
        text = open(path).read()
        open(path, "w").write(text.replace("#usda 1.0\n", "#usda 1.0\n# other\n", 1))
    received = [e for e in scene.frame() if e.event_type == LayerEventType.OUTDATE_STATE_CHANGED]
    assert len(received) == 1 and sorted(received[0].identifiers_or_spec_paths) == sorted([asset, weak])
    assert state.is_layer_outdated(weak)
    assert state.get_all_outdated_layer_identifiers() == sorted([asset, weak])
    assert state.get_outdated_sublayer_identifiers() == [weak]
    assert state.get_outdated_non_sublayer_identifiers() == [asset]
    state.reload_outdated_sublayers()
    assert state.get_all_outdated_layer_identifiers() == [asset]
    assert state.add_auto_reload_layer(asset) and not state.add_auto_reload_layer(asset)
    assert state.is_auto_reload_layer(asset) and state.get_auto_reload_layers() == [asset]
    assert state.get_all_outdated_layer_identifiers(not_auto=True) == []
    assert LayerEventType.AUTO_RELOAD_LAYERS_CHANGED in scene.types()
    assert state.get_all_outdated_layer_identifiers() == []
    assert state.remove_auto_reload_layer(asset) and not state.remove_auto_reload_layer(asset)

    os.chmod(weak, stat.S_IRUSR)
    received = [e for e in scene.frame() if e.event_type == LayerEventType.LAYER_FILE_PERMISSION_CHANGED]
    assert len(received) == 1 and received[0].layer_identifier == weak
    assert state.is_layer_readonly_on_disk(weak) and not state.is_layer_writable(weak)
    assert not LayerUtils.is_layer_writable(weak)


def test_kinds_of_layers_reload_themselves(scene):
    state, weak, asset = scene.layers.get_layers_state(), scene.weak.identifier, scene.path("asset.usda")

    def change():
        for path in (weak, asset):
            text = open(path).read()
            open(path, "w").write(text.replace("#usda 1.0\n", "#usda 1.0\n# other\n", 1))
        return sorted(scene.types())

    scene.context.settings = ContextSettings(auto_reload_sublayers=True)
    get_app().update()
    assert state.is_auto_reload_layer(weak) and not state.is_auto_reload_layer(asset)
    assert state.get_auto_reload_layers() == []
    assert LayerEventType.OUTDATE_STATE_CHANGED in change()
    assert state.get_all_outdated_layer_identifiers() == [asset]
    assert state.get_all_outdated_layer_identifiers(not_auto=True) == [asset]
    scene.context.settings.auto_reload_non_sublayers = True
    get_app().update()
    scene.frame()
    assert state.is_auto_reload_layer(asset) and not state.is_auto_reload_layer("nowhere.usda")
    assert state.get_all_outdated_layer_identifiers() == []
    scene.context.settings = ContextSettings()
    get_app().update()
    change()
    assert state.get_all_outdated_layer_identifiers() == sorted([asset, weak])


# -- events


def test_events_of_content_arrive_once_and_in_order(scene):
    Sdf.PrimSpec(scene.weak, "New", Sdf.SpecifierDef)
    scene.stage.GetPrimAtPath("/A").GetAttribute("x").Set(3)
    scene.root.startTimeCode = 3
    scene.root.subLayerOffsets[0] = Sdf.LayerOffset(2, 3)
    scene.stage.SetEditTarget(scene.weak)
    received = scene.frame()
    kinds = [e.event_type for e in received if e.event_type != LayerEventType.DIRTY_STATE_CHANGED]
    assert kinds == [LayerEventType.PRIM_SPECS_CHANGED, LayerEventType.PRIM_SPECS_CHANGED,
                     LayerEventType.INFO_CHANGED, LayerEventType.EDIT_TARGET_CHANGED]
    specs = {k: v for e in received for k, v in e.layer_spec_paths.items()}
    assert specs[scene.weak.identifier] == ["/New"] and "/A.x" in specs[scene.root.identifier]
    info = [e for e in received if e.event_type == LayerEventType.INFO_CHANGED]
    assert len(info) == 1
    assert info[0].layer_info_data == {scene.root.identifier: ["startTimeCode", "subLayerOffsets_offset",
                                                               "subLayerOffsets_scale"]}
    assert sum(e.event_type == LayerEventType.EDIT_TARGET_CHANGED for e in received) == 1
    assert scene.frame() == []
    scene.root.subLayerPaths.remove("./strong.usda")
    assert {LayerEventType.SUBLAYERS_CHANGED, LayerEventType.USED_LAYERS_CHANGED} <= set(scene.types())
    scene.layers.send_event(layers.layer_event_name(LayerEventType.LIVE_SESSION_JOINING), {"val": ["a"]})
    assert scene.frame()[-1].identifiers_or_spec_paths == ["a"]
    scene.layers.send_event("nothing we know")
    assert scene.layers.get_last_error_type() == LayerErrorType.INVALID_PARAM


def test_subscriptions_get_the_requested_events(scene):
    data, sublayers, prims = [], [], []
    kept = [layers.subscribe_to_custom_data(scene.weak.identifier, ["mine:key"], data.append, scene.context),
            layers.subscribe_to_sublayers(lambda: sublayers.append(1), scene.context),
            layers.subscribe_to_prim_specs(scene.weak.identifier, prims.append, scene.context)]
    scene.weak.customLayerData = {"other": 1}
    scene.frame()
    scene.weak.customLayerData = {"other": 1, "mine": {"key": 5}}
    Sdf.PrimSpec(scene.strong, "Elsewhere", Sdf.SpecifierDef)
    Sdf.PrimSpec(scene.weak, "Here", Sdf.SpecifierDef)
    scene.frame()
    assert data == [{"mine:key": 5}] and prims == [["/Here"]] and sublayers == []
    LayerUtils.create_sublayer(scene.root, 0, "")
    scene.frame()
    assert sublayers == [1]
    del kept[:]
    scene.weak.customLayerData = {}
    scene.frame()
    assert len(data) == 1


def test_frames_of_the_app_update_and_deliver(scene):
    received = []
    kept = scene.layers.get_event_stream().create_subscription_to_pop(received.append)
    scene.weak.comment = "other"
    assert not received
    get_app().update()
    assert LayerEventType.INFO_CHANGED in [event.type for event in received] and kept


# -- auto authoring


def test_auto_authoring(scene):
    authoring = scene.layers.get_auto_authoring()
    assert not authoring.is_enabled()
    scene.edit()
    assert authoring.is_enabled() and scene.layers.get_edit_mode() == LayerEditMode.AUTO_AUTHORING
    delegate = scene.stage.GetEditTarget().GetLayer()
    assert authoring.is_auto_authoring_layer(delegate.identifier)
    assert not authoring.is_auto_authoring_layer(scene.root.identifier)
    assert authoring.get_default_layer() == scene.root.identifier
    authoring.set_default_layer(scene.strong.identifier)
    assert LayerEventType.DEFAULT_LAYER_CHANGED in scene.types()
    authoring.set_default_layer(scene.session.identifier)
    assert authoring.get_default_layer() == scene.strong.identifier

    prim = scene.stage.GetPrimAtPath("/A")
    prim.GetAttribute("x").Set(5.0)
    UsdGeom.Sphere.Define(scene.stage, "/New").GetRadiusAttr().Set(2.0)
    scene.stage.GetPrimAtPath("/R").GetAttribute("a").Set(9.0)
    scene.frame()
    assert scene.weak.GetAttributeAtPath("/A.x").default == 5
    assert scene.strong.GetAttributeAtPath("/New.radius").default == 2
    assert scene.strong.GetAttributeAtPath("/R.a").default == 9, "the new opinion of a referenced property is missing"
    with layers.active_authoring_layer_context(scene.context):
        assert scene.stage.GetEditTarget().GetLayer() == scene.strong
    scene.stage.SetEditTarget(scene.weak)
    scene.frame()
    assert scene.stage.GetEditTarget().GetLayer() == delegate

    editor = Usd.NamespaceEditor(scene.stage)
    assert editor.MovePrimAtPath("/New", "/Renamed") and editor.ApplyEdits()
    scene.stage.GetPrimAtPath("/Renamed").GetAttribute("radius").Set(4.0)
    scene.frame()
    assert scene.strong.GetAttributeAtPath("/Renamed.radius").default == 4 and not scene.stage.GetPrimAtPath("/New")
    assert scene.stage.RemovePrim("/Renamed")
    scene.frame()
    assert not scene.stage.GetPrimAtPath("/Renamed") and not scene.strong.GetPrimAtPath("/Renamed")
    prim.GetAttribute("x").Clear()
    scene.frame()
    assert not scene.weak.GetAttributeAtPath("/A.x").HasInfo("default"), "the opinion it had"

    authoring.suspend()
    scene.stage.DefinePrim("/Later")
    scene.frame()
    assert not scene.strong.GetPrimAtPath("/Later")
    authoring.resume()
    scene.frame()
    assert scene.strong.GetPrimAtPath("/Later")
    scene.layers.set_edit_mode(LayerEditMode.NORMAL)
    assert scene.stage.GetEditTarget().GetLayer() == scene.strong
    assert {LayerEventType.EDIT_MODE_CHANGED, LayerEventType.EDIT_TARGET_CHANGED} <= set(scene.types())


def test_an_edit_for_a_locked_layer_is_reverted_with_a_reason(scene):
    scene.edit()
    scene.layers.get_layers_state().set_layer_lock_state(scene.weak.identifier, True)
    attribute = scene.stage.GetAttributeAtPath("/A.x")
    attribute.Set(7.0)
    assert attribute.Get() == 7, "until the frame"
    received = [e for e in scene.frame() if e.event_type == LayerEventType.EDITS_REFUSED]
    assert attribute.Get() == 1
    assert len(received) == 1 and received[0].identifiers_or_spec_paths == ["/A.x"]
    (edit,) = scene.layers.get_auto_authoring().refused_edits
    assert (edit.path, edit.field, edit.layer_identifier) == ("/A.x", "default", scene.weak.identifier)
    assert edit.error_type == LayerErrorType.READ_ONLY and "locked" in edit.reason


# -- links and locks of specs


def test_linking(scene):
    context, strong, root = scene.context, scene.strong.identifier, scene.root.identifier
    linking = scene.layers.get_specs_linking()
    assert linking.link_spec("/A", strong) == ["/A", "/A.x"]
    received = [e for e in scene.frame() if e.event_type == LayerEventType.SPECS_LINKING_CHANGED]
    assert received[0].layer_spec_paths == {strong: ["/A", "/A.x"]}
    assert linking.link_spec("/Nothing", strong) == [] and linking.link_spec("/A", "nowhere") == []
    assert linking.link_spec("/", root) == [] and "/A/B.y" in linking.link_spec("/", root, hierarchy=True)
    assert linking.get_spec_layer_links("/A") == {"/A": sorted([root, strong]), "/A.x": sorted([root, strong])}
    assert linking.is_spec_linked("/A") and linking.is_spec_linked("/A", strong)
    assert linking.unlink_specs_to_layer(root) != [] and linking.get_spec_links_for_layer(root) == []
    assert not linking.is_enabled()
    scene.edit(LayerEditMode.SPECS_LINKING)
    assert linking.is_enabled()
    scene.stage.GetAttributeAtPath("/A.x").Set(5.0)
    scene.frame()
    assert scene.strong.GetAttributeAtPath("/A.x").default == 5 and scene.weak.GetAttributeAtPath("/A.x").default == 1
    assert linking.unlink_spec("/A", strong) == ["/A", "/A.x"] and linking.get_all_spec_links() == {}

    assert layers.link_specs(context, ["/A.x"], [strong, root]) == {"/A.x": [strong, root]}
    assert layers.get_spec_layer_links(context, "/A.x") == {"/A.x": sorted([strong, root])}
    assert layers.get_spec_links_for_layers(context, strong) == {strong: ["/A.x"]}
    assert layers.is_spec_linked(context, "/A.x", root) and layers.get_all_spec_links(context)
    assert layers.unlink_specs(context, "/A.x", root) == {"/A.x": [root]}
    assert layers.unlink_specs_from_all_layers(context, "/A.x") == {"/A.x": [strong]}
    layers.link_specs(context, "/A.x", strong)
    assert layers.unlink_specs_to_layers(context, strong) == {"/A.x": [strong]}
    layers.link_specs(context, "/A.x", strong)
    assert scene.root.customLayerData["omni_layer"]["specs_linking"]["/A.x"] == ["./strong.usda"]
    layers.unlink_all_specs(context)
    assert layers.get_all_spec_links(context) == {}


def test_suspended_links(scene):
    linking = scene.layers.get_specs_linking()
    linking.link_spec("/A.x", scene.strong.identifier)
    scene.edit(LayerEditMode.SPECS_LINKING)
    linking.suspend()
    scene.stage.GetAttributeAtPath("/A.x").Set(5.0)
    scene.frame()
    assert not scene.strong.GetAttributeAtPath("/A.x") and scene.stage.GetAttributeAtPath("/A.x").Get() == 5
    linking.resume()
    scene.frame()
    assert scene.strong.GetAttributeAtPath("/A.x").default == 5 and scene.weak.GetAttributeAtPath("/A.x").default == 1


def test_there_are_no_live_sessions(scene, caplog):
    syncing = layers.get_live_syncing(scene.context)
    assert isinstance(syncing, layers.LiveSyncing) and layers.get_live_syncing("no such context") is None
    assert syncing.layers_instance is scene.layers and syncing.usd_context is scene.context
    values = {"layer_identifier": scene.root.identifier, "prim_path": "/A", "stop_session": True}
    answers = {}
    for name in (name for name in dir(syncing) if not name.startswith("_")):
        function = getattr(syncing, name)
        if not callable(function) or function in (syncing.layers_instance, syncing.usd_context):
            continue
        needed = [parameter for parameter in inspect.signature(function).parameters.values()
                  if parameter.default is parameter.empty]
        answer = function(*(values.get(parameter.name, "x") for parameter in needed))
        answers[name] = asyncio.run(answer) if inspect.iscoroutine(answer) else answer
    done, why = answers.pop("open_stage_with_live_session_async")
    assert not done and "usdlive://" in why
    assert len(answers) >= 25 and not any(answers.values())
    assert "there are no live sessions" in caplog.text
    with pytest.raises(TypeError, match="no sessions"):
        layers.LiveSession()


def test_locking(scene):
    context, locking = scene.context, scene.layers.get_specs_locking()
    assert locking.lock_spec("/A") == ["/A", "/A.x"]
    received = [e for e in scene.frame() if e.event_type == LayerEventType.SPECS_LOCKING_CHANGED]
    assert received[0].identifiers_or_spec_paths == ["/A", "/A.x"]
    assert locking.is_spec_locked("/A.x") and not locking.is_spec_locked("/A/B")
    for layer in (scene.session, scene.root, scene.strong, scene.weak):
        with Usd.EditContext(scene.stage, layer):
            scene.stage.GetAttributeAtPath("/A.x").Set(9.0)
            scene.stage.GetPrimAtPath("/A").GetReferences().AddInternalReference("/R")
    scene.frame()
    assert scene.stage.GetAttributeAtPath("/A.x").Get() == 1
    assert not scene.stage.GetPrimAtPath("/A").HasAuthoredReferences()
    assert not scene.strong.GetPrimAtPath("/A") and not scene.session.GetPrimAtPath("/A")
    assert scene.layers.get_auto_authoring().refused_edits
    assert locking.unlock_spec("/A") == ["/A", "/A.x"]
    scene.stage.GetAttributeAtPath("/A.x").Set(9.0)
    scene.frame()
    assert scene.stage.GetAttributeAtPath("/A.x").Get() == 9
    everything = layers.lock_specs(context, "/", hierarchy=True)
    assert "/A/B.y" in everything and sorted(everything) == sorted(layers.get_all_locked_specs(context))
    assert layers.is_spec_locked(context, "/R.a"), "also what comes over a reference"
    assert layers.unlock_specs(context, ["/A/B.y"]) == ["/A/B.y"]
    layers.unlock_all_specs(context)
    assert layers.get_all_locked_specs(context) == [] == locking.lock_spec("not a path")
    locking.unlock_all_specs()


def test_a_locked_prim_takes_nothing_new(scene):
    locking, stage = scene.layers.get_specs_locking(), scene.stage
    locking.lock_spec("/A")
    with Usd.EditContext(stage, scene.strong):
        stage.GetPrimAtPath("/A").CreateAttribute("new", Sdf.ValueTypeNames.Double).Set(1.0)
        stage.DefinePrim("/A/C")
        stage.GetAttributeAtPath("/A/B.y").Set(5.0)
    scene.frame()
    assert not stage.GetAttributeAtPath("/A.new"), "a property is part of its prim"
    assert stage.GetPrimAtPath("/A/C") and stage.GetAttributeAtPath("/A/B.y").Get() == 5, "B is not locked"
    assert locking.unlock_spec("/A.x") == ["/A.x"]
    stage.GetAttributeAtPath("/A.x").Set(3.0)
    scene.frame()
    assert stage.GetAttributeAtPath("/A.x").Get() == 3, "a property that was unlocked by itself"

    locking.unlock_all_specs()
    locking.lock_spec("/A", True)
    for layer in (scene.root, scene.weak):
        with Usd.EditContext(stage, layer):
            stage.DefinePrim("/A/D/E").CreateAttribute("deep", Sdf.ValueTypeNames.Double).Set(1.0)
    scene.frame()
    assert not stage.GetPrimAtPath("/A/D") and not scene.root.GetPrimAtPath("/A/D")
    reasons = [edit.reason for edit in scene.layers.get_auto_authoring().refused_edits]
    assert any("/A is locked" in reason for reason in reasons)
    stage.DefinePrim("/R/New")
    scene.frame()
    assert stage.GetPrimAtPath("/R/New"), "elsewhere everything goes on"
    locking.unlock_all_specs()
    stage.DefinePrim("/A/D")
    scene.frame()
    assert stage.GetPrimAtPath("/A/D")


def test_a_locked_prim_takes_nothing_new_from_the_delegate(scene):
    scene.layers.get_specs_locking().lock_spec("/A", True)
    scene.edit()
    scene.stage.GetPrimAtPath("/A").CreateAttribute("new", Sdf.ValueTypeNames.Double).Set(1.0)
    scene.stage.DefinePrim("/A/C/D")
    scene.frame(), scene.frame()
    assert not scene.stage.GetAttributeAtPath("/A.new") and not scene.stage.GetPrimAtPath("/A/C")
    assert all(not layer.GetPrimAtPath("/A/C") for layer in (scene.root, scene.strong, scene.weak))


@pytest.mark.parametrize("target", ["/Renamed", "/R/A"])
def test_a_move_of_a_locked_prim_is_reverted(target, scene):
    scene.layers.get_specs_locking().lock_spec("/A", True)
    before = scene.weak.ExportToString()
    editor = Usd.NamespaceEditor(scene.stage)
    editor.MovePrimAtPath("/A", target)
    assert editor.ApplyEdits() and not scene.weak.GetPrimAtPath("/A")
    scene.frame()
    assert not scene.weak.GetPrimAtPath(target) and scene.stage.GetAttributeAtPath("/A/B.y").Get() == 2
    if target == "/Renamed":
        assert scene.weak.ExportToString() == before


def test_states_are_true_before_the_first_frame(scene, tmp_path):
    weak = scene.weak.identifier
    os.chmod(weak, stat.S_IRUSR)
    other = StageContext(Usd.Stage.Open(scene.root), "early states")
    state = layers.get_layers_state(other)
    assert state.is_layer_readonly_on_disk(weak) and not state.is_layer_writable(weak)
    assert not state.is_layer_savable(weak) and state.get_layer_owner(weak) != ""
    extra = tmp_path / "extra.usda"
    extra.write_text('#usda 1.0\ndef "E"\n{\n}\n')
    assert not state.has_used_layer(str(extra))
    scene.stage.DefinePrim("/New").GetReferences().AddReference(str(extra), "/E")
    assert state.has_used_layer(str(extra)) and state.is_layer_writable(str(extra))
    scene.stage.RemovePrim("/New")
    assert not state.has_used_layer(str(extra))


def test_auto_authoring_removes_a_prim_that_it_has_not_edited(scene):
    for layer in (scene.strong, scene.weak):
        Sdf.CreatePrimInLayer(layer, "/Old/Child").specifier = Sdf.SpecifierDef
    scene.edit()
    delegate = scene.stage.GetEditTarget().GetLayer()
    assert scene.stage.GetPrimAtPath("/Old/Child") and not delegate.GetPrimAtPath("/Old")
    assert scene.stage.RemovePrim("/Old/Child")
    scene.frame()
    assert scene.stage.GetPrimAtPath("/Old") and not scene.stage.GetPrimAtPath("/Old/Child")
    for layer in (scene.strong, scene.weak):
        assert layer.GetPrimAtPath("/Old") and not layer.GetPrimAtPath("/Old/Child")
    # Usd's answer: nothing exists there, and the path is not that of a prim.
    assert not scene.stage.RemovePrim("/None")
    assert not scene.stage.RemovePrim("/A.x") and not scene.stage.RemovePrim("/")
    # The edit is reverted within the frame, also with another edit target.
    scene.stage.GetPrimAtPath("/Old").SetMetadata("comment", "still here")
    assert scene.stage.RemovePrim("/Old")
    scene.frame()
    assert not scene.stage.GetPrimAtPath("/Old") and not scene.strong.GetPrimAtPath("/Old")
    with Usd.EditContext(scene.stage, scene.root):
        assert not scene.stage.RemovePrim("/A"), "the root layer has no opinion"
    assert scene.stage.GetPrimAtPath("/A")
    scene.edit(LayerEditMode.NORMAL)
    assert "RemovePrim" not in vars(scene.stage)
    assert not scene.stage.RemovePrim("/A")


def parts_to_clear(stage):
    """Writes opinions of many kinds to the edit target. Returns functions that clear one each."""
    types, prim = Sdf.ValueTypeNames, stage.GetPrimAtPath("/A")
    prim.CreateAttribute("file", types.Asset).Set("./asset.usda")
    prim.CreateAttribute("many", types.Double).Set(0.0)
    for time in range(1000):
        prim.GetAttribute("many").Set(float(time), time)
    prim.SetCustomData({"k": 1, "l": {"m": 2}})
    prim.SetAssetInfoByKey("identifier", Sdf.AssetPath("./asset.usda"))
    prim.SetTypeName("Cube")
    prim.GetReferences().AddReference("./asset.usda")
    prim.CreateRelationship("to").SetTargets(["/R"])
    prim.CreateAttribute("connected", types.Double).AddConnection("/A.many")
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("color", types.Float).Set(1.0)
    shader = UsdShade.Shader.Define(stage, "/Shader")
    shader.CreateInput("in", types.Float).ConnectToSource("/Shader.outputs:out")
    prim.GetVariantSets().AddVariantSet("v").SetVariantSelection("p")
    return [
        lambda: prim.GetAttribute("file").Clear(), lambda: prim.GetAttribute("many").ClearAtTime(7),
        lambda: prim.GetAttribute("many").ClearAtTime(time=Usd.TimeCode(8)),
        lambda: prim.GetAttribute("many").ClearDefault(), lambda: prim.GetAttribute("many").Clear(),
        lambda: prim.ClearCustomDataByKey("l:m"), lambda: prim.ClearMetadataByDictKey("customData", "k"),
        lambda: prim.ClearAssetInfo(), lambda: prim.ClearTypeName(), lambda: prim.GetReferences().ClearReferences(),
        lambda: prim.GetRelationship("to").ClearTargets(True), lambda: prim.GetAttribute("connected").ClearConnections(),
        lambda: UsdGeom.PrimvarsAPI(prim).RemovePrimvar("color"), lambda: prim.RemoveProperty(propName="connected"),
        lambda: UsdShade.Shader(stage.GetPrimAtPath("/Shader")).GetInput("in").ClearSources(),
        lambda: UsdShade.ConnectableAPI.ClearSources(stage.GetAttributeAtPath("/Shader.inputs:in")),
        lambda: prim.GetVariantSet("v").ClearVariantSelection(), lambda: prim.ClearMetadata("comment")]


@pytest.mark.parametrize("mode", [LayerEditMode.AUTO_AUTHORING, LayerEditMode.SPECS_LINKING])
def test_what_was_not_edited_is_cleared_as_in_the_layer_itself(scene, tmp_path, mode):
    (tmp_path / "other").mkdir()
    other = Scene(tmp_path / "other")
    with Usd.EditContext(scene.stage, scene.weak), Usd.EditContext(other.stage, other.weak):
        clears = parts_to_clear(scene.stage), parts_to_clear(other.stage)
    scene.edit(mode)
    other.stage.SetEditTarget(other.weak)
    before = scene.stage.GetEditTarget().GetLayer().ExportToString()
    for index, (mine, theirs) in enumerate(zip(*clears)):
        assert mine() == theirs(), index
        assert scene.weak.ExportToString() == other.weak.ExportToString(), index
    scene.frame()
    assert scene.weak.ExportToString() == other.weak.ExportToString()
    assert scene.stage.GetEditTarget().GetLayer().ExportToString().count("over") <= before.count("over") + 1
    assert not scene.layers.get_auto_authoring().refused_edits


def test_a_clear_waits_while_suspended_and_is_refused_in_a_locked_layer(scene):
    x, y = (scene.stage.GetAttributeAtPath(path) for path in ("/A.x", "/A/B.y"))
    scene.edit()
    authoring = scene.layers.get_auto_authoring()
    authoring.suspend()
    x.Clear()
    scene.frame()
    assert scene.weak.GetAttributeAtPath("/A.x").default == 1
    authoring.resume()
    scene.frame()
    assert x.Get() is None and scene.weak.GetAttributeAtPath("/A.x").default is None
    scene.layers.get_layers_state().set_layer_lock_state(scene.weak.identifier, True)
    y.Clear()
    scene.stage.GetPrimAtPath("/A/B").RemoveProperty("y")
    assert y.Get() == 2 and [edit.path for edit in authoring.refused_edits] == ["/A/B.y", "/A/B.y"]


def test_only_linked_layers_lose_a_property(scene):
    for layer in (scene.strong, scene.root):
        Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, "/A"), "x", Sdf.ValueTypeNames.Double).default = 5.0
    scene.layers.get_specs_linking().link_spec("/A.x", scene.strong.identifier)
    scene.layers.get_specs_linking().link_spec("/A.x", scene.weak.identifier)
    scene.edit(LayerEditMode.SPECS_LINKING)
    assert scene.stage.GetPrimAtPath("/A").RemoveProperty("x")
    assert scene.root.GetAttributeAtPath("/A.x")
    assert not scene.strong.GetAttributeAtPath("/A.x") and not scene.weak.GetAttributeAtPath("/A.x")


def test_code_that_looks_only_into_the_edit_target_clears_within_clearing(scene):
    def clear():  # does what C++ does
        spec = scene.stage.GetEditTarget().GetLayer().GetAttributeAtPath("/A.x")
        if spec:
            spec.ClearInfo("default")

    scene.edit()
    clear()
    scene.frame()
    assert scene.weak.GetAttributeAtPath("/A.x").default == 1
    with scene.layers.get_auto_authoring().clearing("/A.x", "/A"):
        clear()
    scene.frame()
    assert scene.weak.GetAttributeAtPath("/A.x").default is None
    scene.edit(LayerEditMode.NORMAL)
    with scene.layers.get_auto_authoring().clearing("/A.x"):
        clear()


def test_a_muted_layer_that_is_removed_leaves_no_flag(scene):
    state, weak = scene.layers.get_layers_state(), scene.weak.identifier
    state.set_muteness_scope(True)
    assert state.set_layer_global_muteness(weak, True)
    scene.frame()
    del scene.root.subLayerPaths[1]
    LayerUtils.remove_layer_global_muteness(scene.root, weak)
    scene.stage.UnmuteLayer(weak)
    scene.frame()
    assert "muteness" not in scene.root.customLayerData.get("omni_layer", {})


def test_data_of_kit_and_others_is_read(tmp_path):
    (tmp_path / "my layer.usda").write_text("#usda 1.0\n")
    (tmp_path / "100%25.usda").write_text("#usda 1.0\n")
    root = Sdf.Layer.CreateNew(str(tmp_path / "root.usda"))
    root.subLayerPaths = ["./my layer.usda", "./100%25.usda"]
    root.customLayerData = {"omni_layer": {"locked": {"./my%20layer.usda": True, "./100%25.usda": True},
                                           "muteness": {"./my%20layer.usda": True},
                                           "authoring_layer": "./my%20layer.usda"}}
    stage = Usd.Stage.Open(root)
    context = StageContext(stage, "percent")
    state, spaced = layers.get_layers_state(context), str(tmp_path / "my layer.usda")
    assert state.is_layer_locked(spaced) and state.is_layer_locked(str(tmp_path / "100%25.usda"))
    assert state.is_layer_globally_muted(spaced) and LayerUtils.get_layer_lock_status(root, spaced)
    assert not LayerUtils.restore_authoring_layer_from_custom_data(stage), "it is locked"
    state.set_layer_lock_state(spaced, False)
    assert list(root.customLayerData["omni_layer"]["locked"]) == ["./100%25.usda", "./my%20layer.usda"]
    assert LayerUtils.restore_authoring_layer_from_custom_data(stage)
    for strange in (5, "", ["a"], {"authoring_layer": 5}, {"authoring_layer": ["x"], "locked": 7, "muteness": "m"}):
        root.customLayerData = {"omni_layer": strange}
        assert not LayerUtils.restore_authoring_layer_from_custom_data(stage)
        assert not state.is_layer_locked(spaced) and not LayerUtils.get_layer_lock_status(root, spaced)
        LayerUtils.set_layer_global_muteness(root, spaced, True)
        LayerUtils.save_authoring_layer_to_custom_data(stage)


def test_file_urls_name_layers(scene):
    state = scene.layers.get_layers_state()
    assert state.is_layer_writable("file://" + scene.weak.identifier)
    assert state.has_local_layer("file://localhost" + scene.weak.identifier)


def test_content_that_moves_leads_to_where_it_led(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    for name in ("beside.usda", "tile.1002.png", "sub.usda"):
        (tmp_path / "a" / name).write_text("#usda 1.0\n")
    (tmp_path / "a" / "source.usda").write_text("""#usda 1.0
(
    customLayerData = {
        dictionary omni_layer = {
            string authoring_layer = "./sub.usda"
            dictionary muteness = { bool "./sub.usda" = 1 }
            dictionary specs_linking = { string[] "/P" = ["./sub.usda"] }
        }
    }
)
def "P" (
    references = [@beside.usda@, @./beside.usda@]
)
{
    asset[] paths = [@tile.<UDIM>.png@, @OmniPBR.mdl@, @http://host/x.usd@, @/absolute.usda@, @../up.usda@]
}
""")
    source = Sdf.Layer.FindOrOpen(str(tmp_path / "a" / "source.usda"))
    target = Sdf.Layer.CreateNew(str(tmp_path / "b" / "target.usda"))
    assert LayerUtils.transfer_layer_content(source, target)
    prim = target.GetPrimAtPath("/P")
    assert [r.assetPath for r in prim.referenceList.explicitItems] == ["../a/beside.usda"]
    assert [p.path for p in prim.attributes["paths"].default] == [
        "../a/tile.<UDIM>.png", "OmniPBR.mdl", "http://host/x.usd", "/absolute.usda", "../up.usda"]
    data = target.customLayerData["omni_layer"]
    assert data["authoring_layer"] == "../a/sub.usda" and dict(data["muteness"]) == {"../a/sub.usda": True}
    assert list(data["specs_linking"]["/P"]) == ["../a/sub.usda"]


# -- LayerUtils


def test_layer_utils(scene):
    root, weak = scene.root, scene.weak
    made = LayerUtils.create_sublayer(root, 0, scene.path("made.usda"))
    assert made and root.subLayerPaths[0] == "./made.usda"
    assert LayerUtils.get_sublayer_position_in_parent(root, made.identifier) == 0
    assert LayerUtils.get_sublayer_position_in_parent(root, "nowhere") == -1
    assert LayerUtils.create_sublayer(root, -2, "") is None
    assert LayerUtils.insert_sublayer(made, 0, root.identifier) is None
    assert LayerUtils.get_sublayer_identifier(root, 0) == made.identifier
    assert LayerUtils.get_sublayer_identifier(root, 9) is None
    assert LayerUtils.move_layer(root, 0, root, -1) and root.subLayerPaths[-1] == "./made.usda"
    assert LayerUtils.get_all_sublayers(scene.stage)[0] == root.identifier
    assert len(LayerUtils.get_all_sublayers(scene.stage, include_session_layers=True)) == 5
    replaced = LayerUtils.replace_sublayer(root, 2, scene.path("asset.usda"))
    assert replaced.identifier == scene.path("asset.usda")
    assert LayerUtils.remove_sublayer(root, 2) == replaced.identifier and LayerUtils.remove_sublayer(root, 7) is None
    anonymous = LayerUtils.create_sublayer(root, -1, "")
    assert anonymous and LayerUtils.insert_sublayer(root, 0, anonymous.identifier) is None
    assert LayerUtils.has_prim_spec(weak, "/A") and not LayerUtils.has_prim_spec(weak, "not a path")
    assert LayerUtils.transfer_layer_content(weak, anonymous) and LayerUtils.has_prim_spec(anonymous, "/A/B")
    assert LayerUtils.remove_prim_spec(anonymous, "/A/B") and not LayerUtils.remove_prim_spec(anonymous, "/A/B")
    assert not LayerUtils.set_edit_target(scene.stage, scene.path("asset.usda"))
    assert LayerUtils.set_edit_target(scene.stage, weak.identifier)
    assert LayerUtils.get_edit_target(scene.stage) == weak.identifier
    assert LayerUtils.save_authoring_layer_to_custom_data(scene.stage)
    LayerUtils.set_edit_target(scene.stage, root.identifier)
    assert LayerUtils.restore_authoring_layer_from_custom_data(scene.stage)
    assert LayerUtils.get_edit_target(scene.stage) == weak.identifier
    assert LayerUtils.set_layer_lock_status(root, weak.identifier, True)
    assert LayerUtils.get_layer_lock_status(root, weak.identifier)
    assert LayerUtils.remove_layer_lock_status(root, weak.identifier)
    assert not LayerUtils.get_layer_lock_status(root, weak.identifier)
    assert LayerUtils.set_layer_global_muteness(root, weak.identifier, True)
    assert LayerUtils.remove_layer_global_muteness(root, weak.identifier)
    assert LayerUtils.set_custom_layer_name(weak, "name") and LayerUtils.get_custom_layer_name(weak) == "name"
    assert LayerUtils.get_custom_layer_name(root) == "root.usda"
    assert LayerUtils.save_layers([weak.identifier]) == [] and LayerUtils.save_layers(["no.usda"]) == ["no.usda"]
    weak.comment = "lost by reloading"
    assert LayerUtils.reload_all_layers([weak.identifier]) and not weak.comment
    LayerUtils.resolve_paths(root, anonymous)


# -- live

SETUP = """
import usdlive
import usdlive.omni.kit.usd.layers as layers
class Context:
    def __init__(self): self.live = live
    def get_stage(self): return stage
    def get_name(self): return 'live'
context = Context()
mine = layers.get_layers(context)
from usdlive.omni.kit.app import get_app
def frame():
    live.tick(); get_app().update(); live.tick()
frame()
"""


@pytest.fixture
def two(project, serve, editor):
    (project / "sub.usda").write_text('#usda 1.0\ndef "A"\n{\n    double x = 1\n    double y = 1\n}\n')
    (project / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./sub.usda@]\n)\n\nover \"A\"\n{\n    double z = 1\n}\n")
    server = serve(project)
    editors = [editor(server, name, "root.usda") for name in ("ada", "bo")]
    for one in editors:
        one.run(SETUP)
    return editors


def test_a_frame_of_auto_authoring_is_one_commit(two):
    ada, bo = two
    ada.run("mine.set_edit_mode(layers.LayerEditMode.AUTO_AUTHORING)\nframe()\nassert live.flush(20)")
    before = ada.flush()
    ada.run("stage.GetAttributeAtPath('/A.x').Set(5.0)\nstage.GetAttributeAtPath('/A.z').Set(6.0)\n"
            "for i in range(1000): stage.DefinePrim(f'/New{i}')\nframe()")
    after = ada.flush()
    assert after == before + 1
    bo.catch_up(after)
    commits = bo.run("result = [sorted({e.layer for e in c.edits}) for c in happened "
                     f"if type(c).__name__ == 'Committed' and c.revision == {after}]")
    assert commits == [["root.usda", "sub.usda"]]
    assert bo.run("result = [stage.GetAttributeAtPath('/A.x').Get(), stage.GetAttributeAtPath('/A.z').Get(), "
                  "bool(stage.GetPrimAtPath('/New999'))]") == [5, 6, True]
    assert bo.run("result = layer('sub.usda').GetAttributeAtPath('/A.x').default") == 5
    # Edits that bo writes into the layer that ada mirrors are shown by ada.
    bo.run("layer('sub.usda').GetAttributeAtPath('/A.x').default = 7.0")
    ada.catch_up(bo.flush())
    ada.run("frame()\nassert stage.GetAttributeAtPath('/A.x').Get() == 7.0")


def test_locks_links_and_muteness_reach_the_other(two):
    ada, bo = two
    ada.run("sub = layer('sub.usda').identifier\n"
            "mine.get_layers_state().set_layer_lock_state(sub, True)\n"
            "mine.get_specs_linking().link_spec('/A.x', sub)\nmine.get_specs_locking().lock_spec('/A.z')\n"
            "mine.get_layers_state().set_muteness_scope(True)\nframe()")
    bo.run("received = []\nkept = mine.get_event_stream().create_subscription_to_pop("
           "lambda e: received.append(layers.LayerEventType(e.type).name))")
    bo.catch_up(ada.flush())
    bo.run("sub = layer('sub.usda').identifier\nframe()\n"
           "assert mine.get_layers_state().is_layer_locked(sub)\n"
           "assert not mine.get_layers_state().is_layer_writable(sub)\n"
           "assert mine.get_specs_linking().is_spec_linked('/A.x', sub)\n"
           "assert mine.get_specs_locking().get_all_locked_specs() == ['/A.z']")
    received = bo.run("result = received")
    for name in ("LOCK_STATE_CHANGED", "SPECS_LINKING_CHANGED", "SPECS_LOCKING_CHANGED"):
        assert received.count(name) == 1, received
    # bo gets the reason, with the holder's name.
    bo.run("mine.set_edit_mode(layers.LayerEditMode.AUTO_AUTHORING)\nframe()\n"
           "stage.GetAttributeAtPath('/A.y').Set(9.0)\nstage.GetAttributeAtPath('/A.z').Set(9.0)\nframe()")
    reasons = bo.run("result = {e.path: e.reason for e in mine.get_auto_authoring().refused_edits}")
    assert "locked by ada" in reasons["/A.y"] and "locked" in reasons["/A.z"]
    assert bo.run("result = [stage.GetAttributeAtPath(p).Get() for p in ('/A.y', '/A.z')]") == [1, 1]
    ada.run("mine.get_layers_state().set_layer_lock_state(sub, False)\n"
            "mine.get_specs_locking().unlock_all_specs()\n"
            "mine.get_layers_state().set_layer_global_muteness(sub, True)\nframe()")
    bo.catch_up(ada.flush())
    bo.run("frame()\nassert not mine.get_layers_state().is_layer_locked(sub)\n"
           "assert mine.get_layers_state().is_layer_globally_muted(sub) and not stage.IsLayerMuted(sub)")


def test_everybody_unlocks_their_own_specs(two):
    ada, bo = two
    bo.run("assert mine.get_specs_locking().lock_spec('/A.z') == ['/A.z']\nframe()")
    ada.catch_up(bo.flush())
    ada.run("frame()\nlocking = mine.get_specs_locking()\ntaken = locking.lock_spec('/', True)\nframe()")
    assert ada.run("result = sorted(taken)") == ["/A", "/A.x", "/A.y"], "what somebody else has is not got"
    ada.flush()
    for unlock in ("unlocked = locking.unlock_spec('/', True)", "locking.unlock_all_specs()",
                   "from usdlive.omni.kit.usd.layers import commands as c\n"
                   "unlocked = locking.unlock_spec('/A', True)"):
        ada.run(f"unlocked = None\n{unlock}\nerror = layers.get_last_error_string(context)\nframe()")
        ada.flush()
        ada.run("frame()\nassert locking.get_all_locked_specs() == ['/A.z']\nassert 'bo' in error, error\n"
                "assert unlocked in (None, ['/A', '/A.x', '/A.y'])\n"
                "assert mine.get_auto_authoring().refused_edits == []\n"
                "assert len(locking.lock_spec('/', True)) == 3\nframe()")
    ada.run("locking.unlock_all_specs()\nframe()\nstage.GetAttributeAtPath('/A.x').Set(4.0)\nframe()")
    bo.catch_up(ada.flush())
    assert bo.run("frame()\nresult = [mine.get_specs_locking().get_all_locked_specs(), "
                  "stage.GetAttributeAtPath('/A.x').Get()]") == [["/A.z"], 4]


def test_unlocking_a_lock_of_somebody_else_fails(two):
    ada, bo = two
    bo.run("assert mine.get_specs_locking().lock_spec('/A.z') == ['/A.z']\nframe()")
    ada.catch_up(bo.flush())
    ada.run("frame()\nfrom usdlive.omni.kit import commands\nfrom usdlive.omni.kit.usd.layers import commands as _")
    assert ada.run("result = commands.execute('UnlockSpecs', spec_paths='/A.z', usd_context=context)[0]") is False
    assert ada.run("result = mine.get_specs_locking().is_spec_locked('/A.z')")


def test_m1_two_authors_of_the_first_links_keep_both(two):
    ada, bo = two
    ada.run("sub = stage.GetLayerStack(False)[-1].identifier\n"
            "mine.get_specs_linking().link_spec('/A.x', sub)")
    bo.run("sub = stage.GetLayerStack(False)[-1].identifier\n"
           "mine.get_specs_linking().link_spec('/A.y', sub)")
    bo.run("frame()")
    ada.run("frame()")
    bo.flush()
    bo.catch_up(ada.flush())
    ada.catch_up(bo.flush())
    for one in two:
        assert one.run("frame()\nresult = sorted(mine.get_specs_linking().get_all_spec_links())") == ["/A.x", "/A.y"]


def test_a_flag_that_says_nothing_is_no_commit(two):
    ada, _ = two
    before = ada.flush()
    ada.run("root = stage.GetRootLayer()\nother = stage.GetLayerStack(False)[-1].identifier\n"
            "assert root.identifier != other\n"
            "layers.LayerUtils.set_layer_lock_status(root, other, False)\n"
            "layers.LayerUtils.set_layer_global_muteness(root, other, False)\n"
            "mine.get_layers_state().set_layer_global_muteness(other, False)\nframe()")
    assert ada.flush() == before


def test_edits_of_the_project_are_not_reverted(two):
    """The holder of a lock may edit through a client without these guards; others follow and do not revert
    it."""
    ada, bo = two
    ada.run("mine.get_specs_locking().lock_spec('/A', True)\nframe()")
    bo.catch_up(ada.flush())
    bo.run("frame()")
    ada.run("mine = None\nlayers._layers.clear()\nimport gc; gc.collect()\n"
            "stage.GetAttributeAtPath('/A.y').Set(5.0)\nstage.DefinePrim('/A/New')\nlive.tick()")
    at = ada.flush()
    bo.catch_up(at)
    bo.run("for _ in range(5): frame()\nassert live.flush(20)")
    assert bo.run("result = [stage.GetAttributeAtPath('/A.y').Get(), bool(stage.GetPrimAtPath('/A/New')), "
                  "live.revision, len(mine.get_auto_authoring().refused_edits)]") == [5, True, at, 0]
    bo.run("stage.GetAttributeAtPath('/A.y').Set(9.0)\nframe()\nframe()\nassert live.flush(20)\nframe()")
    assert bo.run("result = stage.GetAttributeAtPath('/A.y').Get()") == 5, "but one's own edits go back"


DIRTINESS = '''
received = []
kept = mine.get_event_stream().create_subscription_to_pop_by_type(
    layers.LayerEventType.DIRTY_STATE_CHANGED,
    lambda event: received.append([layers.get_layer_event_payload(event).identifiers_or_spec_paths,
                                   mine.get_layers_state().get_dirty_layer_identifiers()]))
def until(condition):
    assert live.wait(lambda: (frame(), condition())[1], 20), received
def edit(value):
    layer('sub.usda').GetAttributeAtPath('/A.x').default = value
sub = layer('sub.usda').identifier
'''


def test_an_edit_and_a_save_soon_after_it_are_both_notified(two):
    ada, bo = two
    for one in two:
        one.run(DIRTINESS)
    ada.run("edit(2.0)\nassert mine.get_layers_state().get_dirty_layer_identifiers() == [sub]\nframe()")
    assert ada.run("result = received") == [[[ada.run("result = sub")]] * 2]
    ada.run("received.clear()\nassert live.save().saved\nuntil(lambda: received)\nframe()\n"
            "assert received == [[[sub], []]], received")
    # Edited and saved in one frame.
    ada.run("received.clear()\nedit(3.0)\nassert live.save().saved\n"
            "until(lambda: received and not mine.get_layers_state().get_dirty_layer_identifiers())\n"
            "assert received[-1] == [[sub], []], received")
    # By somebody else, between two looks of bo.
    bo.run("until(lambda: not mine.get_layers_state().get_dirty_layer_identifiers())\nfor _ in range(50): frame()\n"
           "received.clear()")
    ada.run("received.clear()\nedit(4.0)\nassert live.save().saved")
    bo.run("until(lambda: received)\nuntil(lambda: not mine.get_layers_state().get_dirty_layer_identifiers())")


def test_an_edit_that_the_server_refuses_leaves_the_layer_clean(two):
    ada, bo = two
    for one in two:
        one.run(DIRTINESS)
    ada.run("live.lock('sub.usda')")
    ada.flush()  # not yet received by bo
    ada.run("assert live.save().saved")
    bo.run("edit(5.0)\nuntil(lambda: len(received) > 1 and not mine.get_layers_state().get_dirty_layer_identifiers())\n"
           "assert received[0] == [[sub], [sub]] and received[-1] == [[sub], []], received")


def test_the_slower_of_two_locks_is_refused_with_an_event(two):
    ada, bo = two
    ada.run("mine.get_specs_locking().lock_spec('/A.x')\nframe()")
    bo.catch_up(ada.flush())
    bo.run("frame()")
    for one in (ada, bo):  # neither has received the other's edit
        one.run("asked = mine.get_specs_locking().lock_spec('/A.y')")
    ada.flush()
    bo.run("received = []\nkept = mine.get_event_stream().create_subscription_to_pop_by_type("
           "layers.LayerEventType.EDITS_REFUSED, received.append)\nassert live.flush(20)\nframe()")
    reason = bo.run("assert received\nedit = mine.get_auto_authoring().refused_edits[-1]\n"
                    "assert edit.error_type == layers.LayerErrorType.READ_ONLY\nresult = edit.reason")
    assert "/A.y is locked by ada" in reason
    held = "result = dict(layer('root.usda').customLayerData['omni_layer']['specs_locking'])"
    assert bo.run(held) == ada.run(held) == {"/A.x": "ada", "/A.y": "ada"}
