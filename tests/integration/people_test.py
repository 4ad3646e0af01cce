"""Tests locks, layer states and presence, between processes."""

import getpass
import json
import os
import subprocess
import time

import pytest
from conftest import connect, run, wait
from pxr import Gf, Sdf, Tf, Usd

import usdlive
from usdlive import events

ROOT = '#usda 1.0\n\ndef "World"\n{\n    double x = 0\n}\n'


either = pytest.mark.parametrize("backend", ["fast", "portable"])


@pytest.mark.parametrize("hers, his", [("fast", "fast"), ("fast", "portable"), ("portable", "fast")])
def test_a_lock_is_enforced_and_notified(project, serve, hers, his):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada", hers) as ada, connect(server, "bob", his) as bob:
        layers = {live: live.open_layer("shot.usda") for live in (ada, bob)}
        ada.lock("shot.usda")
        assert ada.flush()
        wait(lambda: bob.layer_states().get("shot.usda", events.LayerState("")).locked, bob, ada)
        state = bob.layer_states()["shot.usda"]
        assert (state.holder, state.dirty, state.editors) == ("ada", True, ("ada", "bob"))
        assert abs(state.locked_at - time.time()) < 60
        # The form is that of Kit.
        assert layers[bob].customLayerData["omni_layer"]["locked"] is True

        lost = []
        bob.add_handler(lambda event: lost.append(event) if isinstance(event, events.Lost) else None)
        attribute = layers[bob].GetAttributeAtPath("/World.x")
        assert not layers[bob].permissionToEdit and layers[ada].permissionToEdit
        with pytest.raises(Tf.ErrorException, match="not editable"):
            attribute.default = 7.0
        assert attribute.default == 0.0 and not lost
        saved = []
        bob.add_handler(lambda event: saved.append(event) if isinstance(event, events.Saved) else None)
        bob.save("shot.usda")
        wait(lambda: saved, bob, ada)
        assert saved[0].failed[0][1] == "locked" and "ada" in saved[0].failed[0][2]
        assert run("ls", "-l", server.url) == "shot.usda  changed, locked by ada, open: ada bob\n"

        layers[ada].GetAttributeAtPath("/World.x").default = 1.0
        ada.unlock("shot.usda")
        assert ada.flush()
        wait(lambda: attribute.default == 1.0 and layers[bob].permissionToEdit, bob)
        attribute.default = 2.0
        assert bob.flush()
        assert not lost

        # A client that has not received the lock yet is refused by the server.
        ada.lock("shot.usda")
        assert ada.flush()
        attribute.default = 7.0
        wait(lambda: lost, bob, ada)
        assert lost[0].code == "locked" and "ada" in lost[0].message and lost[0].refused
        assert attribute.default == 2.0 and not layers[bob].permissionToEdit
        kept = Usd.Stage.Open(layers[bob])
        bob.close_layer("shot.usda")
        assert not kept.GetRootLayer().permissionToEdit, "nobody would get an edit of a closed layer"


@either
def test_a_lock_leaves_the_permission_to_its_host_and_to_administrators(project, serve, backend):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project, "--admin", "eve")
    with connect(server, "ada") as ada, connect(server, "bob", backend) as bob, connect(server, "eve", backend) as eve:
        ada.open_layer("shot.usda")
        his, hers = bob.open_layer("shot.usda"), eve.open_layer("shot.usda")
        his.SetPermissionToEdit(False)  # set by his editor itself
        ada.lock("shot.usda")
        wait(lambda: all(one.layer_states().get("shot.usda", events.LayerState("")).locked
                         for one in (bob, eve)), ada, bob, eve)
        assert not his.permissionToEdit and hers.permissionToEdit
        hers.GetAttributeAtPath("/World.x").default = 3.0
        wait(lambda: his.GetAttributeAtPath("/World.x").default == 3.0, ada, bob, eve)
        ada.unlock("shot.usda")
        wait(lambda: not bob.layer_states()["shot.usda"].locked, ada, bob)
        bob.tick()
        assert not his.permissionToEdit
        # A client that joins while the layer is locked.
        ada.lock("shot.usda")
        assert ada.flush()
        with connect(server, "joe", backend) as joe:
            stage = Usd.Stage.Open(joe.open_layer("shot.usda"))
            wait(lambda: not stage.GetRootLayer().permissionToEdit, joe)


