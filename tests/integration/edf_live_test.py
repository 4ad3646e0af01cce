"""Dynamic payloads in a served project: changed parameters reach every editor, and a failing provider only its own."""

from conftest import cat
from edf import PLUGINS, calls, parameters, plugin_path, prim, scene


def start(editor, server, user, monkeypatch, tmp_path, plugins):
    folder = tmp_path / user
    folder.mkdir()
    with monkeypatch.context() as patch:
        patch.setenv("PXR_PLUGINPATH_NAME", plugins)
        patch.setenv("EDF_TEST_LOG", str(folder / "calls"))
        person = editor(server, user, "root.usda")
    person.run("""
def names(path):
    return [child.GetName() for child in stage.GetPrimAtPath(path).GetAllChildren()]
def change(path, **args):
    for key, value in args.items():
        stage.GetPrimAtPath(path).SetMetadataByDictKey("EdfDataParameters", "providerArgs:" + key, value)
def errors():
    return [str(error) for error in stage.GetCompositionErrors()]
from pxr import Tf
resynced = []
def note(notice, sender):
    resynced.extend(str(path) for path in notice.GetResyncedPaths())
listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, note, stage)
""")
    return person


def shows(person, expression, value):
    """Checks that the stage shows the value soon: a tick does not wait for a provider."""
    person.run(f"live.wait(lambda: {expression} == {value!r}, 20)")
    assert person.run(f"result = {expression}") == value


def everybody(people):
    revision = max(person.flush() for person in people)
    for person in people:
        person.catch_up(revision)


def test_parameters_changed_by_one_reload_the_payload_of_all(project, serve, editor, monkeypatch, tmp_path):
    scene(project, prim("A", parameters("generator", size="2x1x1")),
          prim("B", parameters("test", behaviour="well", name="1")), name="root.usda")
    server = serve(project)
    ada, bo = people = [start(editor, server, user, monkeypatch, tmp_path, plugin_path()) for user in ("ada", "bo")]
    for person in people:
        assert person.run("result = [names('/A'), names('/B')]") == [["Item_0", "Item_1"], ["A"]]
    for user in ("ada", "bo"):
        assert calls(tmp_path / user) == ["read well 1"]

    bo.run("resynced.clear()")
    ada.run("change('/A', size='3x1x1', spacing='5')")
    everybody(people)
    for person in people:
        shows(person, "len(names('/A'))", 3)
    assert bo.run("result = sorted(set(resynced))") == ["/A"], "only the affected payload"
    assert bo.run("result = list(stage.GetPrimAtPath('/A/Item_1').GetAttribute('xformOp:translate').Get())") == [5, 0, 0]

    # Both at the same time, different arguments: both are kept.
    ada.run("change('/B', name='2')")
    bo.run("change('/A', size='4x1x1')")
    everybody(people)
    for person in people:
        shows(person, "[len(names('/A')), names('/B'), errors()]", [4, ["A"], []])
    for user in ("ada", "bo"):
        assert calls(tmp_path / user) == ["read well 2"], "one read for each set of arguments"
    text = cat(server, "root.usda")
    assert 'string size = "4x1x1"' in text and 'string name = "2"' in text and "Item_" not in text

    bo.run("resynced.clear()")
    ada.run("stage.GetPrimAtPath('/A').SetMetadata('comment', 'text')")
    everybody(people)
    assert bo.run("result = resynced") == []
    ada.run("stage.GetPrimAtPath('/A').ClearMetadata('EdfDataParameters')")
    everybody(people)
    shows(bo, "[names('/A'), errors()]", [[], []])


def test_a_providers_failure_on_one_machine_harms_nobody(project, serve, editor, monkeypatch, tmp_path):
    scene(project, prim("A", parameters("test", behaviour="well")), prim("C", asset=""), name="root.usda")
    server = serve(project)
    ada = start(editor, server, "ada", monkeypatch, tmp_path, plugin_path())
    bo = start(editor, server, "bo", monkeypatch, tmp_path, str(PLUGINS))  # without the provider
    zoe = start(editor, server, "zoe", monkeypatch, tmp_path, "")  # with what the package brings
    people = [ada, bo, zoe]
    assert ada.run("result = [names('/A'), errors()]") == [["A"], []]
    for person in (bo, zoe):
        [error] = person.run("result = errors()")
        assert "</A>" in error
    assert "no plug-in has the provider 'test'" in bo.log.read_text()

    # Everybody goes on editing, also the parameters of what one cannot show.
    zoe.run("stage.GetPrimAtPath('/C').CreateAttribute('x', Sdf.ValueTypeNames.Int).Set(7)")
    bo.run("change('/A', name='bo')")
    everybody(people)
    for person in people:
        assert person.run("result = stage.GetAttributeAtPath('/C.x').Get()") == 7
    shows(ada, "[names('/A'), errors()]", [["A"], []])

    ada.run("change('/A', behaviour='hangs')")
    everybody(people)
    assert ada.run("result = [names('/A'), len(errors())]") == [[], 1]
    assert "did not answer within 1500 ms" in ada.log.read_text()

    ada.run("stage.GetPrimAtPath('/A').SetMetadata('EdfDataParameters', {'dataProviderId': 'generator', "
            "'providerArgs': {'size': '2x1x1'}})")
    everybody(people)
    for person in (ada, bo):
        shows(person, "[len(names('/A')), errors()]", [2, []])  # recovers without a reload


def test_a_table_that_changes_in_the_project_is_read_again(project, serve, editor, monkeypatch, tmp_path):
    (project / "rows.csv").write_text("name,asset\nOne,./a.usda\n")
    (project / "a.usda").write_text('#usda 1.0\n(\n    defaultPrim = "A"\n)\ndef "A"\n{\n}\n')
    (project / "rows.edf").write_text("")
    scene(project, prim("A", parameters("table", table="./rows.csv"), asset="./rows.edf"), name="root.usda")
    server = serve(project)
    ada = start(editor, server, "ada", monkeypatch, tmp_path, plugin_path())
    assert ada.run("result = names('/A')") == ["One"]
    (project / "rows.csv").write_text("name,asset\nOne,./a.usda\nTwo,./a.usda\n")
    assert ada.run("result = live.wait(lambda: names('/A') == ['One', 'Two'], 20)")
