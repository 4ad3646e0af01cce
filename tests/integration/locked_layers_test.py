"""Locks of layers in Kit's API with several people: who may unlock, where the lock is stored, and what a save writes."""

import random

import pytest

LAYERS = ("a.usda", "b.usda")

# A context on the editor's stage, with Kit's layers.
SETUP = """
import asyncio
from usdlive.omni import usd as omni_usd
from usdlive.omni.kit import commands, undo
from usdlive.omni.kit.app import get_app
from usdlive.omni.kit.usd import layers
import usdlive.omni.kit.usd.layers.commands
context = omni_usd.create_context()
assert context.attach_stage(stage, live)
mine = layers.get_layers(context)
state = mine.get_layers_state()
received = []
kept = mine.get_event_stream().create_subscription_to_pop(
    lambda event: received.append(layers.LayerEventType(event.type).name))
def frame():
    get_app().update()
def why():
    return mine.get_last_error_string()
def flags():
    data = stage.GetRootLayer().customLayerData.get("omni_layer", {}).get("locked", {})
    return {path.removeprefix("./"): flag for path, flag in data.items()}
def save():
    done, text, saved = asyncio.run(context.save_stage_async())
    return [done, text, sorted(live.layer_name(Sdf.Layer.Find(one)) for one in saved)]
def mark(name, text):
    try:
        layer(name).comment = text
        return True
    except Exception:
        return False
frame()
"""


@pytest.fixture
def people(project, serve, editor):
    """Starts the editors of these users on one stage. `chief` is an administrator."""
    for name in LAYERS:
        (project / name).write_text("#usda 1.0\n")
    (project / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./a.usda@, @./b.usda@]\n)\n")
    server = serve(project, "--admin", "chief")

    def start(*users):
        editors = [editor(server, user, "root.usda") for user in users]
        for one in editors:
            one.run(SETUP)
        return editors

    return start


def share(author, *others):
    revision = author.flush()
    for one in others:
        one.catch_up(revision)
        one.run("frame()")


def lock(one, name, locked):
    return one.run(f"result = state.set_layer_lock_state(layer({name!r}).identifier, {locked})\nerror = why()\nframe()")


def test_a_lock_of_somebody_else_is_not_ended(people):
    ada, bo, chief = people("ada", "bo", "chief")
    before = ada.flush()
    assert lock(ada, "a.usda", True) is True
    assert ada.flush() == before + 1, "the layer and the root's map are locked by one transaction"
    share(ada, bo, chief)
    for wanted in (False, True):
        assert lock(bo, "a.usda", wanted) is False
        assert "locked by ada" in bo.run("result = error")
        assert bo.run("result = [state.is_layer_locked(layer('a.usda').identifier), flags()]") == [True, {"a.usda": True}]
    bo.run("root = stage.GetRootLayer()\nsub = layer('a.usda').identifier")
    assert bo.run("result = layers.LayerUtils.set_layer_lock_status(root, sub, False)") is False
    assert bo.run("result = layers.LayerUtils.remove_layer_lock_status(root, sub)") is False
    assert bo.run("result = commands.execute('LockLayer', layer_identifier=sub, locked=False)[0]") is False
    assert bo.flush() == before + 1, "nothing was written"
    assert lock(chief, "a.usda", False) is True, "an administrator may"
    share(chief, ada, bo)
    for one in (ada, bo, chief):
        assert one.run("result = [state.is_layer_locked(layer('a.usda').identifier), flags()]") == [False, {"a.usda": False}]


def test_a_command_is_undone_only_while_the_lock_is_ones_own(people):
    ada, bo, chief = people("ada", "bo", "chief")
    ada.run("sub = layer('a.usda').identifier\n"
            "assert commands.execute('LockLayer', layer_identifier=sub, locked=True)[0]\nframe()")
    share(ada, bo, chief)
    assert lock(chief, "a.usda", False)
    share(chief, ada, bo)
    assert lock(bo, "a.usda", True)
    share(bo, ada, chief)
    ada.run("undo.undo()\nframe()")
    share(ada, bo)
    assert bo.run("result = [state.is_layer_locked(layer('a.usda').identifier), flags()]") == [True, {"a.usda": True}]


def test_of_two_who_lock_at_once_one_gets_all_of_it(people):
    ada, bo = people("ada", "bo")
    for one in (ada, bo):  # neither has received the other's lock
        one.run("asked = state.set_layer_lock_state(layer('a.usda').identifier, True)")
    share(ada, bo)
    share(bo, ada)
    for one in (ada, bo):
        assert one.run("frame()\nresult = [live.layer_states()['a.usda'].holder, flags()]") == ["ada", {"a.usda": True}]
    assert "EDITS_REFUSED" in bo.run("result = received")
    assert lock(bo, "a.usda", False) is False


