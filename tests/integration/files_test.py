"""Tests files that are changed behind the server, and layers that are muted for everybody, between processes."""

import stat
import time

from conftest import connect, refused, run, wait
from pxr import Sdf, Usd

from usdlive import events

SHOT = '#usda 1.0\n(\n    subLayers = [@./anim.usda@]\n)\n\ndef "World"\n{\n    double x = 0\n}\n'
ANIM = '#usda 1.0\n\ndef "World"\n{\n    double x = 5\n    double y = 5\n}\n'
CHANGED = '#usda 1.0\n\ndef "World"\n{\n    double x = 3\n    double z = 1\n}\n\ndef "New"\n{\n}\n'


class EventList(list):
    """Collects the events of one kind."""

    def __init__(self, live, kind):
        super().__init__()
        live.add_handler(lambda event: self.append(event) if isinstance(event, kind) else None)


def state(live, layer="shot.usda"):
    return live.layer_states().get(layer, events.LayerState(layer))


def test_a_file_changed_behind_the_server_is_seen_kept_and_taken(project, serve):
    file = project / "shot.usda"
    file.write_text(SHOT.replace("@./anim.usda@", ""))
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        layers = {live: live.open_layer("shot.usda") for live in (ada, bob)}
        layers[ada].GetAttributeAtPath("/World.x").default = 1.0
        assert ada.flush()
        wait(lambda: state(bob).dirty, bob)
        assert not state(bob).outdated and state(bob).owner and state(bob).writable

        file.write_text(CHANGED)
        begin = time.monotonic()
        wait(lambda: state(ada).outdated and state(bob).outdated, ada, bob)
        assert time.monotonic() - begin < 2.5
        assert run("ls", "-l", server.url) == "shot.usda  changed, outdated: its file was changed, open: ada bob\n"

        # The file that somebody has put there is not overwritten.
        saved = EventList(ada, events.Saved)
        ada.save()
        wait(lambda: saved, ada)
        assert [failure[:2] for failure in saved[0].failed] == [("shot.usda", "layerOutdated")]
        assert file.read_text() == CHANGED

        # It becomes a commit that everybody gets, in the name of the user who requested it.
        reloaded, committed = EventList(bob, events.Reloaded), EventList(ada, events.Committed)
        bob.reload()
        wait(lambda: reloaded and committed, ada, bob)
        assert reloaded[0].reloaded == ("shot.usda",) and not reloaded[0].failed
        assert committed[0].user == "bob"
        wait(lambda: not state(ada).outdated, ada)
        assert not state(ada).dirty
        wanted = Sdf.Layer.CreateAnonymous(".usda")
        wanted.ImportFromString(CHANGED)
        for live in (ada, bob):
            assert layers[live].ExportToString() == wanted.ExportToString()

        # Editing and saving continue, and our own save is not treated as somebody else's change.
        layers[ada].GetAttributeAtPath("/World.x").default = 9.0
        assert ada.flush()
        ada.save("shot.usda")
        wait(lambda: len(saved) == 2, ada)
        assert saved[1].saved == ("shot.usda",)
        time.sleep(2.5)
        ada.tick()
        assert not state(ada).outdated and not state(ada).dirty
        assert Sdf.Layer.OpenAsAnonymous(str(file)).GetAttributeAtPath("/World.x").default == 9.0


def test_a_save_can_be_forced_and_a_reload_asked_for_by_command(project, serve):
    file = project / "shot.usda"
    file.write_text(ANIM)
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        layer.GetAttributeAtPath("/World.x").default = 1.0
        assert ada.flush()
        file.write_text(CHANGED)
        assert "changed on the disk" in refused("save", server.url)
        assert run("save", "--force", server.url) == "saved shot.usda\n"
        assert Sdf.Layer.OpenAsAnonymous(str(file)).GetAttributeAtPath("/World.x").default == 1.0
        file.write_text(CHANGED)
        wait(lambda: state(ada).outdated, ada)
        assert run("reload", server.url) == "reloaded shot.usda\n"
        wait(lambda: layer.GetPrimAtPath("/New"), ada)
        assert run("reload", server.url) == "nothing to be reloaded\n"
        # A file that does not parse changes nothing.
        file.write_text("#usda 1.0\ndef nonsense {\n")
        wait(lambda: state(ada).outdated, ada)
        before = layer.ExportToString()
        assert "shot.usda cannot be read" in refused("reload", server.url)
        ada.tick()
        assert layer.ExportToString() == before and state(ada).outdated


