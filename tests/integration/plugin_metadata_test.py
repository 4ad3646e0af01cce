"""V11: metadata of a studio's plug-in, where the server, the editors, both or some of them have the plug-in."""

import json

import pytest
from conftest import cat

ROOT = """#usda 1.0

def "A" (
    studioFlag = true
    studioNames = ["x", "y"]
    studioData = {
        int first = 1
    }
)
{
}
"""


@pytest.fixture
def plugin(tmp_path):
    """The folder of a plug-in that declares the fields."""
    fields = {"studioFlag": "bool", "studioNames": "string[]", "studioData": "dictionary", "studioNumber": "double"}
    (tmp_path / "plugInfo.json").write_text(json.dumps({"Plugins": [{
        "Name": "studio", "Type": "resource", "Root": ".", "LibraryPath": "", "ResourcePath": ".",
        "Info": {"SdfMetadata": {name: {"type": kind, "appliesTo": "prims"} for name, kind in fields.items()}}}]}))
    return tmp_path


@pytest.mark.parametrize("having", ["ada", "server", "server ada bo", "ada bo"])
def test_v11_metadata_has_the_types_of_the_readers_plugins(project, serve, editor, plugin, monkeypatch, having):
    def start(name, what, *arguments):
        with monkeypatch.context() as patch:
            if name in having.split():
                patch.setenv("PXR_PLUGINPATH_NAME", str(plugin))
            return what(*arguments)

    (project / "root.usda").write_text(ROOT)
    server = start("server", serve, project)
    people = {name: start(name, editor, server, name, "root.usda") for name in ("ada", "bo")}
    fields = ("a = layer('root.usda').GetPrimAtPath('/A')\n"
              "def held(name):\n"
              "    value = a.GetInfo(name)\n"
              "    return getattr(value, 'value', value)\n")

    for name, person in people.items():
        person.run(fields)
        if name in having.split():
            assert person.run("result = [held('studioFlag'), list(held('studioNames')), dict(held('studioData'))]") == [
                True, ["x", "y"], {"first": 1}]
            person.run(f"a.SetInfoDictionaryValue('studioData', '{name}', 1)")
            if name == "ada":
                person.run("a.SetInfo('studioFlag', False); a.SetInfo('studioNumber', 2.5)")
        else:
            # A tool without the plug-in can write it, too: as the text that it has.
            person.run(f"other = Sdf.Layer.CreateAnonymous('.usda')\n"
                       f"other.ImportFromString(layer('root.usda').ExportToString().replace("
                       f"'int first = 1', 'int first = 1; int {name} = 1'))\n"
                       f"layer('root.usda').TransferContent(other)")
    revision = max(person.flush() for person in people.values())
    for person in people.values():
        person.catch_up(revision)
    text = cat(server, "root.usda")
    for key in ("first", "ada", "bo"):
        assert f"int {key} = 1" in text, "the keys of both are kept"
    for name, person in people.items():
        assert person.text("root.usda") == text
        if name in having.split():
            assert person.run("result = sorted(held('studioData'))") == ["ada", "bo", "first"]
    if "ada" in having.split():
        assert "studioNumber = 2.5" in text
        if "bo" in having.split():
            assert people["bo"].run("result = held('studioNumber')") == 2.5
    people["ada"].run("live.save()\nassert live.wait(lambda: any(type(e).__name__ == 'Saved' for e in happened), 20)")
    assert (project / "root.usda").read_text() == text