@either
def test_refusals_of_one_register_are_one_event_a_second(project, serve, backend):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob", backend) as bob:
        hers, his = ada.open_layer("shot.usda"), bob.open_layer("shot.usda")
        hers.customLayerData = {"omni_layer": {"specs_locking": {"/World.x": "ada"}}}
        wait(lambda: his.customLayerData, ada, bob)
        lost = []
        bob.add_handler(lambda event: lost.append(event) if isinstance(event, events.Lost) else None)
        writes = 60
        for frame in range(writes):
            his.GetAttributeAtPath("/World.x").default = 10.0 + frame
            assert bob.flush()
            assert his.GetAttributeAtPath("/World.x").default == 0.0
        wait(lambda: sum(event.count for event in lost) == writes, bob)
        assert lost[0].count == 1 and len(lost) < writes / 3
        assert all(event.code == "locked" for event in lost)
        assert [event.index for event in lost] == sorted(event.index for event in lost)
        newest = bob.lost_work_as_layer(lost[-1].index, "shot.usda")
        assert newest.GetAttributeAtPath("/World.x").default == 10.0 + writes - 1


@either
def test_locking_and_muting_twice_commits_nothing(project, serve, backend):
    (project / "shot.usda").write_text(ROOT)
    (project / "anim.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada", backend) as ada:
        ada.open_layer("shot.usda")

        def commits(change, *arguments):
            before = ada.revision
            change(*arguments)
            assert ada.flush()
            return ada.revision - before

        assert commits(ada.unlock, "shot.usda") == 0
        assert commits(ada.lock, "shot.usda") == 1
        assert commits(ada.lock, "shot.usda") == 0
        assert commits(ada.unlock, "shot.usda") == 1
        assert commits(ada.unlock, "shot.usda") == 0
        for change, wanted in ((ada.mute, 1), (ada.mute, 0), (ada.unmute, 1)):
            assert commits(change, "shot.usda", "anim.usda") == wanted
        run("lock", f"{server.url}/shot.usda")
        wait(lambda: ada.layer_states()["shot.usda"].locked, ada)
        revision = ada.revision
        run("lock", f"{server.url}/shot.usda")
        assert ada.flush() and ada.revision == revision