def test_saves_that_are_asked_for_at_once_all_succeed(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    with connect(serve(project), "ada") as ada:
        layer = ada.open_layer("shot.usda")
        answers = []
        ada.add_handler(lambda e: answers.append(e) if isinstance(e, events.Saved) else None)
        for value in range(5):
            layer.comment = f"number {value}"
            for _ in range(3):
                ada.request_save("shot.usda")
        wait(lambda: len(answers) == 15, ada)
        assert [answer.failed for answer in answers] == [()] * 15
        assert "number 4" in (project / "shot.usda").read_text()


def test_a_file_changed_while_no_server_ran_is_seen(project, serve):
    file = project / "shot.usda"
    file.write_text(ANIM)
    server = serve(project)
    with connect(server, "ada") as ada:
        ada.open_layer("shot.usda")
        assert ada.flush()
    server.stop()
    file.write_text(CHANGED)
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        assert layer.GetAttributeAtPath("/World.x").default == 5.0, "the content is not the server's layer"
        wait(lambda: state(ada).outdated, ada)
        # Writing the same bytes again is no change, whoever does it.
        file.write_text(ANIM)
        wait(lambda: not state(ada).outdated, ada)


def test_a_file_without_write_permission_is_read_only_and_stays(project, serve):
    file = project / "shot.usda"
    file.write_text(ANIM)
    server = serve(project)
    with connect(server, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        file.chmod(stat.S_IRUSR)
        wait(lambda: not state(ada).writable, ada)
        layer.GetAttributeAtPath("/World.x").default = 1.0
        assert ada.flush()
        saved = EventList(ada, events.Saved)
        ada.save()
        wait(lambda: saved, ada)
        assert saved[0].failed[0][1] == "saveFailed" and file.read_text() == ANIM
        file.chmod(stat.S_IRUSR | stat.S_IWUSR)
        wait(lambda: state(ada).writable, ada)
        assert not state(ada).outdated
        ada.save()
        wait(lambda: len(saved) == 2, ada)
        assert saved[1].saved == ("shot.usda",)


def test_a_file_that_was_removed_is_written_again(project, serve):
    file = project / "shot.usda"
    file.write_text(ANIM)
    server = serve(project)
    with connect(server, "ada") as ada:
        ada.open_layer("shot.usda")
        file.unlink()
        wait(lambda: state(ada).dirty, ada)
        assert not state(ada).outdated
        assert run("save", server.url) == "saved shot.usda\n"
        assert Sdf.Layer.OpenAsAnonymous(str(file)).GetAttributeAtPath("/World.y").default == 5.0


def test_a_muted_layer_is_muted_on_every_stage(project, serve):
    (project / "shot.usda").write_text(SHOT)
    (project / "anim.usda").write_text(ANIM)
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        stages = {live: live.open_stage("shot.usda") for live in (ada, bob)}
        free = bob.open_stage("shot.usda", follow_muteness=False)
        attached = Usd.Stage.Open(str(project / "shot.usda"))
        with connect(server, "cy") as cy:
            cy.attach(attached, str(project))

            def shown(stage):
                attribute = stage.GetPrimAtPath("/World").GetAttribute("y")
                return attribute.Get() if attribute else None

            assert [shown(stage) for stage in (*stages.values(), attached)] == [5.0] * 3
            ada.mute("shot.usda", "anim.usda")
            wait(lambda: not any(map(shown, (*stages.values(), attached))), ada, bob, cy)
            wait(lambda: state(bob, "anim.usda").globally_muted, bob)
            assert shown(free) == 5.0, "the muted layer does not follow"
            assert bob.globally_muted("shot.usda") == ["anim.usda"]
            # The form is that of Kit.
            assert stages[bob].GetRootLayer().customLayerData["omni_layer"]["muteness"] == {"./anim.usda": True}

            # A muted layer stays live.
            stages[bob].GetRootLayer()
            bob.open_layer("anim.usda").GetAttributeAtPath("/World.y").default = 6.0
            assert bob.flush()
            assert run("unmute", f"{server.url}/shot.usda", "anim.usda") == \
                "anim.usda is no longer muted on the stages of shot.usda\n"
            wait(lambda: [shown(stage) for stage in (*stages.values(), attached)] == [6.0] * 3, ada, bob, cy)
        # An editor that joins later has the same mutes, also after they were saved.
        ada.mute("shot.usda", "anim.usda")
        assert ada.flush()
        ada.save()
        wait(lambda: not state(ada).dirty, ada)
    server.stop()
    server = serve(project)
    with connect(server, "dan") as dan:
        stage = dan.open_stage("shot.usda")
        assert not stage.GetPrimAtPath("/World").GetAttribute("y")
        assert dan.globally_muted("shot.usda") == ["anim.usda"]


def test_a_layer_that_the_editor_saves_itself_is_saved_by_the_server(project, serve):
    """Ctrl-S of most editors is `Usd.Stage.Save()`."""
    file = project / "shot.usda"
    file.write_text(SHOT.replace("@./anim.usda@", ""))
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bob") as bob:
        stage = Usd.Stage.Open(str(file))
        ada.attach(stage)
        layer = bob.open_layer("shot.usda")
        for number in (1.0, 2.0):
            layer.GetAttributeAtPath("/World.x").default = number
            assert bob.flush()  # ada's layer does not have it yet
            stage.GetPrimAtPath("/World").SetCustomDataByKey("note", number)
            saved = EventList(ada, events.Saved)
            stage.Save()
            wait(lambda: saved, ada)
            assert saved[0].saved == ("shot.usda",) and not saved[0].failed
            on_disk = Sdf.Layer.CreateAnonymous(".usda")
            assert on_disk.ImportFromString(file.read_text())
            assert on_disk.GetAttributeAtPath("/World.x").default == number
            assert on_disk.GetPrimAtPath("/World").customData["note"] == number
            wait(lambda: not state(ada).dirty and not state(ada).outdated, ada)

        # The server is requested to save right afterwards, within the same frame.
        stage.GetPrimAtPath("/World").SetCustomDataByKey("note", 3)
        stage.Save()
        saved = EventList(ada, events.Saved)
        ada.save()
        wait(lambda: len(saved) == 2, ada)
        assert not any(answer.failed for answer in saved), saved
        assert "int note = 3" in file.read_text()

        # Files that others changed behind the server are still not overwritten.
        wait(lambda: not state(ada).outdated, ada)
        layer.GetAttributeAtPath("/World.x").default = 7.0
        assert bob.flush()
        file.write_text(CHANGED)
        saved = EventList(ada, events.Saved)
        ada.save()
        wait(lambda: saved, ada)
        assert [failure[:2] for failure in saved[0].failed] == [("shot.usda", "layerOutdated")]
        del stage
