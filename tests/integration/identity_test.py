"""Whose server is this: another project at the address, a restored backup, a copy (ID1-ID4)."""

import shutil

import pytest
import usdlive
import wire
from conftest import cat, connect, wait
from pxr import Sdf


@pytest.fixture
def folders(tmp_path):
    """Two projects of the same name, with a layer of the same name."""
    made = []
    for name, letter in (("one", "A"), ("two", "B")):
        folder = tmp_path / name / "shot"
        folder.mkdir(parents=True)
        (folder / "shot.usda").write_text(f'#usda 1.0\n\ndef "Of{letter}"\n{{\n}}\n')
        made.append(folder)
    return made


def listen(live, *kinds):
    heard = []
    live.add_handler(lambda event: heard.append(event) if isinstance(event, kinds) else None)
    return heard


def serve_at(serve, folder, port):
    """Serves a folder at the address of another server, which has been stopped."""
    server = serve(folder)
    server.stop()
    server.port = port
    return server.start()


def prim(layer, name):
    Sdf.CreatePrimInLayer(layer, f"/{name}")


def regained(live, lost, layer="shot.usda"):
    """The lost work of a layer, as texts."""
    return [live.lost_work_as_layer(one.index, layer).ExportToString() for one in lost]


@pytest.fixture
def replaced(folders, serve):
    """An editor of A with an acknowledged and an unsent prim, while B is served at the address of A."""
    own = serve(folders[0])
    with connect(own, "ada") as live:
        layer = live.open_layer("shot.usda")
        prim(layer, "SavedInA")
        assert live.flush(10)
        said = listen(live, usdlive.events.ServerError)
        own.kill()
        prim(layer, "UnsentOfA")
        live.tick()
        other = serve_at(serve, folders[1], own.port)
        wait(lambda: live.other_history, live, timeout=20)
        yield live, layer, own, other, said
        live.close(timeout=0)


def test_id2_another_project_at_the_address_is_not_joined(replaced):
    live, layer, own, other, said = replaced
    found = live.other_history
    assert found.other_project and found.expected_project == found.found_project == "shot"
    assert len(found.expected_store) == len(found.found_store) == 32 and found.expected_store != found.found_store
    for word in ("another project", found.expected_store[:8], found.found_store[:8], "join_other_history"):
        assert word in str(found)
    assert not live.flush(2) and not live.connected and live.pending == 1
    assert [one.message for one in said] == [str(found)], "it is said once"
    with pytest.raises(usdlive.Error, match="another project"):
        live.save(timeout=0.5)
    text = layer.ExportToString()
    assert "SavedInA" in text and "UnsentOfA" in text and "OfB" not in text
    other.stop()
    own.start()
    assert live.flush(20) and live.other_history is None
    assert "UnsentOfA" in cat(own, "shot.usda")
    own.stop()
    other.start()
    assert "OfA" not in cat(other, "shot.usda")


def test_id4_the_person_joins_the_other_project(replaced):
    live, layer, _, other, _ = replaced
    lost = listen(live, usdlive.events.Lost)
    live.join_other_history()
    wait(lambda: "OfB" in layer.ExportToString(), live, timeout=20)
    assert live.connected and live.pending == 0 and live.other_history is None
    wait(lambda: len(lost) == 2, live)
    texts = regained(live, lost)
    assert any("UnsentOfA" in text for text in texts) and any("SavedInA" in text for text in texts)
    prim(layer, "NewInB")
    assert live.flush(10)
    assert layer.ExportToString() == cat(other, "shot.usda")
    with pytest.raises(usdlive.Error):
        live.join_other_history()  # there is no other one now


def test_id3_unsent_work_of_an_earlier_process_is_not_sent_to_another_project(folders, serve):
    own = serve(folders[0])
    live = connect(own, "ada")
    prim(live.open_layer("shot.usda"), "First")
    assert live.flush(10)
    own.kill()
    prim(live.open_layer("shot.usda"), "UnsentOfA")
    with pytest.warns(RuntimeWarning):
        live.close(timeout=0.1)
    other = serve_at(serve, folders[1], own.port)
    with connect(other, "ada") as live:
        [work] = live.unsent_work()
        assert work.about.other_project and "another project" in str(work)
        with pytest.raises(usdlive.Error, match="another project"):
            work.send()
        live.open_layer("shot.usda")
        assert "UnsentOfA" in work.as_layer("shot.usda").ExportToString()
    assert "OfA" not in cat(other, "shot.usda")
    other.stop()
    own.start()
    with connect(own, "ada") as live:
        [work] = live.unsent_work()
        assert not work.about.other_project
        assert work.send().committed == 1
    assert "UnsentOfA" in cat(own, "shot.usda")


def restore(server, folder, backup):
    server.stop()
    shutil.rmtree(folder / ".usdlive")
    shutil.copytree(backup, folder / ".usdlive")
    server.start()