def test_a_lock_from_the_command_line(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    layer = f"{server.url}/shot.usda"
    with connect(server, "ada") as ada:
        ada.open_layer("shot.usda")
        assert run("lock", layer) == f"shot.usda is locked by {getpass.getuser()}\n"
        assert run("lock", layer) == f"shot.usda was already locked by {getpass.getuser()}\n"
        wait(lambda: ada.layer_states()["shot.usda"].locked, ada)
        assert ada.layer_states()["shot.usda"].holder == getpass.getuser()
        assert run("unlock", server.url, "shot.usda") == "shot.usda is unlocked\n"
        assert run("unlock", server.url, "shot.usda") == "shot.usda was not locked\n"
        wait(lambda: not ada.layer_states()["shot.usda"].locked, ada)
        ada.lock("shot.usda")
        assert ada.flush()
        for verb in ("lock", "unlock"):
            refused = subprocess.run([os.environ["USDLIVE_BIN"], verb, layer], capture_output=True, text=True)
            assert (refused.returncode, refused.stderr) == (1, "usdlive: shot.usda is locked by ada\n")
    missing = subprocess.run([os.environ["USDLIVE_BIN"], "lock", f"{server.url}/none.usda"],
                             capture_output=True, text=True)
    assert missing.returncode == 1 and "none.usda" in missing.stderr


@either
def test_the_layer_with_kits_map_of_locks_keeps_it(project, serve, backend):
    (project / "shot.usda").write_text(ROOT.replace("#usda 1.0\n", """#usda 1.0
(
    customLayerData = { dictionary omni_layer = { dictionary locked = { bool "./a.usda" = 1 } } }
)
"""))
    with connect(serve(project), "ada", backend) as ada:
        layer = ada.open_layer("shot.usda")
        with pytest.raises(usdlive.Error, match="cannot be locked"):
            ada.lock("shot.usda")
        assert layer.customLayerData["omni_layer"]["locked"] == {"./a.usda": True}
        with pytest.raises(usdlive.Error, match="not open"):
            ada.lock("other.usda")


@either
def test_a_lock_outlives_the_server_and_is_saved_with_the_layer(project, serve, backend):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada", backend) as ada, connect(server, "bob") as bob:
        ada.open_layer("shot.usda")
        layer = bob.open_layer("shot.usda")
        ada.lock("shot.usda")
        assert ada.flush()
        ada.save("shot.usda")
        assert ada.wait(lambda: not ada.layer_states()["shot.usda"].dirty)
        server.kill()
        server.start()
        wait(lambda: ada.connected and bob.connected, ada, bob, timeout=30)
        # A client that resumed still has it open.
        wait(lambda: bob.layer_states().get("shot.usda", events.LayerState("")).editors == ("ada", "bob"),
             ada, bob)
        lost = []
        bob.add_handler(lambda event: lost.append(event) if isinstance(event, events.Lost) else None)
        layer.GetAttributeAtPath("/World.x").default = 7.0
        wait(lambda: lost, bob, ada)
        assert lost[0].code == "locked"
    saved = Sdf.Layer.OpenAsAnonymous(str(project / "shot.usda"))
    assert saved.customLayerData["omni_layer"]["locked"] is True
    assert saved.customLayerData["omni_layer"]["locked_by"] == "ada"


def test_everybody_sees_where_the_others_are(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        camera = Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(1, 2, 3))
        ada.show_presence([Sdf.Path("/World")], camera, 24.0, "shot.usda", json.dumps({"tool": "move"}))
        wait(lambda: any(p.selection for p in bob.presences()), ada, bob)
        seen = bob.presences()[0]
        assert (seen.client, seen.user, seen.application) == (ada.id, "ada", "test")
        assert seen.selection == ("/World",) and seen.time == 24.0 and seen.edit_target == "shot.usda"
        assert Gf.Matrix4d(*seen.camera) == camera
        assert json.loads(seen.data) == {"tool": "move"}
        assert all(0 <= part <= 1 for part in seen.colour)
        assert run("who", server.url).splitlines() == sorted(
            ["ada  test  /World  in shot.usda  at 24", "bob  test"],
            key=lambda line: ada.id if line.startswith("ada") else bob.id)

        # A drag of the camera with 1,000 positions in a second: the number of messages is bounded, and the
        # last position arrives.
        changes = []
        bob.add_handler(lambda e: changes.append(e) if isinstance(e, events.PresenceChanged) else None)
        begin = time.monotonic()
        for frame in range(1000):
            ada.show_presence(time=float(frame))
            ada.tick()
            bob.tick()
            time.sleep(max(0, begin + frame / 1000 - time.monotonic()))
        seconds = time.monotonic() - begin
        wait(lambda: bob.presences()[0].time == 999.0, ada, bob)
        assert 5 <= len(changes) <= 22 * seconds + 5, (len(changes), seconds)

        # A client that hangs disappears within 3 s, and is back when it responds again.
        begin = time.monotonic()
        wait(lambda: not bob.presences(), bob)
        assert time.monotonic() - begin < 3.5
        wait(lambda: bob.presences(), ada, bob)
        ada.close()
        wait(lambda: not bob.presences(), bob, timeout=1)


def test_somebody_is_followed(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        seen = []
        stop = bob.follow("ada", seen.append)
        ada.show_presence(["/World"], camera=Gf.Matrix4d(2.0), time=1.0)
        wait(lambda: seen and seen[-1] is not None and seen[-1].time == 1.0, ada, bob)
        assert Gf.Matrix4d(*seen[-1].camera) == Gf.Matrix4d(2.0) and seen[-1].selection == ("/World",)
        late = []
        bob.follow("ada", late.append)()
        assert [presence.time for presence in late] == [1.0], "where she is now"
        stop()
        ada.show_presence(["/World.x"], time=2.0)
        wait(lambda: any(presence.time == 2.0 for presence in bob.presences()), ada, bob)
        assert seen[-1].time == 1.0 and len(late) == 1
        bob.follow("ada", late.append)
        ada.close()
        wait(lambda: late[-1] is None, bob, timeout=4)


def test_somebody_with_two_windows_is_followed_until_both_are_closed(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "bob") as bob:
        seen = []
        bob.follow("ada", lambda presence: seen.append(presence and presence.selection))
        one, two, three = windows = [connect(server, "ada") for _ in range(3)]

        def show(window, path):
            window.show_presence([path])
            wait(lambda: seen and seen[-1] == (path,), *windows, bob)

        for window, path in ((one, "/One"), (two, "/Two"), (three, "/Three"), (two, "/Two/A")):
            show(window, path)
        assert {presence.user for presence in bob.presences()} == {"ada"} and len(bob.presences()) == 3
        one.open_layer("shot.usda")
        two.open_layer("shot.usda")
        one.close()
        windows.remove(one)
        wait(lambda: len(bob.presences()) == 2, *windows, bob)
        assert seen[-1] == ("/Two/A",), "the window that closed was not the one that is followed"
        two.hide_presence()
        wait(lambda: len(bob.presences()) == 1, *windows, bob, timeout=4)
        assert seen[-1] == ("/Three",)
        assert bob.layer_states()["shot.usda"].editors == ("ada",), "a hidden window still has the layer open"
        show(two, "/Two/B")
        two.close()
        windows.remove(two)
        wait(lambda: seen[-1] == ("/Three",), *windows, bob, timeout=4)
        three.close()
        wait(lambda: seen[-1] is None, bob, timeout=4)
        assert seen.count(None) == 1


def test_both_backends_show_and_see_presence(project, serve):
    (project / "shot.usda").write_text(ROOT)
    server = serve(project)
    with connect(server, "ada", "portable") as ada, connect(server, "bob") as bob:
        seen: dict[str, list] = {"ada": [], "bob": []}
        happened = []
        ada.add_handler(happened.append)
        ends = [bob.follow("ada", seen["ada"].append), ada.follow("bob", seen["bob"].append)]
        for live in (ada, bob):
            live.show_presence([Sdf.Path("/World")], Gf.Matrix4d(2), 1.5, "shot.usda", '{"tool": "move"}')
        wait(lambda: all(found and found[-1].selection for found in seen.values()), ada, bob)
        for user, (live, other) in {"ada": (ada, bob), "bob": (bob, ada)}.items():
            [presence] = [one for one in other.presences() if one.user == user]
            assert presence == seen[user][-1] and presence.client == live.id
            assert (presence.selection, presence.camera[:2], presence.time, presence.edit_target, presence.data) == (
                ("/World",), (2, 0), 1.5, "shot.usda", '{"tool": "move"}')
        ada.show_presence(["/World", "/Other"])
        wait(lambda: seen["ada"][-1].selection == ("/World", "/Other"), ada, bob)
        with pytest.raises(usdlive.Error):
            ada.show_presence(camera=[1, 2])
        bob.close()
        wait(lambda: seen["bob"][-1] is None, ada)
        assert any(isinstance(event, events.PresenceChanged) and event.gone for event in happened)
        for end in ends:
            end()