def test_a_lock_without_a_holder_is_ended_by_anybody(people):
    """Kit's own scripts lock in this way."""
    ada, bo = people("ada", "bo")
    ada.run("layer('a.usda').customLayerData = {'omni_layer': {'locked': True}}\n"
            "layers.LayerUtils.set_layer_lock_status(stage.GetRootLayer(), layer('b.usda').identifier, True)\nframe()")
    share(ada, bo)
    for name in LAYERS:
        assert lock(bo, name, False) is True
    share(bo, ada)
    assert ada.run("result = [state.is_layer_locked(layer(name).identifier) for name in ('a.usda', 'b.usda')]") == [False] * 2


def test_a_root_that_accepts_no_edits_keeps_the_lock_whole(people):
    [ada] = people("ada")
    assert lock(ada, "a.usda", True)
    ada.run("stage.GetRootLayer().SetPermissionToEdit(False)")
    assert lock(ada, "a.usda", False) is False
    own = "layer('a.usda').customLayerData['omni_layer']['locked']"
    assert ada.run(f"result = [{own}, flags()]") == [True, {"a.usda": True}]


def test_a_save_skips_what_somebody_else_has_locked(people, project):
    ada, bo = people("ada", "bo")
    ada.run("mark('a.usda', 'of ada')")
    assert lock(ada, "a.usda", True)
    share(ada, bo)
    bo.run("assert mark('b.usda', 'of bo') and not mark('a.usda', 'of bo')\nframe()")
    share(bo, ada)
    done, text, saved = bo.run("result = save()")
    assert done and "a.usda" in text and "locked by ada" in text and saved == ["b.usda", "root.usda"]
    assert "of bo" in (project / "b.usda").read_text() and "of ada" not in (project / "a.usda").read_text()
    assert bo.run("result = context.has_pending_edit()"), "the skipped layer is still unsaved"
    # A layer that is named is not skipped.
    done, text, saved = bo.run("sub = layer('a.usda').identifier\n"
                               "result = list(asyncio.run(context.save_layers_async('', [sub])))")
    assert not done and "locked by ada" in text and saved == []
    assert ada.run("frame()\nresult = save()") == [True, "", ["a.usda"]]
    assert "of ada" in (project / "a.usda").read_text()


@pytest.mark.parametrize("seed", range(3))
def test_any_sequence_of_locks_edits_and_saves(seed, people, project):
    """Compares two people's locks and saves with a simple model: the holder and the unsaved text of each layer."""
    chosen = random.Random(seed)
    editors = dict(zip(("ada", "bo"), people("ada", "bo")))
    holder = dict.fromkeys(LAYERS)
    content, files = dict.fromkeys(LAYERS, ""), dict.fromkeys(LAYERS, "")
    for step in range(40):
        user, name = chosen.choice(sorted(editors)), chosen.choice(LAYERS)
        one, [other] = editors[user], [editors[other] for other in editors if other != user]
        is_foreign = holder[name] not in (None, user)
        action = chosen.choice(["lock", "unlock", "edit", "edit", "save"])
        where = f"seed {seed}, step {step}: {user} {action} {name}"
        if action in ("lock", "unlock"):
            assert lock(one, name, action == "lock") is not is_foreign, where
            if not is_foreign:
                holder[name] = user if action == "lock" else None
        elif action == "edit":
            text = f"step{step}."
            assert one.run(f"result = mark({name!r}, {text!r})\nframe()") is not is_foreign, where
            if not is_foreign:
                content[name] = text
        else:
            foreign = {layer for layer in LAYERS if holder[layer] not in (None, user)}
            done, text, saved = one.run("result = save()\nframe()")
            assert done and not foreign & set(saved), f"{where}: {text}"
            assert all(layer in saved or layer in text or files[layer] == content[layer] for layer in LAYERS), where
            files.update({layer: content[layer] for layer in LAYERS if layer not in foreign})
            for layer in LAYERS:
                assert files[layer] in (project / layer).read_text(), f"{where}: {layer}"
                assert content[layer] == files[layer] or content[layer] not in (project / layer).read_text(), where
        share(one, other)
        share(other, one)
        for each in editors.values():
            locked = each.run(f"result = [state.is_layer_locked(layer(name).identifier) for name in {LAYERS}]")
            marked = each.run(f"result = [flags().get(name, False) for name in {LAYERS}]")
            assert locked == marked == [holder[name] is not None for name in LAYERS], where