def test_id4_a_restored_backup_destroys_nothing_that_editors_have(folders, serve, tmp_path):
    server = serve(folders[0])
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        layer, other = ada.open_layer("shot.usda"), bo.open_layer("shot.usda")
        prim(layer, "Old")
        assert ada.flush(10)
        server.stop()
        shutil.copytree(folders[0] / ".usdlive", tmp_path / "backup")
        server.start()
        prim(layer, "Newer")
        assert ada.flush(20)
        wait(lambda: "Newer" in other.ExportToString(), bo)
        lost = {live: listen(live, usdlive.events.Lost) for live in (ada, bo)}
        restore(server, folders[0], tmp_path / "backup")
        with connect(server, "cleo") as cleo:  # the epoch and the number of commits are those of before
            prim(cleo.open_layer("shot.usda"), "AfterRestore")
            assert cleo.flush(10)
        prim(layer, "ByAda")
        for live in (ada, bo):
            wait(lambda live=live: live.other_history, ada, bo, timeout=20)
            assert not live.other_history.other_project and "older one" in str(live.other_history)
            assert not live.connected
        assert "Newer" in layer.ExportToString() and "AfterRestore" not in layer.ExportToString()
        for live, shown in ((ada, layer), (bo, other)):
            live.join_other_history()
            wait(lambda shown=shown: "AfterRestore" in shown.ExportToString(), ada, bo, timeout=20)
            wait(lambda live=live: lost[live], live)
            [text] = regained(live, lost[live])
            assert "Newer" in text and "AfterRestore" not in text and "Old" not in text
        assert ada.flush(10)
        text = cat(server, "shot.usda")
        assert "ByAda" in text and "AfterRestore" in text and "Newer" not in text
        wait(lambda: layer.ExportToString() == other.ExportToString() == text, ada, bo)


def test_id2_a_backup_without_newer_commits_is_noticed_too(folders, serve, tmp_path):
    """The server's history ends before what the editor has received."""
    server = serve(folders[0])
    with connect(server, "ada") as live:
        layer = live.open_layer("shot.usda")
        server.stop()
        shutil.copytree(folders[0] / ".usdlive", tmp_path / "backup")
        server.start()
        prim(layer, "Newer")
        assert live.flush(20)
        restore(server, folders[0], tmp_path / "backup")
        wait(lambda: live.other_history, live, timeout=20)
        assert "Newer" in layer.ExportToString() and not live.connected


def test_id2_a_copy_continues_until_it_has_other_commits(folders, serve, tmp_path):
    """A copied folder has the identity and the history of its original."""
    own = serve(folders[0])
    with connect(own, "ada") as live:
        layer = live.open_layer("shot.usda")
        prim(layer, "Old")
        assert live.flush(10)
        own.stop()
        shutil.copytree(folders[0], tmp_path / "copy" / "shot")
        copy = serve_at(serve, tmp_path / "copy" / "shot", own.port)
        prim(layer, "InTheCopy")
        assert live.flush(20) and "InTheCopy" in cat(copy, "shot.usda")
        copy.stop()
        own.start()
        wait(lambda: live.other_history, live, timeout=20)
        assert not live.other_history.other_project
        assert "InTheCopy" not in cat(own, "shot.usda")


def test_id1_the_identity_stays_with_the_folder(folders, serve, tmp_path):
    server = serve(folders[0])

    def identity():
        with wire.Peer(server.url) as peer:
            return peer.welcome["store"]

    first = identity()
    server.stop()
    server.start()
    assert identity() == first
    server.stop()
    folders[0].rename(tmp_path / "renamed")
    server.folder = tmp_path / "renamed"
    server.start()
    assert identity() == first


def test_id5_a_client_id_without_its_secret_is_refused(folders, serve):
    """Everybody receives the ids of others in commits."""
    server = serve(folders[0])
    with connect(server, "ada") as ada:
        layer = ada.open_layer("shot.usda")
        disconnected = listen(ada, usdlive.events.Disconnected)
        with wire.Peer(server.url) as spy:
            prim(layer, "First")
            assert ada.flush(10)
            commit = spy.expect("Commit")
            while commit["client"] != ada.id:
                commit = spy.expect("Commit")
        for _ in range(3):
            with pytest.raises(wire.Broken, match="secret"):
                wire.Peer(server.url, client=ada.id)
        for number in range(10):
            layer.comment = f"edit {number}"
            assert ada.flush(10)
        assert not disconnected
        assert "edit 9" in cat(server, "shot.usda")


def test_id5_a_second_implementation_proves_its_id(folders, serve):
    server = serve(folders[0])
    secret = wire.new_secret()
    client = wire.client_of(secret)
    with wire.Peer(server.url, client=client, secret=secret) as first:
        with wire.Peer(server.url, client=client, secret=secret) as second:
            assert second.welcome["store"] == first.welcome["store"]
            with pytest.raises(Exception):  # the owner has replaced its own session
                first.expect("welcome")
